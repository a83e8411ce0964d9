"""C3D files of motion capture: their points (The C3D File Format, C3D.org, 2008).

A header of 512 bytes, parameters in groups, then frames: four words for each point, and samples
of analog channels, which are skipped. Numbers have 16 or 32 bits, in the format of one of three
processors.
"""

from __future__ import annotations

import itertools
import math
import os
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from io import BufferedReader
from pathlib import Path

import numpy as np

from ergon.scores.gesture.motion import (
    BLOCK_NUMBERS_MAX,
    Motion,
    check_size,
    metres_of,
    unique_names,
)
from ergon.scores.gesture.take_file import Floats, TakeError, open_take

_SECTOR_BYTES = 512
_DEC_PROCESSOR = 85
_BYTE_ORDER_BY_PROCESSOR = {84: "<", _DEC_PROCESSOR: "<", 86: ">"}  # Intel, DEC, MIPS
_HEADER_FRAMES_MAX = 0xFFFF  # largest frame number of the header
_BYTES_BY_TYPE = {-1: 1, 1: 1, 2: 2, 4: 4}  # bytes of a parameter's number, by type
_READ_GROUPS = {"POINT", "TRIAL"}  # groups of parameters
_PARAMETER_BYTES_MAX = 1 << 17  # bytes: 255 sectors

_Parameter = tuple[int, tuple[int, ...], bytes]  # type, dimensions, bytes


class _NumberFormat:
    """Numbers as the processor of a file writes them."""

    def __init__(self, processor: int) -> None:
        self.byte_order = _BYTE_ORDER_BY_PROCESSOR[processor]
        self._is_dec = processor == _DEC_PROCESSOR

    def read_word(self, data: bytes, offset: int) -> int:
        """16 bits without a sign."""
        value: int = struct.unpack_from(f"{self.byte_order}H", data, offset)[0]
        return value

    def read_real(self, data: bytes, offset: int) -> float:
        return float(self.read_reals(data[offset : offset + 4])[0])

    def read_reals(self, data: bytes) -> Floats:
        """Numbers of 32 bits. In DEC's format the two halves are swapped, and the value is four
        times as large.
        """
        if self._is_dec:
            halves = np.frombuffer(data, "<u2").reshape(-1, 2)[:, ::-1]
            return np.ascontiguousarray(halves).view("<f4")[:, 0].astype(np.float64) / 4
        return np.frombuffer(data, f"{self.byte_order}f4").astype(np.float64)


@dataclass(frozen=True, slots=True)
class _FrameLayout:
    """How many points and analog values a frame has, how many frames there are, and the scale,
    which is negative for 32-bit numbers.
    """

    n_points: int
    n_analog: int
    n_frames: int
    scale: float

    @property
    def is_real(self) -> bool:
        return self.scale < 0

    @property
    def bytes_per_number(self) -> int:
        """Bytes of a number."""
        return 4 if self.is_real else 2

    @property
    def bytes_per_frame(self) -> int:
        """Bytes of a frame."""
        return self.bytes_per_number * (4 * self.n_points + self.n_analog)

    @property
    def position_layout(self) -> tuple[int, int, bool]:
        """What decides where each position lies."""
        return self.n_points, self.n_analog, self.is_real


