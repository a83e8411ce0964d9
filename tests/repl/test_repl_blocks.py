"""Blocks: lines by a name, run by hand, every so often, and where a condition holds."""

import json
import random
import sys

import numpy as np
import pytest
from one_bell import SCORE
from sessions import Stepped
from sweep import crossed, few

from ergon.notation.clock.meter import SAME, parse_meter
from ergon.notation.clock.positions import parse_position
from ergon.notation.clock.tempo import Entry, TempoMap
from ergon.notation.text.errors import TextError
from ergon.repl.language.triggers import parse_condition, parse_every, parse_trigger

EMPTY = (
    SCORE.replace("    - {at: A, play: knock, every: 1, times: 2}\n", "")
    .replace("  ada:\nmix", "  ada: []\nmix")
    .replace("  - {at: 3|1, bpm: 120 -> 60, over: 4}\n", "")
)
FILL = """\
def fill:
  ada plays knock every 1/2 times 2
  ada do scale 1.2  # louder
end"""


@pytest.fixture
def own(tmp_path):
    own = Stepped(EMPTY, tmp_path)
    yield own
    own.close()


def _runs(own):
    """The beats on which blocks took effect, from the journal."""
    rows = [json.loads(line) for line in own.journal.read_text().splitlines()]
    lines = {row["number"] for row in rows if row["event"] == "line" and not row.get("typed", True)}
    return [row["beat"] for row in rows if row["event"] == "commit" and row["number"] in lines]


def test_a_block_is_written_in_the_score_and_its_name_runs_it(own):
    own.ok(FILL)
    assert own.session.schedule.head.piece.blocks == {
        "fill": ("ada plays knock every 1/2 times 2", "ada do scale 1.2")
    }
    assert own.ok("show fill").lines[0].endswith("fill:")
    assert own.ok("history").lines[-1].endswith("  def fill: …")
    own.ok("play")
    own.run(0.5)
    assert own.ok("fill").text == "ok 2|1"
    own.run(3.0)
    assert np.abs(own.sound).max() > 1e-6
    assert own.ok("undo").taken
    own.run(3.0)
    assert "knock" not in str(own.session.schedule.head.piece.parts)
    own.close()
    assert np.array_equal(own.again(), own.sound)


def test_a_block_runs_every_so_often_until_it_is_stopped(own):
    own.ok("def fill: ada plays knock times 1")
    own.ok("play")
    own.run(0.1)
    assert own.ok("fill every 2bar").taken  # from bar 2 on
    own.run(9.0)  # 2 s a bar
    assert _runs(own) == [12.0]
    assert own.ok("show").lines[-1] == "fill: every 2bar"
    own.run(4.0)
    assert _runs(own) == [12.0, 20.0]
    own.ok("stop fill")
    own.run(9.0)
    assert _runs(own) == [12.0, 20.0]
    assert own.ok("show").lines[-1] != "fill: every 2bar"
    own.close()
    assert np.array_equal(own.again(), own.sound)
    assert np.abs(own.sound).max() > 1e-6


def test_a_block_runs_where_a_condition_holds(own):
    own.ok("def fill: ada plays knock times 1")
    own.ok("when bar % 4 == 3 fill now")
    own.ok("play")
    own.run(24.5)
    assert _runs(own) == [8.0, 24.0, 40.0]
    own.ok("when beat == 2 and bar < 15 fill now")  # in place of the other
    own.run(6.0)
    assert _runs(own) == [8.0, 24.0, 40.0, 49.0 + 0.0, 53.0]
    own.close()
    assert np.array_equal(own.again(), own.sound)


def test_a_line_typed_before_the_beat_stops_a_run_that_is_queued(own):
    own.ok("def fill: ada plays knock times 1")
    own.ok("play")
    own.ok("fill every 1bar now")
    own.run(1.5)  # the run of 2|1 is queued
    assert any(one.line == "run fill" for one in own.session.schedule.waiting)
    own.ok("stop fill")  # on 2|1
    own.run(3.0)
    assert _runs(own) == []
    own.close()
    assert np.array_equal(own.again(), own.sound)


