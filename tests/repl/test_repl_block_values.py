"""Values in the lines of a block: arguments, and the number of a run."""

from contextlib import closing

import numpy as np
import pytest
from sessions import Stepped

from ergon.notation.clock.meter import parse_meter
from ergon.notation.clock.positions import parse_position
from ergon.notation.clock.tempo import Entry, TempoMap
from ergon.repl.language.triggers import parse_trigger

SCORE = """\
ergon: 1
rates: {audio: 8kHz}
tempo: [{at: 1|1, bpm: 240}]                    # a bar is a second
instruments:
  low:
    modules: {m: {CEL: {M: 5g, f: 90Hz, t60: 50ms}}}
    play: {strike: {at: m, impulse: 1mNs..9mNs}}
    out: {SOX: m}
  high:
    modules: {m: {CEL: {M: 1g, f: 900Hz, t60: 50ms}}}
    play: {strike: {at: m, impulse: 1mNs..9mNs}}
    out: {SOX: m}
mix: {channels: 2, route: [{from: low, to: 1}, {from: high, to: 2}]}
"""


@pytest.fixture
def session(tmp_path):
    with closing(Stepped(SCORE, tmp_path)) as session:
        yield session


def _times(session):
    piece = session.session.schedule.head.piece
    return {strikes.name: strikes.times for strikes in piece.strikes}


def _is_replayed(session):
    session.close()
    return np.array_equal(session.again(), session.sound)


def test_def_with_default_and_with_number(session):
    session.ok("def fill n=8: d1 strikes low every 1/4 times $n")
    assert session.ok("show fill").lines[1].endswith("- $n = 8")
    session.ok("fill")
    assert _times(session)["d1"] == 8
    session.ok("fill 16")
    assert _times(session)["d1"] == 16
    session.ok("run fill n=3 now")
    assert _times(session)["d1"] == 3
    assert session.ok("history").lines[-1].endswith("run fill n=3 now")
    session.ok("play")
    session.run(1.0)
    assert _is_replayed(session)
    with closing(Stepped.resumed(session.journal)) as resumed:
        resumed.ok("fill 5")
        assert _times(resumed)["d1"] == 5


def test_run_with_values_by_order_or_by_name(session):
    session.ok(
        "def fill what=low n=2:\n"
        "  $step = 1/2\n"
        '  d1 strikes $what every $step times $n\n  d2 = "$what*$n" f\nend'
    )
    session.ok("fill high 4 1/4")
    (d1, d2) = session.session.schedule.head.piece.strikes
    assert (d1.parts, d1.times, d1.every.beats) == ({"high"}, 4, 0.25)
    assert d2.rhythm.text == "high*4"
    session.ok("fill step=1")
    d1 = session.session.schedule.head.piece.strikes[0]
    assert (d1.parts, d1.times, d1.every.beats) == ({"low"}, 2, 1.0)


def test_tick_of_rule(session):
    session.ok("def turn: d1 strikes $tick[low high high] every 1/4 times 2")
    session.ok("play")
    session.run(0.2)
    session.ok("turn every 1bar")  # from bar 2 on
    session.run(6.9)
    frames = int(session.rate)
    low = [np.abs(session.sound[n * frames : (n + 1) * frames, 0]).max() > 1e-9 for n in range(7)]
    high = [np.abs(session.sound[n * frames : (n + 1) * frames, 1]).max() > 1e-9 for n in range(7)]
    assert low == [False, True, False, False, True, False, False]
    assert high == [False, False, True, True, False, True, True]
    assert _is_replayed(session)
    with closing(Stepped.resumed(session.journal)) as resumed:
        resumed.ok("play")
        resumed.run(1.5)
        lines = [waiting_line.line for waiting_line in resumed.session.schedule.waiting]
        assert lines == ["run turn tick=8"]


def test_tick_as_number(session):
    session.ok("def up: tempo 12$tick")
    session.ok("up")
    assert session.session.schedule.head.piece.tempo_map.bpm(100.0) == 120.0
    session.ok("up tick=7")
    assert session.session.schedule.head.piece.tempo_map.bpm(100.0) == 127.0


@pytest.mark.parametrize("text", ["every 2bar", "every 3", "when bar % 3 == 2", "when beat == 2"])
@pytest.mark.parametrize("begin", [0.0, 4.0, 5.5])
def test_trigger_count_equals_number_of_its_beats(text, begin):
    entries = [
        Entry(parse_position("1|1"), 60.0, meter=parse_meter("4/4")),
        Entry(parse_position("5|1"), 90.0, meter=parse_meter("3/4")),
    ]
    tempo, trigger = TempoMap(entries), parse_trigger(text)
    runs = [begin] if trigger.runs_at_start(tempo, begin) else []
    after = begin
    while (beat := trigger.next_beat(tempo, begin, after, 60.0)) is not None:
        runs.append(beat)
        after = beat
    assert len(runs) > 3
    for number, beat in enumerate(runs):
        assert trigger.run_count(tempo, begin, beat) == number


@pytest.mark.parametrize(
    ("line", "why"),
    [
        ("def bad: d1 strikes low every $q", "$q has no value: begin the block with def NAME q=8:"),
        ("def bad q: hush", "'q' has no value: write q=8"),
        ("def bad tick=3: hush", "$tick counts the runs"),
        ("def bad 1a=3: hush", "'1a' is not the name of a value"),
        ("def bad: d1 strikes $tick[low lo] every 1", "the line is 'd1 strikes lo every 1'"),
        ("def bad n=x: d1 strikes low every 1 times $n", "the line is"),
        ("def bad what=low: d1 strikes $what[low high] every 1", "$what is low, and counts words"),
        ("def bad: d1 strikes $tick[] every 1", "needs words in brackets"),
        ("fill 3 4", "takes 1 value, and '4' is one more"),
        ("fill m=2", "has no value 'm'; it has n"),
        ('fill "3', "is not a value"),
        ("fill 0", "line 1 of fill: "),
        ("still 3", "takes no value"),
    ],
)
def test_invalid_block_values_are_refused(session, line, why):
    session.ok("def fill n=8: d1 strikes low every 1/4 times $n\ndef still: hush")
    text = session.session.schedule.head.texts.text
    reply = session.type(line)
    assert not reply.taken
    assert why in reply.text
    assert session.session.schedule.head.texts.text == text
