"""Small lines that must not guess: `rest`, `tap`; and what `scope` and `meters` show."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from sessions import Stepped

from ergon import _core
from ergon.repl.session.captures import Capture, Captures
from ergon.repl.session.engine import EngineStatus
from ergon.repl.session.version import NotTakenError
from ergon.repl.wire.protocol import decode_state, encode_state
from tests.repl.test_repl_session import SCORE


@pytest.fixture
def stepped_session(tmp_path: Path) -> Stepped:
    stepped = Stepped(SCORE, tmp_path)
    stepped.ok("play")
    return stepped


def test_rest_without_player_names_players(stepped_session: Stepped):
    text = stepped_session.type("rest")
    assert not text.taken
    assert "rest ada, rest leo or rest all" in text.text


def test_tap_twice_sets_tempo(stepped_session: Stepped, monkeypatch: pytest.MonkeyPatch):
    now = iter([10.0, 10.5])
    monkeypatch.setattr("ergon.repl.session.session_commands.time.monotonic", lambda: next(now))
    assert stepped_session.ok("tap").text == "tap 1: one more sets the tempo"
    stepped_session.ok("tap")
    assert stepped_session.session.schedule.head.piece.tempo_map.bpm(100.0) == 120.0


@pytest.mark.parametrize("second", [10.0, 10.1, 12.5])
def test_tap_out_of_range(stepped_session: Stepped, monkeypatch: pytest.MonkeyPatch, second: float):
    before = stepped_session.session.schedule.head
    now = iter([10.0, second])
    monkeypatch.setattr("ergon.repl.session.session_commands.time.monotonic", lambda: next(now))
    stepped_session.ok("tap")
    reply = stepped_session.type("tap")
    assert "tap between 30 and 300 bpm" in reply.text
    assert stepped_session.session.schedule.head is before


def test_show_parameter_under_set_and_automation(stepped_session: Stepped):
    """Lines that wait for their bar do not count, and automation leads it."""
    stepped_session.run(1.0)
    definition = stepped_session.ok("show bell").lines
    assert [line[6:] for line in definition][::4] == ["  bell:", "    out: {SOX: m}"]
    assert stepped_session.ok("show bell.m.f").lines == ("bell.m.f: 220.0Hz", *definition)
    assert stepped_session.ok("? bell.m.K").lines[0] == "bell.m.K: 3821.89N/m"
    assert stepped_session.ok("show bell.b.gap").lines[0] == "bell.b.gap: 0.001m"
    assert stepped_session.ok("show k1.M").lines[0] == "k1.M: 0.4kg"
    stepped_session.ok("set bell.m.f 300Hz")
    assert stepped_session.ok("show bell.m.f").lines[0] == "bell.m.f: 220.0Hz"
    stepped_session.run(3.0)
    assert stepped_session.ok("show bell.m.f").lines[0] == "bell.m.f: 300.0Hz"
    stepped_session.ok("lfo bell.m.f 200Hz..400Hz period 4bar shape sine now")
    stepped_session.run(0.5)
    value, _, rest = (
        stepped_session.ok("show bell.m.f").lines[0].removeprefix("bell.m.f: ").partition("Hz at ")
    )
    assert 200.0 < float(value) < 400.0
    assert rest.endswith(", by its automation")


def test_scope_draws_past_key_positions(stepped_session: Stepped):
    stepped_session.ok("ada plays knock every 1 now")
    stepped_session.run(2.2)
    head, *drawing = stepped_session.ok("scope ada").lines
    assert "ada on k1" in head
    assert "last 2.0 s" in head
    assert len(drawing) > 5
    stepped_session.ok("rest ada now")
    stepped_session.run(0.5)
    assert "ada on k1" in stepped_session.ok("scope ada").lines[0], (
        "a key also moves where nothing plays"
    )
    refused = stepped_session.type("scope nobody")
    assert not refused.taken


def test_engine_trouble_message_and_state(
    stepped_session: Stepped, monkeypatch: pytest.MonkeyPatch
):
    stepped_session.session.messages()
    result = ["gaps 1"]
    status = EngineStatus(peaks=(1e-43,), troubles=result)
    monkeypatch.setattr(stepped_session.engine, "status", lambda: status)
    stepped_session.run(0.1)
    stepped_session.run(0.1)
    assert [one for one in stepped_session.session.messages() if "gaps" in one] == ["1|1 gaps 1"]
    state = stepped_session.session.state()
    assert state.troubles == ("gaps 1",)
    assert state.level == float("-inf"), "what nobody hears is silence"
    result[0] = "gaps 4"
    stepped_session.run(1.1)
    assert len([one for one in stepped_session.session.messages() if "gaps 4" in one]) == 1


def test_capture_write_without_recorded_samples(tmp_path: Path):
    ticks = np.arange(10, dtype=np.uint64)
    recorded = _core.Recording(44_100.0, 44, [("remi", "k2")], "{}", ticks, np.zeros((10, 1)))
    hands = tmp_path / "session.take"
    hands.write_bytes(recorded.to_bytes())
    captures = Captures(hands)
    with pytest.raises(NotTakenError, match="nothing of it was recorded"):
        captures.write(Capture("remi", "solo", 44 * 100, 44 * 200), tmp_path, 44)
    assert not (tmp_path / "takes").exists()
    cut = Capture("remi", "solo", 0, 44 * 30)
    captures.write(cut, tmp_path, 44)
    assert cut.n_missing == 20


def test_look_draws_two_bars_by_beats(stepped_session: Stepped, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("COLUMNS", "80")
    stepped_session.ok("ada plays knock every 1/2 until 3|1")
    stepped_session.ok("leo plays lean every 4")
    stepped_session.run(2.76)  # a bar takes two seconds
    lines = [line.replace("\u00b7", ".") for line in stepped_session.ok("?").lines]
    assert lines == [
        "     2|1      2        3        4        3|1      2        3        4",
        "ada  kno knoc kno knoc kno knoc kno knoc .        .        .        .",
        "leo  lean     .        .        .        lean     .        .        .",
        "                  ^",
    ]
    stepped_session.ok("ada plays lean now\nleo plays knock at 3|2.5")
    stepped_session.run(0.9)
    rows = stepped_session.ok("?").lines
    assert rows[1].startswith("ada  kn")
    assert "knoc" in rows[2]


def test_look_with_gesture_from_previous_bar(
    stepped_session: Stepped, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setenv("COLUMNS", "30")
    stepped_session.ok("slow = 0@0 smooth 3mm@6 smooth 0@8\nada plays slow")
    stepped_session.run(2 + 2 + 0.6)
    lines = [
        line.replace("\u00b7", ".").replace("\u2026", "~") for line in stepped_session.ok("?").lines
    ]
    assert lines == [
        "     3|1   2     3     4",
        "ada  ~     .     .     .",
        "leo  .     .     .     .",
        "           ^",
    ]


def test_look_draws_rests_of_pattern_empty(
    stepped_session: Stepped, monkeypatch: pytest.MonkeyPatch
):
    """They were drawn with the name of the pattern's first gesture."""
    monkeypatch.setenv("COLUMNS", "80")
    stepped_session.ok("ada plays knock ~ (lean knock) ~ every 1")
    stepped_session.run(2.1)
    ada = next(row for row in stepped_session.ok("?").lines if row.startswith("ada"))
    assert ada.replace("\u00b7", ".") == (
        "ada  knock    .        lea knoc .        knock    .        lea knoc ."
    )


