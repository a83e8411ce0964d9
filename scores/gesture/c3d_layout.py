"""Where the frames of a C3D file lie: header and parameters both say it, and may disagree.

What decides is the length of the file: frames fill it from the end of the parameters up to its last
sector. POINT:SCALE, which no length can tell, goes before the header's scale (C3D.org, 2008: the
header repeats it).
"""

from __future__ import annotations

import itertools
import math
import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from io import BufferedReader
from pathlib import Path

from ergon.scores.gesture.c3d_parameters import (
    SECTOR_BYTES,
    NumberFormat,
    ParameterValues,
    first_number,
)
from ergon.scores.gesture.take_file import TakeError

_WORD_MAX = 0xFFFF  # largest frame number of the header
_BLOCK_BYTES = 1 << 20


@dataclass(frozen=True, slots=True)
class FrameLayout:
    """Where the frames begin [bytes], how many points and analog values each has, how many there
    are, and the scale, which is negative for 32-bit numbers.
    """

    start_offset: int
    n_points: int
    n_analog: int
    n_frames: int
    scale: float

    @property
    def is_real(self) -> bool:
        """Whether the numbers have 32 bits."""
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
    def end_offset(self) -> int:
        """Where the frames end [bytes]."""
        return self.start_offset + self.n_frames * self.bytes_per_frame

    @property
    def reading(self) -> tuple[int, int, int, int, bool]:
        """What decides which positions are read."""
        return self.start_offset, self.n_points, self.n_analog, self.n_frames, self.is_real


def fitting_layout(
    header_bytes: bytes,
    parameter_values: ParameterValues,
    number_format: NumberFormat,
    parameter_ends: tuple[int, int],
    open_file: BufferedReader,
    path: Path,
) -> tuple[FrameLayout, str | None]:
    """The layout that fills the file, and a note on bytes that follow its frames. Raises TakeError.

    What header and parameters agree on is taken by its word. Where they disagree, or the frames
    would begin within the parameters, one reading must fit the length of the file.
    """
    starts = _starts(header_bytes, parameter_values, number_format)
    layouts = _layouts(starts, header_bytes, parameter_values, number_format)
    if not layouts:
        raise TakeError("this is not a C3D file that can be read: its header is damaged", path)
    used_end, section_end = parameter_ends
    parameters_start = SECTOR_BYTES * (header_bytes[0] - 1)
    stated_layouts = [
        layout for layout in layouts if not parameters_start <= layout.start_offset < used_end
    ]
    file_size = os.fstat(open_file.fileno()).st_size
    if len(layouts) == len(stated_layouts) == 1:
        return layouts[0], _note(layouts[0], file_size)
    fitting = _fitting(stated_layouts, open_file, file_size, used_end)
    if not fitting:
        behind_layouts = _layouts([section_end], header_bytes, parameter_values, number_format)
        fitting = _fitting(behind_layouts, open_file, file_size, used_end)
    if len(fitting) == 1:
        return fitting[0], None
    fit_text = "several of them fit" if fitting else "none of them fits"
    disagreement = f"its header and its parameters disagree: {_differences(layouts)}"
    if not stated_layouts:
        start_offset = layouts[0].start_offset
        disagreement = f"its frames begin at byte {start_offset:,}, within its parameters"
        fit_text = "those behind them do not fit"
    raise TakeError(
        f"{disagreement}, and {fit_text} the "
        "length of the file; write it anew with the program that captured it",
        path,
    )


def _starts(
    header_bytes: bytes, parameter_values: ParameterValues, number_format: NumberFormat
) -> list[int]:
    """Where the frames begin [bytes], by the header and by POINT:DATA_START."""
    sectors = [number_format.word(header_bytes, 16)]
    start_sector = first_number(parameter_values, "POINT", "DATA_START", number_format)
    if start_sector is not None and 2 <= start_sector <= _WORD_MAX:
        sectors.append(int(start_sector))
    return [SECTOR_BYTES * (sector - 1) for sector in dict.fromkeys(sectors) if sector >= 2]


