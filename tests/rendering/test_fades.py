"""`tail: auto`: a file ends where its sound has faded, and has the samples of a longer one."""

from pathlib import Path

import numpy as np
import pytest
import soundfile
from checked import codes
from sweep import few

import ergon
from ergon._core import SilenceDetector
from ergon.cli import app

RATE = 44_100
SCORE = """\
ergon: 1
instruments:
  bell:
    modules: {m: {CEL: {M: 2g, f: A3, t60: T60}}}
    out: {SOX: m}
strikes: {hit: {to: bell.m, at: 0.25s, impulse: IMPULSE}}
mix: {route: {from: bell, to: 1, highpass: 20Hz}, MASTER}
render: {tail: TAIL}
"""


def score(
    folder: Path, tail: str, t60: str = "0.9s", impulse: str = "1mNs", master: str = ""
) -> Path:
    text = SCORE.replace("TAIL", tail).replace("T60", t60).replace("IMPULSE", impulse)
    path = folder / "bell.yaml"
    path.write_text(text.replace(", MASTER", f", {master}" if master else ""), encoding="utf-8")
    return path


@pytest.mark.parametrize("level", few(["", "normalise: -6dB, limit: -6dB", "limit: -1dB"], 1))
def test_auto_tail_ends_at_minus_80_db(tmp_path, level):
    master = f"master: {{{level}}}" if level else ""
    ends = {}
    for tail in ("auto", "4s"):
        for options in ({}, {"threads": 2, "block": 777}):
            out = tmp_path / "out.wav"
            arguments = ergon.FileOptions(force=True, **options)
            ergon.render_to_file(score(tmp_path, tail, master=master), out, arguments)
            ends.setdefault(tail, []).append(soundfile.read(out)[0])
    short, long = ends["auto"][0], ends["4s"][0]
    assert np.array_equal(ends["auto"][1], short)
    # 80 dB are 4/3 of the decay time, to the next tenth of a second.
    assert len(short) / RATE == pytest.approx(0.25 + 0.9 * 4 / 3, abs=0.16)
    assert np.array_equal(short, long[: len(short)])
    assert np.abs(long[len(short) :]).max() <= 1.1e-4 * np.abs(long).max()


def test_auto_tail_of_silence_and_endless_sound(tmp_path):
    silent = ergon.render(score(tmp_path, "auto", impulse="0Ns"))
    assert len(silent.frames) < RATE
    endless = ergon.render(score(tmp_path, "auto", t60="900s"))
    assert len(endless.frames) == int(60.25 * RATE)


@pytest.mark.parametrize("block", [1, 100, 4096])
def test_silence_detector_with_beating_sound(block):
    """Quiet for half a second, then loud again: it goes on."""
    sound = np.ones((8 * RATE, 1))
    sound[RATE : RATE + RATE // 2] = 5e-5
    sound[2 * RATE :] = 5e-5
    finder, n = SilenceDetector(RATE, 1, 0), 8 * RATE if block > 1 else 4 * RATE
    ends = (finder.take(sound[at : at + block]) for at in range(0, n, block))
    assert next(end for end in ends if end is not None) == 2 * RATE + 4410


def test_silence_detector_waits_for_last_event():
    finder = SilenceDetector(RATE, 2, 3 * RATE)
    assert finder.take(np.zeros((10 * RATE, 2))) == 3 * RATE + 4410


def test_tail_accepts_time_or_auto():
    text = SCORE.replace("T60", "1s").replace("IMPULSE", "1mNs").replace(", MASTER", "")
    assert codes(text.replace("TAIL", "auto")) == []
    assert codes(text.replace("TAIL", "7s")) == []
    assert codes(text.replace("TAIL", "atuo")) != []


def test_play_with_auto_tail_ends_like_render(tmp_path, monkeypatch):
    """Where nothing is written of a tail: the frames of the file, and no more."""
    monkeypatch.chdir(tmp_path)
    path = score(tmp_path, "auto")
    path.write_text(path.read_text().replace("render: {tail: auto}\n", ""), encoding="utf-8")
    rendered = ergon.render(path)
    assert app.run(["play", str(path), "--audio", "file:played.wav", "--plain"]) == 0
    played, _ = soundfile.read("played.wav")
    # The second that shows that it has faded is heard, to the end of its tick.
    assert 0.9 <= (len(played) - len(rendered.frames)) / RATE <= 0.91
    assert np.abs(played[: len(rendered.frames)] - rendered.frames[:, 0]).max() < 1e-6
