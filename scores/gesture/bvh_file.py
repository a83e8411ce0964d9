"""BVH files (Biovision): a skeleton, and the rotations of its joints in each frame.

Positions of joints in space follow from rotating each about its parent (Meredith & Maddock,
Motion Capture File Formats Explained, University of Sheffield, 2001, 2.1). A position channel
replaces that component of the joint's offset. Lengths have no unit.
"""

from __future__ import annotations

import io
import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ergon.scores.gesture.motion import BLOCK, Motion, judged, unique_names
from ergon.scores.gesture.take_file import (
    MAX_CHANNELS,
    MAX_SAMPLES,
    Floats,
    TakeError,
    lines,
    opened,
)

_CHANNELS = tuple(f"{axis}{what}" for what in ("position", "rotation") for axis in "XYZ")
_HIGH = 1e6  # largest length or angle in an intact file


@dataclass(slots=True)
class _Joint:
    """A joint: its name, the index of its parent, its offset, and its channels in a row of
    numbers.
    """

    name: str
    parent: int | None
    offset: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    channels: list[tuple[int, int]] = field(default_factory=list)  # kind of channel, column


class _Text:
    """Reads the lines of a BVH file as words, and keeps the line number."""

    def __init__(self, file: io.TextIOWrapper, path: Path) -> None:
        self._lines = lines(file, path)
        self._path = path
        self.number = 0

    def words(self) -> list[str]:
        """The words of the next line that is not empty."""
        self.number, line = next(self._lines, (self.number, ""))
        return line.split()

    def wrong(self, message: str) -> TakeError:
        return TakeError(message, self._path, self.number or None)

    def numbers(self, words: list[str], count: int, what: str) -> list[float]:
        try:
            values = [float(word) for word in words]
        except ValueError:
            values = []
        if len(values) != count or not all(abs(value) <= _HIGH for value in values):
            raise self.wrong(f"{what} must be {count:,} numbers")
        return values


def read(path: Path) -> Motion:
    """The motion in a BVH file: its joints, and the ends of its limbs. Raises TakeError,
    OSError.
    """
    with io.TextIOWrapper(opened(path), encoding="utf-8-sig", errors="replace") as file:
        text = _Text(file, path)
        joints, n_channels = _hierarchy(text)
        n, rate = _motion(text)
        at = text.number

    def blocks() -> Iterator[Floats]:
        most = max(1, BLOCK // max(n_channels, 3 * len(joints)))
        with io.TextIOWrapper(opened(path), encoding="utf-8-sig", errors="replace") as file:
            text = _Text(file, path)
            while text.number < at:
                text.words()
            left = n
            while left:
                rows = []
                for _ in range(min(left, most)):
                    if not (words := text.words()):
                        raise TakeError("the file has fewer frames than it says", path)
                    rows.append(text.numbers(words, n_channels, "a frame"))
                left -= len(rows)
                yield _places(joints, np.array(rows).reshape(len(rows), n_channels))

    return judged(Motion(unique_names([j.name for j in joints]), n, rate, None, blocks), path)


def _hierarchy(text: _Text) -> tuple[list[_Joint], int]:
    """The joints, parents first, and how many numbers a frame has."""
    if text.words() != ["HIERARCHY"]:
        raise text.wrong("this is not a BVH file")
    joints: list[_Joint] = []
    above: list[int] = []  # joints whose braces are open
    opening, n_channels = False, 0
    while (words := text.words()) != ["MOTION"]:
        match words:
            case ["ROOT" | "JOINT", *name] if (words[0] == "ROOT") == (not above) and not opening:
                joints.append(_Joint(" ".join(name), above[-1] if above else None))
                opening = words[-1] != "{"
                if not opening:
                    joints[-1].name = " ".join(name[:-1])
                    above.append(len(joints) - 1)
            case ["End", _, *brace] if above and not opening:
                joints.append(_Joint(f"{joints[above[-1]].name} end", above[-1]))
                opening = brace != ["{"]
                if not opening:
                    above.append(len(joints) - 1)
            case ["{"] if opening:
                above.append(len(joints) - 1)
                opening = False
            case ["}"] if above and not opening:
                above.pop()
            case ["OFFSET", *numbers] if above:
                joints[above[-1]].offset = text.numbers(numbers, 3, "an offset")
            case ["CHANNELS", count, *names] if above and not opening:
                if count != str(len(names)) or not set(names) <= set(_CHANNELS):
                    raise text.wrong(f"channels are a count and names of {', '.join(_CHANNELS)}")
                own = joints[above[-1]].channels
                own += [(_CHANNELS.index(name), n_channels + i) for i, name in enumerate(names)]
                n_channels += len(names)
            case _:
                raise text.wrong("this line is out of place in a BVH file")
        if len(joints) > MAX_CHANNELS or n_channels > 6 * MAX_CHANNELS:
            raise text.wrong(f"the file has more than {MAX_CHANNELS:,} points")
    if above or opening:
        raise text.wrong("a brace is not closed before MOTION")
    return joints, n_channels


def _motion(text: _Text) -> tuple[int, float]:
    """The number of frames, and the frame rate [Hz]."""
    frames = text.words()
    if frames[:1] != ["Frames:"] or len(frames) != 2 or not frames[1].isdecimal():
        raise text.wrong("after MOTION comes `Frames:` and their number")
    if len(frames[1]) > 9 or int(frames[1]) > MAX_SAMPLES:
        raise text.wrong(f"the file has more than {MAX_SAMPLES:,} samples")
    words = text.words()
    if words[:2] != ["Frame", "Time:"]:
        raise text.wrong("after `Frames:` comes `Frame Time:` and seconds")
    (period,) = text.numbers(words[2:], 1, "the time of a frame")
    if not period > 1e-6:
        raise text.wrong("the time of a frame must be above a microsecond")
    return int(frames[1]), 1 / period


def _places(joints: list[_Joint], rows: Floats) -> Floats:
    """Positions of the joints in each frame, (frames, joints, 3)."""
    n = len(rows)
    places, turns = np.empty((n, len(joints), 3)), np.empty((len(joints), n, 3, 3))
    for i, joint in enumerate(joints):
        own = np.tile(np.array(joint.offset), (n, 1))
        turn = np.tile(np.eye(3), (n, 1, 1))
        for kind, column in joint.channels:
            if kind < 3:
                own[:, kind] = rows[:, column]
            else:
                turn = turn @ _turned(kind - 3, rows[:, column])
        if joint.parent is None:
            places[:, i], turns[i] = own, turn
        else:
            about = turns[joint.parent]
            places[:, i] = places[:, joint.parent] + np.einsum("nij,nj->ni", about, own)
            turns[i] = about @ turn
    return places


def _turned(axis: int, degrees: Floats) -> Floats:
    """Rotations about an axis, (n, 3, 3)."""
    angle = degrees * (math.pi / 180)
    j, k = (axis + 1) % 3, (axis + 2) % 3
    turn = np.zeros((len(angle), 3, 3))
    turn[:, axis, axis] = 1.0
    turn[:, j, j] = turn[:, k, k] = np.cos(angle)
    turn[:, k, j] = np.sin(angle)
    turn[:, j, k] = -turn[:, k, j]
    return turn
