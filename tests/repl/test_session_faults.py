"""What went wrong in sets on a busy machine: each as a sequence, in virtual time."""

from __future__ import annotations

import itertools
import threading
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from delayed_sessions import MARGIN, Delayed, check_render, delays, events, peaks_of_seconds
from patience import until
from sessions import EVERY, Stepped

from ergon.repl.session.schedule import Schedule
from tests.repl.test_repl_session import SCORE

# --- 2: the music goes on while the prompt is busy ------------------------------------------------


def test_sound_during_line_of_a_minute(delayed: Delayed) -> None:
    delayed.ok("play")
    delayed.ok("leo plays knock every 1 now")
    delayed.run(2.0)
    delayed.delay = lambda: 60.0
    delayed.ok("set bell.m.t60 0.4s")
    delayed.delay = lambda: 0.0
    delayed.run(4.0)
    assert peaks_of_seconds(delayed, 1)[2:].min() > 1e-4
    assert not events(delayed, "skip")
    check_render(delayed)


def test_sound_during_blocked_py_line(tmp_path: Path) -> None:
    """By the session's own threads: the prompt's thread waits within a line."""
    with closing(Stepped(SCORE, tmp_path)) as stepped:
        session = stepped.session
        session.run()
        stepped.ok("play")
        stepped.ok("leo plays knock every 1 now")
        session.gate = threading.Event()
        line = threading.Thread(target=session.submit, args=("py session.gate.wait()",))
        line.start()
        for _ in range(30):  # a minute, two seconds at a time
            with session.lock:  # a stepped engine is no thread of its own
                stepped._sound.append(stepped.engine.process(int(2.0 * stepped.rate)))
            until(lambda: _is_fed(session.schedule), "an extension")
        session.gate.set()
        line.join()
    assert peaks_of_seconds(stepped, 1)[2:].min() > 1e-4
    assert not events(stepped, "skip")
    assert np.array_equal(stepped.again()[: len(stepped.sound)], stepped.sound)


def _is_fed(schedule: Schedule) -> bool:
    """Whether the timeline goes on for more than the next two seconds."""
    return schedule.running.timeline_end > schedule.beat_now() + 12.0


