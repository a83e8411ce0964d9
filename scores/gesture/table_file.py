"""Tables as text: a header, then rows of numbers, as programs and spreadsheets write them.

The separator is `,`, `;` or a tab; a line `sep=;` before the header says which. Cells may be
quoted, and a number may have a decimal comma where that divides no columns. Units stand behind the
names, `x [mm]` or `x (mm)`, or in a row of their own below the names.
"""

from __future__ import annotations

import csv
import itertools
import re
from collections.abc import Iterator
from pathlib import Path
from typing import IO, NamedTuple

from ergon.scores.gesture.points import UNITS_PER_METRE, UNITS_PER_SECOND
from ergon.scores.gesture.take_file import TakeError, content_lines

_SEPARATORS = ";,\t"
_QUOTED_PATTERN = re.compile(r'"[^"]*"')
_STATED_SEPARATOR_PATTERN = re.compile(r'"?sep=(.)"?[,;\t]*', re.IGNORECASE)
_NUMBER_PATTERN = re.compile(
    r"[+-]?[0-9]*[.,]?[0-9]+([eE][+-]?[0-9]+)?|[+-]?(nan|inf)", re.IGNORECASE
)
_NAME_WITH_UNIT_PATTERN = re.compile(r"(.*\S)\s*(?:\((.*)\)|\[(.*)\])")
_THOUSANDS_PATTERN = re.compile(r"[+-]?[1-9][0-9]{0,2},[0-9]{3}")
_UNITS = {unit for unit in (*UNITS_PER_METRE, *UNITS_PER_SECOND) if unit}


class Sheet(NamedTuple):
    """The names of the columns, as `t [s]` and `x [mm]`, with the line they stand in, and the rows
    with theirs.
    """

    names: list[str]
    line: int
    rows: Iterator[tuple[int, list[str]]]


def read_sheet(file: IO[str], path: Path) -> Sheet:
    """Read the table in a text, row by row. Raises TakeError, here and in the rows."""
    numbered_lines = content_lines(file, path)
    header_number, header = next(numbered_lines, (1, ""))
    separator = None
    if stated_separator := _STATED_SEPARATOR_PATTERN.fullmatch(header):
        separator = stated_separator[1]
        header_number, header = next(numbered_lines, (header_number, ""))
    separator = separator or _separator(header)
    column_names = [name.strip() for name in _split_cells(header, separator, path, header_number)]
    while len(column_names) > 1 and not column_names[-1]:
        column_names.pop()  # each line ends with a separator
    if all(map(_NUMBER_PATTERN.fullmatch, column_names)):
        raise TakeError(
            "this line is numbers, but the first line of a table names its columns; write such a "
            "line above it: t [s],x [mm]",
            path,
            header_number,
        )
    table_rows = _rows(numbered_lines, len(column_names), separator, path)
    first_row = next(table_rows, None)
    if first_row is not None and (units := _units_of_row(column_names, first_row[1])) is not None:
        pairs = zip(column_names, units, strict=True)
        column_names = [f"{name} [{unit}]" if unit else name for name, unit in pairs]
        first_row = None
    return Sheet(
        _names_with_units(column_names),
        header_number,
        table_rows if first_row is None else itertools.chain([first_row], table_rows),
    )


def _separator(header: str) -> str:
    """The separator between the columns of a header."""
    unquoted_header = _QUOTED_PATTERN.sub("", header)
    return next((candidate for candidate in _SEPARATORS if candidate in unquoted_header), ",")


def _units_of_row(column_names: list[str], cells: list[str]) -> list[str] | None:
    """The units of a row that has nothing else, below names without units."""
    units = [cell.strip().strip("[]()") for cell in cells]
    is_unit_row = any(units) and all(unit in _UNITS for unit in units if unit)
    return (
        units
        if is_unit_row and not any(map(_NAME_WITH_UNIT_PATTERN.fullmatch, column_names))
        else None
    )


def _names_with_units(column_names: list[str]) -> list[str]:
    """The names with their units in brackets, and `t` for a column that is called time."""
    names_and_units = []
    for name in column_names:
        unit_match = _NAME_WITH_UNIT_PATTERN.fullmatch(name)
        name_text, unit_text = name, None
        if unit_match and (unit_match[2] is None or unit_match[2].strip() in _UNITS):
            name_text, unit_text = unit_match[1], (unit_match[2] or unit_match[3] or "").strip()
        names_and_units.append((name_text, unit_text))
    lower_names = [word.casefold() for word, _ in names_and_units]
    if "t" not in [word for word, _ in names_and_units]:
        time_columns = [i for i, word in enumerate(lower_names) if word in ("t", "time")]
        if len(time_columns) == 1:
            names_and_units[time_columns[0]] = ("t", names_and_units[time_columns[0]][1])
    return [word if unit is None else f"{word} [{unit}]" for word, unit in names_and_units]


def _rows(
    numbered_lines: Iterator[tuple[int, str]], n_columns: int, separator: str, path: Path
) -> Iterator[tuple[int, list[str]]]:
    for line_number, line_text in numbered_lines:
        line_cells = _split_cells(line_text, separator, path, line_number)
        if len(line_cells) > n_columns and not any(cell.strip() for cell in line_cells[n_columns:]):
            del line_cells[n_columns:]
        if not any(cell.strip() for cell in line_cells):
            continue  # a row that is empty but for its separators
        if len(line_cells) != n_columns:
            raise TakeError(
                f"the number of values in this line is {len(line_cells)}, but "
                f"the file has {n_columns} columns",
                path,
                line_number,
            )
        if "," in line_text and (separator != "," or '"' in line_text):
            line_cells = [
                _with_decimal_point(cell, separator, path, line_number) for cell in line_cells
            ]
        yield line_number, line_cells


def _split_cells(line_text: str, separator: str, path: Path, line_number: int) -> list[str]:
    if '"' not in line_text:
        return line_text.split(separator)
    try:
        return next(csv.reader([line_text], delimiter=separator, strict=True))
    except csv.Error:
        raise TakeError("a quotation in this line is not closed", path, line_number) from None


def _with_decimal_point(cell_text: str, separator: str, path: Path, line_number: int) -> str:
    """A number with a decimal comma as one with a point; other cells as they are."""
    if cell_text.count(",") != 1 or "." in cell_text:
        return cell_text
    if separator == "," and _THOUSANDS_PATTERN.fullmatch(cell_text.strip()):
        message = (
            f"the comma in '{cell_text.strip()}' may divide thousands or be a decimal comma; write "
            "a point, or no comma"
        )
        raise TakeError(message, path, line_number)
    return cell_text.replace(",", ".")
