"""From typed lines to commands."""

import dataclasses
import sys

import pytest
from spoken import OTHERS, SCOPE, SESSION, parsed, plays, refused

from ergon.notation.clock.positions import Length, Position, parse_position
from ergon.repl import language
from ergon.repl.language import help, verbs
from ergon.repl.language.commands import BlockCommand, Command
from ergon.repl.language.lines import is_complete
from ergon.repl.language.matter import Set
from ergon.repl.language.parse import parse
from ergon.repl.language.playing import Define
from ergon.repl.language.transport import Tempo
from ergon.scores.gesture import notation


def alike(command: Command) -> Command:
    """Without how a mark was spelt: `Position.text` is no value."""
    position = command.when
    return (
        dataclasses.replace(command, when=dataclasses.replace(position, text=""))
        if isinstance(position, Position)
        else command
    )


@pytest.mark.parametrize(("line", "command"), SESSION + OTHERS)
def test_lines_parse_to_their_commands(line: str, command: Command):
    assert alike(parsed(line)) == alike(command)


_BASES = (Command, BlockCommand)


def test_parse_examples_cover_every_command():
    asked = {type(command) for _, command in SESSION + OTHERS}
    files = [module for name, module in sys.modules.items() if name.startswith(language.__name__)]
    assert asked == {
        thing
        for module in files
        for thing in vars(module).values()
        if isinstance(thing, type) and issubclass(thing, Command) and thing not in _BASES
    }


@pytest.mark.parametrize("form", verbs.FORMS, ids=lambda form: form.usage)
def test_verb_examples_parse_and_appear_in_help(form: verbs.Form):
    assert isinstance(parsed(form.example.replace("as solo", "as solo-2")), Command)
    text = "\n".join(help.verb_help(form.verb))
    assert form.usage in text
    assert form.example in text


def test_parse_keeps_words_and_their_offsets():
    line = "ada plays knock every 1/2 do scale 0.5, mirror until C  in 2bar"
    words = parsed(line).words
    assert {name: word.text for name, word in words.items()} == {
        "player": "ada",
        "what": "knock",
        "every": "1/2",
        "until": "C",
        "do": "scale 0.5, mirror",
        "when": "2bar",
        "play": "knock every 1/2 until C do scale 0.5, mirror",
    }
    assert all(
        line[word.start : word.end] == word.text
        for name, word in words.items()
        if name not in ("do", "play")
    )
    assert parsed("couple k1 k2 K=40N/m").words["stiffness"] == ("40N/m", 15, 20)
    text = parsed("ada plays knock at B layer every 2").words
    assert text["when"] == ("B", 19, 20)
    assert text["play"].text == "knock every 2 layer"
    assert parsed("set bell.m.K 1kN/m now").words["change"].text == "1kN/m"


def test_parse_of_pasted_block_with_continuations():
    block = """\
# the second verse
verse = 0@0 6@1 \\
        0@2          # goes on

ada plays verse every 2 \\
   times 4
\ttempo 72 at C\r
"""
    define, play, tempo = parse(block, SCOPE)
    assert define == Define("verse", notation.parse("0@0 6@1" + " " * 11 + "0@2"))
    assert play == plays("verse", every=Length(beats=2), times=4)
    assert tempo == Tempo(72, when=parse_position("C"))
    times = play.words["times"]
    assert block[times.start : times.end] == "4"


def test_parse_of_block_with_one_bad_line():
    block = "ada plays knock\nremi plyas lean # or roll\n"
    refusal = refused(block)
    assert block[refusal.offset :].startswith("plyas")
    assert refusal.message == "line 2: unknown verb 'plyas'"
    assert refusal.try_ == "ada plays knock\nremi plays lean # or roll\n"


@pytest.mark.parametrize("text", ["", "  \n\n", "# only this", "\t# x \\"])
def test_comments_and_blank_lines_give_no_command(text: str):
    assert parse(text, SCOPE) == ()


def test_line_ending_in_a_backslash_is_incomplete():
    assert not is_complete("ada plays knock \\")
    assert not is_complete("play\nada plays \\  ")
    assert is_complete("ada plays knock")
    assert is_complete("play # or not \\")
    assert is_complete("ada plays \\\n knock")


def test_parse_of_hash_inside_a_word():
    assert parsed("set gong.f A#1") == Set("gong.f", pytest.approx(58.27, abs=0.01), None, None)


@pytest.mark.parametrize("among", [verbs.LEADING_VERBS, verbs.SUBJECT_VERBS])
def test_verb_abbreviations_are_unique(among: tuple[str, ...]):
    for verb in among:
        for length in range(len(verbs.SHORT_FORM_BY_VERB[verb]), len(verb) + 1):
            word = verb[:length]  # `pan` is a verb itself, and the beginning of `panic`
            assert verbs.verbs_matching(word, among) == (word if word in among else verb,)


def test_verb_abbreviations_with_added_verb(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(verbs.SHORT_FORM_BY_VERB, "hum", "hum")
    later = (*verbs.LEADING_VERBS, "hum")
    assert verbs.verbs_matching("hu", later) == ("hush",)
    assert verbs.verbs_matching("hum", later) == ("hum",)