def _layouts(
    header_bytes: bytes,
    parameter_values: dict[tuple[str, str], _Parameter],
    number_format: _NumberFormat,
) -> list[_FrameLayout]:
    """The layouts that the header and the parameters state, that of the header first.

    Samples a frame times ANALOG:USED is the number of analog values (C3D.org, 2008, "Analog
    data"); some writers state only a part of it in the header.
    """

    def parameter_number(group: str, name: str) -> float | None:
        value = _first_number(parameter_values, group, name, number_format)
        return value if value is not None and math.isfinite(value) and value >= 0 else None

    frame_count = _frame_count(
        number_format.read_word(header_bytes, 6),
        number_format.read_word(header_bytes, 8),
        parameter_values,
        number_format,
    )
    header = _FrameLayout(
        number_format.read_word(header_bytes, 2),
        number_format.read_word(header_bytes, 4),
        frame_count,
        number_format.read_real(header_bytes, 12),
    )
    point_counts, analog_counts, frame_counts = [header.n_points], [header.n_analog], [frame_count]
    if (n_points := parameter_number("POINT", "USED")) is not None:
        point_counts.append(int(n_points) & _HEADER_FRAMES_MAX)
    if (n_analog_used := parameter_number("ANALOG", "USED")) is not None:
        analog_and_point_rates = (
            parameter_number("ANALOG", "RATE"),
            parameter_number("POINT", "RATE"),
        )
        analog_counts.append(int(n_analog_used) * number_format.read_word(header_bytes, 18))
        if analog_and_point_rates[0] and analog_and_point_rates[1]:
            analog_counts.append(
                int(n_analog_used)
                * min(
                    round(analog_and_point_rates[0] / analog_and_point_rates[1]), _HEADER_FRAMES_MAX
                )
            )
    if n_frames := parameter_number("POINT", "FRAMES"):
        frame_counts.append(int(n_frames))
    scales = [header.scale]
    scale = _first_number(parameter_values, "POINT", "SCALE", number_format)
    if scale is not None and math.isfinite(scale) and scale * header.scale < 0:
        scales.append(scale)
    candidates = itertools.product(point_counts, analog_counts, frame_counts, scales)
    return list(dict.fromkeys([header, *itertools.starmap(_FrameLayout, candidates)]))


def _fitting_layout(
    layouts: list[_FrameLayout], open_file: BufferedReader, start_offset: int, path: Path
) -> _FrameLayout:
    """The layout that fills the file up to its last sector. Raises TakeError."""
    if len({layout.position_layout for layout in layouts}) == 1:
        return layouts[0]
    file_size = os.fstat(open_file.fileno()).st_size

    def bytes_left(layout: _FrameLayout) -> int:
        return file_size - start_offset - layout.n_frames * layout.bytes_per_frame

    def is_followed_by_zeros(layout: _FrameLayout) -> bool:
        open_file.seek(file_size - bytes_left(layout))
        return not any(open_file.read(_SECTOR_BYTES))

    fitting_layouts = [layout for layout in layouts if 0 <= bytes_left(layout) < _SECTOR_BYTES]
    if len({layout.position_layout for layout in fitting_layouts}) > 1:
        fitting_layouts = [layout for layout in fitting_layouts if is_followed_by_zeros(layout)]
    if len({layout.position_layout for layout in fitting_layouts}) == 1:
        return fitting_layouts[0]
    layouts_text = " or ".join(
        dict.fromkeys(
            f"{layout.n_points} points with {layout.n_analog} analog values" for layout in layouts
        )
    )
    fit_text = "several of them fit" if fitting_layouts else "none of them fits"
    raise TakeError(
        f"its header and its parameters disagree: a frame has {layouts_text}, and {fit_text} "
        "the length of the file; write it anew with the program that captured it",
        path,
    )


