"""`ergon play --live`: a live hand without the options of a duet."""

from pathlib import Path

import pytest
from duets import sound

from ergon.cli import app
from tests.live.test_led_hands import SCORE

Capture = pytest.CaptureFixture[str]


def test_play_with_a_hand_on_an_emulated_key(work_folder: Path, capsys: Capture):
    """A hand that rests plays nothing, where the written part of the stand-in would knock."""
    Path("s.yaml").write_text(SCORE)
    play = ["play", "s.yaml", "--gain", "0dB", "--plain"]
    assert app.run([*play, "--audio", "file:part.wav"]) == 0
    live = ["--live", "remi=emul:?lockstep", "--unchecked"]
    assert app.run([*play, *live, "--audio", "file:hand.wav"]) == 0
    assert abs(sound(Path("part.wav"))).max() > 1e-3
    assert abs(sound(Path("hand.wav"))).max() < 1e-6


def test_play_with_unknown_live_player(work_folder: Path, capsys: Capture):
    Path("s.yaml").write_text(SCORE)
    assert app.run(["play", "s.yaml", "--live", "ad=emul:", "--audio", "null"]) == 2
    assert "the score has no player 'ad'; did you mean 'ada'?" in capsys.readouterr().err
