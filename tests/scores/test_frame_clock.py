"""Frames that are missing between two rows of motion capture: time is never compressed."""

from __future__ import annotations

import re
from pathlib import Path

import motion_files as files
import numpy as np
import pytest

from ergon.scores.gesture.take_file import TakeError
from ergon.scores.gesture.takes import Samples, read

N_FRAMES = 12
PLACES = files.curve(N_FRAMES)
TRC, MOTIVE = files.trc(PLACES), files.optitrack(PLACES)
QTM = files.qtm(PLACES, titles=True, leading=2)
CHANNELS = {".trc": "RWRI.x", ".tsv": "RWRI.x", ".csv": "Hand:RWRI.x"}
SEPARATORS = {".trc": "\t", ".tsv": "\t", ".csv": ","}


def retimed(data: bytes, suffix: str, frames: list[int], rate: float, decimals: int | None) -> str:
    """A file whose rows have other numbers, and the instants of these; None: no instants."""
    lines, separator = data.decode().splitlines(), SEPARATORS[suffix]
    begin = len(lines) - N_FRAMES
    for row, frame in enumerate(frames, begin):
        cells = lines[row].split(separator)
        cells[0] = str(frame)
        cells[1] = f"{frame / rate:.{decimals}f}" if decimals else ""
        lines[row] = separator.join(cells)
    return "\n".join(lines) + "\n"


def taken(tmp_path: Path, suffix: str, text: str) -> Samples:
    path = tmp_path / f"walk{suffix}"
    path.write_bytes(text.encode())
    return read(path, CHANNELS[suffix])


FILES = {".trc": TRC, ".tsv": QTM, ".csv": MOTIVE}
ROWS = [*range(N_FRAMES)]
JUMPING = [*ROWS[:4], *(frame + 50 for frame in ROWS[4:])]
SKIPPING = [*ROWS[:4], *(frame + 1 for frame in ROWS[4:])]


@pytest.mark.parametrize("suffix", FILES)
@pytest.mark.parametrize("frames", [JUMPING, SKIPPING])
def test_jump_of_time_is_refused_by_line(suffix: str, frames: list[int], tmp_path: Path) -> None:
    text = retimed(FILES[suffix], suffix, frames, 100, 5)
    line = len(text.splitlines()) - N_FRAMES + 5
    after = frames[4]
    words = f"walk{suffix}:{line}: the time {after / 100:g} s follows 0.03 s, which is {after - 3} "
    with pytest.raises(TakeError, match=re.escape(words)):
        taken(tmp_path, suffix, text)


@pytest.mark.parametrize("suffix", [".tsv", ".csv"])
def test_jump_of_frame_number_is_refused_by_line(suffix: str, tmp_path: Path) -> None:
    """Without instants the numbers count."""
    text = retimed(FILES[suffix], suffix, SKIPPING, 100, None)
    with pytest.raises(TakeError, match="frame 5 follows frame 3, but those before are 1 apart"):
        taken(tmp_path, suffix, text)


def test_jump_of_frame_number_beside_coarse_times(tmp_path: Path) -> None:
    text = retimed(files.trc(PLACES, rate=250.0), ".trc", SKIPPING, 250, 2)
    with pytest.raises(TakeError, match="frame 5 follows frame 3"):
        taken(tmp_path, ".trc", text)


def test_motive_file_of_alternate_frames(tmp_path: Path) -> None:
    """Its rate is that of the export."""
    frames = [2 * row for row in ROWS]
    text = retimed(MOTIVE, ".csv", frames, 100, 5).replace("Rate,100.0", "Rate,50.0")
    assert taken(tmp_path, ".csv", text).t == pytest.approx(np.arange(N_FRAMES) / 50)


@pytest.mark.parametrize(
    ("rate", "decimals"), [(60, 2), (120, 3), (250, 2), (300, 3), (500, 3), (1000, 3), (59.94, 5)]
)
def test_trc_times_of_few_decimals(rate: float, decimals: int, tmp_path: Path) -> None:
    text = retimed(files.trc(PLACES, rate=rate), ".trc", ROWS, rate, decimals)
    assert taken(tmp_path, ".trc", text).t == pytest.approx(np.arange(N_FRAMES) / rate)


@pytest.mark.parametrize("suffix", FILES)
def test_frames_begin_at_any_instant(suffix: str, tmp_path: Path) -> None:
    frames = [row + 731 for row in ROWS]
    take = taken(tmp_path, suffix, retimed(FILES[suffix], suffix, frames, 100, 3))
    assert take.t == pytest.approx(np.arange(N_FRAMES) / 100)


@pytest.mark.parametrize("suffix", FILES)
def test_rate_of_no_row_is_refused(suffix: str, tmp_path: Path) -> None:
    text = retimed(FILES[suffix], suffix, ROWS, 75, 3)
    with pytest.raises(TakeError, match=r"100 frames a second, but its .*frames are 0\.013"):
        taken(tmp_path, suffix, text)
