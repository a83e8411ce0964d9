"""BVH files (Biovision): a skeleton, and the rotations of its joints in each frame.

Positions of joints in space follow from rotating each about its parent (Meredith & Maddock,
Motion Capture File Formats Explained, University of Sheffield, 2001, 2.1). A position channel
replaces that component of the joint's offset. Lengths have no unit. Writers lay the same words out
in other lines, and write them in other cases; both are read.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from io import TextIOWrapper
from pathlib import Path

import numpy as np

from ergon import _core
from ergon.scores.gesture.motion import BLOCK_NUMBERS_MAX, Motion, check_size, unique_names
from ergon.scores.gesture.take_file import (
    MAX_CHANNELS,
    MAX_SAMPLES,
    Floats,
    TakeError,
    content_lines,
    open_text,
)

_CHANNELS = tuple(
    f"{axis}{channel_kind}" for channel_kind in ("position", "rotation") for axis in "xyz"
)
_KEYWORDS = frozenset(["ROOT", "JOINT", "OFFSET", "CHANNELS", "MOTION"])
_BRACE_PATTERN = re.compile(r"[{}]")
_VALUE_MAX = 1e6  # largest length or angle in an intact file


@dataclass(slots=True)
class _Joint:
    """A joint: its name, the index of its parent, its offset, and its channels in a row of
    numbers.
    """

    name: str
    parent: int | None
    offset: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    channels: list[tuple[int, int]] = field(default_factory=list)  # kind of channel, column


class _WordReader:
    """The words of a BVH file, however they are laid out in lines, with the line of the last."""

    def __init__(self, file: TextIOWrapper, path: Path) -> None:
        self._lines = content_lines(file, path)
        self._path = path
        self._unread_words: list[str] = []  # unread words of the line, last word first
        self.line_number = 0

    def next_word(self) -> str:
        """The next word; empty at the end of the file."""
        while not self._unread_words:
            numbered_line = next(self._lines, None)
            if numbered_line is None:
                return ""
            self.line_number, line = numbered_line
            self._unread_words = _BRACE_PATTERN.sub(r" \g<0> ", line).split()[::-1]
        return self._unread_words.pop()

    def push_back(self, word: str) -> None:
        """Put a word back before the others."""
        self._unread_words.append(word)

    def damage_error(self, message: str, line: int | None = None) -> TakeError:
        return TakeError(message, self._path, line or self.line_number or None)

    def next_numbers(self, count: int, noun: str) -> list[float]:
        read_numbers: list[float] = []
        first_line = None
        for _ in range(count):
            word = self.next_word()
            first_line = first_line or self.line_number
            try:
                number = float(word)
            except ValueError:
                number = math.nan
            if not abs(number) <= _VALUE_MAX:
                raise self.damage_error(f"{noun} must be {count:,} numbers", first_line)
            read_numbers.append(number)
        return read_numbers


def read(path: Path) -> Motion:
    """The motion in a BVH file: its joints, and the ends of its limbs. Raises TakeError,
    OSError.
    """
    with open_text(path) as file:
        words = _WordReader(file, path)
        joints, n_channels = _read_hierarchy(words)
        frame_count, rate = _read_motion_header(words)
        n_numbers = sum(1 for _ in iter(words.next_word, ""))
    n_complete, n_extra = divmod(n_numbers, n_channels) if n_channels else (frame_count, 0)

    def blocks() -> Iterator[Floats]:
        rows_max = max(1, BLOCK_NUMBERS_MAX // max(n_channels, 3 * len(joints)))
        with open_text(path) as file:
            file_words = _WordReader(file, path)
            _read_hierarchy(file_words)
            _read_motion_header(file_words)
            rows_left = frame_count
            while rows_left:
                frame_rows = [
                    file_words.next_numbers(n_channels, "a frame")
                    for _ in range(min(rows_left, rows_max))
                ]
                rows_left -= len(frame_rows)
                yield _joint_positions(
                    joints, np.array(frame_rows).reshape(len(frame_rows), n_channels)
                )

    if n_extra:
        message = (
            f"it holds {n_numbers:,} numbers, but a frame must be {n_channels:,} numbers: a row "
        )
        raise TakeError(message + "is incomplete", path)
    if n_complete < frame_count:
        raise TakeError("the file has fewer frames than it says", path)
    file_note = None
    if n_complete > frame_count:
        file_note = (
            f"the file says {frame_count:,} frames, and {n_complete - frame_count:,} more follow, "
            "which are not read"
        )
    names = unique_names([joint.name for joint in joints])
    passed_over = ("rotations, but for where they put the joints",)
    return check_size(Motion(names, frame_count, rate, None, blocks, file_note, passed_over), path)


def _read_hierarchy(file_words: _WordReader) -> tuple[list[_Joint], int]:
    """The joints, parents first, and how many numbers a frame has."""
    if file_words.next_word().upper() != "HIERARCHY":
        raise file_words.damage_error("this is not a BVH file")
    joints: list[_Joint] = []
    open_joints: list[int] = []  # joints whose braces are open
    n_channels = 0
    while (word := file_words.next_word().upper()) != "MOTION":
        match word:
            case "ROOT" | "JOINT" if (word == "ROOT") == (not open_joints):
                joints.append(
                    _Joint(_read_name(file_words), open_joints[-1] if open_joints else None)
                )
                open_joints.append(len(joints) - 1)
            case "END" if open_joints:
                _read_name(file_words)
                joints.append(_Joint(f"{joints[open_joints[-1]].name} end", open_joints[-1]))
                open_joints.append(len(joints) - 1)
            case "}" if open_joints:
                open_joints.pop()
            case "OFFSET" if open_joints:
                joints[open_joints[-1]].offset = file_words.next_numbers(3, "an offset")
            case "CHANNELS" if open_joints:
                channels = joints[open_joints[-1]].channels
                channel_kinds = _read_channels(file_words)
                channels += [(kind, n_channels + i) for i, kind in enumerate(channel_kinds)]
                n_channels += len(channel_kinds)
            case _:
                raise file_words.damage_error("this line is out of place in a BVH file")
        if len(joints) > MAX_CHANNELS or n_channels > 6 * MAX_CHANNELS:
            raise file_words.damage_error(f"the file has more than {MAX_CHANNELS:,} points")
    if open_joints:
        raise file_words.damage_error("a brace is not closed before MOTION")
    return joints, n_channels


def _read_name(file_words: _WordReader) -> str:
    """The words before a brace that opens."""
    name_words: list[str] = []
    while (read_word := file_words.next_word()) != "{":
        if not read_word or read_word == "}" or read_word.upper() in _KEYWORDS:
            raise file_words.damage_error(
                "this line is out of place in a BVH file: a brace opens no joint"
            )
        name_words.append(read_word)
    return " ".join(name_words)


def _read_channels(file_words: _WordReader) -> list[int]:
    """The kinds of channels that a joint has."""
    count_text, line_number = file_words.next_word(), file_words.line_number
    channel_kinds: list[int] = []
    while (word := file_words.next_word().lower()) in _CHANNELS:
        channel_kinds.append(_CHANNELS.index(word))
    file_words.push_back(word)
    if count_text != str(len(channel_kinds)):
        channel_names = ", ".join(f"{name[0].upper()}{name[1:]}" for name in _CHANNELS)
        raise file_words.damage_error(
            f"channels are a count and names of {channel_names}", line_number
        )
    return channel_kinds


def _read_motion_header(file_words: _WordReader) -> tuple[int, float]:
    """The number of frames, and the frame rate [Hz]."""
    frame_count_text = _word_after_label(file_words, "frames")
    if frame_count_text is None or not frame_count_text.isdecimal():
        raise file_words.damage_error("after MOTION comes `Frames:` and their number")
    if len(frame_count_text) > 9 or int(frame_count_text) > MAX_SAMPLES:
        raise file_words.damage_error(f"the file has more than {MAX_SAMPLES:,} samples")
    period_text = _word_after_label(file_words, "frame", "time")
    if period_text is None:
        raise file_words.damage_error("after `Frames:` comes `Frame Time:` and seconds")
    file_words.push_back(period_text)
    (frame_duration,) = file_words.next_numbers(1, "the time of a frame")
    if not frame_duration > 1e-6:
        raise file_words.damage_error("the time of a frame must be above a microsecond")
    return int(frame_count_text), 1 / frame_duration


def _word_after_label(file_words: _WordReader, *label: str) -> str | None:
    """The word after a label and its colon, with or without spaces; None without the label."""
    *first_words, last_word = label
    if any(file_words.next_word().lower() != expected_word for expected_word in first_words):
        return None
    name, colon, value_text = file_words.next_word().partition(":")
    if name.lower() != last_word:
        return None
    if not colon:
        colon, value_text = (next_word := file_words.next_word())[:1], next_word[1:]
    return (value_text or file_words.next_word()) if colon == ":" else None


def _joint_positions(joints: list[_Joint], frame_rows: Floats) -> Floats:
    """Positions of the joints in each frame, (frames, joints, 3)."""
    n_frames = len(frame_rows)
    joint_positions, joint_rotations = (
        np.empty((n_frames, len(joints), 3)),
        np.empty((len(joints), n_frames, 3, 3)),
    )
    for i, joint in enumerate(joints):
        translations = np.tile(np.array(joint.offset), (n_frames, 1))
        rotations = np.tile(np.eye(3), (n_frames, 1, 1))
        for channel_kind, column_index in joint.channels:
            if channel_kind < 3:
                translations[:, channel_kind] = frame_rows[:, column_index]
            else:
                rotations = rotations @ _rotation_matrices(
                    channel_kind - 3, frame_rows[:, column_index]
                )
        if joint.parent is None:
            joint_positions[:, i], joint_rotations[i] = translations, rotations
        else:
            parent_rotations = joint_rotations[joint.parent]
            joint_positions[:, i] = joint_positions[:, joint.parent] + np.einsum(
                "nij,nj->ni", parent_rotations, translations
            )
            joint_rotations[i] = parent_rotations @ rotations
    return joint_positions


def _rotation_matrices(axis: int, degrees: Floats) -> Floats:
    """Rotations about an axis, (n, 3, 3)."""
    angles = degrees * (math.pi / 180)
    j, k = (axis + 1) % 3, (axis + 2) % 3
    matrices = np.zeros((len(angles), 3, 3))
    matrices[:, axis, axis] = 1.0
    # Sine and cosine of numpy differ by their last bit from one processor to another.
    matrices[:, j, j] = matrices[:, k, k] = [_core.cos(angle) for angle in angles]
    matrices[:, k, j] = [_core.sin(angle) for angle in angles]
    matrices[:, j, k] = -matrices[:, k, j]
    return matrices
