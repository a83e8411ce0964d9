"""What went wrong in sets on a busy machine: each as a sequence, in virtual time."""

from __future__ import annotations

import itertools
import json
import threading
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from delayed_sessions import MARGIN, Delayed, delays
from patience import until
from sessions import EVERY, Stepped

from ergon.repl.session.schedule import Schedule
from tests.repl.test_repl_session import SCORE


@pytest.fixture
def at(tmp_path: Path) -> Iterator[Delayed]:
    session = Delayed(SCORE, tmp_path)
    with delays(lambda: session):
        yield session
    session.close()


def events(at: Stepped, name: str) -> list[dict[str, Any]]:
    """The journal's events of a name."""
    rows = (json.loads(row) for row in at.journal.read_text().splitlines())
    return [row for row in rows if row["event"] == name]


def check_render(at: Delayed) -> None:
    """The journal renders what was heard."""
    at.close()
    at.delay = lambda: 0.0
    assert np.array_equal(at.again(), at.sound)


def seconds_of(at: Stepped, channel: int) -> np.ndarray:
    """The peak of each second of a channel."""
    n = int(at.rate)
    sound = np.abs(at.sound[: len(at.sound) // n * n, channel])
    return sound.reshape(-1, n).max(axis=1)


# --- 2: the music goes on while the prompt is busy ------------------------------------------------


def test_music_goes_on_while_a_line_is_made_for_a_minute(at: Delayed) -> None:
    at.ok("play")
    at.ok("leo plays knock every 1 now")
    at.run(2.0)
    at.delay = lambda: 60.0
    at.ok("set bell.m.t60 0.4s")
    at.delay = lambda: 0.0
    at.run(4.0)
    assert seconds_of(at, 1)[2:].min() > 1e-4
    assert not events(at, "skip")
    check_render(at)


def test_music_goes_on_while_python_waits(tmp_path: Path) -> None:
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
    assert seconds_of(stepped, 1)[2:].min() > 1e-4
    assert not events(stepped, "skip")
    assert np.array_equal(stepped.again()[: len(stepped.sound)], stepped.sound)


def _is_fed(schedule: Schedule) -> bool:
    """Whether the timeline goes on for more than the next two seconds."""
    return schedule.running.timeline_end > schedule.beat_now() + 12.0


@pytest.mark.parametrize("seconds", [40.0, 200.0])
def test_skip_is_written_to_the_journal(at: Delayed, seconds: float) -> None:
    """A suspended program plays nothing new; its render plays that too."""
    at.ok("play")
    at.ok("leo plays knock every 1 now")
    at.run(3.0)
    at.advance(int(seconds * at.rate) // EVERY * EVERY)
    at.run(3.0)
    (skip,) = events(at, "skip")
    assert skip["begin"] < skip["end"]
    assert any("was skipped" in one for one in at.session.messages())
    assert seconds_of(at, 1)[int(seconds) - 2] < 1e-6
    assert seconds_of(at, 1)[-2:].min() > 1e-4
    check_render(at)


# --- 3: order of typing ---------------------------------------------------------------------------


def test_slip_moves_the_lines_typed_later(at: Delayed) -> None:
    """The link came first, and then refused a gain for the key that was not there yet."""
    at.ok("play")
    at.run(0.2)
    assert at.ok("zoe takes k4 like k1 at 2|1").text.startswith("ok 2|1")
    assert at.ok("link k4 bell.m BUT K=900N/m gap=1mm at 2|4.5").text.startswith("ok 2|4.5")
    at.advance(int(3.7 * at.rate) // EVERY * EVERY)  # across both places
    at.run(0.1)
    at.ok("gain bell -3dB now")
    at.run(4.0)
    frames = {one["number"]: (one["frame"], one["change"]) for one in events(at, "commit")}
    assert frames[2] == frames[3]
    assert frames[4][0] <= frames[2][0]
    assert not events(at, "dropped")
    said = at.session.messages()
    assert [one for one in said if "together with 1 typed after it" in one], said
    check_render(at)


@pytest.mark.parametrize("change", ["tempo 90 at 1|1", "set bell.m.t60 0.4s at 1|1"])
@pytest.mark.parametrize("takes", [0.05, 0.4])
def test_play_waits_for_a_line_on_its_first_beat(at: Delayed, change: str, takes: float) -> None:
    """The piece began without the line, which then waited for the second bar."""
    at.ok("leo plays knock every 1")
    at.run(0.2)
    at.delay = lambda: takes
    assert at.ok(change).text.startswith("ok 1|1")
    for _ in range(2):  # late, so that it is given more time than `play`
        at.advance(int(2.0 * at.rate) // EVERY * EVERY)
        at.session.attend()
    at.ok("play")
    at.delay = lambda: 0.0
    at.run(9.0)
    assert [row["number"] for row in events(at, "commit")] == [1, 2, 3]
    assert not [message for message in at.session.messages() if "next bar" in message]
    check_render(at)


def test_fence_with_a_defined_instrument(at: Delayed) -> None:
    at.ok("play")
    at.run(0.2)
    at.ok("chime = bell transpose 3st at 3|1\nroute chime 1")
    assert at.ok("gain chime -6dB now").text.startswith("ok 3|1")
    at.ok("set chime.m.t60 0.2s at 4|1")
    at.run(8.0)
    assert not events(at, "dropped")
    assert at.session.schedule.head.faders.gains["chime"] == pytest.approx(10**-0.3)
    check_render(at)


def test_drop_names_the_line_that_fails(at: Delayed) -> None:
    at.ok("play")
    at.run(0.2)
    at.ok("chime = bell transpose 3st at 3|1\nroute chime 1")
    at.ok("set chime.m.t60 0.2s at 4|1")
    assert not at.type("remove chime at 3|3").taken  # a waiting line needs it
    at.ok("gain bell -3dB")
    at.run(8.0)
    assert not events(at, "dropped")


# --- 4: lateness does not feed itself -------------------------------------------------------------


def test_making_time_after_a_slow_line(at: Delayed) -> None:
    at.ok("play")
    at.delay = lambda: 5.0
    at.ok("set bell.m.t60 0.4s now")
    at.delay = lambda: 0.0
    for _ in range(3):
        at.ok("set bell.m.t60 0.3s now")
        at.run(0.1)
    soonest = at.session.schedule.soonest_frame() - at.engine.frame
    assert soonest <= 2 * MARGIN


@pytest.mark.parametrize("line", ["hush now", "stop now", "mute drum now", "panic", "damp 1s now"])
def test_stops_act_at_once_whatever_waits(at: Delayed, line: str) -> None:
    """Their time was estimated from that of the lines before: 9.9 s for a hush."""
    at.ok("play")
    at.ok("leo plays knock every 1/2 now")
    at.run(1.0)
    at.delay = lambda: 4.0
    at.ok("set bell.m.t60 0.4s at 9|1")
    at.ok("knock = 0@0 smooth 5@1/8 smooth 0@1/2 at 9|1")
    frame = at.engine.frame
    at.ok(line)
    number = at.session._n_lines
    at.run(0.1)
    (done,) = [one for one in events(at, "commit") if one["number"] == number]
    assert done["frame"] <= frame + MARGIN + 2 * EVERY
    at.delay = lambda: 0.0
    check_render(at)


def test_release_before_the_end_of_a_panic(at: Delayed) -> None:
    """The reset landed 18 s after the release, and stopped the piece for good."""
    at.ok("play")
    at.ok("leo plays knock every 1 now")
    at.run(1.0)
    schedule = at.session.schedule
    at.ok("panic")
    (reset,) = [one for one in schedule.changes.under_way if one.lines]
    at.engine.revoke(0)  # as if it came too late
    at.session._take_events()
    assert [one.line for one in schedule.waiting] == ["panic"]
    assert reset.lines
    at.ok("release")
    assert not schedule.waiting
    at.run(2.0)
    assert schedule.running.clock.is_running
    check_render(at)


# --- 5: a piece that stands keeps `at` ------------------------------------------------------------


def test_lines_typed_before_play_act_where_they_say(at: Delayed) -> None:
    assert at.ok("ada plays knock every 1 at 3|1").text.startswith("ok 3|1")
    assert at.ok("tempo 60 at 2|1").text == "ok 2|1"
    assert at.ok("leo plays lean in 2").text.startswith("ok 1|3")
    at.run(1.0)
    assert at.session.state().tempo == 120.0
    assert at.ok("play").text == "ok from 1|1"
    at.run(9.0)
    beats = {one["number"]: one["beat"] for one in events(at, "commit")}
    assert (beats[1], beats[2], beats[3]) == (8.0, 4.0, 2.0)
    assert at.session.state().tempo == 60.0
    ada = np.flatnonzero(np.abs(at.sound[:, 0]) > 1e-6)[0] / at.rate
    assert ada == pytest.approx(1.0 + 2.0 + 4.0, abs=0.3)  # a bar at 120, a bar at 60 bpm
    assert not at.session.messages()
    check_render(at)


@pytest.mark.parametrize("stop", ["stop now", "panic"])
def test_place_of_a_line_while_stopped(at: Delayed, stop: str) -> None:
    at.ok("play")
    at.run(2.3)
    at.ok(stop)
    at.run(0.2)
    assert at.ok("ada plays knock every 1 at 4|1").text.startswith("ok 4|1")
    at.run(5.0)
    assert at.session.schedule.waiting
    if stop == "panic":
        at.ok("release")
    at.ok("play")
    at.run(6.0)
    (done,) = [one for one in events(at, "commit") if one["beat"] == 12.0]
    assert done
    check_render(at)


def test_place_before_the_stopped_beat_is_refused(at: Delayed) -> None:
    at.ok("play from 9|1")
    at.run(1.0)
    at.ok("stop now")
    at.run(0.1)
    assert "is past: the piece stands at 9|" in at.type("ada plays knock at 2|1").text


def test_save_of_a_tempo_at_a_later_bar(at: Delayed, tmp_path: Path) -> None:
    """It set the whole piece to 90, and `save` wrote it so."""
    at.ok("tempo 90 at 5|1")
    at.ok("save kept")
    text = (tmp_path / "kept.yaml").read_text()
    assert "at: 1|1, bpm: 120" in text
    assert "at: 5|1, bpm: 90" in text


# --- 7: lines before play -------------------------------------------------------------------------


def test_lines_typed_singly_before_play_are_as_good_as_a_block(tmp_path: Path) -> None:
    lines = ["kick = skins/kick", "route kick 1 2", "gain kick -3dB"]
    heads = []
    for number, typed in enumerate((lines, ["\n".join(lines)])):
        folder = tmp_path / str(number)
        folder.mkdir()
        with closing(Delayed(SCORE, folder)) as at, delays(lambda at=at: at):
            at.delay = lambda: 0.3
            for line in typed:
                reply = at.type(line)
                assert reply.taken, reply.text
            at.ok("play")
            at.run(4.0)
            heads.append(at.session.schedule.head.texts.text)
            assert not events(at, "dropped")
    assert heads[0] == heads[1]


# --- 8: levels that act before what was sent earlier ----------------------------------------------


def test_gain_of_an_instrument_under_way(at: Delayed) -> None:
    """It acted before the instrument was there, and the journal could not be rendered."""
    at.delay = lambda: 0.1
    at.ok("tempo 110")
    at.ok("kick = skins/kick\nroute kick 1 2")
    assert at.session.schedule.changes.under_way
    at.ok("gain kick -3dB")
    at.delay = lambda: 0.0
    at.ok("play")
    at.ok("rain strikes kick.skin.centre every 1 impulse 20mNs now")
    at.run(2.0)
    assert np.abs(at.sound).max() > 1e-6
    check_render(at)


def test_levels_act_in_the_order_of_their_frames(at: Delayed) -> None:
    """`unmute` was done after `mute`, which had been typed before it and acted after it."""
    at.ok("play")
    at.ok("leo plays knock every 1/4 now")
    at.run(1.0)
    at.ok("mute drum")
    at.run(0.8)
    assert at.session.schedule.changes.under_way
    at.ok("unmute now")
    at.ok("couple k1 k2 K=40N/m Z=0.2Ns/m")
    at.run(4.0)
    assert at.session.schedule.head.faders.muted == {"drum"}
    assert seconds_of(at, 1)[1] > 1e-6
    assert seconds_of(at, 1)[-1] == 0.0
    check_render(at)


def test_unmute_now_before_a_mute_at_the_bar(at: Delayed) -> None:
    """A version that took over before the bar had the level of after it."""
    at.ok("play")
    at.ok("leo plays knock every 1/4 now")
    at.run(1.0)
    at.ok("gain drum x0")
    at.run(0.8)
    assert at.session.schedule.changes.under_way
    at.ok("couple k1 k2 K=40N/m Z=0.2Ns/m now")
    at.run(3.0)
    (level,) = [event["frame"] for event in events(at, "commit") if event["beat"] == 4.0]
    assert np.abs(at.sound[level - 400 : level - 200, 1]).max() > 1e-6
    check_render(at)


def test_gain_of_a_withdrawn_instrument(at: Delayed) -> None:
    """It acted without the instrument, and was lost."""
    at.ok("play")
    at.ok("ada plays knock every 1/4 now")
    at.run(1.75)
    at.ok("kick = skins/kick\nroute kick 1 2")
    at.ok("gain kick -3dB")
    at.ok("gain bell -6dB")
    assert len(at.session.schedule.changes.under_way) == 3
    at.ok("hush now")
    at.run(3.0)
    assert at.session.schedule.head.faders.gains == pytest.approx(
        {"kick": 0.708, "bell": 0.501}, abs=1e-3
    )
    assert not events(at, "dropped")
    check_render(at)


def test_undo_keeps_the_levels_that_acted_before(at: Delayed) -> None:
    """The version after a line lacked the levels that had overtaken it."""
    at.delay = lambda: 0.1
    at.ok("tempo 110")
    at.ok("set bell.m.t60 0.4s")
    at.ok("mute drum")
    assert len(at.session.schedule.changes.under_way) == 2
    at.run(0.5)
    at.ok("knock = 0@0 smooth 5@1/8 smooth 0@1/2")
    at.run(0.5)
    at.ok("undo")
    at.run(0.5)
    assert at.session.schedule.head.faders.muted == {"drum"}
    check_render(at)


def test_undo_acts_after_a_level_under_way(at: Delayed) -> None:
    """It acted before the level that it took back, which then stayed."""
    at.ok("play")
    at.run(1.0)
    at.ok("mute drum")
    at.run(0.8)
    assert at.session.schedule.changes.under_way
    at.ok("undo now")
    at.run(1.0)
    assert not at.session.schedule.head.faders.muted
    assert not at.session.schedule.running.version.faders.muted
    check_render(at)


def test_gain_now_before_a_waiting_play(at: Delayed) -> None:
    """It waited for the beginning of the piece, though it acts with the next tick."""
    at.delay = lambda: 0.1
    at.ok("tempo 110")
    at.ok("play")
    frame = at.engine.frame
    at.ok("gain bell -6dB now")
    at.run(0.5)
    (done,) = [event["frame"] for event in events(at, "commit") if event["number"] == 3]
    assert done == frame + MARGIN
    check_render(at)


# --- 9: two lines that end what plays, on one frame -----------------------------------------------


@pytest.mark.parametrize("lines", [("hush", "damp 1s"), ("damp 1s", "damp 2s", "hush")])
def test_ends_of_one_frame_act_together(at: Delayed, lines: tuple[str, ...]) -> None:
    """Each took the other back from the engine, without end."""
    at.ok("play")
    at.ok("leo plays knock every 1/4 now")
    at.run(1.8)
    for line in lines:
        assert at.ok(line).text.startswith("ok 2|1")
        assert at.session.schedule.changes.under_way
    at.run(1.0)
    done = [event["frame"] for event in events(at, "commit") if event["beat"] == 4.0]
    assert len(done) == len(lines)
    assert len(set(done)) == 1
    check_render(at)


# --- 10: lines that are typed just before their bar -----------------------------------------------


@pytest.mark.parametrize("second", ["tempo 100", "ada plays nobody", "undo"])
def test_join_of_lines_under_way_to_one_bar(at: Delayed, second: str) -> None:
    """It took effect a bar after a line that was typed at the same instant."""
    at.ok("play")
    at.ok("leo plays knock every 1/4 now")
    at.run(1.8)
    at.ok("ada plays knock every 1")
    assert at.session.schedule.changes.under_way
    assert at.type(second).taken == (second != "ada plays nobody")
    at.run(3.0)
    done = [event["beat"] for event in events(at, "commit")][2:]
    assert done == [4.0] * (1 if second == "ada plays nobody" else 2)
    check_render(at)


def test_join_without_enough_time(at: Delayed) -> None:
    at.ok("play")
    at.ok("leo plays knock every 1/4 now")
    at.run(1.97)
    at.ok("ada plays knock every 1")
    at.ok("tempo 100")
    at.run(4.0)
    assert [event["beat"] for event in events(at, "commit")][2:] == [4.0, 8.0]
    check_render(at)


# --- 11: lines that restore a version, one while another waits ------------------------------------


def check_beginning(at: Delayed) -> None:
    """The beginning plays, and no line waits that would bring back anything else."""
    at.run(6.0)
    head = at.session.schedule.head
    assert not at.session.schedule.waiting
    assert head.texts.text == at.session.schedule.past_versions[0].texts.text
    assert not head.faders.muted
    assert not at.session.messages()
    check_render(at)


@pytest.mark.parametrize("first", ["undo", "undo at 4|1"])
def test_undo_replaces_a_waiting_undo(at: Delayed, first: str) -> None:
    """The first acted after the second, and brought back the level."""
    at.ok("play")
    at.ok("mute drum now")
    at.run(0.4)
    at.ok("ada plays knock every 1 now")
    at.run(0.4)
    at.ok(first)
    at.ok("undo now")
    assert [event["number"] for event in events(at, "dropped")] == [4]
    check_beginning(at)


@pytest.mark.parametrize("line", ["mute drum now", "ada plays knock every 1 now"])
def test_undo_replaces_a_waiting_redo(at: Delayed, line: str) -> None:
    """The redo acted after it."""
    at.ok("play")
    at.ok(line)
    at.run(0.4)
    at.ok("undo now")
    at.run(0.4)
    at.ok("redo")
    at.ok("undo now")
    check_beginning(at)


@pytest.mark.parametrize("more", [(), ("gain drum -9dB\nset drum.m.t60 0.5s",)])
def test_undo_of_lines_withdrawn_by_a_stop(at: Delayed, more: tuple[str]) -> None:
    """A line and its undo waited again; a second undo cancelled the line before alone."""
    at.ok("play from 2|1")
    at.ok("tempo 100 -> 130 over 1bar")
    at.ok("lfo bell.m.K 0.9..1.1 period 1bar in 1bar")
    at.run(1.7)
    at.ok("undo")
    for line in (*more, "stop now"):
        at.ok(line)
    at.run(0.5)
    for _ in (*more, "undo"):
        at.ok("undo now")
    check_beginning(at)


def test_refused_undo_keeps_a_waiting_undo(at: Delayed) -> None:
    at.ok("play")
    at.ok("mute drum now")
    at.run(0.4)
    at.ok("ada plays knock every 1 now")
    at.run(0.4)
    at.ok("undo")
    assert not at.type("undo at 1|1").taken
    at.run(2.0)
    (done,) = [event for event in events(at, "commit") if event["number"] == 4]
    assert done["beat"] == 4.0
    check_render(at)


def test_render_of_an_undo_staged_with_its_line(at: Delayed) -> None:
    """It knew the versions of earlier stages alone, so that `undo` did nothing there."""
    at.ok("play")
    at.run(1.8)
    for line in ("mute bell", "tempo 110", "leo plays knock every 1/2", "undo"):
        assert at.ok(line).text.startswith("ok 2|1")
    at.run(3.0)
    done = [event["frame"] for event in events(at, "commit") if event["number"] in (3, 4, 5)]
    assert len(done) == 3
    assert len(set(done)) == 1
    check_render(at)


def test_undo_leaves_out_what_a_level_of_its_bar_overtook(at: Delayed) -> None:
    """The version of the level had the line that was typed before it and acted after it."""
    at.delay = lambda: 0.02
    at.ok("play")
    at.run(7.0)
    at.ok("rain strikes drum.m euclid 3 8 impulse 0.2mNs")
    at.ok("gain bell -6dB")
    at.ok("knock = 0@0 smooth 5@1/8 smooth 0@1/2 now")
    at.run(1.0)
    assert [event["number"] for event in events(at, "commit")] == [1, 4, 3, 2]
    at.ok("undo now")
    at.run(1.0)
    head = at.session.schedule.head
    assert "rain" not in head.texts.text
    assert head.faders.gains == pytest.approx({"bell": 0.501}, abs=1e-3)
    check_render(at)


# --- 12: lines that count from a beginning of the piece that is still to come ---------------------


def test_line_fenced_behind_a_late_play(at: Delayed) -> None:
    """Its beat was past by the clock of before, so that it acted at once."""
    at.ok("play from 8|1")
    at.run(0.5)
    at.delay = lambda: 4.0
    at.ok("play from 7|1")
    at.delay = lambda: 0.0
    assert at.ok("chime = bell transpose 3st in 1bar\nroute chime 1").text.startswith("ok 7|1")
    at.ok("mute drum in 2")
    at.run(6.0)
    frames = {row["number"]: row["frame"] for row in events(at, "commit")}
    assert frames[2] <= frames[3]
    check_render(at)


def paced(at: Delayed, *seconds: float) -> None:
    """Let makings take these times in turn, from the second on."""
    turns = itertools.cycle((*seconds[1:], seconds[0]))
    at.delay = lambda: next(turns)


def test_what_ends_at_a_beat_passes_no_play_that_is_to_begin(at: Delayed) -> None:
    """It acted before the piece began, and was an error for a piece that stands."""
    paced(at, 0.0, 0.004, 1.2, 1.2, 0.0)
    at.ok("tempo 100 -> 130 over 1bar")
    at.ok("play from 11|1")
    at.ok("rest ada")
    at.advance(int(3.0 * at.rate) // EVERY * EVERY)
    at.ok("lfo bell.m.K 0.9..1.1 period 1bar")
    at.ok("damp 1s at 4|3.5")
    at.run(1.0)
    assert {2, 5} <= {line.number for line in at.session.schedule.waiting}
    check_render(at)


def test_stop_passes_a_waiting_play(at: Delayed) -> None:
    """Lines for beats of the piece were in the way, though they were to act after it began."""
    paced(at, 0.004, 0.02, 4.0, 1.2, 0.0, 0.0)
    at.ok("rest ada")
    at.ok("ada plays knock every 1")
    at.run(1.7)
    at.ok("set drum.m.f 95Hz over 1 in 2")
    at.ok("play from 12|1")
    frame = at.engine.frame
    at.ok("stop now")
    at.run(2.0)
    (done,) = [event["frame"] for event in events(at, "commit") if event["number"] == 5]
    assert done <= frame + MARGIN + 2 * EVERY
    check_render(at)
