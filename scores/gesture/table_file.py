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
_STATED_SEPARATOR = re.compile(r'"?sep=(.)"?[,;\t]*', re.IGNORECASE)
# What no name is: digits with a sign of either kind and with any mark between them.
_VALUE_PATTERN = re.compile(
    r"[+\-\u2212\u2013]?[0-9.,'\s]*[0-9][0-9.,'\s]*([eEdD][+\-\u2212]?[0-9]+)?|[+-]?(nan|inf)",
    re.IGNORECASE,
)
_EMPTY_WORDS = ("", "na", "n/a", "#n/a", "null", "none", "nan", "-", "--")  # of a missing value
_NAME_WITH_UNIT_PATTERN = re.compile(r"(.*\S)\s*(?:\((.*)\)|\[(.*)\])")
_THOUSANDS_PATTERN = re.compile(r"[+-]?[1-9][0-9]{0,2}[.,][0-9]{3}")
_DECIMAL_PATTERN = re.compile(r"[+-]?[0-9]*[.,][0-9]*([eE][+-]?[0-9]+)?")
_UNITS = {unit for unit in (*UNITS_PER_METRE, *UNITS_PER_SECOND) if unit}


class Sheet(NamedTuple):
    """The names of the columns, as `t [s]` and `x [mm]`, with the line they stand in, and the rows
    with theirs.
    """

    names: list[str]
    line: int
    rows: Iterator[tuple[int, list[str]]]


def read_sheet(file: IO[str], path: Path) -> Sheet:
    """The table in a text, row by row. Raises TakeError, here and in the rows."""
    numbered_lines = content_lines(file, path)
    header_number, header = next(numbered_lines, (1, ""))
    separator = None
    if stated_separator := _STATED_SEPARATOR.fullmatch(header):
        separator = stated_separator[1]
        header_number, header = next(numbered_lines, (header_number, ""))
    separator = separator or _separator(header)
    column_names = [name.strip() for name in _split_cells(header, separator, path, header_number)]
    while len(column_names) > 1 and not column_names[-1]:
        column_names.pop()  # each line ends with a separator
    if all(map(_VALUE_PATTERN.fullmatch, column_names)):
        raise _missing_header_error("numbers", path, header_number)
    table_rows = _rows(numbered_lines, len(column_names), separator, path)
    first_row = next(table_rows, None)
    if first_row is not None and _is_row_of_values(column_names, first_row[1]):
        raise _missing_header_error("a row of values", path, header_number)
    if first_row is not None and (units := _units_of_row(column_names, first_row[1])) is not None:
        pairs = zip(column_names, units, strict=True)
        column_names = [f"{name} [{unit}]" if unit else name for name, unit in pairs]
        first_row = None
    return Sheet(
        _names_with_units(column_names),
        header_number,
        table_rows if first_row is None else itertools.chain([first_row], table_rows),
    )


def _missing_header_error(description: str, path: Path, line_number: int) -> TakeError:
    return TakeError(
        f"this line is {description}, but the first line of a table names its columns; write such "
        "a line above it: t [s],x [mm]",
        path,
        line_number,
    )


