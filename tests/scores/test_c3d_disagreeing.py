"""C3D files whose header and parameters disagree: the reading that fits the file's length."""

from __future__ import annotations

import struct
from pathlib import Path

import motion_files as files
import numpy as np
import pytest

from ergon.scores.gesture import c3d_file
from ergon.scores.gesture.take_file import TakeError

POINT, TRIAL = 1, 2  # groups of parameters
N_FRAMES = 80
PLACES = files.curve(N_FRAMES)


def word(value: int) -> bytes:
    return struct.pack("<H", value)


def integer(group: int, name: str, value: int):
    return group, name, 2, (), word(value)


def trial(n_frames: int):
    """The first and the last frame, in two words each."""
    ends = {"START": 1, "END": n_frames}
    rows = ((end, word(n & 0xFFFF) + word(n >> 16)) for end, n in ends.items())
    return [(TRIAL, f"ACTUAL_{end}_FIELD", 2, (2,), content) for end, content in rows]


def patched(data: bytes, offset: int, content: bytes) -> bytes:
    return data[:offset] + content + data[offset + len(content) :]


def headed(data: bytes, *, first: int = 1, last: int = N_FRAMES, start: int = 3) -> bytes:
    """A file of 80 frames whose header states other numbers."""
    data = patched(data, 6, word(first) + word(last))
    return patched(data, 16, word(start))


def parametric(*parameters, scale: float = -1.0) -> bytes:
    data = files.c3d(PLACES, scale=scale, parameters=parameters)
    return data + bytes(-len(data) % 512)


def positions(tmp_path: Path, data: bytes) -> np.ndarray:
    path = tmp_path / "walk.c3d"
    path.write_bytes(data)
    return np.concatenate([*c3d_file.read(path).blocks()])


FRAMES = integer(POINT, "FRAMES", N_FRAMES)
CASES = {
    "half the frames in the header": headed(parametric(FRAMES), last=40),
    "first frame 2": headed(parametric(FRAMES), first=2),
    "first frame 0": headed(parametric(FRAMES), first=0),
    "no last frame": headed(parametric(FRAMES), last=0),
    "frames by TRIAL": headed(parametric(integer(POINT, "FRAMES", 40), *trial(80)), last=40),
    "DATA_START beside a start within": headed(
        parametric(FRAMES, integer(POINT, "DATA_START", 3)), start=2
    ),
    "start within the parameters": headed(parametric(FRAMES), start=2),
    "start and frames": headed(
        parametric(FRAMES, integer(POINT, "DATA_START", 3)), start=4, last=64
    ),
    "other DATA_START": headed(parametric(FRAMES, integer(POINT, "DATA_START", 9))),
}


@pytest.mark.parametrize("case", CASES)
def test_c3d_reading_by_length_of_file(case: str, tmp_path: Path) -> None:
    assert np.array_equal(positions(tmp_path, CASES[case]), PLACES)


@pytest.mark.parametrize("processor", files.PROCESSORS)
def test_c3d_scale_of_parameters_before_header(processor: str, tmp_path: Path) -> None:
    numbers = files._Numbers(processor)
    data = files.c3d(PLACES, processor=processor, scale=0.0625)
    assert np.array_equal(positions(tmp_path, patched(data, 12, numbers.real(0.625))), PLACES)
    reals = files.c3d(PLACES, processor=processor, scale=-1.0)
    assert np.array_equal(positions(tmp_path, patched(reals, 12, numbers.real(0.1))), PLACES)


@pytest.mark.parametrize("count", [(POINT, "LONG_FRAMES", 4, (), struct.pack("<f", 70_000)), None])
def test_c3d_wrapped_frame_count(count, tmp_path: Path) -> None:
    places = np.zeros((70_000, 1, 3))
    places[:, 0, 0] = np.arange(70_000) % 500
    wrapped = integer(POINT, "FRAMES", 70_000 & 0xFFFF)
    more = [count] if count else trial(70_000)
    data = files.c3d(places, ("p",), scale=1.0, parameters=[wrapped, *more], last=70_000 & 0xFFFF)
    assert np.array_equal(positions(tmp_path, data), places)


def test_c3d_frames_beyond_stated_number_are_named(tmp_path: Path) -> None:
    """Header and parameters agree on half of what is there."""
    path = tmp_path / "walk.c3d"
    path.write_bytes(headed(parametric(integer(POINT, "FRAMES", 40)), last=40))
    motion = c3d_file.read(path)
    assert motion.n_frames == 40
    assert "40 frames that it states 1,280 bytes follow, as many as 40 frames" in motion.note


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (headed(parametric(integer(POINT, "FRAMES", 50)), last=40), "40 or 50 frames, and none"),
        (headed(files.c3d(np.zeros((80, 2, 3)), parameters=[FRAMES]), last=79), "several of them"),
        (headed(parametric(), start=1), "its header is damaged"),
        (
            headed(parametric(integer(POINT, "FRAMES", 40)), start=2, last=40),
            "begin at byte 512, within its parameters, and those",
        ),
    ],
)
def test_c3d_without_fitting_reading_is_refused(data: bytes, words: str, tmp_path: Path) -> None:
    with pytest.raises(TakeError, match=words):
        positions(tmp_path, data)
