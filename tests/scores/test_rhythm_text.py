"""Rhythms as texts: what they play, and where their mistakes are."""

from __future__ import annotations

from fractions import Fraction
from random import Random

import pytest

from ergon.notation.text.errors import TextError
from ergon.scores.pattern.cycles import Cycles, chance_from
from ergon.scores.pattern.rhythm_text import MAX_TEXT, parse
from ergon.scores.pattern.struck import Struck


def rhythm(text: str) -> Cycles[str]:
    return parse(text, lambda word, _: word)


def shown(text: str, cycle: int = 0) -> str:
    """The events of a cycle as `instant word`, instants counted from its beginning."""
    events = rhythm(text).onsets(cycle)
    return ", ".join(f"{event.begin - cycle} {event.value}" for event in events)


def parsed(text: str) -> Cycles[str] | TextError:
    try:
        return rhythm(text)
    except TextError as error:
        return error


def mistake(text: str, start: int = 0) -> TextError:
    with pytest.raises(TextError) as caught:
        parse(text, Struck, start)
    return caught.value


# --- what is played -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "cycles"),
    [
        ("bd", ["0 bd", "0 bd"]),
        ("bd sd", ["0 bd, 1/2 sd"]),
        ("bd sd hh", ["0 bd, 1/3 sd, 2/3 hh"]),
        ("~ hh", ["1/2 hh"]),
        ("bd [sd sd] hh", ["0 bd, 1/3 sd, 1/2 sd, 2/3 hh"]),
        ("bd . sd sd . hh hh hh", ["0 bd, 1/3 sd, 1/2 sd, 2/3 hh, 7/9 hh, 8/9 hh"]),
        ("a b . c d e", ["0 a, 1/4 b, 1/2 c, 2/3 d, 5/6 e"]),
        ("[bd sd, hh hh hh]", ["0 bd, 0 hh, 1/3 hh, 1/2 sd, 2/3 hh"]),
        ("[a b, c d e]", ["0 a, 0 c, 1/3 d, 1/2 b, 2/3 e"]),
        ("bd*2 sd", ["0 bd, 1/4 bd, 1/2 sd"]),
        ("[bd sd]*2", ["0 bd, 1/4 sd, 1/2 bd, 3/4 sd"]),
        ("bd/2", ["0 bd", "", "0 bd"]),
        ("[bd sd]/2", ["0 bd", "0 sd", "0 bd"]),
        ("a*1.5", ["0 a, 2/3 a", "1/3 a", "0 a, 2/3 a"]),
        ("a*3/2", ["0 a, 2/3 a", "1/3 a"]),
        ("<bd sd hh>", ["0 bd", "0 sd", "0 hh", "0 bd"]),
        ("<a b>/2", ["0 a", "", "0 b", "", "0 a"]),
        ("<a <b c>>", ["0 a", "0 b", "0 a", "0 c"]),
        ("<a b, c d e>", ["0 a, 0 c", "0 b, 0 d", "0 a, 0 e", "0 b, 0 c"]),
        ("bd <sd hh cp>", ["0 bd, 1/2 sd", "0 bd, 1/2 hh", "0 bd, 1/2 cp", "0 bd, 1/2 sd"]),
        ("<a b>*2", ["0 a, 1/2 b", "0 a, 1/2 b"]),
        ("<a@3 b>", ["0 a", "", "", "0 b", "0 a"]),
        ("<a!2 b>", ["0 a", "0 a", "0 b"]),
        ("bd!3 sd", ["0 bd, 1/4 bd, 1/2 bd, 3/4 sd"]),
        ("bd ! ! sd", ["0 bd, 1/4 bd, 1/2 bd, 3/4 sd"]),
        ("bd! sd", ["0 bd, 1/3 bd, 2/3 sd"]),
        ("bd _ _ sd", ["0 bd, 3/4 sd"]),
        ("bd@3 sd", ["0 bd, 3/4 sd"]),
        ("bd@1.5 sd", ["0 bd, 3/5 sd"]),
        ("a*2@3 b", ["0 a, 3/8 a, 3/4 b"]),
        ("a@3!2", ["0 a, 1/2 a"]),
        ("bd(3,8)", ["0 bd, 3/8 bd, 3/4 bd"]),
        ("bd(3,8,2)", ["1/8 bd, 1/2 bd, 3/4 bd"]),
        ("bd(5,8)", ["0 bd, 1/4 bd, 3/8 bd, 5/8 bd, 3/4 bd"]),
        ("[bd sd](1,4) hh", ["0 bd, 1/16 sd, 1/2 hh"]),
        ("{a b c}%4", ["0 a, 1/4 b, 1/2 c, 3/4 a", "0 b, 1/4 c, 1/2 a, 3/4 b"]),
        ("{a b, c d e}", ["0 a, 0 c, 1/2 b, 1/2 d", "0 a, 0 e, 1/2 b, 1/2 c"]),
        ("{a b c, d}%2", ["0 a, 0 d, 1/2 b, 1/2 d", "0 c, 0 d, 1/2 a, 1/2 d"]),
        ("a, b c", ["0 a, 0 b, 1/2 c"]),
        ("~ ~*2 ~@3", [""]),
        ("a~b", ["0 a, 2/3 b"]),
        ("  a\n\tb  ", ["0 a, 1/2 b"]),
    ],
)  # fmt: skip
def test_parse_onsets(text, cycles):
    played = [shown(text, cycle) for cycle in range(len(cycles))]
    assert played == cycles


