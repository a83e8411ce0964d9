"""`ergon tune`: values of an instrument that bring its modes to given frequencies."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from ergon.api.errors import OptionError
from ergon.api.tune import REACHED, Tuned, TuneOptions
from ergon.api.tune import tune as find_tuning
from ergon.common.shown_paths import is_from_pack

from . import options
from .console import Console, plural
from .outcome import Refused, check_stdout
from .tables import table

_ARGUMENTS = {"parts": "PART", "part": "PART", "targets": "TARGET"}


@click.command()
@options.score
@click.argument("part")
@click.argument("targets", metavar="TARGET...", nargs=-1, required=True)
@click.option(
    "--by",
    multiple=True,
    metavar="VALUE",
    help="Tune by these: masses, springs, pitches, a field (M) or a value (m1.M); repeatable.",
)
@click.option(
    "--base",
    metavar="FREQUENCY",
    help="The frequency of ratio 1, such as A3; without it the first mode stays.",
)
@click.option("--write", is_flag=True, help="Write the values into the score.")
@options.target("Write the score with the values into this file; - is stdout.")
@options.force
@options.trust
@options.speaking
def tune(
    console: Console,
    score_path: str,
    part: str,
    targets: tuple[str, ...],
    write: bool,
    output: str | None,
    force: bool,
    **given: Any,
) -> None:
    """Find values of an instrument or a key that bring its modes to given frequencies.

    TARGET is one list of ratios, such as 1:2.76:5.4, or a frequency or note for each mode from the
    lowest on, _ for one that is left alone, or MODE=FREQUENCY, such as 3=A5. Values change as
    little as can be, in proportion. They are printed; --write or -o put them into the score.
    """
    if write and output is not None:
        raise Refused("--write excludes -o; give one of the two")
    if write and is_from_pack(score_path):
        raise Refused("--write does not change a pack; -o writes the score, and `ergon unpack` all")
    check_stdout(output, is_json=console.json)
    try:
        found = find_tuning(
            score_path, part, _targets(targets), TuneOptions(**given), report=console
        )
    except OptionError as error:
        if error.option not in _ARGUMENTS:
            raise
        raise Refused(f"{_ARGUMENTS[error.option]}: {error.reason}") from None
    if console.json:
        _record(console, found)
    elif output != "-":
        console.data(_lines(found))
    if not found.is_reached:
        raise Refused(_unreached(found))
    if found.edited is None and not (write or output is not None):
        console.warn(f"--write would leave the score as it is: {found.trouble}")
    if write or output is not None:
        _write(console, score_path, found, output, force)


def _targets(words: tuple[str, ...]) -> Any:
    """The targets as `ergon.tune` takes them. Raises Refused."""
    if len(words) == 1 and ":" in words[0]:
        return words[0]
    if any(":" in word for word in words):
        raise Refused("TARGET: give one list of ratios, such as 1:2.76:5.4, or frequencies")
    if not any("=" in word for word in words):
        return list(words)
    found: dict[int, str] = {}
    for word in words:
        number, _, frequency = word.partition("=")
        if not number.isdecimal() or not frequency:
            raise Refused(f"TARGET: '{word}' is not MODE=FREQUENCY, such as 3=A5")
        if int(number) in found:
            raise Refused(f"TARGET: mode {int(number)} is given twice")
        found[int(number)] = frequency
    return found


def _lines(found: Tuned) -> str:
    modes = [("mode", "before", "target", "reached", "off")]
    for i, number in enumerate(found.modes):
        modes.append(
            (
                str(number),
                f"{found.before[i]:.3f} Hz",
                f"{found.targets[i]:.3f} Hz",
                f"{found.frequencies[i]:.3f} Hz",
                _cents(float(found.cents[i])),
            )
        )
    text = f"{found.part}: {plural(len(found.modes), 'mode')}\n{table(modes, right=True)}"
    if not found.values:
        return f"{text}no value changes\n"
    values = [("value", "now [SI]", "times", "to be written")]
    for value in found.values:
        times = f"{value.after / value.before:.6g}"
        values.append((value.name, f"{value.before:.6g}", times, value.text))
    return f"{text}\n{table(values)}"


def _cents(off: float) -> str:
    return "0 cents" if abs(off) <= REACHED else f"{off:+.4g} cents"


def _unreached(found: Tuned) -> str:
    """Which targets were not reached, and why."""
    off = found.cents
    worst = max(range(len(off)), key=lambda i: abs(off[i]))
    side = "above" if off[worst] > 0 else "below"
    by = f"{plural(len(found.values), 'value')} that may change"
    ways = "1 independent way" if found.rank == 1 else f"{found.rank} independent ways"
    return (
        f"the targets cannot be reached together: mode {found.modes[worst]} stays "
        f"{abs(off[worst]):.4g} cents {side} its target. The {by} move the "
        f"{plural(len(off), 'mode')} in {ways}; tune by other values, or fewer modes"
    )


def _write(
    console: Console, score_path: str, found: Tuned, output: str | None, force: bool
) -> None:
    from ergon.exchange.safe import write_text

    if found.edited is None:
        raise Refused(f"the score is left as it is: {found.trouble}")
    if output is not None:
        write_text(output, found.edited, force=force, inputs=found.inputs)
        if output != "-":
            console.say(f"wrote {output}")
        return
    if score_path == "-":
        raise Refused("--write needs a score in a file; write to stdout by -o -")
    # The composer asks for this, and the score stays the composer's own file.
    write_text(Path(score_path), found.edited, force=True, replaceable=False)
    console.say(f"wrote {plural(len(found.values), 'value')} into {score_path}")


def _record(console: Console, found: Tuned) -> None:
    for value in found.values:
        console.record(
            "value", name=value.name, before=value.before, after=value.after, text=value.text
        )
    console.record(
        "tuned",
        part=found.part,
        modes=list(found.modes),
        before_hz=found.before.tolist(),
        target_hz=found.targets.tolist(),
        frequency_hz=found.frequencies.tolist(),
        cents=found.cents.tolist(),
        reached=found.is_reached,
        rank=found.rank,
    )