@pytest.mark.parametrize("seconds", [40.0, 200.0])
def test_skip_is_written_to_the_journal(delayed: Delayed, seconds: float) -> None:
    """A suspended program plays nothing new; its render plays that too."""
    delayed.ok("play")
    delayed.ok("leo plays knock every 1 now")
    delayed.run(3.0)
    delayed.advance(int(seconds * delayed.rate) // EVERY * EVERY)
    delayed.run(3.0)
    (skip,) = events(delayed, "skip")
    assert skip["begin"] < skip["end"]
    assert any("was skipped" in one for one in delayed.session.messages())
    assert peaks_of_seconds(delayed, 1)[int(seconds) - 2] < 1e-6
    assert peaks_of_seconds(delayed, 1)[-2:].min() > 1e-4
    check_render(delayed)


# --- 3: order of typing ---------------------------------------------------------------------------


def test_slip_moves_the_lines_typed_later(delayed: Delayed) -> None:
    """The link came first, and then refused a gain for the key that was not there yet."""
    delayed.ok("play")
    delayed.run(0.2)
    assert delayed.ok("zoe takes k4 like k1 at 2|1").text.startswith("ok 2|1")
    assert delayed.ok("link k4 bell.m BUT K=900N/m gap=1mm at 2|4.5").text.startswith("ok 2|4.5")
    delayed.advance(int(3.7 * delayed.rate) // EVERY * EVERY)  # across both places
    delayed.run(0.1)
    delayed.ok("gain bell -3dB now")
    delayed.run(4.0)
    frames = {one["number"]: (one["frame"], one["change"]) for one in events(delayed, "commit")}
    assert frames[2] == frames[3]
    assert frames[4][0] <= frames[2][0]
    assert not events(delayed, "dropped")
    messages = delayed.session.messages()
    assert [one for one in messages if "together with 1 typed after it" in one], messages
    check_render(delayed)


@pytest.mark.parametrize("change", ["tempo 90 at 1|1", "set bell.m.t60 0.4s at 1|1"])
@pytest.mark.parametrize("takes", [0.05, 0.4])
def test_play_waits_for_a_line_on_its_first_beat(
    delayed: Delayed, change: str, takes: float
) -> None:
    """The piece began without the line, which then waited for the second bar."""
    delayed.ok("leo plays knock every 1")
    delayed.run(0.2)
    delayed.delay = lambda: takes
    assert delayed.ok(change).text.startswith("ok 1|1")
    for _ in range(2):  # late, so that it is given more time than `play`
        delayed.advance(int(2.0 * delayed.rate) // EVERY * EVERY)
        delayed.session.hand_over_due()
    delayed.ok("play")
    delayed.delay = lambda: 0.0
    delayed.run(9.0)
    assert [row["number"] for row in events(delayed, "commit")] == [1, 2, 3]
    assert not [message for message in delayed.session.messages() if "next bar" in message]
    check_render(delayed)


def test_fence_with_a_defined_instrument(delayed: Delayed) -> None:
    delayed.ok("play")
    delayed.run(0.2)
    delayed.ok("chime = bell transpose 3st at 3|1\nroute chime 1")
    assert delayed.ok("gain chime -6dB now").text.startswith("ok 3|1")
    delayed.ok("set chime.m.t60 0.2s at 4|1")
    delayed.run(8.0)
    assert not events(delayed, "dropped")
    assert delayed.session.schedule.head.faders.gains["chime"] == pytest.approx(10**-0.3)
    check_render(delayed)


def test_remove_of_instrument_needed_by_waiting_line(delayed: Delayed) -> None:
    delayed.ok("play")
    delayed.run(0.2)
    delayed.ok("chime = bell transpose 3st at 3|1\nroute chime 1")
    delayed.ok("set chime.m.t60 0.2s at 4|1")
    assert not delayed.type("remove chime at 3|3").taken  # a waiting line needs it
    delayed.ok("gain bell -3dB")
    delayed.run(8.0)
    assert not events(delayed, "dropped")


# --- 4: lateness does not feed itself -------------------------------------------------------------


def test_making_time_after_a_slow_line(delayed: Delayed) -> None:
    delayed.ok("play")
    delayed.delay = lambda: 5.0
    delayed.ok("set bell.m.t60 0.4s now")
    delayed.delay = lambda: 0.0
    for _ in range(3):
        delayed.ok("set bell.m.t60 0.3s now")
        delayed.run(0.1)
    soonest = delayed.session.schedule.soonest_frame() - delayed.engine.frame
    assert soonest <= 2 * MARGIN


@pytest.mark.parametrize("line", ["hush now", "stop now", "mute drum now", "panic", "damp 1s now"])
def test_stop_acts_at_once_beside_slow_waiting_lines(delayed: Delayed, line: str) -> None:
    """Their time was estimated from that of the lines before: 9.9 s for a hush."""
    delayed.ok("play")
    delayed.ok("leo plays knock every 1/2 now")
    delayed.run(1.0)
    delayed.delay = lambda: 4.0
    delayed.ok("set bell.m.t60 0.4s at 9|1")
    delayed.ok("knock = 0@0 smooth 5@1/8 smooth 0@1/2 at 9|1")
    frame = delayed.engine.frame
    delayed.ok(line)
    number = delayed.session._n_lines
    delayed.run(0.1)
    (done,) = [one for one in events(delayed, "commit") if one["number"] == number]
    assert done["frame"] <= frame + MARGIN + 2 * EVERY
    delayed.delay = lambda: 0.0
    check_render(delayed)


def test_release_before_the_end_of_a_panic(delayed: Delayed) -> None:
    """The reset landed 18 s after the release, and stopped the piece for good."""
    delayed.ok("play")
    delayed.ok("leo plays knock every 1 now")
    delayed.run(1.0)
    schedule = delayed.session.schedule
    delayed.ok("panic")
    (reset,) = [one for one in schedule.changes.pending if one.lines]
    delayed.engine.revoke(0)  # as if it came too late
    delayed.session._take_events()
    assert [one.line for one in schedule.waiting] == ["panic"]
    assert reset.lines
    delayed.ok("release")
    assert not schedule.waiting
    delayed.run(2.0)
    assert schedule.running.clock.is_running
    check_render(delayed)


# --- 5: a piece that stands keeps `at` ------------------------------------------------------------


def test_lines_typed_before_play_keep_their_beats(delayed: Delayed) -> None:
    assert delayed.ok("ada plays knock every 1 at 3|1").text.startswith("ok 3|1")
    assert delayed.ok("tempo 60 at 2|1").text == "ok 2|1"
    assert delayed.ok("leo plays lean in 2").text.startswith("ok 1|3")
    delayed.run(1.0)
    assert delayed.session.state().tempo == 120.0
    assert delayed.ok("play").text == "ok from 1|1"
    delayed.run(9.0)
    beats = {one["number"]: one["beat"] for one in events(delayed, "commit")}
    assert (beats[1], beats[2], beats[3]) == (8.0, 4.0, 2.0)
    assert delayed.session.state().tempo == 60.0
    ada = np.flatnonzero(np.abs(delayed.sound[:, 0]) > 1e-6)[0] / delayed.rate
    assert ada == pytest.approx(1.0 + 2.0 + 4.0, abs=0.3)  # a bar at 120, a bar at 60 bpm
    assert not delayed.session.messages()
    check_render(delayed)


@pytest.mark.parametrize("stop", ["stop now", "panic"])
def test_place_of_a_line_while_stopped(delayed: Delayed, stop: str) -> None:
    delayed.ok("play")
    delayed.run(2.3)
    delayed.ok(stop)
    delayed.run(0.2)
    assert delayed.ok("ada plays knock every 1 at 4|1").text.startswith("ok 4|1")
    delayed.run(5.0)
    assert delayed.session.schedule.waiting
    if stop == "panic":
        delayed.ok("release")
    delayed.ok("play")
    delayed.run(6.0)
    (done,) = [one for one in events(delayed, "commit") if one["beat"] == 12.0]
    assert done
    check_render(delayed)


def test_place_before_the_stopped_beat_is_refused(delayed: Delayed) -> None:
    delayed.ok("play from 9|1")
    delayed.run(1.0)
    delayed.ok("stop now")
    delayed.run(0.1)
    assert "is past: the piece is stopped at 9|" in delayed.type("ada plays knock at 2|1").text


def test_save_of_a_tempo_at_a_later_bar(delayed: Delayed, tmp_path: Path) -> None:
    """It set the whole piece to 90, and `save` wrote it so."""
    delayed.ok("tempo 90 at 5|1")
    delayed.ok("save kept")
    text = (tmp_path / "kept.yaml").read_text()
    assert "at: 1|1, bpm: 120" in text
    assert "at: 5|1, bpm: 90" in text


# --- 7: lines before play -------------------------------------------------------------------------


def test_lines_before_play_singly_equal_a_block(tmp_path: Path) -> None:
    lines = ["vib = bars/vibraphone", "route vib 1 2", "gain vib -3dB"]
    heads = []
    for number, typed in enumerate((lines, ["\n".join(lines)])):
        folder = tmp_path / str(number)
        folder.mkdir()
        with (
            closing(Delayed(SCORE, folder)) as position,
            delays(lambda position=position: position),
        ):
            position.delay = lambda: 0.3
            for line in typed:
                reply = position.type(line)
                assert reply.taken, reply.text
            position.ok("play")
            position.run(4.0)
            heads.append(position.session.schedule.head.texts.text)
            assert not events(position, "dropped")
    assert heads[0] == heads[1]


# --- 10: lines that are typed just before their bar -----------------------------------------------


@pytest.mark.parametrize("second", ["tempo 100", "ada plays nobody", "undo"])
def test_join_of_lines_under_way_to_one_bar(delayed: Delayed, second: str) -> None:
    """It took effect a bar after a line that was typed at the same instant."""
    delayed.ok("play")
    delayed.ok("leo plays knock every 1/4 now")
    delayed.run(1.8)
    delayed.ok("ada plays knock every 1")
    assert delayed.session.schedule.changes.pending
    assert delayed.type(second).taken == (second != "ada plays nobody")
    delayed.run(3.0)
    done = [event["beat"] for event in events(delayed, "commit")][2:]
    assert done == [4.0] * (1 if second == "ada plays nobody" else 2)
    check_render(delayed)


def test_join_without_enough_time(delayed: Delayed) -> None:
    delayed.ok("play")
    delayed.ok("leo plays knock every 1/4 now")
    delayed.run(1.97)
    delayed.ok("ada plays knock every 1")
    delayed.ok("tempo 100")
    delayed.run(4.0)
    assert [event["beat"] for event in events(delayed, "commit")][2:] == [4.0, 8.0]
    check_render(delayed)


# --- 12: lines that count from a beginning of the piece that is still to come ---------------------


def test_line_fenced_behind_a_late_play(delayed: Delayed) -> None:
    """Its beat was past by the clock of before, so that it acted at once."""
    delayed.ok("play from 8|1")
    delayed.run(0.5)
    delayed.delay = lambda: 4.0
    delayed.ok("play from 7|1")
    delayed.delay = lambda: 0.0
    assert delayed.ok("chime = bell transpose 3st in 1bar\nroute chime 1").text.startswith("ok 7|1")
    delayed.ok("mute drum in 2")
    delayed.run(6.0)
    frames = {row["number"]: row["frame"] for row in events(delayed, "commit")}
    assert frames[2] <= frames[3]
    check_render(delayed)


def paced(delayed: Delayed, *seconds: float) -> None:
    """Let makings take these times in turn, from the second on."""
    turns = itertools.cycle((*seconds[1:], seconds[0]))
    delayed.delay = lambda: next(turns)


def test_rest_and_lfo_lines_behind_waiting_play(delayed: Delayed) -> None:
    """It acted before the piece began, and was an error for a piece that stands."""
    paced(delayed, 0.0, 0.004, 1.2, 1.2, 0.0)
    delayed.ok("tempo 100 -> 130 over 1bar")
    delayed.ok("play from 11|1")
    delayed.ok("rest ada")
    delayed.advance(int(3.0 * delayed.rate) // EVERY * EVERY)
    delayed.ok("lfo bell.m.K 0.9..1.1 period 1bar")
    delayed.ok("damp 1s at 4|3.5")
    delayed.run(1.0)
    assert {2, 5} <= {line.number for line in delayed.session.schedule.waiting}
    check_render(delayed)


def test_stop_passes_a_waiting_play(delayed: Delayed) -> None:
    """Lines for beats of the piece were in the way, though they were to act after it began."""
    paced(delayed, 0.004, 0.02, 4.0, 1.2, 0.0, 0.0)
    delayed.ok("rest ada")
    delayed.ok("ada plays knock every 1")
    delayed.run(1.7)
    delayed.ok("set drum.m.f 95Hz over 1 in 2")
    delayed.ok("play from 12|1")
    frame = delayed.engine.frame
    delayed.ok("stop now")
    delayed.run(2.0)
    (done,) = [event["frame"] for event in events(delayed, "commit") if event["number"] == 5]
    assert done <= frame + MARGIN + 2 * EVERY
    check_render(delayed)
