"""Levels, ends and restored versions that meet others on a busy machine, in virtual time."""

from __future__ import annotations

import numpy as np
import pytest
from delayed_sessions import MARGIN, Delayed, check_render, events, peaks_of_seconds

# --- 8: levels that act before what was sent earlier ----------------------------------------------


def test_gain_of_an_instrument_under_way(delayed: Delayed) -> None:
    """It acted before the instrument was there, and the journal could not be rendered."""
    delayed.delay = lambda: 0.1
    delayed.ok("tempo 110")
    delayed.ok("vib = bars/vibraphone\nroute vib 1 2")
    assert delayed.session.schedule.changes.pending
    delayed.ok("gain vib -3dB")
    delayed.delay = lambda: 0.0
    delayed.ok("play")
    delayed.ok("rain strikes vib.hammer every 1 impulse 20mNs now")
    delayed.run(2.0)
    assert np.abs(delayed.sound).max() > 1e-6
    check_render(delayed)


def test_levels_act_in_the_order_of_their_frames(delayed: Delayed) -> None:
    """`unmute` was done after `mute`, which had been typed before it and acted after it."""
    delayed.ok("play")
    delayed.ok("leo plays knock every 1/4 now")
    delayed.run(1.0)
    delayed.ok("mute drum")
    delayed.run(0.8)
    assert delayed.session.schedule.changes.pending
    delayed.ok("unmute now")
    delayed.ok("couple k1 k2 K=40N/m Z=0.2Ns/m")
    delayed.run(4.0)
    assert delayed.session.schedule.head.faders.muted == {"drum"}
    assert peaks_of_seconds(delayed, 1)[1] > 1e-6
    assert peaks_of_seconds(delayed, 1)[-1] == 0.0
    check_render(delayed)


def test_unmute_now_before_a_mute_at_the_bar(delayed: Delayed) -> None:
    """A version that took over before the bar had the level of after it."""
    delayed.ok("play")
    delayed.ok("leo plays knock every 1/4 now")
    delayed.run(1.0)
    delayed.ok("gain drum x0")
    delayed.run(0.8)
    assert delayed.session.schedule.changes.pending
    delayed.ok("couple k1 k2 K=40N/m Z=0.2Ns/m now")
    delayed.run(3.0)
    (level,) = [event["frame"] for event in events(delayed, "commit") if event["beat"] == 4.0]
    assert np.abs(delayed.sound[level - 400 : level - 200, 1]).max() > 1e-6
    check_render(delayed)


def test_gain_of_a_withdrawn_instrument(delayed: Delayed) -> None:
    """It acted without the instrument, and was lost."""
    delayed.ok("play")
    delayed.ok("ada plays knock every 1/4 now")
    delayed.run(1.75)
    delayed.ok("vib = bars/vibraphone\nroute vib 1 2")
    delayed.ok("gain vib -3dB")
    delayed.ok("gain bell -6dB")
    assert len(delayed.session.schedule.changes.pending) == 3
    delayed.ok("hush now")
    delayed.run(3.0)
    assert delayed.session.schedule.head.faders.gains == pytest.approx(
        {"vib": 0.708, "bell": 0.501}, abs=1e-3
    )
    assert not events(delayed, "dropped")
    check_render(delayed)


def test_undo_keeps_levels_applied_earlier(delayed: Delayed) -> None:
    """The version after a line lacked the levels that had overtaken it."""
    delayed.delay = lambda: 0.1
    delayed.ok("tempo 110")
    delayed.ok("set bell.m.t60 0.4s")
    delayed.ok("mute drum")
    assert len(delayed.session.schedule.changes.pending) == 2
    delayed.run(0.5)
    delayed.ok("knock = 0@0 smooth 5@1/8 smooth 0@1/2")
    delayed.run(0.5)
    delayed.ok("undo")
    delayed.run(0.5)
    assert delayed.session.schedule.head.faders.muted == {"drum"}
    check_render(delayed)


def test_undo_acts_after_a_level_under_way(delayed: Delayed) -> None:
    """It acted before the level that it took back, which then stayed."""
    delayed.ok("play")
    delayed.run(1.0)
    delayed.ok("mute drum")
    delayed.run(0.8)
    assert delayed.session.schedule.changes.pending
    delayed.ok("undo now")
    delayed.run(1.0)
    assert not delayed.session.schedule.head.faders.muted
    assert not delayed.session.schedule.running.version.faders.muted
    check_render(delayed)


def test_gain_now_before_a_waiting_play(delayed: Delayed) -> None:
    """It waited for the beginning of the piece, though it acts with the next tick."""
    delayed.delay = lambda: 0.1
    delayed.ok("tempo 110")
    delayed.ok("play")
    frame = delayed.engine.frame
    delayed.ok("gain bell -6dB now")
    delayed.run(0.5)
    (done,) = [event["frame"] for event in events(delayed, "commit") if event["number"] == 3]
    assert done == frame + MARGIN
    check_render(delayed)


# --- 9: two lines that end what plays, on one frame -----------------------------------------------