def test_scope_of_moving_key_on_and_off(stepped_session: Stepped):
    assert not stepped_session.type("scope ada on").taken  # ada has not moved yet
    stepped_session.ok("ada plays knock every 1 now")
    stepped_session.run(1.0)
    stepped_session.ok("scope ada on")
    first = stepped_session.session.state().drawing
    assert "ada on k1, the last 1.0 s" in first[0]
    assert 5 < len(first) < 12
    stepped_session.run(1.1)
    second = stepped_session.session.state().drawing
    assert "the last 2.0 s" in second[0]
    assert second != first
    state = stepped_session.session.state()
    assert decode_state(encode_state(state)) == state
    stepped_session.ok("scope off")
    assert stepped_session.session.state().drawing == ()
    stepped_session.run(1.0)
    assert stepped_session.session.state().drawing == ()


def test_show_with_strikes(stepped_session: Stepped):
    stepped_session.ok("d1 strikes bell.m every 1 impulse 2mNs now")
    assert "impulse: 2mNs" in stepped_session.ok("show d1").lines[0]
    assert stepped_session.ok("? d1").lines == stepped_session.ok("show d1").lines
    shown = stepped_session.ok("show").lines
    assert [line for line in shown if line.startswith("d1 (strikes): bell.m from 1|1.0")]
    row = next(line for line in stepped_session.ok("?").lines if line.startswith("d1 "))
    assert row.split() == ["d1", *"xxxxxxxx"]
    stepped_session.run(1.0)
    stepped_session.ok("rest d1 now")
    stepped_session.run(0.1)
    assert not [line for line in stepped_session.ok("show").lines if line.startswith("d1 ")]


