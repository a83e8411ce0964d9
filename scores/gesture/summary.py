"""Summarises a file of measured curves block by block: tables, or motion capture."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ergon.scores.gesture import bvh_file, c3d_file, optitrack_file, qtm_file, sdif_file, trc_file
from ergon.scores.gesture.motion import AXES, Motion
from ergon.scores.gesture.npz import npz
from ergon.scores.gesture.table_file import sheet
from ergon.scores.gesture.take_file import (
    MAX_CHANNELS,
    Floats,
    TakeError,
    falling_time,
    number_in,
    opened_text,
)


@dataclass(slots=True)
class Column:
    """One channel: its name as written (`x [mm]`), smallest, largest, first and last value.

    Values that are not finite are left out; instants must be finite.
    """

    name: str
    low: float = math.inf
    high: float = -math.inf
    first: float = math.nan
    last: float = math.nan

    @property
    def is_time(self) -> bool:
        """Whether it holds the instants of the others."""
        return self.name.partition("[")[0].strip() == "t"

    def add(self, block: Floats | Sequence[float]) -> None:
        """Include further values."""
        finite_values = np.asarray(block, np.float64)
        finite_values = finite_values[np.isfinite(finite_values)]
        if not finite_values.size:
            return
        if math.isnan(self.first):
            self.first = float(finite_values[0])
        self.last = float(finite_values[-1])
        self.low = min(self.low, float(finite_values.min()))
        self.high = max(self.high, float(finite_values.max()))


@dataclass(frozen=True, slots=True)
class Table:
    """The number of rows, the columns, a note on what is wrong with the file, and what is not
    read.
    """

    n_rows: int
    columns: tuple[Column, ...]
    note: str | None = None
    passed_over: tuple[str, ...] = ()


_BLOCK = 4096  # rows


def summary(path: Path) -> Table:
    """Summarise a file of one of SUFFIXES in one pass. Raises TakeError or OSError."""
    with np.errstate(all="ignore"):
        file_table = _SUMMARIES[path.suffix.lower()](path)
    if not file_table.n_rows:
        raise TakeError("the file has no numbers", path)
    return file_table


def _table(path: Path) -> Table:
    with opened_text(path) as file:
        try:
            take_table = sheet(file, path)
            table_columns = tuple(Column(name) for name in take_table.names)
            if len(table_columns) > MAX_CHANNELS:
                raise TakeError(f"the file has more than {MAX_CHANNELS:,} columns", path)
            time_index = next((i for i, column in enumerate(table_columns) if column.is_time), None)
            value_block: list[list[float]] = []
            n_rows, instant_before = 0, -math.inf
            for line_number, line_cells in take_table.rows:
                try:
                    value_block.append([float(cell) for cell in line_cells])
                except ValueError:
                    raise TakeError(
                        "this line is not a row of numbers", path, line_number
                    ) from None
                if time_index is not None:
                    row_instant = number_in(line_cells[time_index], path, line_number)
                    if not row_instant > instant_before:
                        raise falling_time(row_instant, instant_before, path, line_number)
                    instant_before = row_instant
                if len(value_block) * len(table_columns) >= _BLOCK:
                    n_rows += _added(table_columns, value_block)
            n_rows += _added(table_columns, value_block)
        except UnicodeDecodeError:
            raise TakeError("this is not text in UTF-8", path) from None
    return Table(n_rows, table_columns)


def _added(table_columns: Sequence[Column], value_block: list[list[float]]) -> int:
    """Add some rows to the columns; returns their number."""
    n_rows = len(value_block)
    for column, values in zip(table_columns, zip(*value_block, strict=True), strict=False):
        column.add(values)
    value_block.clear()
    return n_rows


def _npz(path: Path) -> Table:
    """The number arrays of an npz file; other arrays cannot be played and are left out."""
    table_columns, passed_over = [], []
    n_rows = 0
    with npz(path) as arrays:
        for array_index in range(len(arrays.names)):
            array_row = arrays.row(array_index)
            if array_row is None or not array_row.length:
                passed_over.append(
                    f"array {arrays.names[array_index]}, which is not a row of numbers"
                )
                continue
            table_column = Column(array_row.name)
            for value_block in arrays.blocks(array_row):
                if table_column.is_time and not np.isfinite(value_block).all():
                    raise TakeError(
                        f"'{array_row.name[:40]}' has an instant that is not finite", path
                    )
                table_column.add(value_block)
            table_columns.append(table_column)
            n_rows = max(n_rows, array_row.length)
    return Table(n_rows, tuple(table_columns), None, tuple(passed_over))


def _tsv(path: Path) -> Table:
    return _points(qtm_file.read)(path) if qtm_file.is_qtm(path) else _table(path)


def _csv(path: Path) -> Table:
    is_motive = optitrack_file.is_optitrack(path)
    return _points(optitrack_file.read)(path) if is_motive else _table(path)


def _points(opening: Callable[[Path], Motion]) -> Callable[[Path], Table]:
    """A reader that summarises moving points: three columns each, in metres if the file tells a
    unit.
    """

    def points(path: Path) -> Table:
        motion = opening(path)
        unit = " [m]" if motion.metres else ""
        names = [f"{point}.{axis}{unit}" for point in motion.points for axis in AXES[:3]]
        table_columns = tuple(Column(name) for name in names)
        for block in motion.blocks():
            values = block.reshape(len(block), -1).T * (motion.metres or 1.0)
            for column, values_of_column in zip(table_columns, values, strict=True):
                column.add(values_of_column)
        if not motion.rate:
            return Table(motion.n, table_columns, motion.note, motion.passed_over)
        time = Column("t [s]", 0.0, (motion.n - 1) / motion.rate, 0.0, (motion.n - 1) / motion.rate)
        return Table(motion.n, (time, *table_columns), motion.note, motion.passed_over)

    return points


def _sdif(path: Path) -> Table:
    """Columns of an SDIF file. Each has instants of its own; the row count is that of the
    longest.
    """
    table_columns, time_column = [], Column("t [s]")
    n_rows = 0
    passed_over = Counter[str]()
    for name, table_column in sdif_file.columns(path, passed_over).items():
        table_columns.append(Column(name))
        table_columns[-1].add(np.frombuffer(table_column.x))
        if len(table_column.t) > n_rows:
            n_rows, time_column = len(table_column.t), Column("t [s]")
            time_column.add(np.frombuffer(table_column.t))
    passed = (
        f"{matrix_type}, {n} times" if n > 1 else matrix_type
        for matrix_type, n in passed_over.items()
    )
    return Table(n_rows, (time_column, *table_columns), None, tuple(passed))


_SUMMARIES: dict[str, Callable[[Path], Table]] = {
    ".csv": _csv,
    ".tsv": _tsv,
    ".npz": _npz,
    ".c3d": _points(c3d_file.read),
    ".bvh": _points(bvh_file.read),
    ".trc": _points(trc_file.read),
    ".sdif": _sdif,
}
SUFFIXES = tuple(_SUMMARIES)
