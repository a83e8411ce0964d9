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
from ergon.api.modes import ModesOptions, PartModes, mode_rows, mode_words, stave_picture
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
@options.declared(ModesOptions, "upto count around")
@click.option("--csv", "table", metavar="FILE", help="Write the table into a CSV file.")
@click.option("--svg", metavar="FILE", help="Draw modes by pitch and cents into an SVG picture.")
@click.option(
    "--shapes",
    is_flag=True,
    help="With --csv, --json or --svg: how each mass moves in each mode.",
)
@options.force
@options.trust
@options.speaking
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
    with file_group(force=force, inputs=inputs) as files:
        if table is not None:
            files.write(table, _csv(part_modes, shapes).encode())
        if svg is not None:
            name = Path(score_path).name
            picture = _shapes(part_modes, name) if shapes else stave_picture(part_modes, name).svg
            files.write(svg, picture.encode())
    for part in part_modes:
        if console.json:
            _records(console, part, shapes)
        else:
            _warn(console, part)
            if table is None and svg is None:
                console.data(_lines(part))
    for path in (table, svg):
        if path is not None:
            console.say(f"wrote {path}")


def _shapes(part_modes: Sequence[PartModes], name: str) -> str:
    import numpy as np

    from ergon.view.structure import Shape, shapes

    parts = []
    for part in part_modes:
        x, y = part.places[:, 0].tolist(), part.places[:, 1].tolist()
        drawn = []
        for shape, words in zip(part.shapes, mode_words(part), strict=True):
            # With uneven damping, masses do not swing in phase: this is the instant of most motion.
            turned = shape * np.exp(-0.5j * np.angle(np.sum(shape**2)))
            drawn.append(Shape(words, x, y, turned.real.tolist()))
        if part.masses:
            parts.append((part.part, drawn))
    return shapes(parts, title=f"Shapes of the modes of {name}")


def _warn(console: Console, part: PartModes) -> None:
    if part.n_laws:
        laws = plural(part.n_laws, "link")
        console.warn(f"{part.part}: the law of {laws} was linearised at rest")
    if part.n_contacts:
        console.warn(f"{part.part}: {plural(part.n_contacts, 'contact')} counted as open")
    if not part.is_certified:
        reason = "the search ended before all were known"
        console.warn(f"{part.part}: modes may be missing or listed twice: {reason}")


def _lines(part: PartModes) -> str:
    masses = "1 mass" if len(part.masses) == 1 else f"{len(part.masses):,} masses"
    heading = f"{part.part}: {plural(len(part.poles), 'mode')} of {masses}"
    if not len(part.poles):
        reason = "none of its modes is in this range" if part.masses else "nothing in it moves"
        return f"{part.part}: no modes: {reason}\n"
    return f"{heading}\n{columns(mode_rows(part), right=True)}"


def _records(console: Console, part: PartModes, shapes: bool) -> None:
    for i, (f, t60) in enumerate(zip(part.frequencies, part.t60, strict=True)):
        note, cents = part.notes[i]
        fields: dict[str, object] = {
            "part": part.part,
            "mode": i + 1,
            "note": note or None,
            "cents": cents if note else None,
            "frequency_hz": float(f),
            "t60_s": None if math.isinf(t60) else float(t60),
            "levels_db": {point: _finite(float(part.levels(point)[i])) for point in part.points},
        }
        if shapes:
            fields["masses"] = list(part.masses)
            fields["shape"] = [[float(x.real), float(x.imag)] for x in part.shapes[i]]
        console.record("mode", **fields)
    console.record(
        "modes",
        part=part.part,
        modes=len(part.poles),
        masses=len(part.masses),
        certified=part.is_certified,
        laws_at_rest=part.n_laws,
        open_contacts=part.n_contacts,
    )


def _finite(level: float) -> float | None:
    return None if math.isinf(level) else level


def _csv(part_modes: Sequence[PartModes], shapes: bool) -> str:
    out = io.StringIO()
    rows = csv.writer(out, lineterminator="\n")
    rows.writerows(_shape_rows(part_modes) if shapes else _mode_rows(part_modes))
    return out.getvalue()


def _mode_rows(part_modes: Sequence[PartModes]) -> Iterator[Sequence[object]]:
    points = list(dict.fromkeys(point for part in part_modes for point in part.points))
    header = ("part", "mode", "note", "cents", "frequency_hz", "t60_s")
    yield (*header, *(f"{point} [dB]" for point in points))
    for part in part_modes:
        levels = {point: part.levels(point) for point in part.points}
        for i, (f, t60) in enumerate(zip(part.frequencies, part.t60, strict=True)):
            note, cents = part.notes[i]
            level_texts = (f"{levels[point][i]:.3f}" if point in levels else "" for point in points)
            yield (
                part.part,
                i + 1,
                note,
                f"{cents:.6f}",
                repr(float(f)),
                repr(float(t60)),
                *level_texts,
            )


def _shape_rows(part_modes: Sequence[PartModes]) -> Iterator[Sequence[object]]:
    yield "part", "mode", "frequency_hz", "mass", "x_m", "y_m", "real", "imaginary"
    for part in part_modes:
        for i, f in enumerate(part.frequencies):
            for name, place, x in zip(part.masses, part.places, part.shapes[i], strict=True):
                place_texts = (repr(float(place[0])), repr(float(place[1])))
                moves = (repr(float(x.real)), repr(float(x.imag)))
                yield part.part, i + 1, repr(float(f)), name, *place_texts, *moves