def _layouts(
    starts: Sequence[int],
    header_bytes: bytes,
    parameter_values: ParameterValues,
    number_format: NumberFormat,
) -> list[FrameLayout]:
    """The readings that the header and the parameters state, those of the header first.

    Samples a frame times ANALOG:USED is the number of analog values (C3D.org, 2008, "Analog
    data"); some writers state only a part of it in the header.
    """

    def parameter_number(group: str, name: str) -> float | None:
        value = first_number(parameter_values, group, name, number_format)
        return value if value is not None and math.isfinite(value) and value >= 0 else None

    point_counts = [number_format.word(header_bytes, 2)]
    analog_counts = [number_format.word(header_bytes, 4)]
    if (n_points := parameter_number("POINT", "USED")) is not None:
        point_counts.append(int(n_points) & _WORD_MAX)
    if (n_analog_used := parameter_number("ANALOG", "USED")) is not None:
        rates = parameter_number("ANALOG", "RATE"), parameter_number("POINT", "RATE")
        analog_counts.append(int(n_analog_used) * number_format.word(header_bytes, 18))
        if rates[0] and rates[1]:
            analog_counts.append(int(n_analog_used) * min(round(rates[0] / rates[1]), _WORD_MAX))
    candidates = itertools.product(
        starts,
        point_counts,
        analog_counts,
        _frame_counts(header_bytes, parameter_values, number_format),
        _scales(header_bytes, parameter_values, number_format),
    )
    layouts = itertools.starmap(FrameLayout, candidates)
    return list({layout.reading: layout for layout in layouts}.values())


def _scales(
    header_bytes: bytes, parameter_values: ParameterValues, number_format: NumberFormat
) -> list[float]:
    """The scale, or two of different signs; none if the header's is no scale."""
    header_scale = number_format.real(header_bytes, 12)
    if not math.isfinite(header_scale) or not header_scale:
        return []
    scale = first_number(parameter_values, "POINT", "SCALE", number_format)
    if scale is None or not math.isfinite(scale) or not scale:
        return [header_scale]
    return [scale] if scale * header_scale > 0 else [header_scale, scale]


def _frame_counts(
    header_bytes: bytes, parameter_values: ParameterValues, number_format: NumberFormat
) -> list[int]:
    """The numbers of frames that the header and the parameters state.

    65,535 is what a field of 16 bits says of all longer files.
    """
    first_frame, last_frame = (number_format.word(header_bytes, place) for place in (6, 8))
    counts: list[float] = [last_frame - first_frame + 1]
    for name in ("FRAMES", "LONG_FRAMES"):
        if n_frames := first_number(parameter_values, "POINT", name, number_format):
            counts.append(n_frames)
    ends = [
        first_number(parameter_values, "TRIAL", f"ACTUAL_{end}_FIELD", number_format)
        for end in ("START", "END")
    ]
    if ends[0] and ends[1]:
        counts.append(ends[1] - ends[0] + 1)
    frame_counts = [int(count) for count in counts if math.isfinite(count) and count >= 0]
    if last_frame == _WORD_MAX and max(frame_counts, default=0) > _WORD_MAX:
        frame_counts = [count for count in frame_counts if count > _WORD_MAX]
    return list(dict.fromkeys(frame_counts))


def _fitting(
    layouts: Iterable[FrameLayout], open_file: BufferedReader, file_size: int, parameters_end: int
) -> list[FrameLayout]:
    """The layouts that end in the last sector; of several, those beside which only zeros lie."""
    fitting = [layout for layout in layouts if 0 <= file_size - layout.end_offset < SECTOR_BYTES]
    if len(fitting) > 1:
        fitting = [
            layout
            for layout in fitting
            if _is_zero(open_file, layout.end_offset, file_size)
            and _is_zero(open_file, parameters_end, layout.start_offset)
        ]
    return fitting


def _is_zero(open_file: BufferedReader, start_offset: int, end_offset: int) -> bool:
    """Whether only zeros lie between two places of a file."""
    open_file.seek(start_offset)
    for offset in range(start_offset, end_offset, _BLOCK_BYTES):
        if any(open_file.read(min(_BLOCK_BYTES, end_offset - offset))):
            return False
    return True


def _note(layout: FrameLayout, file_size: int) -> str | None:
    """What follows the frames that a file states, beyond its last sector; None for nothing."""
    bytes_left = file_size - layout.end_offset
    if bytes_left < SECTOR_BYTES:
        return None
    n_more = bytes_left // layout.bytes_per_frame if layout.bytes_per_frame else 0
    return (
        f"behind the {layout.n_frames:,} frames that it states {bytes_left:,} bytes follow, "
        f"as many as {n_more:,} frames have; they are not read"
    )


def _differences(layouts: Sequence[FrameLayout]) -> str:
    """What readings say of the frames, where they differ."""
    kinds = dict.fromkeys(
        f"{layout.n_points} points with {layout.n_analog} analog values" for layout in layouts
    )
    counts = dict.fromkeys(f"{layout.n_frames:,}" for layout in layouts)
    starts = dict.fromkeys(f"{layout.start_offset:,}" for layout in layouts)
    texts = [f"there are {' or '.join(counts)} frames"] if len(counts) > 1 else []
    texts += [f"they begin at byte {' or '.join(starts)}"] if len(starts) > 1 else []
    texts += [f"a frame has {' or '.join(kinds)}"] if len(kinds) > 1 or not texts else []
    return "; ".join(texts)
