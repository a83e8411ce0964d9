"""Tables as text: a header, then rows of numbers, as programs and spreadsheets write them.

Between columns stand `,`, `;` or tabs. Cells may be quoted, and where the separator is no comma a
number may have a decimal comma.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator
from pathlib import Path
from typing import IO, NamedTuple

from ergon.scores.gesture.take_file import TakeError, lines

_SEPARATORS = ",;\t"
_QUOTED = re.compile(r'"[^"]*"')
_NUMBER = re.compile(r"[+-]?[0-9]*[.,]?[0-9]+([eE][+-]?[0-9]+)?|[+-]?(nan|inf)", re.IGNORECASE)


class Sheet(NamedTuple):
    """The names of the columns with the line they stand in, and the rows with theirs."""

    names: list[str]
    line: int
    rows: Iterator[tuple[int, list[str]]]


def sheet(file: IO[str], path: Path) -> Sheet:
    """The table in a text, row by row. Raises TakeError, here and in the rows."""
    numbered = lines(file, path)
    line, header = next(numbered, (1, ""))
    bare = _QUOTED.sub("", header)
    separator = next((candidate for candidate in _SEPARATORS if candidate in bare), ",")
    names = [name.strip() for name in _cells(header, separator, path, line)]
    if all(map(_NUMBER.fullmatch, names)):
        raise TakeError(
            "this line is numbers, but the first line of a table names its columns; write such a "
            "line above it: t [s],x [mm]",
            path,
            line,
        )
    return Sheet(names, line, _rows(numbered, len(names), separator, path))


def _rows(
    numbered: Iterator[tuple[int, str]], width: int, separator: str, path: Path
) -> Iterator[tuple[int, list[str]]]:
    for line, text in numbered:
        cells = _cells(text, separator, path, line)
        if len(cells) != width:
            raise TakeError(
                f"the number of values in this line is {len(cells)}, but "
                f"the file has {width} columns",
                path,
                line,
            )
        if separator != "," and "," in text:
            cells = [_with_point(cell) for cell in cells]
        yield line, cells


def _cells(text: str, separator: str, path: Path, line: int) -> list[str]:
    if '"' not in text:
        return text.split(separator)
    try:
        return next(csv.reader([text], delimiter=separator, strict=True))
    except csv.Error:
        raise TakeError("a quotation in this line is not closed", path, line) from None


def _with_point(cell: str) -> str:
    """A number with a decimal comma as one with a point; other cells as they are."""
    return cell.replace(",", ".") if cell.count(",") == 1 and "." not in cell else cell
