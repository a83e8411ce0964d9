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
def stepped(tmp_path):
    player_session = Stepped(EMPTY, tmp_path)
    yield player_session
    player_session.close()


def _runs(stepped):
    """The beats on which blocks took effect, from the journal."""
    rows = [json.loads(line) for line in stepped.journal.read_text().splitlines()]
    lines = {row["number"] for row in rows if row["event"] == "line" and not row.get("typed", True)}
    return [row["beat"] for row in rows if row["event"] == "commit" and row["number"] in lines]


def test_def_block_and_run_by_name(stepped):
    stepped.ok(FILL)
    assert stepped.session.schedule.head.piece.blocks == {
        "fill": ("ada plays knock every 1/2 times 2", "ada do scale 1.2")
    }
    assert stepped.ok("show fill").lines[0].endswith("fill:")
    assert stepped.ok("history").lines[-1].endswith("  def fill: …")
    stepped.ok("play")
    stepped.run(0.5)
    assert stepped.ok("fill").text == "ok 2|1"
    stepped.run(3.0)
    assert np.abs(stepped.sound).max() > 1e-6
    assert stepped.ok("undo").taken
    stepped.run(3.0)
    assert "knock" not in str(stepped.session.schedule.head.piece.parts)
    stepped.close()
    assert np.array_equal(stepped.again(), stepped.sound)


def test_block_with_every_until_stop(stepped):
    stepped.ok("def fill: ada plays knock times 1")
    stepped.ok("play")
    stepped.run(0.1)
    assert stepped.ok("fill every 2bar").taken  # from bar 2 on
    stepped.run(9.0)  # 2 s a bar
    assert _runs(stepped) == [12.0]
    assert stepped.ok("show").lines[-1] == "fill: every 2bar"
    stepped.run(4.0)
    assert _runs(stepped) == [12.0, 20.0]
    stepped.ok("stop fill")
    stepped.run(9.0)
    assert _runs(stepped) == [12.0, 20.0]
    assert stepped.ok("show").lines[-1] != "fill: every 2bar"
    stepped.close()
    assert np.array_equal(stepped.again(), stepped.sound)
    assert np.abs(stepped.sound).max() > 1e-6


def test_block_with_when_condition(stepped):
    stepped.ok("def fill: ada plays knock times 1")
    stepped.ok("when bar % 4 == 3 fill now")
    stepped.ok("play")
    stepped.run(24.5)
    assert _runs(stepped) == [8.0, 24.0, 40.0]
    stepped.ok("when beat == 2 and bar < 15 fill now")  # in place of the other
    stepped.run(6.0)
    assert _runs(stepped) == [8.0, 24.0, 40.0, 49.0 + 0.0, 53.0]
    stepped.close()
    assert np.array_equal(stepped.again(), stepped.sound)


def test_stop_of_queued_block_run(stepped):
    stepped.ok("def fill: ada plays knock times 1")
    stepped.ok("play")
    stepped.ok("fill every 1bar now")
    stepped.run(1.5)  # the run of 2|1 is queued
    assert any(one.line == "run fill" for one in stepped.session.schedule.waiting)
    stepped.ok("stop fill")  # on 2|1
    stepped.run(3.0)
    assert _runs(stepped) == []
    stepped.close()
    assert np.array_equal(stepped.again(), stepped.sound)


def test_undo_of_block_rule(stepped):
    stepped.ok("def fill: ada plays knock times 1")
    stepped.ok("play")
    stepped.ok("fill every 1bar now")
    stepped.run(7.0)
    assert len(_runs(stepped)) == 3
    assert [line.split("  ")[-1] for line in stepped.ok("history").lines] == [
        "(the score)",
        "def fill: ada plays knock times 1",
        "fill every 1bar now",
    ]
    stepped.ok("undo")
    stepped.run(5.0)
    assert len(_runs(stepped)) <= 4
    assert not stepped.session.schedule.head.rules
    stepped.ok("redo")
    stepped.run(3.0)
    assert len(_runs(stepped)) >= 4
    stepped.close()
    assert np.array_equal(stepped.again(), stepped.sound)


