"""TSV files that Qualisys Track Manager exports: a header of names and values, then rows in mm.

3D data have three columns for each marker; 6D data have sixteen for each body, the first three
of which are its position.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ergon.scores.gesture.frame_clock import FrameClock
from ergon.scores.gesture.motion import (
    Motion,
    check_size,
    position_blocks,
    row_positions,
    unique_names,
)
from ergon.scores.gesture.take_file import Floats, TakeError, content_lines, open_take, open_text

_FIRST_WORDS = (b"FILE_VERSION", b"NO_OF_FRAMES")
_LABELS_AFTER_NAMES = ("TRAJECTORY_TYPES", "EVENT")
_LEADING_COLUMNS_MAX = 2  # columns before the positions: the number of the frame, its time
_COLUMNS_BY_NAMES_FIELD = {"MARKER_NAMES": 3, "BODY_NAMES": 16}  # columns of each


def is_qtm(path: Path) -> bool:
    """Whether a file begins as files of QTM do. Raises TakeError, OSError."""
    with open_take(path) as file:
        return file.read(64).removeprefix(b"\xef\xbb\xbf").startswith(_FIRST_WORDS)


@dataclass(frozen=True, slots=True)
class _RowLayout:
    """The layout of the rows: their first line, the columns before the positions, and the columns
    of each marker or body.
    """

    path: Path
    names: list[str]
    first_line: int
    n_leading: int
    point_columns: int

    def read_positions(self, line: str, line_number: int) -> list[float]:
        """Positions of a row; nan for empty cells. A tab may come last."""
        line_cells, row_width = (
            line.split("\t"),
            self.n_leading + self.point_columns * len(self.names),
        )
        if len(line_cells) == row_width + 1 and not line_cells[-1]:
            line_cells.pop()
        if len(line_cells) != row_width:
            raise TakeError(
                f"the number of values in this line is {len(line_cells)}, but the "
                f"{'markers' if self.point_columns == 3 else 'bodies'} need {row_width}",
                self.path,
                line_number,
            )
        return row_positions(
            line_cells, range(self.n_leading, row_width, self.point_columns), self.path, line_number
        )


def read(path: Path) -> Motion:
    """The motion in a file of QTM. A point that is not seen is at 0, 0, 0, or has empty cells.

    Raises TakeError and OSError.
    """
    header, layout = _read_header(path)
    n_frames = _frame_count(header.get("NO_OF_FRAMES", []), path)

    rate = _frame_rate(header.get("FREQUENCY", []), path)

    def blocks() -> Iterator[Floats]:
        position_rows = _timed_positions(layout, rate)
        yield from map(_hidden_as_nan, position_blocks(position_rows, n_frames, path))

    return check_size(
        Motion(
            unique_names(layout.names),
            n_frames,
            rate,
            1e-3,
            blocks,
            None,
            ("columns that are not positions",),
        ),
        path,
    )


def _timed_positions(layout: _RowLayout, rate: float | None) -> Iterator[list[float]]:
    """The positions of each frame. Raises TakeError where frames are missing."""
    clock = FrameClock(rate, layout.path)
    with open_text(layout.path) as file:
        for line_number, line in content_lines(file, layout.path):
            if line_number < layout.first_line:
                continue
            positions = layout.read_positions(line, line_number)
            number_text, time_text, *_ = [*line.split("\t", 2)[: layout.n_leading], "", ""]
            if layout.n_leading == 1 and "." in number_text:
                number_text, time_text = time_text, number_text
            clock.follow(number_text, time_text, line_number)
            yield positions
    clock.finish()


def _read_header(path: Path) -> tuple[dict[str, list[str]], _RowLayout]:
    header: dict[str, list[str]] = {}
    with open_text(path) as file:
        first_data_line = 0, ""
        for numbered_line in content_lines(file, path):
            label_word, *values = numbered_line[1].split("\t")
            if header.keys().isdisjoint(_COLUMNS_BY_NAMES_FIELD):
                header[label_word.strip()] = values
            elif label_word not in _LABELS_AFTER_NAMES:
                first_data_line = numbered_line
                break
    name_kind = next((kind for kind in _COLUMNS_BY_NAMES_FIELD if kind in header), "MARKER_NAMES")
    n_columns = _COLUMNS_BY_NAMES_FIELD[name_kind]
    marker_names = [name.strip() for name in header.get(name_kind, ())]
    while marker_names and not marker_names[-1]:
        marker_names.pop()
    if not marker_names:
        raise TakeError(
            "this file of QTM has no MARKER_NAMES and no BODY_NAMES; export 3D or 6D data with a "
            "header",
            path,
        )
    row_number, cells = first_data_line[0], first_data_line[1].split("\t")
    # Column titles may come first. Every line may end in a tab; then the line of names does too.
    has_titles = any(cell[:1].isalpha() for cell in cells)
    is_tabbed = not header[name_kind][-1].strip()
    n_leading = min(
        max(len(cells) - n_columns * len(marker_names) - is_tabbed, 0), _LEADING_COLUMNS_MAX
    )
    return header, _RowLayout(path, marker_names, row_number + has_titles, n_leading, n_columns)


def _frame_count(cells: list[str], path: Path) -> int:
    if not cells or not cells[0].strip().isdecimal() or len(cells[0]) > 9:
        raise TakeError("NO_OF_FRAMES in this file of QTM is not a number", path)
    return int(cells[0])


def _frame_rate(cells: list[str], path: Path) -> float | None:
    """The frame rate [Hz]; None if an external clock drives the cameras."""
    if cells[:1] == ["EXT"]:
        return None
    try:
        rate = float(cells[0])
    except (ValueError, IndexError):
        rate = 0.0
    if not 0 < rate <= 1e6:
        raise TakeError("FREQUENCY in this file of QTM is not a number above 0", path)
    return rate


def _hidden_as_nan(coordinates: Floats) -> Floats:
    """The positions, with NaN in place of 0, 0, 0."""
    coordinates[(coordinates == 0).all(axis=2)] = np.nan
    return coordinates
