"""Renders of some instruments of a score."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import ergon
from ergon.cli import app

SCORE = """\
ergon: 1
rates: {audio: 8kHz}
instruments:
  bell: {modules: {m: {CEL: {M: 2g, f: A3, t60: 100ms}}}, out: {SOX: m}}
  vib:
    modules: {m: {CEL: {M: 2g, f: A4, t60: 100ms}}}
    notes: [C4, E4]
    out: {SOX: m}
  drum: {modules: {m: {CEL: {M: 5g, f: A2, t60: 100ms}}}, out: {SOX: m}}
strikes: {all: {to: [bell.m, vib.m, drum.m], at: 0, every: 1/4, times: 3, impulse: 1mNs}}
mix: {channels: 3, route: [{from: bell, to: 1}, {from: vib, to: 2}, {from: drum, to: 3}]}
render: {bits: float, tail: 0.2s}
"""


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("s.yaml").write_text(SCORE, encoding="utf-8")


@pytest.mark.parametrize(
    ("options", "channels"),
    [
        ({"only": "bell"}, {0}),
        ({"only": "vib, drum"}, {1, 2}),
        ({"except_": "vib"}, {0, 2}),
        ({"except_": "bell,drum"}, {1}),
        ({"only": "vib.E4"}, {1}),
    ],
)
def test_render_only_and_except_instruments(options, channels):
    everything = ergon.render("s.yaml").frames
    some = ergon.render("s.yaml", ergon.RenderOptions(**options)).frames
    n_frames = min(len(everything), len(some))
    for channel in range(3):
        if channel not in channels:
            assert not some[:, channel].any()
        elif options != {"only": "vib.E4"}:
            assert np.array_equal(some[:n_frames, channel], everything[:n_frames, channel])
        else:
            assert 0.0 < np.abs(some[:, channel]).max() < np.abs(everything[:, channel]).max()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--only", "vb"], "--only vb: no instrument is called so; did you mean vib?"),
        (["--only", "bell", "--except", "vib"], "--only: excludes --except; leave one of the two"),
        (["--except", "bell,vib,drum"], "no instrument is left that is heard"),
    ],
)
def test_only_and_except_refuse_wrong_names(words, message, capsys: pytest.CaptureFixture[str]):
    assert app.run(["render", "s.yaml", "-o", "x.wav", *words]) == 2
    assert message in capsys.readouterr().err
    assert not Path("x.wav").exists()


def test_only_suppresses_w321_of_instruments_left_out(capsys: pytest.CaptureFixture[str]):
    assert app.run(["render", "s.yaml", "-o", "x.wav", "--only", "bell"]) == 0
    assert "W321" not in capsys.readouterr().err
