"""TRC files of markers, as Cortex (Motion Analysis) and OpenSim write them.

Three lines of head (names of fields, then their values), a line of the names of markers, a line of
axes, then a frame a row: its number, its instant and three numbers for each marker, between tabs
(OpenSim documentation, "Marker (.trc) Files").
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

from ergon.scores.gesture.frame_clock import RATE_TOLERANCE, FrameClock, instant_and_step
from ergon.scores.gesture.motion import (
    Motion,
    check_size,
    metres_of,
    position_blocks,
    row_positions,
    unique_names,
)
from ergon.scores.gesture.take_file import MAX_CHANNELS, Floats, TakeError, content_lines, open_text

_FIRST_WORD = "PathFileType"
_LEADING_COLUMNS = 2  # columns before the positions: the number of the frame, its instant
_RATE_MAX = 1e6  # Hz


@dataclass(frozen=True, slots=True)
class _FileHeader:
    """The fields of the head, the names of the markers, and the line before the frames."""

    fields: dict[str, str]
    names: list[str]
    line: int


def read(path: Path) -> Motion:
    """The motion in a TRC file; a marker that is not seen has empty cells.

    Raises TakeError and OSError.
    """
    header = _read_header(path)
    n_frames, n_markers = (_frame_count(header, name, path) for name in ("NumFrames", "NumMarkers"))
    if n_markers != len(header.names):
        message = f"its head says {n_markers:,} markers, and names {len(header.names):,}"
        raise TakeError(message, path, header.line)
    rate = _frame_rate(header, path)
    metres = metres_of(header.fields.get("Units", ""))

    def blocks() -> Iterator[Floats]:
        return position_blocks(_timed_positions(header, rate, path), n_frames, path)

    names = unique_names(header.names)
    return check_size(Motion(names, n_frames, rate, metres, blocks), path)


def _read_header(path: Path) -> _FileHeader:
    with open_text(path) as file:
        numbered_lines = content_lines(file, path)
        (_, first_text), (_, field_text), (_, value_text), (_, marker_text), (axis_line, _) = (
            next(numbered_lines, (0, "")) for _ in range(5)
        )
    marker_names = [
        name.strip() for name in marker_text.split("\t")[_LEADING_COLUMNS:] if name.strip()
    ]
    if (
        not first_text.startswith(_FIRST_WORD)
        or not marker_text.startswith("Frame#")
        or not axis_line
    ):
        raise TakeError(
            "this is not a TRC file: it begins with PathFileType, and its fourth line with Frame#",
            path,
        )
    if len(marker_names) > MAX_CHANNELS:
        raise TakeError(f"the file has more than {MAX_CHANNELS:,} points", path)
    cells = (text.split("\t") for text in (field_text, value_text))
    pairs = zip(*cells, strict=False)
    return _FileHeader(
        {name.strip(): value.strip() for name, value in pairs}, marker_names, axis_line
    )


def _frame_rows(header: _FileHeader, path: Path) -> Iterator[tuple[int, list[str]]]:
    """The cells of each frame, with their line. Raises TakeError."""
    row_width = _LEADING_COLUMNS + 3 * len(header.names)
    with open_text(path) as file:
        for line_number, row_text in content_lines(file, path):
            if line_number <= header.line:
                continue
            line_cells = [cell.strip() for cell in row_text.split("\t")]
            if len(line_cells) == row_width + 1 and not line_cells[-1]:  # a tab may come last
                line_cells.pop()
            if (
                _LEADING_COLUMNS <= len(line_cells) < row_width
                and (row_width - len(line_cells)) % 3 == 0
            ):
                line_cells += [""] * (
                    row_width - len(line_cells)
                )  # an editor cut the blanks of hidden markers
            if len(line_cells) != row_width:
                message = (
                    f"the number of values in this line is {len(line_cells)}, but the markers need "
                )
                raise TakeError(f"{message}{row_width}", path, line_number)
            yield line_number, line_cells


def _timed_positions(header: _FileHeader, rate: float, path: Path) -> Iterator[list[float]]:
    """The positions of each frame. Raises TakeError where frames are missing."""
    clock = FrameClock(rate, path)
    for line_number, cells in _frame_rows(header, path):
        clock.follow(cells[0], cells[1], line_number)
        yield row_positions(cells, range(_LEADING_COLUMNS, len(cells), 3), path, line_number)
    clock.finish()


def _frame_count(header: _FileHeader, field_name: str, path: Path) -> int:
    field_text = header.fields.get(field_name, "")
    if not field_text.isdecimal() or len(field_text) > 9:
        raise TakeError(f"{field_name} in the head of this file is not a number", path)
    return int(field_text)


def _frame_rate(header: _FileHeader, path: Path) -> float:
    """The frame rate [Hz], which the instants of the first two frames must have, as far as they
    are not rounded. Raises TakeError.
    """
    rate = _number_of_text(header.fields.get("DataRate", ""))
    if not 0 < rate <= _RATE_MAX:
        raise TakeError("DataRate in the head of this file is not a number above 0", path)
    instants = [instant_and_step(cells[1]) for _, cells in islice(_frame_rows(header, path), 2)]
    frame_step, rounding = 1 / rate, 0.0
    if len(instants) == 2:
        (first, first_rounding), (second, second_rounding) = (
            instant or (math.nan, 0.0) for instant in instants
        )
        frame_step, rounding = second - first, min(first_rounding, second_rounding)
    if not abs(frame_step * rate - 1) <= RATE_TOLERANCE + rounding * rate:
        message = (
            f"its head says {rate:g} frames a second, but its first two frames are {frame_step:g} "
            "s "
        )
        raise TakeError(message + "apart", path, header.line + 1)
    return rate


def _number_of_text(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return float("nan")
