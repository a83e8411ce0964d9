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

from ergon.scores.gesture.motion import BLOCK, Motion, judged, metres_of, unique_names
from ergon.scores.gesture.take_file import Floats, TakeError, opened

_SECTOR = 512
_DEC = 85
_ORDERS = {84: "<", _DEC: "<", 86: ">"}  # Intel, DEC, MIPS
_MANY = 0xFFFF  # largest frame number of the header
_SIZES = {-1: 1, 1: 1, 2: 2, 4: 4}  # of a parameter's numbers, by its type
_READ = {"POINT", "TRIAL"}  # groups of parameters
_PARAMETERS_MAX = 1 << 17  # bytes: 255 sectors

_Value = tuple[int, tuple[int, ...], bytes]  # type, dimensions, bytes


class _Numbers:
    """Numbers as the processor of a file writes them."""

    def __init__(self, processor: int) -> None:
        self.order = _ORDERS[processor]
        self._is_dec = processor == _DEC

    def word(self, data: bytes, offset: int) -> int:
        """16 bits without a sign."""
        value: int = struct.unpack_from(f"{self.order}H", data, offset)[0]
        return value

    def real(self, data: bytes, offset: int) -> float:
        return float(self.reals(data[offset : offset + 4])[0])

    def reals(self, data: bytes) -> Floats:
        """Numbers of 32 bits. In DEC's format the two halves are swapped, and the value is four
        times as large.
        """
        if self._is_dec:
            halves = np.frombuffer(data, "<u2").reshape(-1, 2)[:, ::-1]
            return np.ascontiguousarray(halves).view("<f4")[:, 0].astype(np.float64) / 4
        return np.frombuffer(data, f"{self.order}f4").astype(np.float64)


@dataclass(frozen=True, slots=True)
class _Layout:
    """How many points and analog values a frame has, how many frames there are, and the scale,
    which is negative for 32-bit numbers.
    """

    n_points: int
    n_analog: int
    n: int
    scale: float

    @property
    def is_real(self) -> bool:
        return self.scale < 0

    @property
    def width(self) -> int:
        """Bytes of a number."""
        return 4 if self.is_real else 2

    @property
    def frame(self) -> int:
        """Bytes of a frame."""
        return self.width * (4 * self.n_points + self.n_analog)

    @property
    def meaning(self) -> tuple[int, int, bool]:
        """What decides where each position lies."""
        return self.n_points, self.n_analog, self.is_real


def _layouts(
    head: bytes, values: dict[tuple[str, str], _Value], numbers: _Numbers
) -> list[_Layout]:
    """The layouts that the header and the parameters state, that of the header first.

    Samples a frame times ANALOG:USED is the number of analog values (C3D.org, 2008, "Analog
    data"); some writers state only a part of it in the header.
    """

    def finite_number(group: str, name: str) -> float | None:
        value = _number(values, group, name, numbers)
        return value if value is not None and math.isfinite(value) and value >= 0 else None

    n = _frames(numbers.word(head, 6), numbers.word(head, 8), values, numbers)
    header = _Layout(numbers.word(head, 2), numbers.word(head, 4), n, numbers.real(head, 12))
    points, analog, frames = [header.n_points], [header.n_analog], [n]
    if (used := finite_number("POINT", "USED")) is not None:
        points.append(int(used) & _MANY)
    if (used := finite_number("ANALOG", "USED")) is not None:
        rates = finite_number("ANALOG", "RATE"), finite_number("POINT", "RATE")
        analog.append(int(used) * numbers.word(head, 18))
        if rates[0] and rates[1]:
            analog.append(int(used) * min(round(rates[0] / rates[1]), _MANY))
    if total := finite_number("POINT", "FRAMES"):
        frames.append(int(total))
    scales = [header.scale]
    scale = _number(values, "POINT", "SCALE", numbers)
    if scale is not None and math.isfinite(scale) and scale * header.scale < 0:
        scales.append(scale)
    candidates = itertools.product(points, analog, frames, scales)
    return list(dict.fromkeys([header, *itertools.starmap(_Layout, candidates)]))


