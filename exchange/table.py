"""What a file of measured curves holds, told without trusting it: CSV with units, or npz."""

from __future__ import annotations

import csv
import itertools
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

_CHANNELS_MAX = 1000


class NotTableError(ValueError):
    """The file is no table of numbers that can be told about."""


@dataclass(frozen=True, slots=True)
class Column:
    """One channel: its name as written (`x [mm]`), smallest, largest, first and last value."""

    name: str
    low: float
    high: float
    first: float
    last: float


@dataclass(frozen=True, slots=True)
class Table:
    """So many rows of these columns."""

    n_rows: int
    columns: tuple[Column, ...]


def read_table(path: Path) -> Table:
    """Summarise a `.csv` or `.npz` file in one pass. Raises NotTableError or OSError."""
    return _npz(path) if path.suffix.lower() == ".npz" else _csv(path)


def _csv(path: Path) -> Table:
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            lines = (line for line in file if not line.startswith("#"))
            header = next(lines, "")
            separator = next((s for s in ",;\t" if s in header), ",")
            rows = csv.reader(itertools.chain([header], lines), delimiter=separator)
            head = [name.strip() for name in next(rows, [])]
            if not head or len(head) > _CHANNELS_MAX:
                raise NotTableError("this is no table of numbers")
            first: list[float] = []
            low, high = [math.inf] * len(head), [-math.inf] * len(head)
            last: list[float] = []
            n_rows = 0
            for row in rows:
                if not row:
                    continue
                last = [float(cell) for cell in row]
                if len(last) != len(head):
                    raise NotTableError(f"line {rows.line_num} has {len(last)} columns")
                first = first or last
                low = list(map(min, low, last))
                high = list(map(max, high, last))
                n_rows += 1
    except (ValueError, csv.Error) as error:
        if isinstance(error, NotTableError):
            raise
        raise NotTableError(f"this is no table of numbers ({error})") from None
    if not n_rows:
        raise NotTableError("this table is empty")
    every = zip(head, low, high, first, last, strict=True)
    return Table(n_rows, tuple(Column(*one) for one in every))


def _npz(path: Path) -> Table:
    import zipfile

    import numpy as np

    try:
        # Never pickles: they can run code.
        with np.load(path, allow_pickle=False) as arrays:
            columns: list[Column] = []
            n_rows = 0
            for name in arrays.files[:_CHANNELS_MAX]:
                array: Any = arrays[name]
                if array.dtype.kind not in "fiu" or not array.size:
                    continue
                flat = array.reshape(len(array), -1) if array.ndim else array.reshape(1, 1)
                n_rows = max(n_rows, len(flat))
                ends = float(flat[0, 0]), float(flat[-1, 0])
                columns.append(Column(name, float(flat.min()), float(flat.max()), *ends))
    except (ValueError, zipfile.BadZipFile, KeyError) as error:
        raise NotTableError(f"this is no npz file ({error})") from None
    if not columns:
        raise NotTableError("this npz file holds no numbers")
    return Table(n_rows, tuple(columns))
