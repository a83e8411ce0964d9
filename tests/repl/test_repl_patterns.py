"""Patterns at the prompt: the words of a part, undone, saved, kept, entered anywhere, rendered."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from sessions import Stepped
from sweep import few

from ergon.repl.session.version import piece_of
from ergon.scores.reading.load import load
from tests.repl.test_repl_session import SCORE, onset, written

TAP = "  lean: 0mm@0 smooth 3mm@1/4 smooth 0mm@1/2\n  tap: 0mm@0 smooth 5mm@60ms 0mm@160ms\n"
SCORE = SCORE.replace("  lean: 0mm@0 smooth 3mm@1 smooth 0mm@2\n", TAP)


@pytest.fixture
def session(tmp_path: Path):
    stepped = Stepped(SCORE, tmp_path)
    yield stepped
    stepped.close()


def same(session: Stepped) -> None:
    """The journal renders what was heard, at every frame."""
    session.close()
    assert np.array_equal(session.again(), session.sound)


def gestures(session: Stepped, player: str = "ada") -> list[tuple[str, float]]:
    """What the running version plays: names and beats."""
    running = session.session.schedule.running
    result = [g for g in running.stage.gestures if g.player == player]
    return [(g.name, round(running.beat(round(g.start * session.rate)), 2)) for g in result]


@pytest.mark.parametrize(
    ("line", "row"),
    few(
        [
            ("ada plays knock lean knock", "{at: 2|1, play: knock lean knock}"),
            (
                "ada plays knock (tap tap) ~ every 1/2 times 3",
                "{at: 2|1, play: knock (tap tap) ~, every: 1/2, times: 3}",
            ),
            (
                "ada plays choose knock tap every 1/2 chance 60%",
                "{at: 2|1, play: choose knock tap, every: 1/2, chance: 60%, until: 999|1}",
            ),
            (
                "ada plays tap euclid 3 8 rotate 2",
                "{at: 2|1, play: tap, euclid: 3 8 rotate 2, until: 999|1}",
            ),
            (
                "ada plays tap lean every 1 every 4th do mirror, scale 0.5 swing 2/3 do scale 0.9 "
                "now",
                "{at: 1|1.2, play: tap lean, every: 1, nth: '4th do mirror, scale 0.5', "
                "swing: 2/3, until: 999|1, do: [scale 0.9]}",
            ),
        ],
        2,
    ),
)
def test_pattern_line_sounds_as_written_part(session, tmp_path, line, row):
    session.ok("play")
    reply = session.ok(line)
    assert reply.text.startswith("ok ")
    text = session.session.schedule.head.texts.text
    added = next(said.strip() for said in text.splitlines() if "play:" in said)
    if "now" not in line:
        assert row in added.replace('"', "'")
    session.run(5.0)
    begun = session.session.schedule.running.clock.begin_instant
    wanted = written(text, tmp_path, 3.0)
    shift = round(begun * session.rate)
    result = session.sound[shift : shift + len(wanted)]
    assert onset(result) == onset(wanted)
    # Instants are counted from another beginning, so that their last bits differ.
    assert np.max(np.abs(result - wanted)) < 1e-9 * np.max(np.abs(wanted))


def test_pattern_line_with_undo_and_redo(session):
    session.ok("play")
    session.ok("ada plays knock every 1")
    session.run(4.2)
    session.ok("ada plays tap (lean ~ knock) every 1 chance 0.8")
    session.run(4.0)
    assert {name for name, at in gestures(session) if at >= 8} >= {"tap", "lean"}
    session.ok("undo")
    session.run(4.0)
    assert {name for name, at in gestures(session) if at >= 20} == {"knock"}
    session.ok("redo")
    session.run(2.0)
    assert {name for name, at in gestures(session) if at >= 24} >= {"tap", "lean"}
    same(session)


@pytest.mark.parametrize(
    "line",
    few(
        [
            "ada plays choose knock tap lean every 1/2 chance 0.7",
            "ada plays walk knock tap (lean tap) every 1 do jitter 4ms 0.2mm",
            "ada plays shuffle knock tap lean euclid 5 8 rotate 3 swing 0.6",
            "ada plays tap euclid 5 8 every 4th do mirror",
        ],
        1,
    ),
)
def test_pattern_with_play_from_middle(tmp_path, line):
    """`play from`, a resumed session and a session from the beginning play the same."""
    result = []
    for name, start in (("a", "1|1"), ("b", "41|1")):
        (tmp_path / name).mkdir()
        with closing(Stepped(SCORE, tmp_path / name)) as session:
            session.ok(f"{line} at 1|1" if name == "a" else line)
            session.ok(f"play from {start}")
            if name == "a":
                session.run(0.1)
                session.ok("play from 41|1")
            session.run(3.0)
            played = gestures(session)
            result.append([one for one in played if 160 <= one[1] < 190])
            same(session)
            journal = session.journal
    assert result[0] == result[1] != []
    with closing(Stepped.resumed(journal)) as session:
        session.ok("play from 41|1")
        session.run(3.0)
        assert [one for one in gestures(session) if 160 <= one[1] < 190] == result[0]


@pytest.mark.parametrize(
    "line",
    few(
        [
            "ada plays knock lean tap every 1 every 3rd do mirror",
            "ada plays choose knock tap every 1 chance 0.7",
            "ada plays tap lean euclid 3 8 rotate 1",
            "ada plays shuffle knock (tap lean) tap every 1 times 9",
        ],
        1,
    ),
)
def test_more_transformations_change_neither_order_nor_chance(tmp_path, line):
    """`do` cuts a line in two; what follows goes on where the first part ended."""
    result = []
    for name, more in (("a", None), ("b", "ada do scale 0.5")):
        (tmp_path / name).mkdir()
        with closing(Stepped(SCORE, tmp_path / name)) as session:
            session.ok("play")
            session.ok(line)
            session.run(7.3)
            if more:
                session.ok(more)
            session.run(3.0)
            piece = session.session.schedule.head.piece
            texts = session.session.schedule.head.texts
            (session.journal.parent / "copy.yaml").write_text(texts.text)
            assert piece_of(texts) == piece
            result.append([one for one in gestures(session) if 18 <= one[1] < 30])
    assert result[0] == result[1] != []


def test_keep_of_pattern_bars(session, tmp_path):
    session.ok("play")
    session.ok("ada plays choose knock tap lean every 1/2 chance 0.7")
    session.ok("leo plays knock (tap tap) lean euclid 5 8 every 3rd do mirror")
    session.run(12.3)
    first = session.session.schedule.beat_now() // 4.0 * 4.0 - 8.0  # the two bars that are over
    session.ok("keep 2bar as verse")
    played = gestures(session), gestures(session, "leo")
    saved = load(tmp_path / "verse.yaml").piece
    assert saved is not None
    from ergon.scores.staging.preparing import prepare

    beat = saved.tempo_map.beats
    for player, was in zip(("ada", "leo"), played, strict=True):
        item = [
            (g.name, beat(g.start)) for g in prepare(saved).hands.gestures if g.player == player
        ]
        assert item
        assert item == [
            (name, pytest.approx(position - first, abs=0.01))
            for name, position in was
            if first <= position < first + 8
        ]


def test_save_of_pattern(session, tmp_path):
    session.ok("play")
    session.ok("ada plays walk knock tap every 1/2 swing 0.6 every 2nd do scale 0.5")
    session.run(8.5)
    session.ok("rest ada")
    session.ok("save live")
    piece = load(tmp_path / "live.yaml").piece
    assert piece is not None
    (play,) = piece.parts
    assert play.played_text == "walk knock tap"
    assert play.pattern is not None
    assert play.pattern.swing == 0.6


@pytest.mark.parametrize(
    ("line", "why", "suggestion"),
    [
        ("ada plays knock laen every 1", "'laen' is not a gesture or a take", "lean"),
        ("ada plays knock ~ lean", "write `every`", None),
        ("ada plays (knock lean every 1", "not closed", None),
        ("ada plays knock every 1 chance 2", "above the maximum of 1", None),
        ("ada plays knock euclid 9 8", "1 to 8 pulses", None),
        ("ada plays knock every 1 every 4th do miror", "unknown transformation", "mirror"),
        ("ada plays knock lean evry 1", "unknown word 'evry'", "every"),
    ],
)
def test_wrong_pattern_lines_change_no_version(session, line, why, suggestion):
    before = session.session.schedule.head
    reply = session.type(line)
    assert not reply.taken
    assert why in reply.text
    if suggestion:
        assert suggestion in (reply.try_ or reply.text)
    assert session.session.schedule.head is before


_NAMES = st.sampled_from(["knock", "lean", "tap", "~"])
_ITEMS = st.recursive(
    _NAMES,
    lambda inner: st.builds(
        "({}{}){}".format,
        st.sampled_from(["", "", "choose ", "walk ", "shuffle "]),
        st.lists(inner, min_size=1, max_size=3).map(" ".join),
        st.sampled_from(["", "", "*2"]),
    ),
    max_leaves=6,
)
_LINES = st.builds(
    "{} plays {}{} every {}{}{}{}{}".format,
    st.sampled_from(["ada", "leo"]),
    st.sampled_from(["", "", "choose ", "walk ", "shuffle "]),
    st.lists(_ITEMS, min_size=1, max_size=3).map(" ".join),
    st.sampled_from(["1", "1/2", "1/3", "300ms", "1bar"]),
    st.sampled_from(["", " times 3", " until 6|1"]),
    st.sampled_from(["", " chance 0.6", " euclid 3 8", " euclid 5 7 rotate 2", " swing 2/3"]),
    st.sampled_from(["", " every 2nd do scale 0.5", " do jitter 2ms 0.1mm"]),
    st.sampled_from(["", " now", " at 3|2"]),
)
_ACTS = st.lists(
    st.one_of(
        _LINES,
        _LINES,
        st.sampled_from(
            ["undo", "redo", "rest ada", "ada do scale 0.8", "leo do mirror", "seed 3", "tempo 96",
             "play from 30|1", "play from 2|3", "stop", "play", "keep 2bar as kept", "save"]
        ),
    ),
    min_size=2,
    max_size=8,
)  # fmt: skip


def sessions(n: int):
    return settings(
        max_examples=n, derandomize=True, database=None, suppress_health_check=list(HealthCheck)
    )


@pytest.mark.slow
@sessions(4)
@given(acts=_ACTS)
def test_journal_of_random_pattern_session(tmp_path_factory, acts):
    typed_and_rendered(tmp_path_factory.mktemp("session"), acts)


@pytest.mark.slow
@sessions(300)
@given(acts=_ACTS)
def test_journals_of_many_random_pattern_sessions(tmp_path_factory, acts):
    typed_and_rendered(tmp_path_factory.mktemp("session"), acts)


def typed_and_rendered(folder: Path, acts: list[str]) -> None:
    with closing(Stepped(SCORE, folder)) as session:
        session.ok("play")
        for line in acts:
            reply = session.type(line)
            assert "in ergon itself" not in reply.text, line
            session.run(0.7)
        session.run(2.0)
        same(session)


# --- strikes -------------------------------------------------------------------------------------


def test_strikes_are_typed_replaced_rested_and_rendered(session, tmp_path):
    session.ok("play")
    session.ok("rain strikes bell.m euclid 3 8 impulse 0.1mNs chance 0.8")
    session.run(4.3)
    assert onset(session.sound) > 0
    session.ok("rain strikes bell.m drum.m every 1/2 impulse 0.1mNs..0.3mNs swing 0.6")
    session.run(4.0)
    written_ = session.session.schedule.head.piece
    assert [one.name for one in written_.strikes] == ["rain", "rain-2"]
    assert [target.text for target in written_.strikes[1].to] == ["bell.m", "drum.m"]
    session.ok("undo")
    session.run(2.5)
    assert [one.name for one in session.session.schedule.head.piece.strikes] == ["rain"]
    session.ok("redo")
    session.run(2.5)
    session.ok("rest rain")
    session.run(2.5)
    session.ok("save live")
    piece = load(tmp_path / "live.yaml").piece
    assert piece is not None
    assert [one.name for one in piece.strikes] == ["rain", "rain-2"]
    assert all(one.until is not None and one.until.text != "999|1" for one in piece.strikes)
    last = np.flatnonzero(np.abs(np.diff(session.sound[:, 0], 2)) > 0)
    assert last.size
    same(session)


def test_strikes_with_play_from_middle(tmp_path):
    """What is played from 9|1 is what a whole piece strikes from there on."""
    listened = []
    for name, start in (("a", "1|1"), ("b", "9|1")):
        (tmp_path / name).mkdir()
        with closing(Stepped(SCORE, tmp_path / name)) as session:
            session.ok("rain strikes drum.m every 1/4 impulse 1mNs chance 0.5")
            session.ok(f"play from {start}")
            session.run(22.0 if name == "a" else 6.0)
            begun = session.session.schedule.running.clock.begin_instant
            shift = round((begun + 16.0) * session.rate)
            step = np.abs(np.diff(session.sound[shift:, 1], 2))[: int(4 * session.rate)]
            listened.append(np.flatnonzero(step > 0.2 * step.max()) // 1000)
    assert set(listened[0]) == set(listened[1])
    assert len(set(listened[0])) > 5


@pytest.mark.parametrize(
    ("line", "why"),
    [
        ("rain strikes bel.m every 1 impulse 2mNs", "'bel' is not an instrument or a key"),
        ("rain strikes every 1 impulse 2mNs", "the modules are missing"),
        ("rain strikes bell.m every 1", "the impulse is missing"),
        ("rain strikes bell.m evry 1 impulse 2mNs", "'evry' is not an instrument or a key"),
        ("rain strikes bell.m every 1 impulse 2N", "impulse"),
        ("rain strikes bell.q every 1 impulse 2mNs", "bell.q"),
        ("rain strikes bell.m every 1 impulse 2mNs chance 3", "above the maximum of 1"),
        ("over strikes bell.m every 1 impulse 2mNs", "is not a name"),
        ("rest rian", "'rian' is not a player or strikes"),
    ],
)
def test_wrong_strike_lines_give_the_reason(session, line, why):
    reply = session.type(line)
    assert not reply.taken
    assert why in reply.text


# --- automation ----------------------------------------------------------------------------------


def value(session: Stepped, time: float, module: str = "m") -> float:
    """K of a module of the bell at an instant of the session [s]."""
    points = session.session.schedule.running.stage.paths.get(("bell", module), [])
    if not points:
        return float("nan")
    return float(np.interp(time, [p[0] for p in points], [p[1] for p in points]))


def hertz(k: float) -> float:
    return float(np.sqrt(k / 0.002)) / (2 * np.pi)


def test_automation_pattern_with_undo_and_save(session, tmp_path):
    session.ok("play")
    session.ok("ada plays knock every 1")
    session.ok("set bell.m.f A3 C4 E4 every 1")
    session.run(4.0)
    begun = session.session.schedule.running.clock.begin_instant
    listened = [round(hertz(value(session, begun + 2.0 + beat / 2 + 0.1)), 1) for beat in range(4)]
    assert listened == [pytest.approx(f, rel=1e-3) for f in (220.0, 261.6, 329.6, 220.0)]
    session.ok("lfo bell.m.t60 0.5..2 period 1bar shape triangle")
    session.run(3.0)
    session.ok("undo")
    session.run(3.0)
    session.ok("set bell.m.f A3")
    session.run(2.5)
    piece = session.session.schedule.head.piece
    assert [one.name for one in piece.automation] == ["bell.m.f"]
    assert piece.automation[0].until is not None
    assert piece.automation[0].until.text != "999|1"
    assert not value(session, 1e6) > 0.0 or hertz(value(session, 1e6)) == pytest.approx(220.0)
    session.ok("save live")
    saved = load(tmp_path / "live.yaml").piece
    assert saved is not None
    assert saved.automation[0].pattern is not None
    same(session)


def test_lfo_start_and_end_without_jump(session):
    session.ok("play")
    session.ok("ada plays knock every 1/2")
    session.ok("lfo bell.m.K 0.8..1.2 period 2bar shape sine")
    session.run(5.0)
    session.ok("lfo bell.m.K off now")
    session.run(2.0)
    session.ok("lfo bell.m.K x1..x2 period 1")
    session.ok("tempo 90")
    session.run(3.0)
    third = np.abs(np.diff(session.sound[:, 0], 3))
    assert third.max() < 20 * np.percentile(third[third > 0], 99)
    same(session)


def test_automation_unchanged_by_unrelated_lines(tmp_path):
    listened = []
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        with closing(Stepped(SCORE, tmp_path / name)) as session:
            session.ok("play")
            session.ok("ada plays knock every 1")
            session.ok("lfo bell.m.K 0.8..1.2 period 2bar")
            session.ok("set drum.m.f 90Hz 120Hz every 1/2 chance 0.7")
            session.run(5.1)
            session.ok("leo plays lean now" if name == "b" else "meters")
            session.run(0.3)
            session.ok("lean = 0mm@0 smooth 2mm@1/4 smooth 0mm@1/2" if name == "b" else "meters")
            session.run(3.0)
            listened.append(session.sound[:, 0])
            same(session)
    assert np.array_equal(*listened)


@pytest.mark.parametrize(
    "line",
    few(
        ["set bell.m.f walk A3.minor every 1/2 chance 0.8", "lfo bell.m.f 0.9..1.1 period 3bar"],
        ["set bell.m.f walk A3.minor every 1/2 chance 0.8"],
    ),
)
def test_automation_values_with_play_from_middle(tmp_path, line):
    result = []
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        with closing(Stepped(SCORE, tmp_path / name)) as session:
            session.ok(line)
            session.ok("play from 1|1")
            session.run(0.1)
            if name == "b":
                session.ok("play from 9|1")
            session.run(18.0 if name == "a" else 4.0)
            by = session.session.schedule.running.clock.begin_instant
            result.append([value(session, by + at) for at in np.arange(17.0, 19.0, 0.02)])
            same(session)
    assert result[0] == pytest.approx(result[1], rel=1e-9)


def test_keep_of_bars_with_automation(session, tmp_path):
    session.ok("play")
    session.ok("ada plays knock every 1")
    session.ok("set bell.m.f A3 C4 E4 every 1")
    session.ok("lfo drum.m.f 0.9..1.1 period 4")
    session.run(9.0)
    session.ok("keep 1bar as verse")
    saved = load(tmp_path / "verse.yaml").piece
    assert saved is not None
    assert [one.name for one in saved.automation] == ["bell.m.f", "drum.m.f"]
    assert all(one.until is not None for one in saved.automation)


@pytest.mark.parametrize(
    ("line", "why"),
    [
        ("set bell.m.f A3 H4 every 1", "neither a frequency"),
        ("set bell.m.f A3 C4", "the length of a step"),
        ("lfo bell.b.gap 1mm..2mm period 1", "only these parameters change"),
        ("lfo bell.m.K 0.8 period 1", "is not a range"),
        ("lfo bell.m.K 0.8..1.2", "the length of one swing is missing"),
        ("lfo bell.m.K 0.8..1.2 period 1 shape round", "is not one of sine"),
        ("lfo bell.m.K off", "no pattern and no lfo controls bell.m.K at "),
    ],
)
def test_wrong_automation_lines_give_the_reason(session, line, why):
    before = session.session.schedule.head
    reply = session.type(line)
    assert not reply.taken
    assert why in reply.text
    assert session.session.schedule.head is before


def test_notes_are_typed_undone_rested_and_rendered(session, tmp_path):
    session.ok("play")
    reply = session.ok("bell notes A3 C4 E4 euclid 5 8")
    assert "2|1" in reply.text
    session.run(4.0)
    begun = session.session.schedule.running.clock.begin_instant
    beats = [4 + at / 2 for at in (0, 2, 3, 5, 6)]  # the second bar's pulses, eight to a bar
    listened = [hertz(value(session, begun + beat / 2)) for beat in beats]
    assert listened == [pytest.approx(f, rel=1e-3) for f in (220.0, 261.63, 329.63, 220.0, 261.63)]
    session.ok("bell notes walk A4.minor-pentatonic every 1/2 chance 0.7 impulse 0.5mNs")
    session.run(4.0)
    session.ok("undo")
    session.run(3.0)
    session.ok("rest bell")
    session.run(2.5)
    session.ok("save live")
    saved = load(tmp_path / "live.yaml").piece
    assert saved is not None
    assert [one.name for one in saved.strikes] == ["bell"]
    assert saved.strikes[0].notes
    same(session)


@pytest.mark.parametrize(
    ("line", "why"),
    [
        ("bell notes A3 H4 every 1", "neither a frequency"),
        ("bell notes A3 C4", "the length of a step is missing"),
        ("bel notes A3 C4 every 1", "is not an instrument"),
        ("bell.b notes A3 C4 every 1", "bell.b"),
    ],
)
def test_wrong_note_lines_give_the_reason(session, line, why):
    reply = session.type(line)
    assert not reply.taken
    assert why in reply.text


def test_transform_last_gesture_of_ended_pattern(tmp_path):
    player_session = Stepped(
        SCORE.replace("A, play: knock, every: 1, times: 2", "1|1, play: knock"), tmp_path
    )
    player_session.ok("ada plays (knock lean)*2 every 1 times 1")
    player_session.ok("play")
    player_session.run(1.6)  # the last lean began on 1|4 and lasts half a beat
    player_session.ok("ada do scale 1.1 now")
    last = player_session.session.schedule.head.piece.parts[-1]
    assert (last.played_text, last.pattern, len(last.do)) == ("lean", None, 1)
    player_session.run(1.0)
    player_session.close()
    assert np.array_equal(player_session.again(), player_session.sound)