def _fitting(layouts: list[_Layout], file: BufferedReader, start: int, path: Path) -> _Layout:
    """The layout that fills the file up to its last sector. Raises TakeError."""
    if len({layout.meaning for layout in layouts}) == 1:
        return layouts[0]
    size = os.fstat(file.fileno()).st_size

    def left_over(layout: _Layout) -> int:
        return size - start - layout.n * layout.frame

    def is_followed_by_zeros(layout: _Layout) -> bool:
        file.seek(size - left_over(layout))
        return not any(file.read(_SECTOR))

    fits = [layout for layout in layouts if 0 <= left_over(layout) < _SECTOR]
    if len({layout.meaning for layout in fits}) > 1:
        fits = [layout for layout in fits if is_followed_by_zeros(layout)]
    if len({layout.meaning for layout in fits}) == 1:
        return fits[0]
    stated = " or ".join(
        dict.fromkeys(
            f"{each.n_points} points with {each.n_analog} analog values" for each in layouts
        )
    )
    count = "several of them fit" if fits else "none of them fits"
    raise TakeError(
        f"its header and its parameters disagree: a frame has {stated}, and {count} "
        "the length of the file; write it anew with the program that captured it",
        path,
    )


def read(path: Path) -> Motion:
    """The motion in a C3D file. Raises TakeError and OSError."""
    with opened(path) as file:
        size = os.fstat(file.fileno()).st_size
        head = file.read(_SECTOR)
        if len(head) < _SECTOR or head[1] != 0x50 or not head[0]:
            raise TakeError("this is not a C3D file", path)
        numbers, values = _parameters(file, _SECTOR * (head[0] - 1), path)
        rate = _number(values, "POINT", "RATE", numbers) or numbers.real(head, 20)
        start = _SECTOR * (numbers.word(head, 16) - 1)
        header, *others = _layouts(head, values, numbers)
        if not math.isfinite(header.scale) or not header.scale or start < _SECTOR or header.n < 0:
            raise TakeError("this is not a C3D file that can be read: its header is damaged", path)
        layout = _fitting([header, *others], file, start, path)
    n_points, n, is_real, frame = layout.n_points, layout.n, layout.is_real, layout.frame
    # POINT:SCALE repeats the header's scale; floating-point numbers are not scaled.
    factor = 1.0 if is_real else layout.scale
    width = layout.width
    if start + n * frame > size:
        n_complete = max(0, (size - start) // frame)
        raise TakeError(f"the file is cut: of {n:,} frames {n_complete:,} are there", path)
    is_rate = math.isfinite(rate) and rate > 0
    metres = metres_of(_text(values, "POINT", "UNITS").replace("\0", " "))

    def blocks() -> Iterator[Floats]:
        with opened(path) as file:
            file.seek(start)
            frames_left, frames_max = n, max(1, BLOCK * width // max(frame, 1))
            while frames_left:
                data = file.read(frame * min(frames_left, frames_max))
                if len(data) != frame * min(frames_left, frames_max):
                    raise TakeError("the file is shorter than its header says", path)
                frames_left -= len(data) // frame
                yield _places(data, len(data) // frame, n_points, numbers, is_real) * factor

    labels = _labels(values, n_points)
    passed_over = [f"{layout.n_analog:,} analog values a frame"] if layout.n_analog else []
    if groups := sorted({group for group, _ in values if group} - _READ):
        passed_over.append(f"parameters of {', '.join(groups)}")
    motion = Motion(labels, n, rate if is_rate else None, metres, blocks, None, tuple(passed_over))
    return judged(motion, path)


def _places(data: bytes, n: int, n_points: int, numbers: _Numbers, is_real: bool) -> Floats:
    """Positions (n, points, 3); NaN if the fourth word of a point is negative."""
    if is_real:
        words = numbers.reals(data)
    else:
        words = np.frombuffer(data, f"{numbers.order}i2").astype(np.float64)
    points_by_frame = words.reshape(n, -1)[:, : 4 * n_points].reshape(n, n_points, 4)
    return np.where(points_by_frame[:, :, 3:] < 0, np.nan, points_by_frame[:, :, :3])


def _parameters(
    file: BufferedReader, position: int, path: Path
) -> tuple[_Numbers, dict[tuple[str, str], _Value]]:
    """Parameters by the names of their groups and their own."""
    file.seek(position)
    data = file.read(_PARAMETERS_MAX)
    if len(data) < 4 or data[3] not in _ORDERS:
        raise TakeError("this is not a C3D file that can be read: no parameters", path)
    numbers = _Numbers(data[3])
    groups: dict[int, str] = {}
    rows_found: list[tuple[int, str, _Value]] = []
    position = 4
    while position + 2 < len(data):
        # A negative length of the name locks a parameter; a negative number makes it a group.
        length, group = abs(struct.unpack_from("b", data, position)[0]), data[position + 1]
        position += 2
        name = data[position : position + length].decode("ascii", "replace").upper()
        position += length
        if not length or position + 2 > len(data):
            break
        offset = numbers.word(data, position)
        if group >= 0x80:
            groups[0x100 - group] = name
        elif (value := _value(data, position + 2)) is not None:
            rows_found.append((group, name, value))
        if not offset:
            break
        position += offset
    return numbers, {(groups.get(group, ""), name): value for group, name, value in rows_found}


def _value(data: bytes, offset: int) -> _Value | None:
    """The parameter that begins at an offset; None if it is damaged."""
    if offset + 2 > len(data):
        return None
    kind, n_dimensions = struct.unpack_from("bB", data, offset)
    dimensions = tuple(data[offset + 2 : offset + 2 + n_dimensions])
    size = _SIZES.get(kind, 0) * math.prod(dimensions)
    offset += 2 + n_dimensions
    if kind not in _SIZES or offset + size > len(data):
        return None
    return kind, dimensions, data[offset : offset + size]


def _text(values: dict[tuple[str, str], _Value], group: str, name: str) -> str:
    kind, _, data = values.get((group, name), (0, (), b""))
    return data.decode("latin-1") if kind == -1 else ""


def _number(
    values: dict[tuple[str, str], _Value], group: str, name: str, numbers: _Numbers
) -> float | None:
    """The first number of a parameter; two 16-bit integers are one number, the frame count of a
    long file.
    """
    kind, _, data = values.get((group, name), (0, (), b""))
    if kind == 4 and len(data) >= 4:
        return numbers.real(data, 0)
    if kind == 2 and len(data) >= 4:
        return numbers.word(data, 0) + 0x10000 * numbers.word(data, 2)
    return numbers.word(data, 0) if kind == 2 and len(data) >= 2 else None


def _frames(first: int, last: int, values: dict[tuple[str, str], _Value], numbers: _Numbers) -> int:
    """The number of frames; from parameters if it is too large for the header."""
    if last == _MANY:
        begin = _number(values, "TRIAL", "ACTUAL_START_FIELD", numbers)
        end = _number(values, "TRIAL", "ACTUAL_END_FIELD", numbers)
        if begin and end and math.isfinite(begin) and math.isfinite(end):
            return int(end) - int(begin) + 1
        for name in ("LONG_FRAMES", "FRAMES"):
            n = _number(values, "POINT", name, numbers)
            if n and math.isfinite(n):
                return int(n)
    return last - first + 1


def _labels(values: dict[tuple[str, str], _Value], n: int) -> tuple[str, ...]:
    """Names of points, (n,)."""
    names: list[str] = []
    number = 1
    while (label := ("POINT", "LABELS" if number == 1 else f"LABELS{number}")) in values:
        _, dimensions, _ = values[label]
        text, width = _text(values, *label), max(1, dimensions[0] if dimensions else 1)
        names += [text[i : i + width].strip(" \0") for i in range(0, len(text), width)]
        number += 1
    return unique_names([*names, *[""] * n][:n])