def test_runs_are_not_in_the_history_and_undo_ends_the_rule(own):
    own.ok("def fill: ada plays knock times 1")
    own.ok("play")
    own.ok("fill every 1bar now")
    own.run(7.0)
    assert len(_runs(own)) == 3
    assert [line.split("  ")[-1] for line in own.ok("history").lines] == [
        "(the score)",
        "def fill: ada plays knock times 1",
        "fill every 1bar now",
    ]
    own.ok("undo")
    own.run(5.0)
    assert len(_runs(own)) <= 4
    assert not own.session.schedule.head.rules
    own.ok("redo")
    own.run(3.0)
    assert len(_runs(own)) >= 4
    own.close()
    assert np.array_equal(own.again(), own.sound)


def test_a_resumed_session_goes_on_with_its_rules(own):
    own.ok(FILL)
    own.ok("play")
    own.ok("when bar % 2 == 0 fill now")
    own.run(5.0)
    own.close()
    again = Stepped.resumed(own.journal)
    assert again.ok("show").lines[-1] == "fill: when bar % 2 == 0"
    again.ok("play")
    again.run(6.0)
    assert len(_runs(again)) >= 1
    again.close()
    assert np.array_equal(again.again(), again.sound)
    third = Stepped.resumed(again.journal)
    assert third.ok("show").lines[-1] == "fill: when bar % 2 == 0"
    third.close()


def test_a_jump_and_a_stop_leave_no_run_behind(own):
    own.ok("def fill: ada plays knock times 1")
    own.ok("play")
    own.ok("fill every 1bar now")
    own.run(3.5)
    own.ok("stop")
    own.run(3.0)
    assert not own.session.schedule.waiting
    own.ok("play from 1|3")
    own.run(5.0)
    own.close()
    assert np.array_equal(own.again(), own.sound)
    assert _runs(own)[-1] == pytest.approx(8.0, abs=0.01)


def test_what_is_renamed_is_renamed_in_blocks_and_a_block_runs_on(own):
    own.ok(FILL)
    own.ok("def soft: ada plays (knock lean)*2 every 1")
    own.ok("fill every 1bar")
    own.ok("rename knock tap")
    own.ok("rename ada mia")
    own.ok("rename fill tutti")
    own.run(0.1)
    head = own.session.schedule.head
    assert head.piece.blocks == {
        "tutti": ("mia plays tap every 1/2 times 2", "mia do scale 1.2"),
        "soft": ("mia plays (tap lean)*2 every 1",),
    }
    assert set(head.rules) == {"tutti"}
    own.ok("tutti")
    assert "is in use" in own.type("rename soft tutti").text
    own.close()
    assert np.array_equal(own.again(), own.sound)


def _n_calls(own, line):
    """How many functions of Python a line calls."""
    called = []
    sys.setprofile(lambda frame, event, what: called.append(event == "call"))
    try:
        own.ok(line)
    finally:
        sys.setprofile(None)
    return sum(called)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("part", "of"),
    crossed(
        ["  ada: []\n", "  ada:\n    - {at: A, play: knock}\n"],
        ["knock every 1/2 times 2", "(knock lean)*2 every 1/4 times 1"],
    ),
)
def test_a_line_costs_the_same_however_often_a_block_ran(tmp_path, part, of):
    text = EMPTY.replace("  ada: []\n", part + "  bo: []\n")
    text = text.replace("players:\n", "players:\n  bo: {key: k1}\n")
    own = Stepped(text, tmp_path, keeps=False)
    for line in (f"def fill: ada plays {of}", "play", "fill every 1 now"):
        own.ok(line)
    own.run(12.05)
    lines = ("ada plays lean now", "ada do scale 1.1 now", "set bell.m.f B3 now", "rest ada now")
    few = [_n_calls(own, line) for line in lines]
    own.run(60.0)  # 120 runs more
    many = [_n_calls(own, line) for line in lines]
    assert own.session.schedule.head.texts.text.count("knock") > 130
    for line, before, after in zip(lines, few, many, strict=True):
        assert after < 1.1 * before + 100, line
    own.close()


