"""What the fuzzers found, each as it was found first."""

from pathlib import Path

import numpy as np
import pytest
from one_bell import SCORE

from ergon import _core
from ergon.common.errors import ErgonError
from ergon.exchange import frozen, sound, wave
from ergon.exchange.frozen import MANIFEST_NAME, NotFrozenError
from ergon.exchange.safe import FileRefusedError, write_all
from ergon.exchange.wave_header import NotWaveError
from ergon.notation.text.errors import TextError
from ergon.scores.gesture import notation
from ergon.scores.gesture.sampled import sampled_positions
from ergon.scores.reading.load import load
from ergon.scores.staging import live
from ergon.scores.staging.preparing import prepare
from ergon.scores.staging.refusals import StageError
from ergon.scores.staging.stage import stage
from tests.fuzz.render_targets import frozen_parts, renders


@pytest.mark.parametrize(
    ("text", "marked", "words"),
    [
        # Beats and seconds compare only once the tempo is known.
        ("0@0 3@0.5s 6@1 2@0.6s", "6@1", "time must rise"),
        ("0@0 throw 1@0.0001", "1@0.0001", "a throw must last at least one audio frame"),
        ("0@0 -3mm@0.125 900m@0.135", "-3mm@0.125", "too fast for any mass"),
        ("0@0 3@1e9", "3@1e9", "more than 20,000,000 samples"),
    ],
)
def test_sampled_gesture_refuses_impossible_paths(text: str, marked: str, words: str):
    with pytest.raises(TextError, match=words) as caught:
        sampled_positions(notation.parse(text).points, 0.5, 1000.0)
    error = caught.value
    assert text[error.offset : error.offset + error.length] == marked


def test_hold_with_rounding_difference_stays_constant():
    """The notation took it, and the engine refused it."""
    points = notation.parse("0@0 hold 4e-10m@1 hold 8e-10m@2 smooth 6@3").points
    assert points[1].x == points[2].x == 0.0
    assert np.ptp(sampled_positions(points, 0.5, 1000.0)[:500]) == 0.0


def test_live_hand_part_ending_before_piece_start():
    """`shift` did it, and the hand had a negative number of ticks."""
    live = SCORE.replace("hand: virtual", "hand: live")
    piece = load("s.yaml", text=live.replace("every: 1, times: 2", "do: [shift -9999]")).piece
    assert piece is not None
    (hand,) = prepare(piece, {"ada": None}).live_hands
    assert hand.n_ticks == 2


@pytest.mark.parametrize("text", ["0mm@0 3mm@900ms 0mm@1", "0mm@0 throw 1mm@0.0000001"])
def test_gesture_refusal_same_in_library_and_check(text: str):
    """`check` marked the word after `play:`, and the library the point."""
    with pytest.raises(ErgonError) as refused:
        sampled_positions(notation.parse(text).points, 0.5, 44100.0)
    assert isinstance(refused.value, TextError)
    score = SCORE.replace("gestures:", f"gestures:\n  fault: {text}", 1)
    loaded = load("s.yaml", text=score.replace("play: knock", "play: fault"))
    assert loaded.piece is not None, loaded.diagnostics
    with pytest.raises(StageError) as staged:
        prepare(loaded.piece)
    (result, *_) = staged.value.diagnostics
    line = score.splitlines()[result.place.line - 1]
    first = line.index(text) + refused.value.offset
    assert result.place.column == first + 1
    assert result.place.length == refused.value.length
    words = refused.value.message.split(":")[0]
    assert result.code == refused.value.code
    assert words in result.message


@pytest.mark.slow
@pytest.mark.parametrize(("key", "seconds"), [("", 10.0), (", X0: 2mm", 10_000.0)])
def test_live_hand_pauses_without_computation(
    key: str, seconds: float, monkeypatch: pytest.MonkeyPatch
):
    """The path of a part that lasts hours took 30 s, frame by frame."""
    text = SCORE.replace("hand: virtual", "hand: live").replace("Z: 1.2Ns/m", f"Z: 1.2Ns/m{key}")
    text = text.replace("every: 1, times: 2}", "every: 1, times: 2}\n    - {at: 200s, play: knock}")
    piece = load("s.yaml", text=text).piece
    assert piece is not None
    ticks = []
    computed = live._tick_positions

    def counted(simulation: _core.Simulation, every: int, n_ticks: int) -> np.ndarray:
        ticks.append(n_ticks)
        return computed(simulation, every, n_ticks)

    monkeypatch.setattr(live, "_tick_positions", counted)
    (hand,) = prepare(piece, {"ada": None}).live_hands
    assert hand.n_ticks > 200_000
    assert sum(ticks) <= min(1e3 * seconds, hand.n_ticks + 2)
    monkeypatch.setattr(live, "_pauses", lambda *_: ())
    (complete,) = prepare(piece, {"ada": None}).live_hands
    assert np.abs(hand.standin_path - complete.standin_path).max() < 1e-11
    assert np.ptp(complete.standin_path[-400:]) > 1e-3


