"""A performance for other ears: the mix through a fold, before the limiter."""

from pathlib import Path

import numpy as np
import pytest
import soundfile
from numpy.typing import NDArray
from sweep import few

from ergon import _core
from ergon.api.options import PlayOptions
from ergon.api.play import PreparedPlay, prepare
from ergon.cli import app
from ergon.common.report import Report
from ergon.rendering.level import HIGHPASS_HZ
from ergon.repl.session.live import LiveEngine

SCORE = """\
ergon: 1
instruments:
  sky:
    BANK: {count: 30, f: 200Hz..4kHz, spread: random, t60: 0.2s, M: 1g}
    place: {across: 4m}
    out: {SOV: sky.all}
strikes: {rain: {to: sky.all, at: 0, for: 0.3s, rate: 3Hz, impulse: 1uNs..4uNs}}
mix:
  layout: six.yaml
  route: [{from: sky, to: nearest}]
render: {tail: 0.2s}
"""
SIX = """\
ergon: 1
project: equidistant
speakers: [{az: 45deg, r: 2m}, {az: -45deg, r: 2m}, {az: -135deg, r: 2m}, {az: 135deg, r: 2m}, \
{az: 0deg, el: 30deg, r: 2m}, [0m, 0m, 2m]]
"""
GAIN = "20dB"


@pytest.fixture(autouse=True)
def score(work_folder: Path) -> None:
    Path("s.yaml").write_text(SCORE)
    Path("six.yaml").write_text(SIX)


def prepared(to: str) -> PreparedPlay:
    return prepare("s.yaml", PlayOptions(audio="null", gain=GAIN, to=to), Report())


def folded(to: str) -> tuple[NDArray[np.float32], int]:
    """What is to be heard, with how much of it sounds on in the fold."""
    ready = prepared(to)
    stage, fold = ready.stage, ready.config.fold
    assert fold is not None
    frames = np.zeros((stage.n_frames, stage.simulation.n_out))
    stage.simulation.process(frames)
    mixed = np.zeros((stage.n_frames + fold.tail, stage.n_channels))
    mixer = stage.mixer(highpass=HIGHPASS_HZ, reference=ready.config.reference)
    mixer.process(frames, mixed[: stage.n_frames])
    built = np.zeros((len(mixed), {"binaural": 2, "stereo": 2, "ambix2": 9}[to]))
    fold.process(mixed * ready.config.gain, built)
    assert 1e-3 < np.abs(built).max() < 1.0
    return built.astype(np.float32), fold.tail


@pytest.mark.parametrize("to", few(["binaural", "stereo", "ambix2"], 1))
def test_live_fold_output_equals_folded_mix(to: str) -> None:
    words = ["play", "s.yaml", "--audio", "file:heard.wav", "--gain", GAIN, "--to", to, "-q"]
    assert app.run(words) == 0
    listened, _ = soundfile.read("heard.wav", dtype="float32", always_2d=True)
    wanted, _ = folded(to)
    assert listened.shape == wanted.shape
    assert np.array_equal(listened, wanted)


def test_live_fold_channels_in_session() -> None:
    ready = prepared("binaural")
    engine = LiveEngine(ready.stage, ready.config)
    try:
        assert len(engine.performance.status().peaks) == 2
        assert engine.n_channels == 6
    finally:
        engine.close()


@pytest.mark.parametrize(
    ("words", "changed", "output"),
    [
        (["--to", "binaural"], ("layout: six.yaml", "channels: 6"), "where its loudspeakers are"),
        (["--to", "quadro"], ("", ""), "quadro"),
        (["--to", "ambix9"], ("", ""), "the order of Ambisonics is 1 to 7"),
        (["--head", "a.sofa"], ("", ""), "a head is used by `--to binaural` only"),
        (
            ["--to", "stereo", "--head", "a.sofa"],
            ("", ""),
            "a head is used by `--to binaural` only",
        ),
    ],
)
def test_hear_of_unknown_place_is_refused(
    words: list[str], changed: tuple[str, str], output: str, capsys: pytest.CaptureFixture[str]
) -> None:
    text = SCORE.replace(*changed) if changed[0] else SCORE
    Path("s.yaml").write_text(text.replace("to: nearest", "to: 1") if changed[0] else text)
    assert app.run(["play", "s.yaml", "--audio", "null", "--gain", GAIN, *words]) == 2
    assert output in capsys.readouterr().err


def test_live_fold_refuses_wrong_channel_count() -> None:
    ready = prepared("stereo")
    stage = ready.stage
    with pytest.raises(_core.EngineError, match="the fold takes 2 channels"):
        _core.Performance(
            stage.simulation, stage.mixer(), audio="null", fold=_core.Fold(np.zeros((2, 2, 1)))
        )
