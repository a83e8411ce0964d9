"""`ergon play --until`: it stops where it is asked to."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import soundfile
from commands import forked

SCORE = """\
ergon: 1
tempo: [{at: 1|1, bpm: 240}]               # a bar is a second
rates: {audio: 8kHz}
instruments: {bell: {modules: {m: {CEL: {M: 2g, f: 440Hz, t60: 0.5s}}}, out: {SOX: m}}}
strikes: {a: {to: [bell.m], at: 1|1, every: 1, times: 40, impulse: 1mNs}}
mix: {route: {from: bell, to: 1}}
render: {tail: 1s}
"""


def played(folder: Path, *words: str) -> np.ndarray:
    (folder / "score.yaml").write_text(SCORE, encoding="utf-8")
    done = forked(["play", "score.yaml", "--audio", "file:out.wav", *words], folder)
    assert done.returncode == 0, done.stderr
    sound, _ = soundfile.read(folder / "out.wav", always_2d=True)
    (folder / "out.wav").unlink()
    return sound[:, 0]


def test_play_until_a_position(tmp_path: Path):
    complete = played(tmp_path)
    part = played(tmp_path, "--until", "3|1")
    assert len(part) == 2 * 8000
    assert np.array_equal(part, complete[: len(part)])
    middle = played(tmp_path, "--from", "2|1", "--until", "2|3")
    assert len(middle) == pytest.approx(0.5 * 8000, abs=64)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--from", "3|1", "--until", "2|1"), "it begins at 3|1"),
        (("--until", "1|1"), "it begins at 1|1"),
        (("--until", "Q"), "unknown mark 'Q'"),
    ],
)
def test_play_until_before_from(tmp_path: Path, words, message):
    (tmp_path / "score.yaml").write_text(SCORE, encoding="utf-8")
    done = forked(["play", "score.yaml", "--audio", "file:out.wav", *words], tmp_path)
    assert done.returncode == 2
    assert "--until" in done.stderr
    assert message in done.stderr
