"""What files of motion capture have in common: points that move in space, of which one coordinate
is read.

A channel is a point and an axis: `RWRI.x`, or `RWRI.auto` for the straight line that fits its
path best. Positions count from where the point is first seen, because the origin of a studio
means nothing to a key. A short gap in which the point is hidden is filled by a spline.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from math import nan
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ergon.notation.text.spelling import nearest
from ergon.scores.gesture.points import UNITS_PER_METRE
from ergon.scores.gesture.take_file import MAX_CHANNELS, MAX_SAMPLES, Floats, TakeError

AXES = ("x", "y", "z", "auto")
BLOCK_NUMBERS_MAX = 1 << 18  # numbers that are read at once
_HIDDEN_DURATION_MAX = 0.2  # s that a spline runs across
_LINE_VARIANCE_RATIO_MIN = 0.8  # smallest share of the variance along the line of `auto`
_NAMES_LISTED_MAX = 8
_HIDDEN_WORDS = ("", "NULL")  # cells of a hidden point
_UNIT_WORDS = {
    **dict.fromkeys(("millimeters", "millimetres", "millimeter", "millimetre"), "mm"),
    **dict.fromkeys(("centimeters", "centimetres", "centimeter", "centimetre"), "cm"),
    **dict.fromkeys(("meters", "metres", "meter", "metre"), "m"),
}
_COORDINATE_MAX = 1e9  # largest coordinate in an intact file, in any unit


@dataclass(frozen=True, slots=True)
class Motion:
    """Points of a file; sizes: n frames.

    `rate` [Hz] is None if the file does not state it, as is `unit_metres`, the length of 1.0 in the
    file. `blocks` gives positions as (frames, points, 3), some frames at a time, in the file's
    unit; a point that is not seen is NaN there. `note` says what is wrong with a file that can be
    read, `unread_contents` what is in it beside the points.
    """

    points: tuple[str, ...]
    n_frames: int
    rate: float | None
    unit_metres: float | None
    blocks: Callable[[], Iterator[Floats]]
    note: str | None = None
    unread_contents: tuple[str, ...] = ()


def metres_of(unit: str) -> float | None:
    """The length [m] of a unit that a file names in letters of either size; None if unknown."""
    name = unit.strip().casefold()
    divisor = UNITS_PER_METRE.get(_UNIT_WORDS.get(name, name)) if name else None
    return None if divisor is None else 1 / divisor


def check_size(motion: Motion, path: Path) -> Motion:
    """The motion itself, if its size is one that a take may have. Raises TakeError."""
    if not motion.points:
        raise TakeError("the file holds no points that move", path)
    if len(motion.points) > MAX_CHANNELS:
        raise TakeError(f"the file has more than {MAX_CHANNELS:,} points", path)
    if motion.n_frames > MAX_SAMPLES:
        raise TakeError(f"the file has more than {MAX_SAMPLES:,} samples", path)
    return motion


def unique_names(column_names: Sequence[str]) -> tuple[str, ...]:
    """The names; a name that is empty or taken gets its number, from 1."""
    taken_names: set[str] = set()
    names = []
    for number, name in enumerate(column_names, 1):
        names.append(f"{name} {number}".strip() if not name or name in taken_names else name)
        taken_names.add(names[-1])
    return tuple(names)


def row_positions(
    cells: Sequence[str], first_columns: Iterable[int], path: Path, line_number: int
) -> list[float]:
    """Three numbers from each of the columns `first_columns` on; NaN for cells that are empty or
    say `NULL`. Raises TakeError.
    """
    words = [cell.strip() for column in first_columns for cell in cells[column : column + 3]]
    try:
        coordinates = [nan if word.upper() in _HIDDEN_WORDS else float(word) for word in words]
    except ValueError:
        raise TakeError("this line is not a row of numbers", path, line_number) from None
    if any(abs(value) > _COORDINATE_MAX for value in coordinates):
        raise TakeError("this line has a position that no camera sees", path, line_number)
    return coordinates


def position_blocks(
    rows_of_frames: Iterable[list[float]], n_frames: int, path: Path
) -> Iterator[Floats]:
    """Rows of positions as (frames, points, 3). Raises TakeError if the number of rows is not
    `n_frames`.
    """
    rows: list[list[float]] = []
    n_rows = 0
    for row in rows_of_frames:
        rows.append(row)
        n_rows += 1
        if len(rows) * len(row) >= BLOCK_NUMBERS_MAX:
            yield np.array(rows).reshape(len(rows), -1, 3)
            rows = []
    if rows:
        yield np.array(rows).reshape(len(rows), -1, 3)
    if n_rows != n_frames:
        raise TakeError(f"the file says {n_frames:,} frames, and holds {n_rows:,}", path)


def chosen_point_and_axis(
    point_names: Sequence[str], channel_name: str | None, path: Path
) -> tuple[int, str]:
    """The index of a point and the axis of a channel. Raises TakeError."""
    listed_names = ", ".join(point_names[:_NAMES_LISTED_MAX])
    if (n_unlisted := len(point_names) - _NAMES_LISTED_MAX) > 0:
        listed_names += f" and {n_unlisted} more"
    if channel_name is None:
        example = f"{point_names[0]}.x"
        raise TakeError(
            f"write `channel` as a point and an axis ({', '.join(AXES)}), such as {example[:60]}; "
            f"the points are {listed_names}",
            path,
            field="channel",
        )
    point_name, _, axis_name = channel_name.rpartition(".")
    if channel_name in point_names or axis_name not in AXES:
        name = channel_name if channel_name in point_names else point_name or channel_name
        nearest_name = name if name in point_names else nearest(name, point_names)
        raise TakeError(
            f"'{channel_name[:60]}' is not a point with an axis ({', '.join(AXES)}); the points "
            f"are {listed_names}",
            path,
            suggestion=f"{nearest_name}.x" if nearest_name else None,
            field="channel",
        )
    if point_name not in point_names:
        nearest_name = nearest(point_name, point_names)
        raise TakeError(
            f"no point '{point_name[:60]}'; there are {listed_names}",
            path,
            suggestion=f"{nearest_name}.{axis_name}" if nearest_name else None,
            field="channel",
        )
    return list(point_names).index(point_name), axis_name


def metres_per_unit(file_unit: float | None, written_unit: float | None, path: Path) -> float:
    """The length of 1.0 in a file [m], by the file or by `written_unit`. Raises TakeError."""
    if file_unit is not None and written_unit is not None:
        raise TakeError("the file states its own unit; remove `unit`", path, field="unit")
    metres = written_unit if file_unit is None else file_unit
    if metres is None:
        raise TakeError(
            "the file does not state the unit of its lengths; write what 1.0 means, "
            "such as unit: 1cm",
            path,
            field="unit",
        )
    return metres


def channel_track(
    motion: Motion, channel: str | None, rate: float | None, written_unit: float | None, path: Path
) -> tuple[Floats, Floats, str | None]:
    """Instants [s] and positions [m] of a channel, both (seen,), and a note on damage and on gaps
    that the spline fills.

    Time begins with the file, not with the first frame in which the point is seen. Raises
    TakeError.
    """
    point_index, axis_name = chosen_point_and_axis(motion.points, channel, path)
    metres = metres_per_unit(motion.unit_metres, written_unit, path)
    if motion.rate is not None and rate is not None:
        raise TakeError("the file states its own rate; remove `rate`", path, field="rate")
    sample_rate = motion.rate if rate is None else rate
    if sample_rate is None:
        raise TakeError(
            "the file does not state its rate; write it, such as rate: 100Hz", path, field="rate"
        )
    positions = np.concatenate(
        [np.empty((0, 3)), *(block[:, point_index].copy() for block in motion.blocks())]
    )
    seen_frames = np.flatnonzero(np.isfinite(positions).all(axis=1))
    if seen_frames.size < 2:
        raise TakeError(f"'{motion.points[point_index][:60]}' is seen in no two frames", path)
    damage = _hidden_note(seen_frames, sample_rate, motion.points[point_index], path)
    positions = positions[seen_frames]
    positions -= positions[0]
    if axis_name == "auto":
        coordinates = positions @ _path_direction(positions, motion.points[point_index], path)
    else:
        coordinates = positions[:, AXES.index(axis_name)]
    notes = "; ".join(filter(None, (motion.note, damage)))
    return seen_frames / sample_rate, coordinates * metres, notes or None


def _hidden_note(
    seen_frames: NDArray[np.intp], rate: float, point_name: str, path: Path
) -> str | None:
    """A note on frames in which a point is not seen; None if there are none. Raises TakeError for
    long gaps.
    """
    gaps = np.diff(seen_frames)
    longest_index = int(gaps.argmax())
    if (gaps[longest_index] - 1) / rate > _HIDDEN_DURATION_MAX:
        raise TakeError(
            f"'{point_name[:60]}' is not seen from {(seen_frames[longest_index] + 1) / rate:.3f} s "
            f"to {seen_frames[longest_index + 1] / rate:.3f} s; fill the gap in the program that "
            "captured it, or take another point",
            path,
        )
    n_hidden = int((gaps - 1).sum())
    if not n_hidden:
        return None
    return f"'{point_name[:60]}' is not seen in {n_hidden:,} frames; a spline runs across them"


def _path_direction(positions: Floats, point_name: str, path: Path) -> Floats:
    """The direction of the straight line that fits a path best, a unit vector (3,), towards its
    farther end.
    """
    deviations = positions - positions.mean(axis=0)
    # Relative to the largest value, so that no square overflows or underflows.
    scale = float(np.abs(deviations).max())
    if not scale:
        raise TakeError(f"'{point_name[:60]}' does not move", path, field="channel")
    deviations = deviations / scale
    eigenvalues, eigenvectors = np.linalg.eigh(deviations.T @ deviations)
    variance_ratio = float(eigenvalues[-1] / eigenvalues.sum())
    if variance_ratio < _LINE_VARIANCE_RATIO_MIN:
        raise TakeError(
            f"'{point_name[:60]}' does not move along a straight line: the nearest one holds "
            f"{100 * variance_ratio:.0f}% of its variance, and auto needs "
            f"{100 * _LINE_VARIANCE_RATIO_MIN:.0f}%; choose x, y or z",
            path,
            field="channel",
        )
    line_direction: Floats = eigenvectors[:, -1]
    positions_along = deviations @ line_direction
    return (
        line_direction
        if positions_along.max() - positions_along[0] >= positions_along[0] - positions_along.min()
        else -line_direction
    )