def test_resume_with_block_rules(stepped):
    stepped.ok(FILL)
    stepped.ok("play")
    stepped.ok("when bar % 2 == 0 fill now")
    stepped.run(5.0)
    stepped.close()
    again = Stepped.resumed(stepped.journal)
    assert again.ok("show").lines[-1] == "fill: when bar % 2 == 0"
    again.ok("play")
    again.run(6.0)
    assert len(_runs(again)) >= 1
    again.close()
    assert np.array_equal(again.again(), again.sound)
    third = Stepped.resumed(again.journal)
    assert third.ok("show").lines[-1] == "fill: when bar % 2 == 0"
    third.close()


def test_jump_and_stop_with_block_rules(stepped):
    stepped.ok("def fill: ada plays knock times 1")
    stepped.ok("play")
    stepped.ok("fill every 1bar now")
    stepped.run(3.5)
    stepped.ok("stop")
    stepped.run(3.0)
    assert not stepped.session.schedule.waiting
    stepped.ok("play from 1|3")
    stepped.run(5.0)
    stepped.close()
    assert np.array_equal(stepped.again(), stepped.sound)
    assert _runs(stepped)[-1] == pytest.approx(8.0, abs=0.01)


def test_rename_within_running_block(stepped):
    stepped.ok(FILL)
    stepped.ok("def soft: ada plays (knock lean)*2 every 1")
    stepped.ok("fill every 1bar")
    stepped.ok("rename knock tap")
    stepped.ok("rename ada mia")
    stepped.ok("rename fill tutti")
    stepped.run(0.1)
    head = stepped.session.schedule.head
    assert head.piece.blocks == {
        "tutti": ("mia plays tap every 1/2 times 2", "mia do scale 1.2"),
        "soft": ("mia plays (tap lean)*2 every 1",),
    }
    assert set(head.rules) == {"tutti"}
    stepped.ok("tutti")
    assert "is in use" in stepped.type("rename soft tutti").text
    stepped.close()
    assert np.array_equal(stepped.again(), stepped.sound)


def _n_calls(stepped, line):
    """How many functions of Python a line calls."""
    called = []
    sys.setprofile(lambda frame, event, what: called.append(event == "call"))
    try:
        stepped.ok(line)
    finally:
        sys.setprofile(None)
    return sum(called)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("part", "source"),
    crossed(
        ["  ada: []\n", "  ada:\n    - {at: A, play: knock}\n"],
        ["knock every 1/2 times 2", "(knock lean)*2 every 1/4 times 1"],
    ),
)
def test_line_cost_after_many_block_runs(tmp_path, part, source):
    text = EMPTY.replace("  ada: []\n", part + "  bo: []\n")
    text = text.replace("players:\n", "players:\n  bo: {key: k1}\n")
    player_session = Stepped(text, tmp_path, keeps=False)
    for line in (f"def fill: ada plays {source}", "play", "fill every 1 now"):
        player_session.ok(line)
    player_session.run(12.05)
    lines = ("ada plays lean now", "ada do scale 1.1 now", "set bell.m.f B3 now", "rest ada now")
    few = [_n_calls(player_session, line) for line in lines]
    player_session.run(60.0)  # 120 runs more
    many = [_n_calls(player_session, line) for line in lines]
    assert player_session.session.schedule.head.texts.text.count("knock") > 130
    for line, before, after in zip(lines, few, many, strict=True):
        assert after < 1.1 * before + 100, line
    player_session.close()


def test_hush_and_panic_with_block_rules(stepped):
    stepped.ok("def fill: ada plays knock times 1")
    stepped.ok("fill every 1bar now")
    stepped.ok("play")
    stepped.run(1.0)
    stepped.ok("hush now")
    stepped.run(0.5)
    assert not stepped.session.schedule.head.rules
    stepped.ok("fill every 1bar now")
    stepped.run(0.5)
    stepped.ok("panic")
    stepped.run(0.5)
    assert not stepped.session.schedule.head.rules
    stepped.close()
    assert np.array_equal(stepped.again(), stepped.sound)