def test_hush_and_panic_end_rules(own):
    own.ok("def fill: ada plays knock times 1")
    own.ok("fill every 1bar now")
    own.ok("play")
    own.run(1.0)
    own.ok("hush now")
    own.run(0.5)
    assert not own.session.schedule.head.rules
    own.ok("fill every 1bar now")
    own.run(0.5)
    own.ok("panic")
    own.run(0.5)
    assert not own.session.schedule.head.rules
    own.close()
    assert np.array_equal(own.again(), own.sound)


def test_a_block_that_cannot_run_is_told_once(own):
    own.ok("tilt = 0@0 smooth 3@1/4 smooth 0@1/2")
    own.ok("def fill: ada plays tilt times 1")
    own.ok("remove tilt")
    assert "line 1 of fill: 'tilt' is not a gesture" in own.type("fill").text
    own.ok("def fill: ada do mirror")  # ada plays nothing
    own.ok("play")
    own.session.messages()
    own.ok("when bar > 2 fill")
    own.run(9.0)
    (said,) = own.session.messages()
    assert said.startswith("fill cannot run: ")
    assert own.session.schedule.head.rules
    own.close()
    assert np.array_equal(own.again(), own.sound)


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("def fill:", "a line, or several below it is missing"),
        ("def fill ada plays knock", "a ':' is missing"),
        ("def ada: ada plays knock", "is the name of a player"),
        ("def knock: ada plays knock", "is the name of a gesture"),
        ("def rest: ada plays knock", "'rest' is a verb"),
        ("def fill: undo", "a block cannot hold 'undo'"),
        ("def fill: ada plays knock now", "says when it acts"),
        ("def fill:\n ada plays knock\n ada plays nock", "line 3: 'nock' is not"),
        ("def fill:\n def tilt: undo\nend", "a block cannot hold"),
        ("def fill:\n fill\nend", "unknown verb 'fill'"),
        ("def fill:" + "\n ada plays knock" * 51, "50 are the most"),
        ("solo every 4bar", "is not"),
        ("when bar % 4 == 3 nil", "'nil' is not a block"),
    ],
)
def test_what_is_no_block_is_refused(own, line, said):
    reply = own.type(line)
    assert not reply.taken
    assert said in reply.text


@pytest.mark.parametrize(
    ("line", "said", "try_"),
    [
        ("when bar % 4 = 3 fill", "is not a condition", "when bar % 4 == 3 fill"),
        ("when bar % 4 == 4 fill", "is never true: a remainder of % 4 is from 0 to 3", None),
        ("when bar % 0 == 0 fill", "is never true", None),
        ("when bar < 1 fill", "is never true: bars count from 1", None),
        ("when __import__('os') fill", "is not a condition", None),
        ("when bar == 3", "a block is missing", None),
        ("fill every 1/2", "from 1 to 10,000", None),
        ("fill every 2s", "beats or whole bars", None),
        ("stop fil", "'fil' is not a block", "stop fill"),
        ("fill evry 2bar", "unknown verb", None),
    ],
)
def test_a_rule_says_what_is_wrong(own, line, said, try_):
    own.ok("def fill: ada plays knock")
    reply = own.type(line)
    assert not reply.taken
    assert said in reply.text
    assert reply.try_ == try_


def test_a_block_in_a_score_holds_only_what_a_block_may(tmp_path):
    own = Stepped(EMPTY + "blocks: {fill: [load other.yaml], tilt: [fill]}\n", tmp_path)
    assert "line 1 of fill: a block cannot hold 'load other.yaml'" in own.type("fill").text
    assert "line 1 of tilt: a block cannot hold 'fill'" in own.type("tilt").text
    own.close()


def test_enter_ends_a_block_after_end_or_a_blank_line(own):
    is_whole = own.session.is_whole
    assert not is_whole("def fill:")
    assert not is_whole("def fill:\n  ada plays knock")
    assert is_whole("def fill:\n  ada plays knock\n")
    assert is_whole(FILL)
    assert is_whole("def fill: ada plays knock")


def test_lines_below_a_block_are_lines_of_their_own(own):
    own.ok(f"{FILL}\nmute bell\ndef tilt:\n  unmute bell\n\nfill every 4bar")
    head = own.session.schedule.head
    assert set(head.piece.blocks) == {"fill", "tilt"}
    assert head.faders.muted == {"bell"}
    assert set(head.rules) == {"fill"}


