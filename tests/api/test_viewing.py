"""What a page is given: a score's own motion and sound, and sound on two channels."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from motions import Piece

from ergon import _core
from ergon.api.options import FileOptions
from ergon.api.render import render
from ergon.api.viewing import binaural_file, render_view, sound_beside
from ergon.common.report import Report
from ergon.exchange import sound
from ergon.exchange.safe import open_for_writing
from ergon.exchange.wave_header import Bits, Stamp, WaveFormat

SCORE = """\
ergon: 1
tempo: [{at: 1|1, bpm: 120}]
instruments:
  bell: {CEL: {M: 1g, f: 440Hz, t60: 0.5s}, out: {SOX: bell}}
strikes: {s: {to: bell, at: 1|1, impulse: 1mNs}}
MIX
render: {tail: 0.3s}
"""


class SentenceReport(Report):
    def __init__(self) -> None:
        self.sentences: list[str] = []

    def say(self, message: str) -> None:
        self.sentences.append(message)


def score(folder: Path, mix: str = "") -> Path:
    path = folder / "s.yaml"
    path.write_text(SCORE.replace("MIX", mix))
    return path


def written(path: Path, frames: np.ndarray, bits: Bits = "float") -> Path:
    """A WAV file without a word of what its channels are."""
    format = WaveFormat(8000, frames.shape[1], bits)
    kind = np.float64 if bits == "double" else np.float32
    with open_for_writing(str(path), binary=True, force=True, inputs=()) as file:
        writer = sound.writer(str(path), file, format, len(frames), Stamp("x"))
        writer.write(np.ascontiguousarray(frames, kind))
        writer.close()
    return path


def read(path: Path) -> np.ndarray:
    return np.concatenate(list(sound.read_blocks(path)))


def test_render_view_sound_equals_render(tmp_path: Path) -> None:
    path = score(tmp_path)
    (folder := tmp_path / "shown").mkdir()
    shown = render_view(path, folder, FileOptions(motion=True), Report())
    assert shown.sound is not None
    assert np.abs(read(shown.sound) - render(path).frames).max() < 2**-15
    moved = _core.read_motion(shown.motion)
    assert json.loads(moved.manifest)["score"] == str(path)
    assert moved.duration == pytest.approx(len(read(shown.sound)) / 44100, abs=0.02)
    assert {one.name for one in tmp_path.iterdir()} == {"s.yaml", "shown"}


def test_fold_of_room_channels_to_stereo(tmp_path: Path) -> None:
    path = score(tmp_path, "mix: {layout: layouts/ring24.yaml, route: [{from: bell, to: [1]}]}")
    (folder := tmp_path / "shown").mkdir()
    shown = render_view(path, folder, FileOptions(motion=True), Report())
    assert shown.sound is not None
    result = sound.read_info(shown.sound)
    assert (result.format.n_channels, result.format.bits) == (2, 16)
    assert np.abs(read(shown.sound)).max(axis=0).min() > 1e-3


@pytest.mark.parametrize("channels", [1, 2, 3, 5])
def test_fold_of_channels_without_a_layout_alternates_sides(tmp_path: Path, channels: int) -> None:
    frames = np.random.default_rng(1).uniform(-0.5, 0.5, (5000, channels))
    text = SentenceReport()
    built = read(binaural_file(written(tmp_path / "a.wav", frames, "double"), tmp_path, text))
    left, right = frames[:, 0::2].mean(axis=1), frames[:, 1::2].mean(axis=1) if channels > 1 else 0
    wanted = left[:, None] if channels == 1 else np.stack([left, right], axis=1)
    assert np.abs(built - wanted).max() < 2**-15
    assert len(text.sentences) == (channels > 2)


def test_for_two_ears_with_stereo_file_unchanged(tmp_path: Path) -> None:
    path = written(tmp_path / "a.wav", np.zeros((100, 2)))
    assert binaural_file(path, tmp_path, Report()) == path
    assert {one.name for one in tmp_path.iterdir()} == {"a.wav"}


def test_sound_beside_motion_of_same_or_other_score(tmp_path: Path) -> None:
    path = score(tmp_path)
    shown = render_view(path, tmp_path, FileOptions(motion=True), Report())
    text = SentenceReport()
    assert sound_beside(shown.motion, text) == shown.motion.with_suffix(".wav")
    assert text.sentences == []
    other = Piece().write(tmp_path / "other.motion")
    assert sound_beside(other, text) is None
    assert text.sentences == []
    (tmp_path / "other.wav").write_bytes(shown.motion.with_suffix(".wav").read_bytes())
    assert sound_beside(other, text) is None
    assert "is not the sound of" in text.sentences[0]
    (tmp_path / "other.wav").write_bytes(b"RIFF")
    assert sound_beside(other, text) is None
