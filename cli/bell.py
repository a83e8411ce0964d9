"""`ergon bell`: an instrument of a struck object, from recordings of strokes or a table."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from ergon.workshop.api.bell import PLACE, BellOptions
from ergon.workshop.api.bell import bell as find_bell

from . import options
from .console import Console, plural
from .tables import table
from .units import seconds_text

if TYPE_CHECKING:
    from ergon.workshop.bells.bell import Bell

_MODES_SHOWN_MAX = 40  # modes shown in the table


@click.command()
@click.argument("strokes", metavar="[PLACE=]STROKE...", nargs=-1, required=True)
@options.from_dataclass(BellOptions, "modes")
@click.option(
    "--as",
    "form",
    type=click.Choice(["modes", "cels", "chain"]),
    default="modes",
    show_default=True,
    help="One body of all modes; or a CEL for each; or a chain of masses.",
)
@options.target("Write the instrument into this file, for `use:` of a score.")
@options.force
@options.with_console
def bell(
    console: Console,
    strokes: tuple[str, ...],
    modes: int | None,
    form: str,
    output: str | None,
    force: bool,
) -> None:
    """Find the modes of a struck object, and write it as an instrument.

    A STROKE is a WAV, FLAC or AIFF file of one stroke that dies away. Several are of one object,
    heard from one point: soft to hard at one place, or at places that are named, rim=a.wav
    waist=b.wav.
    Instead of them one table of resonances is read, as ModRes writes and Modalys reads them.
    """
    from ergon.exchange.safe import check_target, write_text
    from ergon.workshop.bells.instrument import text

    files_by_place: dict[str, list[Path]] = {}
    for stroke in strokes:
        place, equals, file = stroke.partition("=")
        files_by_place.setdefault(place if equals else PLACE, []).append(
            Path(file if equals else stroke)
        )
    input_files = [file for place_files in files_by_place.values() for file in place_files]
    if output is not None:
        check_target(Path(output), force=force, inputs=input_files)
    bell_found = find_bell(files_by_place, BellOptions(modes=modes), report=console)
    bell_text = text(bell_found, form=form)
    if console.json:
        _records(console, bell_found)
    else:
        console.data(_bell_text(bell_found))
    if output is not None:
        write_text(output, bell_text, force=force, inputs=input_files)
        console.say(f"wrote {output}: `use: [{Path(output).name}]` has the instrument `bell`")


def _bell_text(bell: Bell) -> str:
    import numpy as np

    table_rows = [("", "frequency", "+-", "T60", "+-", *bell.places, "energy")]
    strongest_modes = np.argsort(-bell.energy)[:_MODES_SHOWN_MAX]
    for mode_index in sorted(strongest_modes):
        deviation = bell.deviation
        levels_db = 20.0 * np.log10(
            np.maximum(np.abs(bell.levels[mode_index] * bell.listening_levels[mode_index]), 1e-10)
        )
        table_rows.append(
            (
                str(mode_index + 1),
                f"{bell.f[mode_index]:.3f} Hz",
                ""
                if deviation is None
                else f"{1731.23 * deviation.frequencies[mode_index] / bell.f[mode_index]:.2g} "
                "cents",
                seconds_text(float(bell.t60[mode_index])),
                ""
                if deviation is None
                else f"{100.0 * _t60_deviation(bell, mode_index) / bell.t60[mode_index]:.2g} %",
                *(f"{level_db:.1f} dB" for level_db in levels_db),
                f"{100.0 * bell.energy[mode_index]:.2g} %",
            )
        )
    table_lines = table(table_rows, right=True).splitlines()
    if len(bell.f) > _MODES_SHOWN_MAX:
        table_lines.append(f"and {plural(len(bell.f) - _MODES_SHOWN_MAX, 'mode')} that are softer")
    for stroke in bell.strokes:
        residual_db = 10.0 * np.log10(max(1.0 - stroke.explained, 1e-12))
        contact = f", contact {1e3 * stroke.contact:.2g} ms" if stroke.contact else ""
        if (
            stroke.contact is None
            and sum(other_stroke.place == stroke.place for other_stroke in bell.strokes) > 1
        ):
            contact = ", contact time not measurable from these strokes"
        impulse = (
            f"impulse {stroke.impulse:.2g} of the hardest" if stroke.impulse != 1.0 else "hardest"
        )
        explained_text = (
            f"{100.0 * stroke.explained:.2f} % of the energy explained, {residual_db:.1f} dB left"
        )
        table_lines.append(f"{stroke.name} at {stroke.place}: {explained_text}; {impulse}{contact}")
    return "\n".join(line.rstrip() for line in table_lines) + "\n"


def _records(console: Console, bell: Bell) -> None:
    deviation = bell.deviation
    for mode_index in range(len(bell.f)):
        console.record(
            "mode",
            frequency_hz=float(bell.f[mode_index]),
            t60_s=float(bell.t60[mode_index]),
            levels={
                name: float(
                    bell.levels[mode_index, place_index] * bell.listening_levels[mode_index]
                )
                for place_index, name in enumerate(bell.places)
            },
            energy=float(bell.energy[mode_index]),
            frequency_deviation_hz=None
            if deviation is None
            else float(deviation.frequencies[mode_index]),
            t60_deviation_s=None if deviation is None else _t60_deviation(bell, mode_index),
        )
    for stroke in bell.strokes:
        console.record(
            "stroke",
            file=stroke.name,
            place=stroke.place,
            impulse=stroke.impulse,
            contact_s=stroke.contact,
            explained=stroke.explained,
        )


def _t60_deviation(bell: Bell, mode_index: int) -> float:
    """Standard deviation of T60 [s], from that of the decay."""
    assert bell.deviation is not None
    return float(bell.deviation.decays[mode_index] * bell.t60[mode_index] ** 2 / 6.907755278982137)