def test_words_are_offered(own):
    own.ok("def fill: ada plays knock")

    def offered(line):
        return [one.text for one in own.session.complete(line, len(line))]

    assert offered("fi") == ["fill"]
    assert "every" in offered("fill ")
    assert offered("when ") == ["bar", "beat"]
    assert offered("when bar % 4 == 3 ") == ["and", "fill"]
    assert "fill" in offered("stop ")
    assert "fill" in offered("run ")


def _tempo(meter="4/4"):
    return TempoMap([Entry(parse_position("1|1"), 60.0, meter=parse_meter(meter))])


def _all(trigger, tempo, begin, until):
    found, after = [], begin
    while (beat := trigger.next_beat(tempo, begin, after, until)) is not None:
        found.append(beat)
        after = beat
    return found


def test_when_a_rule_runs():
    tempo = _tempo("3/4")
    assert _all(parse_every("2bar"), tempo, 4.0, 20.0) == [10.0, 16.0]  # from 2|2
    assert parse_every("2bar").next_beat(tempo, 40.0, 3.0, 9.0) == 4.0  # before it began, in step
    assert _all(parse_every("5"), tempo, 1.0, 12.0) == [6.0, 11.0]
    assert parse_every("5").next_beat(tempo, 21.0, 0.5, 9.0) == 1.0
    assert _all(parse_condition("bar % 2 == 0"), tempo, 0.0, 16.0) == [3.0, 9.0, 15.0]
    assert _all(parse_condition("beat == 3 and bar >= 2"), tempo, 0.0, 9.0) == [5.0, 8.0]
    assert parse_condition("bar == 1").runs_at_start(tempo, 0.0)
    assert not parse_condition("bar == 1").runs_at_start(tempo, 0.5)
    assert not parse_condition("bar == 1").runs_at_start(tempo, 1.0)
    assert parse_condition("beat == 2").runs_at_start(tempo, 1.0 + SAME / 2)


def test_what_a_journal_keeps_of_a_rule_is_read_as_it_was():
    for text in ("every 4bar", "when bar % 4 == 3 and beat != 2"):
        assert parse_trigger(text).text == text
    with pytest.raises(TextError):
        parse_trigger("eval 1")


def _any_line(chance):
    block = chance.choice(["fill", "tilt"])
    return chance.choice(
        [
            f"def {block}: ada plays {chance.choice(['knock', 'lean'])} times 1",
            f"def {block}:\n ada plays knock every 1/4 times 3\n gain bell x0.7\nend",
            f"def {block}:\n set bell.m.K x1.1\n ada do scale 0.9\nend",
            f"{block} every {chance.choice(['1', '2', '1bar', '2bar'])}",
            f"when bar % {chance.choice([2, 3])} == 0 {block}",
            f"when beat == {chance.choice([1, 2, 4])} {block}",
            f"{block}",
            f"stop {block}",
            f"remove {block}",
            "undo",
            "redo",
            "hush",
            "stop",
            "play",
            f"play from {chance.randrange(1, 30)}|1",
            f"tempo {chance.choice([60, 120, 240, 480])}",
            "ada plays lean every 2",
            "link k1 bell.m REF K=20N/m Z=0.1Ns/m",
            "remove links",
            "panic",
            "release",
        ]
    ) + chance.choice(["", "", " now"])


@pytest.mark.parametrize("seed", few(range(6), [0, 1]))
def test_random_sets_with_blocks_render_to_the_bit(tmp_path, seed):
    chance = random.Random(seed)
    own = Stepped(EMPTY, tmp_path)
    own.ok("play")
    for _ in range(40):
        reply = own.type(_any_line(chance))
        assert "internal" not in reply.text
        own.run(chance.uniform(0.0, 1.0))
        if chance.random() < 0.04:
            own.close()
            assert np.array_equal(own.again(), own.sound)
            own = Stepped.resumed(own.journal)
            own.type("play")
    own.close()
    assert np.array_equal(own.again(), own.sound)
    said = "\n".join(own.session.messages())
    assert "Error:" not in said