def test_parse_reads_words_once():
    words = []

    def read(word: str, offset: int) -> str:
        words.append((word, offset))
        return word

    parse("kick.hammer*2 [C#5 e4'f]!3 <b-4 x_y>(3,8)", read, 100)
    assert words == [
        ("kick.hammer", 100), ("C#5", 115), ("e4'f", 119), ("b-4", 128), ("x_y", 132),
    ]  # fmt: skip


@pytest.mark.parametrize(
    "word", ["kick.hammer", "C#5", "e4'f", "b-4", "x_y", "d:3", "60", "r+1", "été", "a.b.c"]
)
def test_parse_word_signs(word):
    assert rhythm(f"~ {word} {word}!2 {word}? [{word}]").leaves == (word,)


def test_leaves_order():
    leaves = parse("<a b>!2 [c | a]", Struck).leaves
    assert leaves == (Struck("a", 1), Struck("b", 3), Struck("c", 9), Struck("a", 13))


def test_event_of_weighted_step():
    (event, _) = rhythm("bd@3 sd").onsets(2)
    assert (event.begin, event.end) == (2, Fraction(11, 4))


# --- chance -------------------------------------------------------------------------------------


def test_question_mark_share():
    counts = [len(rhythm("a? b").onsets(cycle)) for cycle in range(400)]
    assert set(counts) == {1, 2}
    assert sum(counts) == pytest.approx(600, abs=50)
    often = sum(len(rhythm("a?0.1").onsets(cycle)) for cycle in range(400))
    assert often == pytest.approx(360, abs=30)
    assert shown("a?0 b?1") == "0 a"


def test_draws_by_seed_and_voice():
    part = rhythm("[a? b|c]*8")
    plays = {
        key: [part.onsets(cycle, chance_from(*key)) for cycle in range(4)]
        for key in [(1, "ada"), (2, "ada"), (1, "ben")]
    }
    again = rhythm("[a? b|c]*8")
    assert plays[1, "ada"] == [again.onsets(cycle, chance_from(1, "ada")) for cycle in range(4)]
    assert plays[1, "ada"] != plays[2, "ada"]
    assert plays[1, "ada"] != plays[1, "ben"]


@pytest.mark.parametrize("text", ["a?!64", "a? " + "! " * 63, "a?(64,64)", "[a?!8]!8", "a?*64"])
def test_draws_of_repetitions(text):
    numbers = []

    def chance(number: int, instant: Fraction) -> float:
        numbers.append((number, instant))
        return 0.9

    assert len(rhythm(text).onsets(0, chance)) == 64
    assert len(set(numbers)) == 64


def test_operator_numbers():
    numbers = []
    chance = lambda number, _: numbers.append(number) or 0.5  # noqa: E731
    parse("a? b?!2 [c? | d?] e?(2,3)", lambda word, _: word, first_number=10).onsets(0, chance)
    assert sorted(numbers) == [10, 11, 12, 14, 15, 16, 17]  # d?: 14; 13 is not chosen


def test_choice_share():
    words = [shown("[a | b b | c]", cycle) for cycle in range(300)]
    assert set(words) == {"0 a", "0 b, 1/2 b", "0 c"}
    assert min(words.count(word) for word in set(words)) > 70