@pytest.mark.parametrize(
    ("line", "row"),
    [
        ("d1 strikes bell.m every 1/2 chance 0.5 times 16 impulse 1mNs now", "x"),
        ("d1 strikes bell.m euclid 3 8 every 2 impulse 1mNs now", "x"),
        ("d1 strikes bell.m rate 2Hz for 4bar impulse 1mNs now", "\u2026"),
        ("d1 strikes bell.m impulse 1mNs now", "x"),
    ],
)
def test_look_with_strikes(stepped_session: Stepped, line: str, row: str):
    stepped_session.ok(line)
    (shown,) = [line for line in stepped_session.ok("?").lines if line.startswith("d1 ")]
    assert row in shown.split()


def test_meter_while_playing(stepped_session: Stepped):
    stepped_session.ok("d1 strikes bell.m every 1 impulse 2mNs now")
    stepped_session.run(0.7)
    stepped_session.ok("meter 3/4")
    stepped_session.run(6.0)
    assert stepped_session.where.startswith(
        "5|"
    )  # a bar of four beats, then bars of three: beat 13
    stepped_session.close()
    assert np.array_equal(stepped_session.again(), stepped_session.sound)


TUNED = """ergon: 1
tuning: {%s}
instruments:
  bars:
    modules: {m: {CEL: {M: 1g, f: C4, t60: 50ms}}}
    notes: [%s]
    out: {SOX: m}
mix: {route: [{from: bars, to: 1}]}
"""


@pytest.mark.parametrize(
    ("tuning", "notes", "expected"),
    [
        (
            "edo: 31, A4: 415Hz",
            "C4, 18\\31",
            "tuning: 31 equal steps to an octave, A4 has 415 Hz, ratios count from C4\n"
            f"bars: C4 {415 * 2 ** (-23 / 31):.2f} Hz, 18of31 {415 * 2 ** (-5 / 31):.2f} Hz",
        ),
        (
            "scale: own.scl, root: 264.5Hz",
            "C4, A4, 3/2",
            "tuning: a scale 'Three' of 3 degrees, key 69 has 440 Hz, ratios count from 264.5Hz\n"
            "bars: C4 55.00 Hz, A4 440.00 Hz, 3to2 396.75 Hz",
        ),
    ],
)
def test_show_tuning_of_score(tuning, notes, expected, tmp_path):
    (tmp_path / "own.scl").write_text("Three\n3\n5/4\n3/2\n2/1\n", encoding="utf-8")
    with closing(Stepped(TUNED % (tuning, notes), tmp_path)) as session:
        assert "\n".join(session.ok("show tuning").lines) == expected
        assert expected.partition("\n")[0] in session.ok("show").lines
        assert session.ok("? tuning").lines == session.ok("show tuning").lines


def test_show_tuning_of_score_without_tuning(stepped_session: Stepped):
    (line,) = stepped_session.ok("show tuning").lines
    assert line == "tuning: 12 equal steps to an octave, A4 has 440 Hz, ratios count from C4"
    assert not [line for line in stepped_session.ok("show").lines if line.startswith("tuning")]
