"""Lines that wait for their bars while the piece jumps, its tempo changes, and names go."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sessions import Stepped

from ergon.repl.session.running import stage_spans
from ergon.scores.staging.stage import Stage
from tests.repl.test_repl_session import SCORE


@pytest.fixture
def session(tmp_path: Path):
    stepped = Stepped(SCORE.replace("bpm: 120", "bpm: 240"), tmp_path)
    yield stepped
    stepped.close()


def same(session: Stepped) -> None:
    """The journal renders what was heard, at every frame."""
    session.close()
    assert np.array_equal(session.again(), session.sound)


def commits(session: Stepped) -> dict[int, int]:
    """The frame at which each line took effect, by its number."""
    events = [json.loads(line) for line in session.journal.read_text().splitlines()]
    return {one["number"]: one["frame"] for one in events if one["event"] == "commit"}


@pytest.mark.slow
def test_endless_part_continues_before_far_waiting_line(session: Stepped):
    """It fell silent 32 bars after the last line that took effect."""
    session.ok("play")
    session.ok("ada plays knock every 1")
    session.ok("rest ada at 60|1")
    session.run(50.0)
    second = int(session.rate)
    loudest = [np.abs(session.sound[n * second :][:second]).max() for n in range(2, 50)]
    assert min(loudest) > 1e-3
    session.run(14.0)
    assert np.abs(session.sound[-second:]).max() < 1e-6
    same(session)


def test_waiting_line_passed_by_jump_acts_at_once(session: Stepped):
    """The music stopped at the frame that the line waited for, until its window was extended."""
    session.ok("play")
    session.ok("ada plays knock every 1 now")
    session.ok("leo plays lean every 2 at 9|1")
    session.ok("gain drum -3dB at 40|1")
    session.run(2.0)
    session.ok("play from 153|2")
    session.run(0.5)
    assert not session.session.schedule.waiting
    session.run(12.0)
    second = int(session.rate)
    assert np.abs(session.sound[-second:]).max() > 1e-3
    same(session)


def test_waiting_line_keeps_beat_after_tempo_change(session: Stepped):
    """It acted at the second at which its beat had been."""
    session.ok("play")
    session.ok("ada plays knock every 1 at 9|1")  # at 8 s
    session.ok("tempo 120 now")
    session.run(20.0)
    tempo = session.session.schedule.head.piece.tempo_map
    frame = commits(session)[2]
    clock = session.session.schedule.running.clock
    assert clock.beat(tempo, frame / session.rate) == pytest.approx(32.0, abs=0.1)
    onset = int(np.flatnonzero(np.abs(session.sound).max(axis=1) > 1e-6)[0])
    assert onset / session.rate == pytest.approx(16.0, abs=0.1)
    session.ok("undo")
    same(session)


def test_rename_of_name_in_waiting_line_is_refused(session: Stepped):
    """It was an internal error."""
    session.ok("play")
    session.run(0.1)
    session.ok("gain leo -5dB")
    reply = session.type("rename leo mia now")
    assert not reply.taken
    assert reply.text == (
        "after this line, the waiting line 'gain leo -5dB' (due at 2|1) would fail: leo was "
        "renamed or removed by another line; `undo` cancels waiting lines, the last one first"
    )
    session.run(2.0)
    session.ok("rename leo mia now")
    same(session)


@pytest.mark.slow
def test_suspended_session_reports_skipped_lines(tmp_path: Path):
    stepped = Stepped(SCORE, tmp_path)
    stepped.ok("play")
    stepped.run(1.0)
    stepped.engine.process(
        int(200.0 * stepped.rate)
    )  # as where the program is stopped, and the sound is not
    stepped.session.do_once()
    messages = [one for one in stepped.session.messages() if "was skipped" in one]
    assert len(messages) == 1
    assert messages[0].startswith("the program was suspended, or the machine was too busy: ")
    stepped.run(1.0)
    assert not stepped.session.messages()
    stepped.close()


def test_late_lines_are_postponed_once(session: Stepped):
    """The time that a version takes was doubled for each: the twelfth waited for hours."""
    schedule = session.session.schedule
    schedule.moments.margin = 64
    session.ok("play")
    session.run(0.1)
    session.ok("gain bell -1dB")
    schedule.making_time.slowest_seconds = 0.01
    for _ in range(12):
        session.ok("gain bell -1dB")
    session.engine.process(int(3 * session.rate) // 64 * 64)  # the session does not get to look
    session.session.do_once()
    bars = {one.beat // 4 for one in schedule.waiting if one.number}
    assert len(bars) == 1
    assert max(bars) * 4 < schedule.beat_now() + 40


def test_slow_version_eventually_begins(session: Stepped, monkeypatch: pytest.MonkeyPatch):
    """The sound goes on meanwhile: each version came too late, and `play` never began."""
    engine, schedule = session.engine, session.session.schedule

    def slowly(*given: Any, **more: Any) -> Stage:
        engine.process(int(0.8 * session.rate) // 64 * 64)
        return stage_spans(*given, **more)

    monkeypatch.setattr("ergon.repl.session.takeover.stage_spans", slowly)
    schedule.moments.margin = 64
    session.ok("play")
    session.run(8.0)
    assert schedule.running.clock.is_running
    session.ok("gain bell -3dB")
    session.run(8.0)
    assert not schedule.waiting
    assert schedule.running.version.faders.gains["bell"] == pytest.approx(10**-0.15)


TRAVEL = """\
ergon: 1
title: A
use: [instruments/bell.yaml]
keys: {k1: {M: 400g, K: 60N/m, Z: 1.2Ns/m, travel: -15mm..15mm}}
instruments:
  action: {modules: {b: {BUT: {between: [k1, bell.hammer], K: 4kN/m, Z: 2Ns/m}}}}
gestures: {knock: 0mm@0 smooth 2mm@60ms 0mm@120ms}
players: {ada: {key: k1}}
parts:
  ada: []
"""


def test_impossible_waiting_line_is_dropped_from_journal(tmp_path: Path):
    """The journal held both, and could not be rendered."""
    stepped = Stepped(TRAVEL, tmp_path)
    stepped.ok("play")
    stepped.run(0.3)
    stepped.ok("tempo 100")
    stepped.ok("ada plays knock every 1 do scale 5")
    stepped.ok("knock = 0mm@0 smooth 6mm@60ms 0mm@120ms now")
    stepped.run(6.0)
    assert any("could not take effect and is dropped" in one for one in stepped.session.messages())
    events = [json.loads(line) for line in stepped.journal.read_text().splitlines()]
    dropped = [one["number"] for one in events if one["event"] == "dropped"]
    assert len(dropped) == 1
    assert set(dropped).isdisjoint(commits(stepped))
    same(stepped)
