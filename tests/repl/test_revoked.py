"""Changes that are withdrawn before their frame: by the stepped engine, and by the live one."""

from __future__ import annotations

import time
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from patience import until

from ergon.live.perform import PlaybackConfig
from ergon.repl.session.engine import Change, EngineEvent, SteppedEngine
from ergon.repl.session.live import LiveEngine
from ergon.scores.reading.load import load
from ergon.scores.staging.stage import Stage, StageTakeover, stage

EVERY = 64
SCORE = """\
ergon: 1
instruments: {bell: {modules: {m: {CEL: {M: 2g, f: 300Hz, t60: 2s}}}, out: {SOX: m}}}
strikes: {s: {to: bell.m, at: 1|1, impulse: 1mNs}}
"""


def fresh(folder: Path) -> Stage:
    (folder / "bell.yaml").write_text(SCORE)
    piece = load(folder / "bell.yaml").piece
    assert piece is not None
    return stage(piece, planned=True, on_fault="mute", takeover=StageTakeover(spans=()))


@pytest.fixture
def begun(tmp_path: Path) -> Stage:
    return fresh(tmp_path)


def damped(like: Stage, frame: int) -> Change:
    """A change that damps what sounds."""
    going = StageTakeover(spans=(), running_stage=like, start_frame=frame)
    new = stage(like.piece, planned=True, on_fault="mute", takeover=going)
    return Change(frame, new, like, damping_t60=0.1)


def test_revoke_reports_later_changes_as_late(begun: Stage) -> None:
    engine = SteppedEngine(begun, tick_frames=EVERY, highpass=None)
    first = damped(begun, 10 * EVERY)
    tickets = [engine.change(first)]
    tickets += [engine.change(damped(first.stage, at * EVERY)) for at in (30, 20, 20)]
    engine.revoke(20 * EVERY)
    assert engine.events() == [EngineEvent(0, ticket, is_late=True) for ticket in tickets[1:]]
    engine.process(40 * EVERY)
    assert engine.events() == [EngineEvent(10 * EVERY, tickets[0])]
    engine.revoke(0)
    assert not engine.events()


def test_change_after_revoke_takes_effect(tmp_path: Path) -> None:
    sounds = []
    for revokes in (False, True):
        begun = fresh(tmp_path)
        engine = SteppedEngine(begun, tick_frames=EVERY, highpass=None)
        if revokes:
            engine.change(damped(begun, 10 * EVERY))
            engine.revoke(10 * EVERY)
        ticket = engine.change(damped(begun, 10 * EVERY))
        sounds.append(engine.process(50 * EVERY))
        built = [one for one in engine.events() if not one.is_late]
        assert built == [EngineEvent(10 * EVERY, ticket)]
    np.testing.assert_array_equal(*sounds)


def test_revoke_at_present_frame(begun: Stage) -> None:
    engine = SteppedEngine(begun, tick_frames=EVERY, highpass=None)
    engine.process(10 * EVERY)
    ticket = engine.change(damped(begun, 10 * EVERY))
    engine.revoke(10 * EVERY)
    engine.process(EVERY)
    assert engine.events() == [EngineEvent(10 * EVERY, ticket, is_late=True)]


def test_revoke_by_the_live_engine(begun: Stage) -> None:
    with closing(LiveEngine(begun, PlaybackConfig(audio="null"))) as engine:
        soon = (engine.frame // engine.tick_frames + 1) * engine.tick_frames
        position = soon + 600 * engine.tick_frames * engine.tick_frames  # minutes on
        tickets = [engine.change(damped(begun, position)) for _ in range(3)]
        engine.revoke(position + 1)
        path = engine.guide(position, {})
        engine.revoke(position)
        last = engine.change(damped(begun, position))
        result: list[EngineEvent] = []

        def read(found: list[EngineEvent]) -> list[EngineEvent]:
            found += engine.events()
            return found

        until(lambda: len(read(result)) >= len(tickets), "the revoked changes are reported")
        time.sleep(0.05)
        read(result)
        assert [(one.ticket, one.is_late) for one in result] == [(own, True) for own in tickets]
        assert path not in tickets
        assert last not in tickets
    engine.revoke(0)  # nothing is left to withdraw