@pytest.mark.parametrize("lines", [("hush", "damp 1s"), ("damp 1s", "damp 2s", "hush")])
def test_ends_of_one_frame_act_together(delayed: Delayed, lines: tuple[str, ...]) -> None:
    """Each took the other back from the engine, without end."""
    delayed.ok("play")
    delayed.ok("leo plays knock every 1/4 now")
    delayed.run(1.8)
    for line in lines:
        assert delayed.ok(line).text.startswith("ok 2|1")
        assert delayed.session.schedule.changes.pending
    delayed.run(1.0)
    done = [event["frame"] for event in events(delayed, "commit") if event["beat"] == 4.0]
    assert len(done) == len(lines)
    assert len(set(done)) == 1
    check_render(delayed)


# --- 11: lines that restore a version, one while another waits ------------------------------------


def check_beginning(delayed: Delayed) -> None:
    """The beginning plays, and no line waits that would bring back anything else."""
    delayed.run(6.0)
    head = delayed.session.schedule.head
    assert not delayed.session.schedule.waiting
    assert head.texts.text == delayed.session.schedule.past_versions[0].texts.text
    assert not head.faders.muted
    assert not delayed.session.messages()
    check_render(delayed)


@pytest.mark.parametrize("first", ["undo", "undo at 4|1"])
def test_undo_replaces_a_waiting_undo(delayed: Delayed, first: str) -> None:
    """The first acted after the second, and brought back the level."""
    delayed.ok("play")
    delayed.ok("mute drum now")
    delayed.run(0.4)
    delayed.ok("ada plays knock every 1 now")
    delayed.run(0.4)
    delayed.ok(first)
    delayed.ok("undo now")
    assert [event["number"] for event in events(delayed, "dropped")] == [4]
    check_beginning(delayed)


def test_line_after_waiting_undo_is_not_wiped(delayed: Delayed) -> None:
    """It acted before the undo, whose version has nothing of it."""
    delayed.ok("play")
    delayed.ok("ada plays knock every 1 now")
    delayed.run(0.4)
    delayed.ok("undo")
    delayed.ok("set drum.m.t60 0.5s now")
    delayed.run(6.0)
    assert not delayed.session.schedule.waiting
    assert "0.5s" in delayed.session.schedule.head.texts.text
    assert "every 1" not in delayed.session.schedule.head.texts.text


@pytest.mark.parametrize("line", ["mute drum now", "ada plays knock every 1 now"])
def test_undo_replaces_a_waiting_redo(delayed: Delayed, line: str) -> None:
    """The redo acted after it."""
    delayed.ok("play")
    delayed.ok(line)
    delayed.run(0.4)
    delayed.ok("undo now")
    delayed.run(0.4)
    delayed.ok("redo")
    delayed.ok("undo now")
    check_beginning(delayed)


@pytest.mark.parametrize("more", [(), ("gain drum -9dB\nset drum.m.t60 0.5s",)])
def test_undo_of_lines_withdrawn_by_a_stop(delayed: Delayed, more: tuple[str]) -> None:
    """A line and its undo waited again; a second undo cancelled the line before alone."""
    delayed.ok("play from 2|1")
    delayed.ok("tempo 100 -> 130 over 1bar")
    delayed.ok("lfo bell.m.K 0.9..1.1 period 1bar in 1bar")
    delayed.run(1.7)
    delayed.ok("undo")
    for line in (*more, "stop now"):
        delayed.ok(line)
    delayed.run(0.5)
    for _ in (*more, "undo"):
        delayed.ok("undo now")
    check_beginning(delayed)


def test_refused_undo_keeps_a_waiting_undo(delayed: Delayed) -> None:
    delayed.ok("play")
    delayed.ok("mute drum now")
    delayed.run(0.4)
    delayed.ok("ada plays knock every 1 now")
    delayed.run(0.4)
    delayed.ok("undo")
    assert not delayed.type("undo at 1|1").taken
    delayed.run(2.0)
    (done,) = [event for event in events(delayed, "commit") if event["number"] == 4]
    assert done["beat"] == 4.0
    check_render(delayed)


def test_render_of_an_undo_staged_with_its_line(delayed: Delayed) -> None:
    """It knew the versions of earlier stages alone, so that `undo` did nothing there."""
    delayed.ok("play")
    delayed.run(1.8)
    for line in ("mute bell", "tempo 110", "leo plays knock every 1/2", "undo"):
        assert delayed.ok(line).text.startswith("ok 2|1")
    delayed.run(3.0)
    done = [event["frame"] for event in events(delayed, "commit") if event["number"] in (3, 4, 5)]
    assert len(done) == 3
    assert len(set(done)) == 1
    check_render(delayed)


def test_undo_of_line_overtaken_by_level(delayed: Delayed) -> None:
    """The version of the level had the line that was typed before it and acted after it."""
    delayed.delay = lambda: 0.02
    delayed.ok("play")
    delayed.run(7.0)
    delayed.ok("rain strikes drum.m euclid 3 8 impulse 0.2mNs")
    delayed.ok("gain bell -6dB")
    delayed.ok("knock = 0@0 smooth 5@1/8 smooth 0@1/2 now")
    delayed.run(1.0)
    assert [event["number"] for event in events(delayed, "commit")] == [1, 4, 3, 2]
    delayed.ok("undo now")
    delayed.run(1.0)
    head = delayed.session.schedule.head
    assert "rain" not in head.texts.text
    assert head.faders.gains == pytest.approx({"bell": 0.501}, abs=1e-3)
    check_render(delayed)