def _is_row_of_values(column_names: list[str], next_cells: list[str]) -> bool:
    """Whether a first line with numbers in it names no column: nowhere stands a word above a
    number.
    """
    are_values = [_VALUE_PATTERN.fullmatch(name) is not None for name in column_names]
    return any(are_values) and not any(
        not is_value
        and name.casefold() not in _EMPTY_WORDS
        and _VALUE_PATTERN.fullmatch(cell.strip())
        for is_value, name, cell in zip(are_values, column_names, next_cells, strict=True)
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
    named_columns = []
    for name in column_names:
        unit_match = _NAME_WITH_UNIT_PATTERN.fullmatch(name)
        name_text, unit_text = name, None
        if unit_match and (unit_match[2] is None or unit_match[2].strip() in _UNITS):
            name_text, unit_text = unit_match[1], (unit_match[2] or unit_match[3] or "").strip()
        named_columns.append((name_text, unit_text))
    words = [word.casefold() for word, _ in named_columns]
    if "t" not in [word for word, _ in named_columns]:
        time_columns = [i for i, word in enumerate(words) if word in ("t", "time")]
        if len(time_columns) == 1:
            named_columns[time_columns[0]] = ("t", named_columns[time_columns[0]][1])
    return [word if unit is None else f"{word} [{unit}]" for word, unit in named_columns]


def _rows(
    numbered_lines: Iterator[tuple[int, str]], n_columns: int, separator: str, path: Path
) -> Iterator[tuple[int, list[str]]]:
    marks = _DecimalMarks(separator, path)
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
        if separator != "," or '"' in line_text:
            line_cells = marks.with_points(line_cells, line_text, line_number)
        yield line_number, line_cells
    marks.finish()


def _split_cells(written_text: str, separator: str, path: Path, line_number: int) -> list[str]:
    if '"' not in written_text:
        return written_text.split(separator)
    try:
        return next(csv.reader([written_text], delimiter=separator, strict=True))
    except csv.Error:
        raise TakeError("a quotation in this line is not closed", path, line_number) from None


class _DecimalMarks:
    """Which of `,` and `.` is the decimal mark of a table; the other one may divide thousands.

    `0,5` and `0.5` tell; `1,000` and `1.000` do not, and are decimals only if nothing in the table
    speaks against it. A comma needs something that speaks for it.
    """

    def __init__(self, separator: str, path: Path) -> None:
        self._separator, self._path = separator, path
        self._decimal_marks: set[str] = set()  # those that some number shows
        self._doubtful_cells: dict[str, tuple[str, int]] = {}  # by mark: the first, with its line

    def with_points(self, cells: list[str], line_text: str, line_number: int) -> list[str]:
        """The cells with points in place of decimal commas. Raises TakeError."""
        for mark in ",.":
            if mark in line_text and (
                mark == "," or "." not in self._decimal_marks or self._is_mixed
            ):
                for cell in cells:
                    self._follow(cell.strip(), mark, line_number)
        if "," not in line_text:
            return cells
        return [
            cell.replace(",", ".") if cell.count(",") == 1 and "." not in cell else cell
            for cell in cells
        ]

    @property
    def _is_mixed(self) -> bool:
        return "," in self._decimal_marks or "," in self._doubtful_cells

    def _follow(self, cell_text: str, mark: str, line_number: int) -> None:
        if mark not in cell_text or not _DECIMAL_PATTERN.fullmatch(cell_text):
            return
        if not _THOUSANDS_PATTERN.fullmatch(cell_text):
            self._decimal_marks.add(mark)
        else:
            self._doubtful_cells.setdefault(mark, (cell_text, line_number))
            if self._separator == "," and mark == ",":
                raise self._doubtful_error(mark)
        for doubtful_mark, other_mark in (",.", ".,"):
            is_contradicted = (
                other_mark in self._decimal_marks or other_mark in self._doubtful_cells
            )
            if doubtful_mark in self._doubtful_cells and is_contradicted:
                raise self._doubtful_error(doubtful_mark)

    def finish(self) -> None:
        """Refuse commas that no other number of the table shows to be decimal. Raises TakeError."""
        if "," in self._doubtful_cells and "," not in self._decimal_marks:
            raise self._doubtful_error(",")

    def _doubtful_error(self, mark: str) -> TakeError:
        cell_text, line_number = self._doubtful_cells[mark]
        name = {",": "comma", ".": "point"}[mark]
        remedy = "write a point, or no comma" if mark == "," else "write one mark in all numbers"
        return TakeError(
            f"the {name} in '{cell_text}' may divide thousands or be a decimal {name}; {remedy}",
            self._path,
            line_number,
        )
