"""`ada do every 4 rev` at the prompt: undone, saved, kept, entered anywhere, rendered."""

from __future__ import annotations

from pathlib import Path as FilePath
from typing import NamedTuple

import numpy as np
import pytest
from sessions import Stepped

from ergon.repl.session.version import piece_of
from ergon.scores.reading.load import load
from ergon.scores.staging.preparing import prepare
from tests.repl.test_repl_patterns import SCORE, gestures, same


@pytest.fixture
def session(tmp_path: FilePath):
    stepped = Stepped(SCORE, tmp_path)
    yield stepped
    stepped.close()


class Path(NamedTuple):
    """A gesture that was played: its beat, how long it lasts, when it is highest, as a share."""

    beat: float
    name: str
    lasting: float
    highest: float
    x: tuple[float, ...]


def path(gesture, beat: float) -> Path:
    lasting = gesture.instants[-1] - gesture.instants[0]
    highest = (gesture.instants[int(np.argmax(gesture.positions))] - gesture.instants[0]) / lasting
    x = tuple(gesture.positions)
    return Path(round(beat, 2), gesture.name, round(lasting, 4), round(highest, 4), x)


def played(session: Stepped, seconds: float) -> list[Path]:
    """What ada plays while the session runs."""
    result = set()
    for _ in range(round(seconds / 0.25)):
        session.run(0.25)
        running, now = session.session.schedule.running, session.session.schedule.beat_now()
        hers = [g for g in running.stage.gestures if g.player == "ada"]
        paths = [path(g, running.beat(round(g.start * session.rate))) for g in hers]
        result |= {each for each in paths if now - 1.0 <= each.beat < now}
    return sorted(result)


def test_gesture_rounds_after_undo_and_redo(session):
    session.ok("ada plays tap every 1 at 1|1")
    session.ok("play")
    session.run(2.2)
    session.ok("ada do every 4 rev at 3|3")
    result = [each for each in played(session, 5.0) if each.beat >= 10.0]
    assert [each.beat for each in result if each.highest > 0.5] == [12.0]
    assert [each.beat for each in result if each.highest < 0.5] == [10.0, 11.0, 13.0, 14.0]
    session.ok("undo")
    session.run(1.0)
    result = played(session, 4.0)
    assert len(result) >= 6
    assert all(each.highest < 0.5 for each in result)
    same(session)


def test_gesture_rounds_of_a_counted_line(session):
    session.ok("ada plays tap every 1 times 12 at 1|1")
    session.ok("play")
    session.run(1.2)
    session.ok("ada do every 4 rev at 3|1")
    result = [each for each in played(session, 7.0) if each.beat >= 8.0]
    assert [each.beat for each in result] == [8.0, 9.0, 10.0, 11.0]
    assert [each.highest > 0.5 for each in result] == [True, False, False, False]
    same(session)


def test_fast_halves_the_gesture_and_the_time_between(session):
    session.ok("ada plays tap every 1 at 1|1")
    session.ok("play")
    session.run(1.2)
    session.ok("ada do fast 2 at 3|1")
    result = [each for each in played(session, 5.0) if 8.0 <= each.beat < 10.0]
    assert [each.beat for each in result] == [8.0, 8.5, 9.0, 9.5]
    assert {each.lasting for each in result} == {0.08}
    same(session)


@pytest.mark.parametrize(
    "do",
    [
        "degrade 0.5",
        "sometimes 0.5 rev, rarely fast 2",
        "every 4 (rev, mirror), palindrome",
        "iter 2",
    ],
)
def test_gesture_rounds_with_play_from_middle(tmp_path, do):
    result = []
    for name, start in (("a", "1|1"), ("b", "21|1")):
        (tmp_path / name).mkdir()
        stepped = Stepped(SCORE, tmp_path / name)
        stepped.ok(f"ada plays tap lean every 1/2 do {do} at 1|1")
        stepped.ok(f"play from {start}")
        if name == "a":
            stepped.run(0.1)
            stepped.ok("play from 21|1")
        stepped.run(2.0)
        result.append([each for each in gestures(stepped) if 80 <= each[1] < 100])
        same(stepped)
        with_journal = stepped.journal
    assert result[0] == result[1] != []
    again = Stepped.resumed(with_journal)
    again.ok("play from 21|1")
    again.run(2.0)
    assert [each for each in gestures(again) if 80 <= each[1] < 100] == result[0]
    again.close()


def test_save_of_gesture_rounds(session, tmp_path):
    session.ok("ada plays tap lean every 1 at 1|1")
    session.ok("play")
    session.run(1.0)
    session.ok("ada do every 3 (rev, scale 0.5), degrade 0.3 at 3|1")
    before = played(session, 6.0)
    head = session.session.schedule.head
    assert piece_of(head.texts) == head.piece
    session.ok("rest ada")
    session.ok("save live")
    saved = load(tmp_path / "live.yaml").piece
    assert saved is not None
    beat = saved.tempo_map.beats
    hers = [path(g, beat(g.start)) for g in prepare(saved).hands.gestures if g.player == "ada"]
    later = [each for each in sorted(hers) if 8.0 <= each.beat < 13.0]
    assert later == [each for each in before if 8.0 <= each.beat < 13.0]
    assert 0 < len(later) < 5


@pytest.mark.parametrize(
    "do", ["fast 2", "every 2 rev, scale 0.5, degrade 0.4", "slow 2, rev", "iter 2"]
)
def test_keep_of_gesture_rounds(session, tmp_path, do):
    session.ok("play")
    session.ok(f"ada plays tap lean every 1/2 do {do}")
    before = played(session, 10.0)
    first = session.session.schedule.beat_now() // 4.0 * 4.0 - 8.0  # the two bars that are over
    session.ok("keep 2bar as verse")
    verse = load(tmp_path / "verse.yaml").piece
    assert verse is not None
    beat = verse.tempo_map.beats
    hers = [g for g in prepare(verse).hands.gestures if g.player == "ada"]
    result = sorted(path(g, first + beat(g.start)) for g in hers)
    assert result == [each for each in before if first <= each.beat < first + 8.0] != []


@pytest.mark.parametrize("do", ["off 1/8 rev", "every 2 ply 2", "stack rev", "jux rev"])
def test_gesture_rounds_with_second_path_are_refused(session, do):
    session.ok("ada plays tap every 1")
    reply = session.type(f"ada do {do}")
    assert not reply.taken
    assert "one place at a time" in reply.text
