"""`ergon tune`: values of an instrument that bring its modes to given frequencies."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from ergon.api.errors import OptionError
from ergon.api.tune import REACHED_CENTS, Tuned, TuneOptions
from ergon.api.tune import tune as find_tuning
from ergon.common.shown_paths import is_from_pack

from . import options
from .console import Console, plural
from .outcome import Refused, check_stdout
from .tables import table

_ARGUMENT_BY_OPTION = {"parts": "PART", "part": "PART", "targets": "TARGET"}


@click.command()
@options.score
@click.argument("part")
@click.argument("targets", metavar="TARGET...", nargs=-1, required=True)
@options.from_dataclass(TuneOptions, "by base")
@click.option("--write", is_flag=True, help="Write the values into the score.")
@options.target("Write the score with the values into this file; - is stdout.")
@options.force
@options.trust
@options.with_console
def tune(
    console: Console,
    score_path: str,
    part: str,
    targets: tuple[str, ...],
    write: bool,
    output: str | None,
    force: bool,
    **arguments: Any,
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
        tuning = find_tuning(
            score_path, part, _targets(targets), TuneOptions(**arguments), report=console
        )
    except OptionError as error:
        if error.option not in _ARGUMENT_BY_OPTION:
            raise
        raise Refused(f"{_ARGUMENT_BY_OPTION[error.option]}: {error.reason}") from None
    if console.json:
        _record(console, tuning)
    elif output != "-":
        console.data(_tuning_text(tuning))
    if not tuning.is_reached:
        raise Refused(_unreached_text(tuning))
    if tuning.edited is None and not (write or output is not None):
        console.warn(f"--write would leave the score as it is: {tuning.trouble}")
    if write or output is not None:
        _write(console, score_path, tuning, output, force)


def _targets(target_words: tuple[str, ...]) -> Any:
    """The targets as `ergon.tune` takes them. Raises Refused."""
    if len(target_words) == 1 and ":" in target_words[0]:
        return target_words[0]
    if any(":" in word for word in target_words):
        raise Refused("TARGET: give one list of ratios, such as 1:2.76:5.4, or frequencies")
    if not any("=" in word for word in target_words):
        return list(target_words)
    target_texts: dict[int, str] = {}
    for target_word in target_words:
        mode_text, _, frequency = target_word.partition("=")
        if not mode_text.isdecimal() or not frequency:
            raise Refused(f"TARGET: '{target_word}' is not MODE=FREQUENCY, such as 3=A5")
        if int(mode_text) in target_texts:
            raise Refused(f"TARGET: mode {int(mode_text)} is given twice")
        target_texts[int(mode_text)] = frequency
    return target_texts


def _tuning_text(tuned: Tuned) -> str:
    mode_rows = [("mode", "before", "target", "reached", "off")]
    for mode_index, mode_number in enumerate(tuned.modes):
        mode_rows.append(
            (
                str(mode_number),
                f"{tuned.before[mode_index]:.3f} Hz",
                f"{tuned.targets[mode_index]:.3f} Hz",
                f"{tuned.frequencies[mode_index]:.3f} Hz",
                _cents_text(float(tuned.cents[mode_index])),
            )
        )
    tuned_text = f"{tuned.part}: {plural(len(tuned.modes), 'mode')}\n{table(mode_rows, right=True)}"
    if not tuned.values:
        return f"{tuned_text}no value changes\n"
    value_rows = [("value", "now [SI]", "times", "to be written")]
    for value in tuned.values:
        times = f"{value.after / value.before:.6g}"
        value_rows.append((value.name, f"{value.before:.6g}", times, value.text))
    return f"{tuned_text}\n{table(value_rows)}"


def _cents_text(cents: float) -> str:
    return "0 cents" if abs(cents) <= REACHED_CENTS else f"{cents:+.4g} cents"


def _unreached_text(tuned: Tuned) -> str:
    """Which targets were not reached, and why."""
    cents_off = tuned.cents
    worst_index = max(range(len(cents_off)), key=lambda i: abs(cents_off[i]))
    side = "above" if cents_off[worst_index] > 0 else "below"
    value_count = f"{plural(len(tuned.values), 'value')} that may change"
    independent_ways = "1 independent way" if tuned.rank == 1 else f"{tuned.rank} independent ways"
    return (
        f"the targets cannot be reached together: mode {tuned.modes[worst_index]} stays "
        f"{abs(cents_off[worst_index]):.4g} cents {side} its target. The {value_count} move the "
        f"{plural(len(cents_off), 'mode')} in {independent_ways}; tune by other values, or fewer "
        "modes"
    )


def _write(
    console: Console, score_path: str, tuned: Tuned, output_path: str | None, force: bool
) -> None:
    from ergon.exchange.safe import write_text

    if tuned.edited is None:
        raise Refused(f"the score is left as it is: {tuned.trouble}")
    if output_path is not None:
        write_text(output_path, tuned.edited, force=force, inputs=tuned.inputs)
        if output_path != "-":
            console.say(f"wrote {output_path}")
        return
    if score_path == "-":
        raise Refused("--write needs a score in a file; write to stdout by -o -")
    # The composer asks for this, and the score stays the composer's own file.
    write_text(Path(score_path), tuned.edited, force=True, replaceable=False)
    console.say(f"wrote {plural(len(tuned.values), 'value')} into {score_path}")


def _record(console: Console, tuned: Tuned) -> None:
    for value in tuned.values:
        console.record(
            "value", name=value.name, before=value.before, after=value.after, text=value.text
        )
    console.record(
        "tuned",
        part=tuned.part,
        modes=list(tuned.modes),
        before_hz=tuned.before.tolist(),
        target_hz=tuned.targets.tolist(),
        frequency_hz=tuned.frequencies.tolist(),
        cents=tuned.cents.tolist(),
        reached=tuned.is_reached,
        rank=tuned.rank,
    )
