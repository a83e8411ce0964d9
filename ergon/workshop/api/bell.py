"""Struck objects from recordings of strokes, or from tables of resonances, as instruments."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from ergon.api.errors import OptionError
from ergon.common.option import Integer, documented, option
from ergon.common.report import Report
from ergon.common.sound_files import is_sound

if TYPE_CHECKING:
    from ergon.workshop.bells.bell import Bell

Form = Literal["modes", "cels", "chain"]
PLACE = "point"
_MODES_MAX = 500


@documented
@dataclass(frozen=True, slots=True, kw_only=True)
class BellOptions:
    """How many modes a bell keeps; by default all, up to 500."""

    modes: int | None = option(None, "Keep so many modes, the loudest.", Integer(1, _MODES_MAX))


def bell(
    strokes: str | Path | Sequence[str | Path] | Mapping[str, Sequence[str | Path]],
    options: BellOptions | None = None,
    *,
    report: Report | None = None,
) -> Bell:
    """The modes of a struck object, from recordings of strokes or a table of resonances.

    Recordings are WAV, FLAC or AIFF.

    `strokes` is a file, several files of one place from soft to hard, or a mapping from names of
    places to their files; all are of one object, heard from one point. A table is a single file.
    Raises NotAStrokeError, TableError and OptionError.
    """
    from ergon.notation.tables.shapes import NAME
    from ergon.workshop.bells import bell as bells
    from ergon.workshop.bells import resonances, stroke

    options, report = options or BellOptions(), report or Report()
    n_modes = _MODES_MAX if options.modes is None else options.modes
    if not 1 <= n_modes <= _MODES_MAX:
        raise OptionError("modes", f"is {n_modes}; it must be from 1 to {_MODES_MAX}")
    if isinstance(strokes, (str, Path)):
        strokes = [strokes]
    files_by_place = strokes if isinstance(strokes, Mapping) else {PLACE: strokes}
    placed_files = [
        (place, Path(file)) for place, place_files in files_by_place.items() for file in place_files
    ]
    if not placed_files:
        raise OptionError("strokes", "no file is given; give a recording of a stroke")
    for place in files_by_place:
        if not NAME.fullmatch(place) or place in ("all", "last", "centre", "mic"):
            message = f"names a place {place!r}; a name has letters, digits, '-' and '_', begins "
            message += "with a letter, and is not all, last, centre or mic"
            raise OptionError("strokes", message)
    table_files = [file for _, file in placed_files if not is_sound(file)]
    if table_files:
        if len(placed_files) > 1:
            message = (
                f"{table_files[0]} is not WAV, FLAC or AIFF, so it is read as a table of "
                "resonances; "
            )
            message += "use a table without other files"
            raise OptionError("strokes", message)
        return bells.bell_from_table(resonances.read(table_files[0]), n_modes)
    placed_strokes = [
        (place, stroke.stroke(str(file), *stroke.read(file, report)))
        for place, file in placed_files
    ]
    with report.waiting("looking for modes"):
        return bells.bell_from_strokes(placed_strokes, n_modes)
