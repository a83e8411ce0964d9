"""C3D files of motion capture: their points (The C3D File Format, C3D.org, 2008).

A header of 512 bytes, parameters in groups, then frames: four words for each point, and samples
of analog channels, which are skipped. Numbers have 16 or 32 bits, in the format of one of three
processors.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ergon.scores.gesture.c3d_layout import fitting_layout
from ergon.scores.gesture.c3d_parameters import (
    SECTOR_BYTES,
    NumberFormat,
    ParameterValues,
    first_number,
    parameter_text,
    read_parameters,
)
from ergon.scores.gesture.motion import (
    BLOCK_NUMBERS_MAX,
    Motion,
    check_size,
    metres_of,
    unique_names,
)
from ergon.scores.gesture.take_file import Floats, TakeError, open_take

_READ_GROUPS = {"POINT", "TRIAL"}  # groups of parameters


def read(path: Path) -> Motion:
    """The motion in a C3D file. Raises TakeError and OSError."""
    with open_take(path) as open_file:
        file_size = os.fstat(open_file.fileno()).st_size
        header_bytes = open_file.read(SECTOR_BYTES)
        if len(header_bytes) < SECTOR_BYTES or header_bytes[1] != 0x50 or not header_bytes[0]:
            raise TakeError("this is not a C3D file", path)
        number_format, parameter_values, parameter_ends = read_parameters(
            open_file, SECTOR_BYTES * (header_bytes[0] - 1), path
        )
        rate = first_number(parameter_values, "POINT", "RATE", number_format) or number_format.real(
            header_bytes, 20
        )
        layout, note = fitting_layout(
            header_bytes, parameter_values, number_format, parameter_ends, open_file, path
        )
    n_points, n_frames, is_real, frame_size = (
        layout.n_points,
        layout.n_frames,
        layout.is_real,
        layout.bytes_per_frame,
    )
    factor = 1.0 if is_real else layout.scale  # floating-point numbers are not scaled
    number_bytes = layout.bytes_per_number
    if layout.end_offset > file_size:
        n_complete = max(0, (file_size - layout.start_offset) // max(frame_size, 1))
        raise TakeError(f"the file is cut: of {n_frames:,} frames {n_complete:,} are there", path)
    has_rate = math.isfinite(rate) and rate > 0
    metres = metres_of(parameter_text(parameter_values, "POINT", "UNITS").replace("\0", " "))

    def blocks() -> Iterator[Floats]:
        with open_take(path) as open_file:
            open_file.seek(layout.start_offset)
            frames_left, frames_max = (
                n_frames,
                max(1, BLOCK_NUMBERS_MAX * number_bytes // max(frame_size, 1)),
            )
            while frames_left:
                block_bytes = open_file.read(frame_size * min(frames_left, frames_max))
                if len(block_bytes) != frame_size * min(frames_left, frames_max):
                    raise TakeError("the file is shorter than its header says", path)
                frames_left -= len(block_bytes) // frame_size
                yield (
                    _point_positions(
                        block_bytes,
                        len(block_bytes) // frame_size,
                        n_points,
                        number_format,
                        is_real,
                    )
                    * factor
                )

    labels = _point_names(parameter_values, n_points)
    passed_over = [f"{layout.n_analog:,} analog values a frame"] if layout.n_analog else []
    if groups := sorted({group for group, _ in parameter_values if group} - _READ_GROUPS):
        passed_over.append(f"parameters of {', '.join(groups)}")
    motion = Motion(
        labels, n_frames, rate if has_rate else None, metres, blocks, note, tuple(passed_over)
    )
    return check_size(motion, path)


def _point_positions(
    block_bytes: bytes, n_frames: int, n_points: int, number_format: NumberFormat, is_real: bool
) -> Floats:
    """Positions (n, points, 3); NaN if the fourth word of a point is negative."""
    if is_real:
        frame_numbers = number_format.reals(block_bytes)
    else:
        frame_numbers = np.frombuffer(block_bytes, f"{number_format.byte_order}i2").astype(
            np.float64
        )
    points_by_frame = frame_numbers.reshape(n_frames, -1)[:, : 4 * n_points].reshape(
        n_frames, n_points, 4
    )
    return np.where(points_by_frame[:, :, 3:] < 0, np.nan, points_by_frame[:, :, :3])


def _point_names(parameter_values: ParameterValues, n: int) -> tuple[str, ...]:
    """Names of points, (n,)."""
    point_names: list[str] = []
    label_index = 1
    while (
        label_key := ("POINT", "LABELS" if label_index == 1 else f"LABELS{label_index}")
    ) in parameter_values:
        _, dimensions, _ = parameter_values[label_key]
        text, width = (
            parameter_text(parameter_values, *label_key),
            max(1, dimensions[0] if dimensions else 1),
        )
        point_names += [text[i : i + width].strip(" \0") for i in range(0, len(text), width)]
        label_index += 1
    return unique_names([*point_names, *[""] * n][:n])