def test_failing_block_with_one_message(stepped):
    stepped.ok("tilt = 0@0 smooth 3@1/4 smooth 0@1/2")
    stepped.ok("def fill: ada plays tilt times 1")
    stepped.ok("remove tilt")
    assert "line 1 of fill: 'tilt' is not a gesture" in stepped.type("fill").text
    stepped.ok("def fill: ada do mirror")  # ada plays nothing
    stepped.ok("play")
    stepped.session.messages()
    stepped.ok("when bar > 2 fill")
    stepped.run(9.0)
    (messages,) = stepped.session.messages()
    assert messages.startswith("fill cannot run: ")
    assert stepped.session.schedule.head.rules
    stepped.close()
    assert np.array_equal(stepped.again(), stepped.sound)


@pytest.mark.parametrize(
    ("line", "message"),
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
def test_def_block_with_mistakes(stepped, line, message):
    reply = stepped.type(line)
    assert not reply.taken
    assert message in reply.text


@pytest.mark.parametrize(
    ("line", "message", "try_"),
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
def test_block_rule_with_mistakes(stepped, line, message, try_):
    stepped.ok("def fill: ada plays knock")
    reply = stepped.type(line)
    assert not reply.taken
    assert message in reply.text
    assert reply.try_ == try_


def test_blocks_section_with_mistakes(tmp_path):
    player_session = Stepped(EMPTY + "blocks: {fill: [load other.yaml], tilt: [fill]}\n", tmp_path)
    assert (
        "line 1 of fill: a block cannot hold 'load other.yaml'" in player_session.type("fill").text
    )
    assert "line 1 of tilt: a block cannot hold 'fill'" in player_session.type("tilt").text
    player_session.close()


def test_enter_after_block_end(stepped):
    is_whole = stepped.session.is_whole
    assert not is_whole("def fill:")
    assert not is_whole("def fill:\n  ada plays knock")
    assert is_whole("def fill:\n  ada plays knock\n")
    assert is_whole(FILL)
    assert is_whole("def fill: ada plays knock")


def test_paste_of_block_and_lines(stepped):
    stepped.ok(f"{FILL}\nmute bell\ndef tilt:\n  unmute bell\n\nfill every 4bar")
    head = stepped.session.schedule.head
    assert set(head.piece.blocks) == {"fill", "tilt"}
    assert head.faders.muted == {"bell"}
    assert set(head.rules) == {"fill"}


def test_completion_of_block_words(stepped):
    stepped.ok("def fill: ada plays knock")

    def offered(line):
        return [one.text for one in stepped.session.complete(line, len(line))]

    assert offered("fi") == ["filter", "fill"]
    assert "every" in offered("fill ")
    assert offered("when ") == ["bar", "beat"]
    assert offered("when bar % 4 == 3 ") == ["and", "fill"]
    assert "fill" in offered("stop ")
    assert "fill" in offered("run ")


def _tempo(meter="4/4"):
    return TempoMap([Entry(parse_position("1|1"), 60.0, meter=parse_meter(meter))])


def _all(trigger, tempo, begin, until):
    result, after = [], begin
    while (beat := trigger.next_beat(tempo, begin, after, until)) is not None:
        result.append(beat)
        after = beat
    return result


def test_next_beat_of_every_and_when_rules():
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


def test_journal_of_block_rule():
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
def test_journals_of_random_block_sessions(tmp_path, seed):
    chance = random.Random(seed)
    player_session = Stepped(EMPTY, tmp_path)
    player_session.ok("play")
    for _ in range(40):
        reply = player_session.type(_any_line(chance))
        assert "internal" not in reply.text
        player_session.run(chance.uniform(0.0, 1.0))
        if chance.random() < 0.04:
            player_session.close()
            assert np.array_equal(player_session.again(), player_session.sound)
            player_session = Stepped.resumed(player_session.journal)
            player_session.type("play")
    player_session.close()
    assert np.array_equal(player_session.again(), player_session.sound)
    messages = "\n".join(player_session.session.messages())
    assert "Error:" not in messages