def read(path: Path) -> Motion:
    """The motion in a C3D file. Raises TakeError and OSError."""
    with open_take(path) as open_file:
        file_size = os.fstat(open_file.fileno()).st_size
        header_bytes = open_file.read(_SECTOR_BYTES)
        if len(header_bytes) < _SECTOR_BYTES or header_bytes[1] != 0x50 or not header_bytes[0]:
            raise TakeError("this is not a C3D file", path)
        number_format, parameter_values = _parameters(
            open_file, _SECTOR_BYTES * (header_bytes[0] - 1), path
        )
        rate = _first_number(
            parameter_values, "POINT", "RATE", number_format
        ) or number_format.read_real(header_bytes, 20)
        start_offset = _SECTOR_BYTES * (number_format.read_word(header_bytes, 16) - 1)
        header, *other_layouts = _layouts(header_bytes, parameter_values, number_format)
        if (
            not math.isfinite(header.scale)
            or not header.scale
            or start_offset < _SECTOR_BYTES
            or header.n_frames < 0
        ):
            raise TakeError("this is not a C3D file that can be read: its header is damaged", path)
        layout = _fitting_layout([header, *other_layouts], open_file, start_offset, path)
    n_points, n_frames, is_real, bytes_per_frame = (
        layout.n_points,
        layout.n_frames,
        layout.is_real,
        layout.bytes_per_frame,
    )
    # POINT:SCALE repeats the header's scale; floating-point numbers are not scaled.
    factor = 1.0 if is_real else layout.scale
    number_bytes = layout.bytes_per_number
    if start_offset + n_frames * bytes_per_frame > file_size:
        n_complete = max(0, (file_size - start_offset) // bytes_per_frame)
        raise TakeError(f"the file is cut: of {n_frames:,} frames {n_complete:,} are there", path)
    has_rate = math.isfinite(rate) and rate > 0
    metres = metres_of(_parameter_text(parameter_values, "POINT", "UNITS").replace("\0", " "))

    def blocks() -> Iterator[Floats]:
        with open_take(path) as open_file:
            open_file.seek(start_offset)
            frames_left, frames_max = (
                n_frames,
                max(1, BLOCK_NUMBERS_MAX * number_bytes // max(bytes_per_frame, 1)),
            )
            while frames_left:
                block_bytes = open_file.read(bytes_per_frame * min(frames_left, frames_max))
                if len(block_bytes) != bytes_per_frame * min(frames_left, frames_max):
                    raise TakeError("the file is shorter than its header says", path)
                frames_left -= len(block_bytes) // bytes_per_frame
                yield (
                    _point_positions(
                        block_bytes,
                        len(block_bytes) // bytes_per_frame,
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
        labels, n_frames, rate if has_rate else None, metres, blocks, None, tuple(passed_over)
    )
    return check_size(motion, path)


def _point_positions(
    block_bytes: bytes, n_frames: int, n_points: int, number_format: _NumberFormat, is_real: bool
) -> Floats:
    """Positions (n, points, 3); NaN if the fourth word of a point is negative."""
    if is_real:
        frame_numbers = number_format.read_reals(block_bytes)
    else:
        frame_numbers = np.frombuffer(block_bytes, f"{number_format.byte_order}i2").astype(
            np.float64
        )
    points_by_frame = frame_numbers.reshape(n_frames, -1)[:, : 4 * n_points].reshape(
        n_frames, n_points, 4
    )
    return np.where(points_by_frame[:, :, 3:] < 0, np.nan, points_by_frame[:, :, :3])


def _parameters(
    open_file: BufferedReader, parameters_start: int, path: Path
) -> tuple[_NumberFormat, dict[tuple[str, str], _Parameter]]:
    """Parameters by the names of their groups and their own."""
    open_file.seek(parameters_start)
    section_bytes = open_file.read(_PARAMETER_BYTES_MAX)
    if len(section_bytes) < 4 or section_bytes[3] not in _BYTE_ORDER_BY_PROCESSOR:
        raise TakeError("this is not a C3D file that can be read: no parameters", path)
    number_format = _NumberFormat(section_bytes[3])
    group_names: dict[int, str] = {}
    parameter_rows: list[tuple[int, str, _Parameter]] = []
    cursor = 4
    while cursor + 2 < len(section_bytes):
        # A negative length of the name locks a parameter; a negative number makes it a group.
        name_length, group_number = (
            abs(struct.unpack_from("b", section_bytes, cursor)[0]),
            section_bytes[cursor + 1],
        )
        cursor += 2
        parameter_name = (
            section_bytes[cursor : cursor + name_length].decode("ascii", "replace").upper()
        )
        cursor += name_length
        if not name_length or cursor + 2 > len(section_bytes):
            break
        entry_distance = number_format.read_word(section_bytes, cursor)
        if group_number >= 0x80:
            group_names[0x100 - group_number] = parameter_name
        elif (value := _read_parameter(section_bytes, cursor + 2)) is not None:
            parameter_rows.append((group_number, parameter_name, value))
        if not entry_distance:
            break
        cursor += entry_distance
    return number_format, {
        (group_names.get(group, ""), name): value for group, name, value in parameter_rows
    }


def _read_parameter(parameter_bytes: bytes, byte_offset: int) -> _Parameter | None:
    """The parameter that begins at an offset; None if it is damaged."""
    if byte_offset + 2 > len(parameter_bytes):
        return None
    number_type, n_dimensions = struct.unpack_from("bB", parameter_bytes, byte_offset)
    dimensions = tuple(parameter_bytes[byte_offset + 2 : byte_offset + 2 + n_dimensions])
    n_bytes = _BYTES_BY_TYPE.get(number_type, 0) * math.prod(dimensions)
    byte_offset += 2 + n_dimensions
    if number_type not in _BYTES_BY_TYPE or byte_offset + n_bytes > len(parameter_bytes):
        return None
    return number_type, dimensions, parameter_bytes[byte_offset : byte_offset + n_bytes]


def _parameter_text(values: dict[tuple[str, str], _Parameter], group: str, name: str) -> str:
    kind, _, data = values.get((group, name), (0, (), b""))
    return data.decode("latin-1") if kind == -1 else ""


def _first_number(
    parameter_values: dict[tuple[str, str], _Parameter],
    group_name: str,
    parameter_name: str,
    number_format: _NumberFormat,
) -> float | None:
    """The first number of a parameter; two 16-bit integers are one number, the frame count of a
    long file.
    """
    number_type, _, value_bytes = parameter_values.get((group_name, parameter_name), (0, (), b""))
    if number_type == 4 and len(value_bytes) >= 4:
        return number_format.read_real(value_bytes, 0)
    if number_type == 2 and len(value_bytes) >= 4:
        return number_format.read_word(value_bytes, 0) + 0x10000 * number_format.read_word(
            value_bytes, 2
        )
    return (
        number_format.read_word(value_bytes, 0)
        if number_type == 2 and len(value_bytes) >= 2
        else None
    )


def _frame_count(
    first_frame: int,
    last_frame: int,
    parameter_values: dict[tuple[str, str], _Parameter],
    number_format: _NumberFormat,
) -> int:
    """The number of frames; from parameters if it is too large for the header."""
    if last_frame == _HEADER_FRAMES_MAX:
        start_field = _first_number(parameter_values, "TRIAL", "ACTUAL_START_FIELD", number_format)
        end_field = _first_number(parameter_values, "TRIAL", "ACTUAL_END_FIELD", number_format)
        if start_field and end_field and math.isfinite(start_field) and math.isfinite(end_field):
            return int(end_field) - int(start_field) + 1
        for name in ("LONG_FRAMES", "FRAMES"):
            frame_count = _first_number(parameter_values, "POINT", name, number_format)
            if frame_count and math.isfinite(frame_count):
                return int(frame_count)
    return last_frame - first_frame + 1


def _point_names(
    parameter_values: dict[tuple[str, str], _Parameter], n_points: int
) -> tuple[str, ...]:
    """Names of points, (n,)."""
    point_names: list[str] = []
    label_index = 1
    while (
        label_key := ("POINT", "LABELS" if label_index == 1 else f"LABELS{label_index}")
    ) in parameter_values:
        _, dimensions, _ = parameter_values[label_key]
        text, width = (
            _parameter_text(parameter_values, *label_key),
            max(1, dimensions[0] if dimensions else 1),
        )
        point_names += [text[i : i + width].strip(" \0") for i in range(0, len(text), width)]
        label_index += 1
    return unique_names([*point_names, *[""] * n_points][:n_points])
