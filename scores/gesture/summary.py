"""Summarises a file of measured curves block by block: tables, or motion capture."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ergon.scores.gesture import bvh_file, c3d_file, optitrack_file, qtm_file, sdif_file, trc_file
from ergon.scores.gesture.motion import AXES, Motion
from ergon.scores.gesture.npz import open_npz
from ergon.scores.gesture.points import UNITS_PER_METRE, UNITS_PER_SECOND
from ergon.scores.gesture.table_file import read_sheet
from ergon.scores.gesture.take_file import (
    MAX_CHANNELS,
    Floats,
    TakeError,
    open_text,
    parse_cell,
    time_order_error,
)


@dataclass(slots=True)
class Column:
    """One channel: its name as written (`x [mm]`), smallest, largest, first and last value.

    Values that are not finite are left out and counted, with the first of them and, in a text, its
    line; instants must be finite.
    """

    name: str
    low_value: float = math.inf
    high_value: float = -math.inf
    first_value: float = math.nan
    last_value: float = math.nan
    n_values: int = 0
    n_missing: int = 0
    first_missing: int | None = None  # sample, from 1 on
    line_missing: int | None = None

    @property
    def is_time(self) -> bool:
        """Whether it holds the instants of the others."""
        return self.name.partition("[")[0].strip() == "t"

    def add(self, block: Floats | Sequence[float]) -> None:
        """Include further values."""
        values = np.asarray(block, np.float64)
        is_finite = np.isfinite(values)
        if not is_finite.all():
            self.n_missing += int(values.size - np.count_nonzero(is_finite))
            if self.first_missing is None:
                self.first_missing = self.n_values + int(is_finite.argmin()) + 1
        self.n_values += values.size
        values = values[is_finite]
        if not values.size:
            return
        if math.isnan(self.first_value):
            self.first_value = float(values[0])
        self.last_value = float(values[-1])
        self.low_value = min(self.low_value, float(values.min()))
        self.high_value = max(self.high_value, float(values.max()))


@dataclass(frozen=True, slots=True)
class Table:
    """The number of rows, the columns, a note on what is wrong with the file, and what is not
    read.
    """

    n_rows: int
    columns: tuple[Column, ...]
    note: str | None = None
    unread: tuple[str, ...] = ()
    has_hidden: bool = False  # whether a value that is missing is a point that no camera saw


_BLOCK_NUMBERS = 4096  # rows
_UNREAD_SEPARATOR = re.compile(r"[ |:]")


def summary(path: Path) -> Table:
    """Summarise a file of one of SUFFIXES in one pass. Raises TakeError or OSError."""
    with np.errstate(all="ignore"):
        table = _SUMMARIES[path.suffix.lower()](path)
    if not table.n_rows:
        raise TakeError("the file has no numbers", path)
    return table


def _read_table(path: Path) -> Table:
    with open_text(path) as file:
        try:
            table = read_sheet(file, path)
            columns = tuple(Column(name) for name in table.names)
            if len(columns) > MAX_CHANNELS:
                raise TakeError(f"the file has more than {MAX_CHANNELS:,} columns", path)
            time_index = next((i for i, column in enumerate(columns) if column.is_time), None)
            block: list[list[float]] = []
            n_rows, last_instant = 0, -math.inf
            for line_number, cells in table.rows:
                block.append(values := _row_numbers(table.names, cells, path, line_number))
                if not all(map(math.isfinite, values)):
                    _note_missing_line(columns, values, line_number)
                if time_index is not None:
                    instant = parse_cell(cells[time_index], path, line_number)
                    if not instant > last_instant:
                        raise time_order_error(instant, last_instant, path, line_number)
                    last_instant = instant
                if len(block) * len(columns) >= _BLOCK_NUMBERS:
                    n_rows += _add_rows(columns, block)
            n_rows += _add_rows(columns, block)
        except UnicodeDecodeError:
            raise TakeError("this is not text in UTF-8", path) from None
    return Table(n_rows, columns, _playing_mistake(columns))


def _playing_mistake(columns: Sequence[Column]) -> str | None:
    """What keeps a take of a table from being played, if anything does."""
    column_names = [column.name.partition("[")[0].strip() for column in columns]
    if (
        repeated_word := next((word for word in column_names if column_names.count(word) > 1), None)
    ) is not None:
        return f"two columns are called {repeated_word[:40]!r}: a take of them is refused"
    units = {column.name: column.name.partition("[")[2].rstrip("] ") for column in columns}
    for column in columns:
        unit_names = UNITS_PER_SECOND if column.is_time else UNITS_PER_METRE
        if (unit := units[column.name]) and unit not in unit_names:
            column_noun = "time" if column.is_time else "position"
            return f"{column.name[:40]!r} has no unit of a {column_noun}: a take of it is refused"
    counts = {column.n_values for column in columns}
    time = next((column for column in columns if column.is_time), None)
    if time is not None and len(counts) > 1:
        other_column = next(column for column in columns if column.n_values != time.n_values)
        return (
            f"{time.n_values:,} instants, but {other_column.n_values:,} values of "
            f"{other_column.name[:40]!r}: a take of it is "
            "refused"
        )
    return None


def _row_numbers(names: Sequence[str], cells: Sequence[str], path: Path, line: int) -> list[float]:
    """The numbers of a row. Raises TakeError, with the column of the cell that is none."""
    for name, cell in zip(names, cells, strict=True):
        try:
            float(cell)
            is_number = "_" not in cell
        except ValueError:
            is_number = False
        if not is_number:
            message = f"{cell.strip()[:40]!r} in column {name[:40]!r} is not a number"
            if len(names) == 1 and _UNREAD_SEPARATOR.search(cell.strip()):
                message += "; columns are divided by commas, semicolons or tabs"
            raise TakeError(message, path, line)
    return [float(cell) for cell in cells]


def _note_missing_line(columns: Sequence[Column], values: Sequence[float], line: int) -> None:
    """Note in which line a column first has a value that is not finite."""
    for column, value in zip(columns, values, strict=False):
        if not math.isfinite(value) and column.line_missing is None:
            column.line_missing = line


def _add_rows(columns: Sequence[Column], block: list[list[float]]) -> int:
    """Add some rows to the columns; returns their number."""
    n_rows = len(block)
    for column, values in zip(columns, zip(*block, strict=True), strict=False):
        column.add(values)
    block.clear()
    return n_rows


def _summarise_npz(path: Path) -> Table:
    """The number arrays of an npz file; other arrays cannot be played and are left out."""
    columns, unread = [], []
    n_rows = 0
    with open_npz(path) as arrays:
        for index in range(len(arrays.names)):
            row = arrays.row(index)
            if row is None or not row.length:
                unread.append(f"array {arrays.names[index]}, which is not a row of numbers")
                continue
            column = Column(row.name)
            for block in arrays.blocks(row):
                if column.is_time and not np.isfinite(block).all():
                    raise TakeError(f"'{row.name[:40]}' has an instant that is not finite", path)
                column.add(block)
            columns.append(column)
            n_rows = max(n_rows, row.length)
    return Table(n_rows, tuple(columns), _playing_mistake(columns), tuple(unread))


def _summarise_tsv(path: Path) -> Table:
    return _points_summariser(qtm_file.read)(path) if qtm_file.is_qtm(path) else _read_table(path)


def _summarise_csv(path: Path) -> Table:
    is_motive = optitrack_file.is_optitrack(path)
    return _points_summariser(optitrack_file.read)(path) if is_motive else _read_table(path)


def _points_summariser(read_motion: Callable[[Path], Motion]) -> Callable[[Path], Table]:
    """A reader that summarises moving points: three columns each, in metres if the file tells a
    unit.
    """

    def summarise(path: Path) -> Table:
        motion = read_motion(path)
        unit = " [m]" if motion.unit_metres else ""
        names = [f"{point}.{axis}{unit}" for point in motion.points for axis in AXES[:3]]
        columns = tuple(Column(name) for name in names)
        for block in motion.blocks():
            values = block.reshape(len(block), -1).T * (motion.unit_metres or 1.0)
            for column, values_of_column in zip(columns, values, strict=True):
                column.add(values_of_column)
        if not motion.rate:
            return Table(
                motion.n_frames, columns, motion.note, motion.unread_contents, has_hidden=True
            )
        time = Column(
            "t [s]",
            0.0,
            (motion.n_frames - 1) / motion.rate,
            0.0,
            (motion.n_frames - 1) / motion.rate,
        )
        columns = (time, *columns)
        return Table(motion.n_frames, columns, motion.note, motion.unread_contents, has_hidden=True)

    return summarise


def _summarise_sdif(path: Path) -> Table:
    """Columns of an SDIF file. Each has instants of its own; the row count is that of the
    longest.
    """
    columns, times = [], Column("t [s]")
    n_rows = 0
    unread = Counter[str]()
    note = None
    for name, column in sdif_file.read_columns(path, unread).items():
        if note is None and not (np.diff(np.frombuffer(column.instants)) > 0.0).all():
            note = f"the instants of {name[:40]!r} do not rise: a take of it is refused"
        columns.append(Column(name))
        columns[-1].add(np.frombuffer(column.values))
        if len(column.instants) > n_rows:
            n_rows, times = len(column.instants), Column("t [s]")
            times.add(np.frombuffer(column.instants))
    unread_names = (
        f"{matrix_type}, {n} times" if n > 1 else matrix_type for matrix_type, n in unread.items()
    )
    return Table(n_rows, (times, *columns), note, tuple(unread_names))


_SUMMARIES: dict[str, Callable[[Path], Table]] = {
    ".csv": _summarise_csv,
    ".tsv": _summarise_tsv,
    ".npz": _summarise_npz,
    ".c3d": _points_summariser(c3d_file.read),
    ".bvh": _points_summariser(bvh_file.read),
    ".trc": _points_summariser(trc_file.read),
    ".sdif": _summarise_sdif,
}
SUFFIXES = tuple(_SUMMARIES)