# --- mistakes -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "place", "part"),  # `place`: what the mistake points to
    [
        ("", (0, 1), "no steps"),
        ("   ", (0, 3), "no steps"),
        ("a [b <c d> e", (2, 1), "this '[' is not closed; write [ … ]"),
        ("a {b <c d", (5, 1), "this '<' is not closed"),
        ("a [b <c", (5, 1), "this '<' is not closed"),
        ("a [", (2, 1), "this '[' is not closed"),
        ("a b] c", (3, 1), "']' has no '[' before it"),
        ("a b)", (3, 1), "')' has no '('"),
        ("[a b>", (4, 1), "'>' does not close the '['"),
        ("hat(7,16):p", (9, 1), "follow the word of a step"),
        ("a & b", (2, 1), "'&' does not begin a step"),
        ("a -5", (2, 1), "'-' does not begin a step"),
        ("a ^b", (2, 1), "'^' does not begin a step"),
        ("a _b", (2, 1), "'_' does not begin a step"),
        ("*2 a", (0, 1), "'*' follows a step without a space: kick*2"),
        ("a *2", (2, 1), "'*' follows a step without a space"),
        ("a (3,8)", (2, 1), "'(' follows a step without a space: kick(3,8)"),
        ("a%4", (1, 1), "'%' follows braces"),
        ("a*", (1, 1), "'*' needs a plain number"),
        ("a*<2 3>", (1, 1), "'*' needs a plain number"),
        ("a*-2", (1, 1), "'*' needs a plain number"),
        ("a/0", (2, 1), "a number above 0"),
        ("a@0.0", (2, 3), "a number above 0"),
        ("a*1001", (2, 4), "at most 1,000"),
        ("a*1.23456789", (2, 10), "too long"),
        ("a?1.5", (2, 3), "a probability from 0 to 1"),
        ("a*2b", (3, 1), "a space must follow the number '2'"),
        ("a!1.5", (1, 4), "without a fraction"),
        ("a !3", (2, 1), "'!' follows its step without a space"),
        ("! a", (0, 1), "'!' repeats the step before it"),
        ("[_ a]", (1, 1), "'_' lengthens the step before it"),
        ("a(3,<8 5>)", (1, 9), "plain numbers of pulses and steps"),
        ("a(3", (1, 2), "plain numbers of pulses and steps"),
        ("a(9,8)", (1, 5), "1 to 8 pulses"),
        ("a(3,257)", (1, 7), "1 to 256 steps"),
        ("a [] b", (2, 1), "no step here"),
        ("a,, b", (1, 1), "no step here"),
        ("a | ", (2, 1), "no step here"),
        (", a", (0, 1), "no step here"),
        ("a, b | c", (5, 1), "divided by brackets"),
        ("{a | b}", (3, 1), "'|' is written in square brackets"),
        (". a b", (0, 1), "a dot that groups"),
        ("a b .", (4, 1), "a dot that groups"),
        ("a. b", (1, 1), "a dot that groups"),
        ("a .b", (2, 1), "a dot that groups"),
        ("0 .. 3", (2, 1), "a dot that groups"),
        ("{a b}%", (5, 1), "'%' needs a plain number"),
    ],
)
def test_parse_mistake_place(text, place, part):
    error = mistake(text, start=1_000)
    assert part in error.message
    assert (error.offset - 1_000, error.length) == place


def test_parse_suggestions():
    assert mistake("a - b").suggestion == "~"
    assert mistake("[a b>").suggestion == "]"


def test_parse_mistake_from_reader():
    def read(word: str, offset: int) -> str:
        raise TextError("no such instrument", offset=offset, length=len(word), suggestion="kick")

    with pytest.raises(TextError) as caught:
        parse("~ kich", read)
    assert (caught.value.offset, caught.value.length, caught.value.suggestion) == (2, 4, "kick")


@pytest.mark.parametrize(
    ("text", "place", "part"),
    [
        ("a*1000*1000*1000", (6, 5), "up to 1,000,000 steps"),
        ("[a!1000]!1000", (8, 5), "more than 4,096"),
        ("a!1000!1000!1000!1000!1000", (21, 5), "more than 4,096"),
        ("[[[a!20]!20]!20]", (12, 3), "more than 4,096"),
        ("~*1000*1000", (6, 5), "steps"),
        ("{a@0.01}%1000", (0, 13), "steps"),
        ("{a}%1000 {a}%1000 {a}%1000 {a}%1000 {a}%1000", (0, 44), "up to 5,000 steps"),
        ("a*1000 . b*1000 | c*1000 , d*1000", (25, 1), "divided"),
        ("a(256,256)(256,256)", (10, 9), "steps"),
        ("[" * 33 + "a" + "]" * 33, (32, 1), "at most 32 brackets"),
        ("a" + "/1.5" * 900, (797, 4), "inside one another"),
        ("a" * (MAX_TEXT + 1), (MAX_TEXT, 1), "at most 4,000 characters"),
    ],
)
def test_parse_too_large(text, place, part):
    error = mistake(text)
    assert part in error.message
    assert (error.offset, error.length) == place


@pytest.mark.parametrize(
    "text",
    [
        "[" * 32 + "a?0.1" + "]" * 32,
        "<" * 32 + "a b" + ">" * 32,
        "{" * 32 + "a b" + "}%1" * 32,
        "a!1000 b!1000 c!1000 d!1000",
        "a*1000 b*1000",
        "a" + "/1000" * 100,
        "a " * 2_000,
        "a?" + "!" * 1_000,
        "a/1000*1000",
    ],
)
def test_parse_largest(text):
    part = rhythm(text)
    assert sum(len(part.onsets(cycle)) for cycle in range(2)) > 0


def test_parse_random_signs():
    random = Random(3)
    parts = [
        "a",
        "b",
        "~",
        *"[]<>{}()!?|,._-@",
        " ",
        " . ",
        "%4",
        "*2",
        "/3",
        "!3",
        "(3,8)",
        "*1.5",
    ]
    for _ in range(3_000):
        text = "".join(random.choices(parts, k=random.randint(1, 16)))
        result = parsed(text)
        if isinstance(result, TextError):
            assert 0 <= result.offset < result.offset + result.length <= len(text)
        else:
            assert len(result.onsets(2)) <= result.cost
