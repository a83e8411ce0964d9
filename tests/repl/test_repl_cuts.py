"""Hush, stop and panic by a cut of the stage: they sound as the versions that the texts make."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cuts import ACTS, Act, after_act, after_line, begun, line_at, process
from sessions import EVERY, Stepped
from sweep import few

from ergon.notation.clock.shifted import StoppedTempoMap
from ergon.scores.reading.load import load
from ergon.scores.staging.cutting import cut_stage
from ergon.scores.staging.hands import Window
from ergon.scores.staging.preparing import Span
from ergon.scores.staging.stage import Stage, StageTakeover, stage
from tests.repl.test_repl_session import SCORE

_TOUCHING = SCORE.replace(
    "BUT: {between: [k2, m], K: 900N/m, gap: 1mm}", "RES: {between: [k2, m], K: 900N/m}"
)
COUPLED = _TOUCHING + "duet: [{couple: [k1, k2], REF: {K: 30N/m, Z: 0.2Ns/m}, at: 1|1}]\n"
GONG = """\
  gong:
    modules: {p: {PLATE: {shape: hex, radius: 4, rim: fixed, M: 300g, f: 65Hz, t60: 4s}}}
    out: {SOX: p.centre}
"""
_LONGER = 300  # random sessions of the slow test


@pytest.fixture
def stepped(tmp_path: Path) -> Iterator[Stepped]:
    with closing(Stepped(SCORE, tmp_path, journal=False)) as session:
        yield session


@pytest.fixture
def coupled(tmp_path: Path) -> Iterator[Stepped]:
    with closing(Stepped(COUPLED, tmp_path, journal=False)) as session:
        yield session


def check_random(seed: int, folder: Path) -> None:
    """A random session, whose lines after the act take over from the cut as from the texts."""
    with closing(begun(seed, folder)[0]) as stepped:
        for act in ACTS:
            sounds = after_act(stepped, act)
            np.testing.assert_array_equal(sounds.by_cut, sounds.by_text, f"{seed}: {act}")
            line = line_at(stepped, sounds, "tempo 100 now" if act == "hush" else "play")
            later = after_line(stepped, sounds, line, 0.5)
            np.testing.assert_array_equal(later.by_cut, later.by_text, f"{seed}: after {act}")


@pytest.mark.parametrize("seed", few(range(12), [0, 1, 2, 4, 5, 6, 8, 9, 10, 11]))
def test_cut_sounds_as_its_version(seed: int, tmp_path: Path) -> None:
    check_random(seed, tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(12, 12 + _LONGER))
def test_cut_sounds_as_its_version_many_random_sessions(seed: int, tmp_path: Path) -> None:
    check_random(seed, tmp_path)


@pytest.mark.parametrize("act", ACTS)
def test_cut_keeps_gestures_in_flight_after_stop_only(act: Act, stepped: Stepped) -> None:
    for line in ("play", "ada plays lean every 1 now", "leo plays knock every 1/2 now"):
        stepped.ok(line)
    stepped.run(1.3)
    sounds = after_act(stepped, act)
    gestures = sounds.cut.stage.gestures
    assert bool(gestures) == (act == "stop")
    assert gestures == sounds.texted.stage.gestures
    frame = sounds.frame / stepped.rate
    assert all(gesture.start < frame < gesture.stop for gesture in gestures)
    assert len(sounds.cut.stage.timeline.ranges()) == len(gestures)


@pytest.mark.parametrize("act", ACTS)
def test_cut_with_strikes(act: Act, stepped: Stepped) -> None:
    """Also none of a phrase that has begun, which the texts play to its end."""
    stepped.ok("phrase tune 0 bell.m 0.2mNs, 1/2 drum.m, 2 bell.m drum.m length 3")
    stepped.ok("play")
    stepped.ok("hook strikes tune every 3 now")
    stepped.ok("rain strikes drum.m every 1/3 impulse 0.1mNs now")
    stepped.run(2.2)
    stage, every = stepped.session.schedule.running.stage, stepped.engine.tick_frames
    frame = (stepped.engine.frame // every + 1) * every
    cut = cut_stage(stage, frame, ends_gestures=act != "stop", is_stopped=act != "hush")
    for mat in range(stage.network.n_mat):
        strikes = cut.timeline.strikes_on(mat)
        assert all(strike.at < frame / stepped.rate for strike in strikes)
    assert any(stage.timeline.strikes_on(mat) for mat in range(stage.network.n_mat))


@pytest.mark.parametrize("act", ["stop", "panic"])
def test_cut_with_open_coupling(act: Act, coupled: Stepped) -> None:
    """The cut goes on as if nothing had happened; the version of the texts lets go for 20 ms."""
    coupled.ok("play")
    coupled.ok("ada plays knock every 1 times 1 now")
    coupled.run(1.5)  # the gesture is over, and its key swings
    sounds = after_act(coupled, act)
    going_on = coupled.engine._simulation.fork()
    process(going_on, sounds.frame - coupled.engine.frame)
    np.testing.assert_array_equal(sounds.by_cut, process(going_on, len(sounds.by_cut)))
    assert 0.0 < sounds.error < 0.1


def test_hush_keeps_the_pitch_of_the_last_note(stepped: Stepped) -> None:
    stepped.ok("play")
    stepped.ok("bell notes C4 E4 every 1/2 impulse 0.1mNs now")
    stepped.ok("lfo drum.m.K 0.8..1.2 period 1bar now")
    stepped.run(1.6)
    sounds = after_act(stepped, "hush")
    np.testing.assert_array_equal(sounds.by_cut, sounds.by_text)
    before, cut = stepped.session.schedule.running.stage.paths, sounds.cut.stage.paths
    frame = sounds.frame / stepped.rate
    bell, drum = ("bell", "m"), ("drum", "m")
    assert max(t for t, *_ in before[bell]) > frame + 1.0
    assert {point[1:] for point in cut[bell] if point[0] >= frame} == {cut[bell][-1][1:]}
    assert cut[drum] == before[drum]
    assert max(t for t, *_ in cut[drum]) > frame + 1.0


def test_stop_holds_automation(stepped: Stepped) -> None:
    stepped.ok("play")
    stepped.ok("lfo drum.m.K 0.8..1.2 period 1bar now")
    stepped.ok("set bell.m.f x1.5 over 2bar now")
    stepped.run(1.6)
    sounds = after_act(stepped, "stop")
    np.testing.assert_array_equal(sounds.by_cut, sounds.by_text)
    stage = sounds.cut.stage
    assert isinstance(stage.piece.tempo_map, StoppedTempoMap)
    assert stage.paths == sounds.texted.stage.paths
    last = sounds.frame / stepped.rate + 0.0201  # reached within 20 ms
    for points in stage.paths.values():
        assert len({point[1:] for point in points if point[0] >= last - 1e-3}) == 1


def test_cut_of_a_cut_stage(stepped: Stepped) -> None:
    stepped.ok("play")
    stepped.ok("ada plays knock every 1/2 now")
    stepped.run(1.6)
    sounds = after_act(stepped, "stop")
    stage, half = sounds.cut.stage, len(sounds.by_cut) // 2 // EVERY * EVERY
    old = stepped.engine._simulation.fork()
    process(old, sounds.frame - stepped.engine.frame)
    first, again = stage.simulation.fork(), sounds.frame + half
    first.take_over(old)
    process(first, half)
    second = cut_stage(stage, again, ends_gestures=False, is_stopped=True).simulation
    second.take_over(first)
    np.testing.assert_array_equal(process(second, len(sounds.by_cut) - half), sounds.by_cut[half:])


def test_cut_with_a_real_hand(tmp_path: Path) -> None:
    """A hand whose movement is known moves its key through hush and stop."""
    (tmp_path / "score.yaml").write_text(SCORE)
    piece = load(tmp_path / "score.yaml").piece
    assert piece is not None
    moved = 4e-3 * np.abs(np.sin(np.arange(4000) / 40.0))
    real = {"leo": moved}
    played = replace(piece, parts=(), starts=())
    before = _staged(piece, real, None, 0, [Span(piece, Window())])
    frame = 100 * before.live_hands[0].tick_frames
    process(before.simulation, frame)
    for ends_gestures, stops in ((True, False), (False, True), (True, True)):
        tempo = StoppedTempoMap(piece.tempo_map, piece.tempo_map.beats(0.1), frame / piece.rate)
        here = replace(played, tempo_map=tempo) if stops else played
        texted = _staged(here, real, before, frame, [])
        cut = cut_stage(before, frame, ends_gestures=ends_gestures, is_stopped=stops)
        sounds = []
        for new in (texted, cut):
            new.simulation.take_over(before.simulation.fork())
            sounds.append(process(new.simulation, 8000))
        assert sounds[0][:, 1].any()
        np.testing.assert_array_equal(*sounds)
        assert [hand.index for hand in cut.live_hands] == [hand.index for hand in before.live_hands]


def _staged(piece, real, like: Stage | None, start: int, spans) -> Stage:
    going = StageTakeover(spans, like, start)
    return stage(piece, planned=True, real_hands=real, on_fault="mute", takeover=going)


@pytest.mark.parametrize("act", ACTS)
def test_cut_with_struck_bodies(act: Act, tmp_path: Path) -> None:
    """A body that masses strike is stepped; the texts' version would solve its modes first."""
    text = SCORE.replace("instruments:\n", f"instruments:\n{GONG}").replace(
        "mix: {channels: 2, route: [", "mix: {channels: 2, route: [{from: gong, to: [1]}, "
    )
    struck = "strikes: {hit: {to: gong.p.centre, at: 1|1, every: 1, until: 9|1, {}}}\n"
    text += struck.replace("{}", "mass: 10g, speed: 1m/s")
    with closing(Stepped(text, tmp_path, journal=False)) as stepped:
        stepped.ok("play")
        stepped.run(1.3)
        sounds = after_act(stepped, act)
        plans = [stepped.session.schedule.running.stage.plan, sounds.cut.stage.plan]
        before, after = ([(row.what, row.parts) for row in plan.rows()] for plan in plans)
        assert after == before
        assert ("stepped", ["gong"]) in before
        assert ("modes", ["gong"]) in [
            (row.what, row.parts) for row in sounds.texted.stage.plan.rows()
        ]
        assert sounds.error < 0.02  # the error of the steps against the exact modes
