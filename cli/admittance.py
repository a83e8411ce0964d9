"""`ergon admittance`: the velocity of points under a force, by its frequency."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import click

from ergon.api.admittance import N_FREQUENCIES_DEFAULT, Admittance, AdmittanceOptions
from ergon.api.admittance import admittance as find_admittance
from ergon.api.errors import OptionError

from . import options
from .console import Console, plural
from .outcome import Refused
from .tables import table as columns

_PEAKS_SHOWN_MAX = 12  # peaks in the terminal
_ARGUMENT_BY_OPTION = {"forced": "FROM", "observed": "TO"}


@click.command()
@options.score
@click.argument("forced", metavar="FROM")
@click.argument("observed", metavar="[TO]...", nargs=-1)
@click.option("--low", metavar="FREQUENCY", default="20Hz", show_default=True, help="The lowest.")
@click.option("--high", metavar="FREQUENCY", default="5kHz", show_default=True, help="The highest.")
@click.option(
    "--count",
    type=click.IntRange(2),
    default=N_FREQUENCIES_DEFAULT,
    show_default=True,
    help="How many.",
)
@click.option("--linear", is_flag=True, help="Frequencies even in Hz, not by logarithm.")
@click.option("--peaks", is_flag=True, help="Add the frequencies of the modes between.")
@click.option("--csv", "csv_target", metavar="FILE", help="Write all numbers into a CSV file.")
@click.option("--npz", metavar="FILE", help="Write all numbers as arrays into an npz file.")
@click.option("--svg", metavar="FILE", help="Draw the levels into an SVG picture.")
@options.force
@options.trust
@options.with_console
def admittance(
    console: Console,
    score_path: str,
    forced: str,
    observed: tuple[str, ...],
    csv_target: str | None,
    npz: str | None,
    svg: str | None,
    force: bool,
    **arguments: Any,
) -> None:
    """Say how fast points move for a force, by its frequency, in dB re 1 (m/s)/N.

    The force acts at FROM, a key or a mass such as bell.m or string.s.12; the velocity is that of
    each TO, without one that of FROM. Their parts are taken by themselves, with the links between
    them, contacts open and laws at their slope at rest.
    """
    try:
        admittance = find_admittance(
            score_path, forced, observed, AdmittanceOptions(**arguments), report=console
        )
    except OptionError as error:
        if error.option not in _ARGUMENT_BY_OPTION:
            raise
        raise Refused(f"{_ARGUMENT_BY_OPTION[error.option]}: {error.reason}") from None
    part_names = " + ".join(admittance.parts)
    if admittance.n_laws:
        laws_text = plural(admittance.n_laws, "link")
        console.warn(f"{part_names}: the law of {laws_text} was linearised at rest")
    if admittance.n_contacts:
        console.warn(f"{part_names}: {plural(admittance.n_contacts, 'contact')} counted as open")
    _write_files(console, admittance, csv_target, npz, svg, force)
    if console.json:
        _records(console, admittance)
    elif not (csv_target or npz or svg):
        console.data(
            "".join(_peaks_text(admittance, row) for row in range(len(admittance.observed)))
        )


def _write_files(
    console: Console,
    admittance: Admittance,
    csv_target: str | None,
    npz: str | None,
    svg: str | None,
    force: bool,
) -> None:
    import numpy as np

    from ergon.exchange.safe import file_group

    with file_group(force=force, inputs=admittance.inputs) as output_files:
        if csv_target is not None:
            csv_text = io.StringIO()
            csv.writer(csv_text, lineterminator="\n").writerows(_csv_rows(admittance))
            output_files.write(csv_target, csv_text.getvalue().encode())
        if npz is not None:
            np.savez(
                output_files.open(Path(npz), binary=True),
                frequency_hz=admittance.frequencies,
                admittance=admittance.values,
                forced=np.array(admittance.forced),
                heard=np.array(admittance.observed),
            )
        if svg is not None:
            output_files.write(svg, admittance.plot().svg.encode())
    for path in (csv_target, npz, svg):
        if path is not None:
            console.say(f"wrote {path}")


def _peaks_text(admittance: Admittance, point_index: int) -> str:
    """The highest peaks of a point, from the lowest frequency on."""
    from ergon.notation.tables.notes import nearest_note

    heading = f"velocity of {admittance.observed[point_index]} for a force at {admittance.forced}"
    frequencies = admittance.frequencies
    levels_db = admittance.decibels[point_index]
    phases = admittance.phases[point_index]
    all_peaks = admittance.peaks(point_index)
    peaks = sorted(all_peaks[:_PEAKS_SHOWN_MAX].tolist())
    range_text = f"{frequencies[0]:g} to {frequencies[-1]:g} Hz, {len(frequencies):,} frequencies"
    if not admittance.values[point_index].any():
        return f"{heading}: no force from there reaches this point, so it does not move\n"
    if not peaks:
        levels_text = (
            f"{levels_db[0]:.1f} dB at {frequencies[0]:g} Hz, {levels_db[-1]:.1f} dB at "
            f"{frequencies[-1]:g} Hz"
        )
        return f"{heading}: no peak from {range_text}: {levels_text}\n"
    peaks_text = (
        f"the highest {_PEAKS_SHOWN_MAX} of {len(all_peaks):,} peaks"
        if all_peaks[_PEAKS_SHOWN_MAX:].size
        else ""
    )
    table_rows = [("", "note", "cents", "frequency", "level", "phase")]
    for peak_number, frequency_index in enumerate(peaks, 1):
        note_name, cents = nearest_note(float(frequencies[frequency_index]))
        level = (
            "no bound"
            if math.isinf(levels_db[frequency_index])
            else f"{levels_db[frequency_index]:.1f} dB"
        )
        phase_text = (
            ""
            if math.isinf(levels_db[frequency_index])
            else f"{round(phases[frequency_index]):+d}°"
        )
        table_rows.append(
            (
                str(peak_number),
                note_name,
                f"{cents:+.1f}",
                f"{frequencies[frequency_index]:.2f} Hz",
                level,
                phase_text,
            )
        )
    return (
        f"{heading}: {peaks_text or 'peaks'} from {range_text}\n{columns(table_rows, right=True)}"
    )


def _records(console: Console, admittance: Admittance) -> None:
    for point_index, observed_name in enumerate(admittance.observed):
        levels = admittance.decibels[point_index].tolist()
        console.record(
            "admittance",
            forced=admittance.forced,
            heard=observed_name,
            parts=list(admittance.parts),
            frequency_hz=admittance.frequencies.tolist(),
            level_db=[None if math.isinf(level) else level for level in levels],
            phase_deg=[
                None if math.isnan(phase) else phase
                for phase in admittance.phases[point_index].tolist()
            ],
        )


def _csv_rows(admittance: Admittance) -> Iterator[Sequence[object]]:
    column_names = ["frequency_hz"]
    for name in admittance.observed:
        column_names += [f"{name} [dB]", f"{name} real", f"{name} imaginary"]
    yield column_names
    levels = admittance.decibels
    for frequency_index, frequency in enumerate(admittance.frequencies.tolist()):
        csv_row: list[object] = [repr(frequency)]
        for point_index in range(len(admittance.observed)):
            point_admittance = complex(admittance.values[point_index, frequency_index])
            csv_row += [
                f"{levels[point_index, frequency_index]:.6f}",
                repr(point_admittance.real),
                repr(point_admittance.imag),
            ]
        yield csv_row
