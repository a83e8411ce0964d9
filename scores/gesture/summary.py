"""What a file of measured curves holds, told a block at a time: CSV, or npz."""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ergon.scores.gesture.npz import npz
from ergon.scores.gesture.take_file import MAX_CHANNELS, Floats, TakeError, lines, opened


@dataclass(slots=True)
class Column:
    """One channel: its name as written (`x [mm]`), smallest, largest, first and last value."""

    name: str
    low: float = math.inf
    high: float = -math.inf
    first: float = math.nan
    last: float = math.nan

    def add(self, block: Floats | Sequence[float]) -> None:
        """Further values."""
        if math.isnan(self.first):
            self.first = float(block[0])
        self.last = float(block[-1])
        self.low = min(self.low, float(np.min(block)))
        self.high = max(self.high, float(np.max(block)))


@dataclass(frozen=True, slots=True)
class Table:
    """So many rows of these columns."""

    n_rows: int
    columns: tuple[Column, ...]


_BLOCK = 4096  # rows


def summary(path: Path) -> Table:
    """Summarise a `.csv` or `.npz` file in one pass. Raises TakeError or OSError."""
    table = _npz(path) if path.suffix.lower() == ".npz" else _csv(path)
    if not table.n_rows:
        raise TakeError("the file has no numbers", path)
    return table


def _csv(path: Path) -> Table:
    with io.TextIOWrapper(opened(path), encoding="utf-8-sig") as file:
        try:
            rows = lines(file, path)
            _, header = next(rows, (1, ""))
            separator = next((s for s in ",;\t" if s in header), ",")
            columns = tuple(Column(name.strip()) for name in header.split(separator))
            if len(columns) > MAX_CHANNELS:
                raise TakeError(f"the file has more than {MAX_CHANNELS:,} columns", path)
            block: list[list[float]] = []
            n_rows = 0
            for number, line in rows:
                cells = line.split(separator)
                if len(cells) != len(columns):
                    reason = (
                        f"the number of values in this line is {len(cells)}, but "
                        f"the file has {len(columns)} columns"
                    )
                    raise TakeError(reason, path, number)
                try:
                    block.append([float(cell) for cell in cells])
                except ValueError:
                    raise TakeError("this line is not a row of numbers", path, number) from None
                if len(block) * len(columns) >= _BLOCK:
                    n_rows += _added(columns, block)
            n_rows += _added(columns, block)
        except UnicodeDecodeError:
            raise TakeError("this is not text in UTF-8", path) from None
    return Table(n_rows, columns)


def _added(columns: Sequence[Column], block: list[list[float]]) -> int:
    """Every column's values of some rows; how many rows they are."""
    n_rows = len(block)
    for column, values in zip(columns, zip(*block, strict=True), strict=False):
        column.add(values)
    block.clear()
    return n_rows


def _npz(path: Path) -> Table:
    """Its rows of numbers; what else there is in it is nothing that is played."""
    columns = []
    n_rows = 0
    with npz(path) as arrays:
        for index in range(len(arrays.names)):
            row = arrays.row(index)
            if row is None or not row.length:
                continue
            column = Column(row.name)
            for block in arrays.blocks(row):
                column.add(block)
            columns.append(column)
            n_rows = max(n_rows, row.length)
    return Table(n_rows, tuple(columns))