@pytest.mark.parametrize("key", ["Z: 1.2Ns/m", "Z: 1.2Ns/m, X0: 2mm", "Z: 0Ns/m"])
def test_live_hand_moving_for_hours_is_refused(key: str, monkeypatch: pytest.MonkeyPatch):
    """Two hours of a key that moves all the time took minutes (`scores`, case 90888)."""
    monkeypatch.setattr(live, "MAX_FRAMES", 20 * 44100)
    # Z: 1.2Ns/m comes to rest within a second: 200 s, of which a few are computed.
    text = SCORE.replace("hand: virtual", "hand: live").replace("Z: 1.2Ns/m", key)
    text = text.replace("every: 1, times: 2}", "every: 1, times: 2}\n    - {at: 200s, play: knock}")
    piece = load("s.yaml", text=text).piece
    assert piece is not None
    if key == "Z: 1.2Ns/m":
        assert prepare(piece, {"ada": None}).live_hands[0].n_ticks > 200_000
        return
    with pytest.raises(StageError, match="moves its key for more than 20 s") as refused:
        prepare(piece, {"ada": None})
    (error,) = refused.value.diagnostics
    assert error.code == "E308"


def test_live_tick_slower_than_one_second_is_refused():
    """`1e-9kHz` made a tick of 4e10 frames, and the path of the stand-in asked for 300 GB."""
    live = SCORE.replace("hand: virtual", "hand: live, standin: lean, tick: 1e-9kHz")
    loaded = load("s.yaml", text=live)
    (error,) = (one for one in loaded.diagnostics if one.severity == "error")
    assert error.code == "E202"
    assert "below the minimum of 1Hz" in error.message


LOST_BODY = """\
ergon: 1
laws:
  bow: {damping: f*v*exp(-(v/w)**2), f: 0.4N, w: 0.1m/s}
keys: {k: {M: 300g, K: 60N/m, Z: 1Ns/m}}
instruments:
  thing:
    modules:
      p: {PLATE: {shape: square, radius: 3, rim: fixed, M: 0.002855kg, f: 107.2Hz, t60: 1.837s}}
      l1: {LNL: {between: [p.0, p.centre], damping: bow}}
      l2: {BUT: {between: [p.centre, p.0], contact: plain, gap: 0.2mm, K: 419N/m, Z: 0.003478Ns/m}}
      l3: {LNL: {between: [p.centre, p.0], points: [[-1mm, -1N], [0mm, 3600N], [1mm, 2N]]}}
      hand: {LNL: {between: [k, p.0], damping: bow}}
      drive: {ENF: {to: p.0, from: 0.4577N}}
    out: {o0: {SOX: p.0}}
gestures:
  go: {notation: 0mm@0 smooth 4mm@40ms throw 0mm@90ms, touch: open, ergons: particle}
players: {ada: {key: k}}
parts: {ada: [{at: 1|1, play: go}]}
accuracy: {cents: 3}
"""


@pytest.mark.slow
def test_plan_of_muted_plate_with_fine_contacts():
    """A trial muted the plate, and contacts that are computed finely still looked for it."""
    loaded = load("s.yaml", text=LOST_BODY)
    assert loaded.piece is not None
    plan = stage(loaded.piece, planned=True).plan
    assert plan is not None
    assert plan.rows()


def test_save_over_symlink_loop_is_refused(tmp_path: Path):
    """`save` of a journal that names one was an internal error (`journals`, case 31290)."""
    (tmp_path / "a").symlink_to(tmp_path / "b")
    (tmp_path / "b").symlink_to(tmp_path / "a")
    with pytest.raises(FileRefusedError, match="a symbolic link in a circle"):
        write_all({tmp_path / "a": b"", tmp_path / "c": b""}, lambda path: None)
    assert not (tmp_path / "c").exists()


def test_frozen_parts_with_infinite_rate_are_refused(tmp_path: Path):
    """`1e999` is JSON, and its rate was turned into a whole number."""
    manifest, files = frozen_parts()
    (tmp_path / MANIFEST_NAME).write_text(manifest.replace("44100.0", "1e999"))
    for name, data in files.items():
        (tmp_path / name).write_bytes(data)
    with pytest.raises(NotFrozenError, match="not a manifest of frozen parts"):
        frozen.read(tmp_path)


def test_damaged_flac_not_passed_to_mp3_decoder(tmp_path: Path, capfd: pytest.CaptureFixture[str]):
    """A damaged FLAC file went to a decoder of MP3, which wrote to the terminal."""
    path = tmp_path / "render.flac"
    (complete, _) = renders(".flac")
    path.write_bytes(b"ID3" + complete[3:])
    with pytest.raises(NotWaveError, match="is not FLAC"):
        sound.read_info(path)
    assert capfd.readouterr() == ("", "")


def test_sound_file_shrinking_while_read_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """A hash of it never ended."""
    path = tmp_path / "render.wav"
    (complete, *_) = renders(".wav")
    path.write_bytes(complete)
    info = sound.read_info(path)
    path.write_bytes(complete[:-40])
    monkeypatch.setattr(wave, "read_info", lambda _: info)
    for read in (sound.digest_samples, lambda path: list(sound.read_blocks(path))):
        with pytest.raises(NotWaveError, match="became shorter"):
            read(path)


def test_read_blocks_of_signalling_nan_without_warning(tmp_path: Path):
    path = tmp_path / "render.wav"
    (_, _, float_render, *_) = renders(".wav")
    path.write_bytes(float_render[:-4] + b"\x01\x00\x80\x7f")
    (block,) = sound.read_blocks(path)
    assert np.isnan(block[-1, -1])
