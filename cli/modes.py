"""`ergon modes`: pitch, decay and level of the modes of parts."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ergon.api.errors import OptionError
from ergon.api.modes import ModesOptions, PartModes, mode_labels, mode_rows, stave_picture
from ergon.api.modes import modes as find_modes

from . import options
from .console import Console, plural
from .outcome import Refused
from .tables import table as columns

if TYPE_CHECKING:
    pass


@click.command()
@options.score
@click.argument("parts", metavar="[PART]...", nargs=-1)
@options.from_dataclass(ModesOptions, "upto count around")
@click.option("--csv", "table", metavar="FILE", help="Write the table into a CSV file.")
@click.option("--svg", metavar="FILE", help="Draw modes by pitch and cents into an SVG picture.")
@click.option(
    "--shapes",
    is_flag=True,
    help="With --csv, --json or --svg: how each mass moves in each mode.",
)
@options.force
@options.trust
@options.with_console
def modes(
    console: Console,
    score_path: str,
    parts: tuple[str, ...],
    table: str | None,
    svg: str | None,
    shapes: bool,
    force: bool,
    **arguments: Any,
) -> None:
    """Say at which pitches instruments and keys vibrate, how long, and how much where.

    Each part is taken by itself, without its links to others, its contacts open and its laws at
    their slope at rest. Levels are in dB below the mode that moves most at that point: where the
    part is struck, touched by others and heard.
    """
    from ergon.exchange.safe import file_group

    if shapes and table is None and svg is None and not console.json:
        raise Refused("--shapes needs --csv, --json or --svg: shapes are many numbers, or pictures")
    try:
        part_modes = find_modes(score_path, ModesOptions(parts=parts, **arguments), report=console)
    except OptionError as error:
        if error.option != "parts":
            raise
        raise Refused(f"PART: {error.reason}") from None
    inputs = part_modes[0].inputs if part_modes else (Path(score_path),)
    with file_group(force=force, inputs=inputs) as output_files:
        if table is not None:
            output_files.write(table, _csv_text(part_modes, shapes).encode())
        if svg is not None:
            name = Path(score_path).name
            picture = (
                _shapes_picture(part_modes, name) if shapes else stave_picture(part_modes, name).svg
            )
            output_files.write(svg, picture.encode())
    for modes_of_part in part_modes:
        if console.json:
            _records(console, modes_of_part, shapes)
        else:
            _warn_of_approximations(console, modes_of_part)
            if table is None and svg is None:
                console.data(_modes_text(modes_of_part))
    for path in (table, svg):
        if path is not None:
            console.say(f"wrote {path}")


def _shapes_picture(part_modes: Sequence[PartModes], score_name: str) -> str:
    import numpy as np

    from ergon.view.structure import Shape, shapes

    shape_tables = []
    for modes_of_part in part_modes:
        x_places = modes_of_part.places[:, 0].tolist()
        y_places = modes_of_part.places[:, 1].tolist()
        drawn_shapes = []
        for shape, label in zip(modes_of_part.shapes, mode_labels(modes_of_part), strict=True):
            # With uneven damping, masses do not swing in phase: this is the instant of most motion.
            rotated_shape = shape * np.exp(-0.5j * np.angle(np.sum(shape**2)))
            drawn_shapes.append(Shape(label, x_places, y_places, rotated_shape.real.tolist()))
        if modes_of_part.masses:
            shape_tables.append((modes_of_part.part, drawn_shapes))
    return shapes(shape_tables, title=f"Shapes of the modes of {score_name}")


def _warn_of_approximations(console: Console, modes_of_part: PartModes) -> None:
    if modes_of_part.n_laws:
        laws = plural(modes_of_part.n_laws, "link")
        console.warn(f"{modes_of_part.part}: the law of {laws} was linearised at rest")
    if modes_of_part.n_contacts:
        console.warn(
            f"{modes_of_part.part}: {plural(modes_of_part.n_contacts, 'contact')} counted as open"
        )
    if not modes_of_part.is_certified:
        reason = "the search ended before all were known"
        console.warn(f"{modes_of_part.part}: modes may be missing or listed twice: {reason}")


def _modes_text(modes_of_part: PartModes) -> str:
    masses = "1 mass" if len(modes_of_part.masses) == 1 else f"{len(modes_of_part.masses):,} masses"
    heading = f"{modes_of_part.part}: {plural(len(modes_of_part.poles), 'mode')} of {masses}"
    if not len(modes_of_part.poles):
        missing_reason = (
            "none of its modes is in this range" if modes_of_part.masses else "nothing in it moves"
        )
        return f"{modes_of_part.part}: no modes: {missing_reason}\n"
    return f"{heading}\n{columns(mode_rows(modes_of_part), right=True)}"


def _records(console: Console, modes_of_part: PartModes, shapes: bool) -> None:
    for mode_index, (frequency, t60) in enumerate(
        zip(modes_of_part.frequencies, modes_of_part.t60, strict=True)
    ):
        note_name, cents = modes_of_part.notes[mode_index]
        record_fields: dict[str, object] = {
            "part": modes_of_part.part,
            "mode": mode_index + 1,
            "note": note_name or None,
            "cents": cents if note_name else None,
            "frequency_hz": float(frequency),
            "t60_s": None if math.isinf(t60) else float(t60),
            "levels_db": {
                point: _finite(float(modes_of_part.levels(point)[mode_index]))
                for point in modes_of_part.points
            },
        }
        if shapes:
            record_fields["masses"] = list(modes_of_part.masses)
            record_fields["shape"] = [
                [float(displacement.real), float(displacement.imag)]
                for displacement in modes_of_part.shapes[mode_index]
            ]
        console.record("mode", **record_fields)
    console.record(
        "modes",
        part=modes_of_part.part,
        modes=len(modes_of_part.poles),
        masses=len(modes_of_part.masses),
        certified=modes_of_part.is_certified,
        laws_at_rest=modes_of_part.n_laws,
        open_contacts=modes_of_part.n_contacts,
    )


def _finite(level: float) -> float | None:
    return None if math.isinf(level) else level


def _csv_text(part_modes: Sequence[PartModes], shapes: bool) -> str:
    csv_text = io.StringIO()
    csv_writer = csv.writer(csv_text, lineterminator="\n")
    csv_writer.writerows(_shape_rows(part_modes) if shapes else _mode_rows(part_modes))
    return csv_text.getvalue()


def _mode_rows(part_modes: Sequence[PartModes]) -> Iterator[Sequence[object]]:
    point_names = list(dict.fromkeys(point for part in part_modes for point in part.points))
    first_columns = ("part", "mode", "note", "cents", "frequency_hz", "t60_s")
    yield (*first_columns, *(f"{point} [dB]" for point in point_names))
    for modes_of_part in part_modes:
        levels = {point: modes_of_part.levels(point) for point in modes_of_part.points}
        for mode_index, (frequency, t60) in enumerate(
            zip(modes_of_part.frequencies, modes_of_part.t60, strict=True)
        ):
            note_name, cents = modes_of_part.notes[mode_index]
            level_texts = (
                f"{levels[point][mode_index]:.3f}" if point in levels else ""
                for point in point_names
            )
            yield (
                modes_of_part.part,
                mode_index + 1,
                note_name,
                f"{cents:.6f}",
                repr(float(frequency)),
                repr(float(t60)),
                *level_texts,
            )


def _shape_rows(part_modes: Sequence[PartModes]) -> Iterator[Sequence[object]]:
    yield "part", "mode", "frequency_hz", "mass", "x_m", "y_m", "real", "imaginary"
    for modes_of_part in part_modes:
        for mode_index, frequency in enumerate(modes_of_part.frequencies):
            for mass_name, mass_place, displacement in zip(
                modes_of_part.masses,
                modes_of_part.places,
                modes_of_part.shapes[mode_index],
                strict=True,
            ):
                place_texts = (repr(float(mass_place[0])), repr(float(mass_place[1])))
                displacement_texts = (
                    repr(float(displacement.real)),
                    repr(float(displacement.imag)),
                )
                yield (
                    modes_of_part.part,
                    mode_index + 1,
                    repr(float(frequency)),
                    mass_name,
                    *place_texts,
                    *displacement_texts,
                )
