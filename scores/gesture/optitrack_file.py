"""CSV files that OptiTrack's Motive exports: a line of names and values, rows of names, frames.

Every column group with a Position of X, Y and Z is a point: markers, rigid bodies, bones.
"""

from __future__ import annotations

import csv
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from ergon.scores.gesture.frame_clock import FrameClock
from ergon.scores.gesture.motion import (
    Motion,
    check_size,
    position_blocks,
    row_positions,
    unique_names,
)
from ergon.scores.gesture.take_file import Floats, TakeError, content_lines, open_take, open_text

_FIRST_BYTES = b"Format Version,"
_METRES_BY_UNIT = {"meters": 1.0, "centimeters": 0.01, "millimeters": 1e-3}
_RATE_FIELDS = ("Export Frame Rate", "Capture Frame Rate")
_COUNT_FIELDS = ("Total Exported Frames", "Total Frames in Take")
_HEADER_LINES_MAX = 16  # lines before the one that begins with Frame


def is_optitrack(path: Path) -> bool:
    """Whether a file begins as files of Motive do. Raises TakeError, OSError."""
    with open_take(path) as file:
        return file.read(64).removeprefix(b"\xef\xbb\xbf").startswith(_FIRST_BYTES)


@dataclass(frozen=True, slots=True)
class _RowLayout:
    """The layout of the frames: their first line, the number of cells in each, each point's first
    column, and whether the second column has instants.
    """

    path: Path
    first_line: int
    n_cells: int
    names: list[str]
    point_columns: list[int]
    has_times: bool

    def read_positions(self, line: str, line_number: int) -> list[float]:
        """Positions of a frame; nan for empty cells. A comma may come last."""
        line_cells = line.split(",")
        if len(line_cells) == self.n_cells + 1 and not line_cells[-1].strip():
            line_cells.pop()
        if len(line_cells) != self.n_cells:
            raise TakeError(
                f"the number of values in this line is {len(line_cells)}, but the header has "
                f"{self.n_cells} columns",
                self.path,
                line_number,
            )
        return row_positions(line_cells, self.point_columns, self.path, line_number)


def read(path: Path) -> Motion:
    """The motion in a file of Motive; a point that is not seen has empty cells.

    Raises TakeError and OSError.
    """
    header, layout = _read_header(path)

    rate = _frame_rate(header, path)

    def blocks() -> Iterator[Floats]:
        return position_blocks(_timed_positions(layout, rate), n_frames, path)

    count_text = next((header[name] for name in _COUNT_FIELDS if header.get(name)), None)
    n_frames = (
        sum(1 for _ in _position_rows(layout))
        if count_text is None
        else _frame_count(count_text, path)
    )
    metres = _METRES_BY_UNIT.get(header.get("Length Units", "").lower())
    return check_size(
        Motion(
            unique_names(layout.names),
            n_frames,
            rate,
            metres,
            blocks,
            None,
            ("columns that are not positions",),
        ),
        path,
    )


def _timed_positions(layout: _RowLayout, rate: float | None) -> Iterator[list[float]]:
    """The positions of each frame. Raises TakeError where frames are missing."""
    clock = FrameClock(rate, layout.path)
    for line, line_number in _position_rows(layout):
        positions = layout.read_positions(line, line_number)
        number_text, time_text, *_ = [*line.split(",", 2), ""]
        clock.follow(number_text, time_text if layout.has_times else "", line_number)
        yield positions
    clock.finish()


def _position_rows(layout: _RowLayout) -> Iterator[tuple[str, int]]:
    with open_text(layout.path) as file:
        for line_number, line in content_lines(file, layout.path):
            if line_number >= layout.first_line:
                yield line, line_number


def _read_header(path: Path) -> tuple[Mapping[str, str], _RowLayout]:
    header_rows: list[list[str]] = []
    with open_text(path) as file:
        for line_number, line in content_lines(file, path):
            line_cells = [cell.strip() for cell in _header_cells(line, path, line_number)]
            if header_rows and line_cells[0] == "Frame":
                break
            header_rows.append(line_cells)
            if len(header_rows) > _HEADER_LINES_MAX:
                raise TakeError("this file of Motive has no line that begins with Frame", path)
        else:
            raise TakeError("this file of Motive has no line that begins with Frame", path)
    first_row = header_rows[0]
    header = dict(zip(first_row[::2], first_row[1::2], strict=False))
    header_width = len(line_cells)
    if len(header_rows) < 3 or any(len(row) > header_width for row in header_rows[1:]):
        raise TakeError("this file of Motive has no rows of names above Frame", path, line_number)
    padded_rows = [row + [""] * (header_width - len(row)) for row in header_rows[1:]]
    # Older files have no labels before their header rows: the first is the kind, the second the
    # name.
    column_names = next(
        (row for row in padded_rows if "Name" in row[:2]), padded_rows[min(1, len(padded_rows) - 1)]
    )
    column_kinds = padded_rows[-1]
    starts = [
        column
        for column in range(2, header_width - 2)
        if line_cells[column : column + 3] == ["X", "Y", "Z"]
        and column_kinds[column : column + 3] == ["Position"] * 3
    ]
    if not starts:
        raise TakeError(
            "this file of Motive has no columns called Position, X, Y, Z", path, line_number
        )
    point_names = [column_names[column] for column in starts]
    has_times = line_cells[1].casefold().startswith("time (s")
    return header, _RowLayout(path, line_number + 1, header_width, point_names, starts, has_times)


def _header_cells(line_text: str, path: Path, line_number: int) -> list[str]:
    """Cells of a line of the header: a name may be quoted."""
    try:
        return next(csv.reader([line_text], strict=True))
    except csv.Error:
        raise TakeError("a quotation in this line is not closed", path, line_number) from None


def _frame_count(count_text: str, path: Path) -> int:
    if not count_text.isdecimal() or len(count_text) > 9:
        raise TakeError("the number of frames in this file of Motive is not a number", path)
    return int(count_text)


def _frame_rate(header: Mapping[str, str], path: Path) -> float | None:
    """Frames a second; None where the file does not tell."""
    rate_text = next((header[name] for name in _RATE_FIELDS if header.get(name)), None)
    if rate_text is None:
        return None
    try:
        rate = float(rate_text)
    except ValueError:
        rate = 0.0
    if not 0 < rate <= 1e6:
        raise TakeError("the frame rate in this file of Motive is not a number above 0", path)
    return rate
