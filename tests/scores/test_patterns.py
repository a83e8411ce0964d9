"""Patterns: what is played in which place, when, and what chance has to do with it."""

from __future__ import annotations

import re
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ergon.notation.clock.positions import Length, parse_length, parse_position
from ergon.notation.clock.tempo import Entry, TempoMap
from ergon.notation.text.errors import TextError
from ergon.scores.pattern import order, rhythm, turns, words
from ergon.scores.pattern.draws import Draws
from ergon.scores.pattern.pattern import Pattern, PlaceSequence
from ergon.scores.pattern.steps import entry_place_beats

FLAT = TempoMap()
RAMP = TempoMap([Entry(parse_position("0"), 60.0, 120.0, Length(beats=64))])


def course(text: str, seed: int = 7, **more) -> PlaceSequence:
    return PlaceSequence(Pattern(order.parse(text), **more), Draws(seed, f"ada/{text}"))


def played(text: str, rounds: int = 1, seed: int = 7, **more) -> list[tuple[float, str]]:
    """(step, name) of all that some rounds play."""
    first = course(text, seed, **more)
    places = range(first.place_count(rounds))
    return [(first.position(n), name) for n in places if (name := first.played_name(n)) is not None]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("a", [(0, "a")]),
        ("a b a", [(0, "a"), (1, "b"), (2, "a")]),
        ("a ~ b", [(0, "a"), (2, "b")]),
        ("a*3 b", [(0, "a"), (1, "a"), (2, "a"), (3, "b")]),
        ("a ~*2 b", [(0, "a"), (3, "b")]),
        # A group takes one step, which its items share evenly.
        ("a (b c)", [(0, "a"), (1, "b"), (1.5, "c")]),
        ("(a b c d) e", [(0, "a"), (0.25, "b"), (0.5, "c"), (0.75, "d"), (1, "e")]),
        ("(a (b c)) d", [(0, "a"), (0.5, "b"), (0.75, "c"), (1, "d")]),
        ("(a ~ b ~)", [(0, "a"), (0.5, "b")]),
        # With a count it is written out, as in the notation of gestures.
        ("(a b)*2 c", [(0, "a"), (1, "b"), (2, "a"), (3, "b"), (4, "c")]),
        ("((a b)*2) c", [(0, "a"), (0.25, "b"), (0.5, "a"), (0.75, "b"), (1, "c")]),
        ("((a b) c)*2", [(0, "a"), (0.5, "b"), (1, "c"), (2, "a"), (2.5, "b"), (3, "c")]),
        ("(a (b c)*2 d)", [(0, "a"), (1 / 6, "b"), (2 / 6, "c"), (0.5, "b"), (4 / 6, "c"),
                           (5 / 6, "d")]),
    ],
)  # fmt: skip
def test_pattern_items_in_order(text, expected):
    assert played(text) == [(pytest.approx(step), name) for step, name in expected]


def test_pattern_rounds_in_succession():
    assert played("a (b c)", 3) == [
        (turn * 2 + step, name) for turn in range(3) for step, name in played("a (b c)")
    ]


@pytest.mark.parametrize(
    ("text", "expected"),  # G. Toussaint, "The Euclidean algorithm generates …", 2005
    [
        ("1 2", "x."),
        ("1 4", "x..."),
        ("2 5", "x.x.."),
        ("3 4", "x.xx"),
        ("3 8", "x..x..x."),
        ("4 9", "x.x.x.x.."),
        ("4 11", "x..x..x..x."),
        ("5 6", "x.xxxx"),
        ("5 8", "x.xx.xx."),
        ("5 12", "x..x.x..x.x."),
        ("5 16", "x..x..x..x..x..."),
        ("7 12", "x.xx.x.xx.x."),
        ("4 4", "xxxx"),
        ("3 8 rotate 2", ".x..x.x."),
        ("3 8 rotate 3", "x..x.x.."),
        ("5 8 rotate 8", "x.xx.xx."),
    ],
)
def test_euclidean_rhythms(text, expected):
    rhythm_ = rhythm.parse_euclid(text)
    result = "".join("x" if i in rhythm_.positions() else "." for i in range(rhythm_.steps))
    assert result == expected


@given(st.integers(1, 40), st.integers(0, 40), st.integers(0, 80))
def test_euclid_spreads_pulses_evenly(pulses, more, rotate):
    steps_ = pulses + more
    result = rhythm.Euclid(pulses, steps_, rotate % steps_).positions()
    assert len(set(result)) == pulses
    gaps = {
        (b - a) % steps_ or steps_ for a, b in zip(result, (*result[1:], result[0]), strict=True)
    }
    assert max(gaps) - min(gaps) <= 1


def test_euclid_continues_names_across_pulses():
    result = played("a b c", 3, euclid=rhythm.Euclid(5, 8))
    pulses = [cycle * 8 + at for cycle in range(3) for at in (0, 2, 3, 5, 6)]
    assert result == list(zip(pulses, "abcabcabcabcabc", strict=True))
    assert played("(a b)", 1, euclid=rhythm.Euclid(3, 8)) == [
        (at + part, name) for at in (0, 3, 6) for part, name in ((0, "a"), (0.5, "b"))
    ]


@pytest.mark.parametrize("share", [0.5, 0.6, 2 / 3, 0.75])
def test_swing_moves_every_second_step(share):
    found = [step for step, _ in played("a (b c)", 2, swing=share)]
    assert found == pytest.approx([0, 2 * share, 1 + share, 2, 2 + 2 * share, 3 + share])


def test_choose_draws_each_item_equally_often():
    names = [name for _, name in played("choose a b c", 3000)]
    assert {name: round(names.count(name) / 1000, 1) for name in "abc"} == {
        name: pytest.approx(1.0, abs=0.11) for name in "abc"
    }
    steps_ = [step for step, _ in played("choose a b c", 20)]
    assert steps_ == list(range(20))
    # Copies of a group draw for themselves, and a longer item may be one of them.
    both = played("(choose a b)*2", 500)
    pairs = [first[1] + second[1] for first, second in zip(both[::2], both[1::2], strict=True)]
    assert set(pairs) == {"aa", "ab", "ba", "bb"}
    mixed = played("choose a (b c)", 200)
    for step in range(200):
        item = [(at - step, name) for at, name in mixed if step <= at < step + 1]
        assert item in ([(0, "a")], [(0, "b"), (0.5, "c")])


def test_shuffle_plays_all_items_in_random_order():
    rounds = [
        "".join(name for _, name in played("shuffle a b c", 1, seed=seed)) for seed in range(200)
    ]
    assert {"".join(sorted(one)) for one in rounds} == {"abc"}
    assert len(set(rounds)) == 6
    many = [name for _, name in played("shuffle a b c", 200)]
    assert len({"".join(many[i : i + 3]) for i in range(0, 600, 3)}) == 6
    spans = played("shuffle a (b c)*2", 40)
    assert [step for step, _ in spans] == list(range(200))  # five steps whatever their order


def test_walk_moves_to_neighbours():
    path = ["abcd".index(name) for _, name in played("walk a b c d", 600)]
    assert path[0] == 0
    assert set(path) == {0, 1, 2, 3}
    assert {b - a for a, b in pairwise(path)} == {-1, 0, 1}


def test_chance_omits_places():
    everything = played("a b", 1000)
    some = played("a b", 1000, chance=0.6)
    assert set(some) < set(everything)
    assert len(some) / len(everything) == pytest.approx(0.6, abs=0.04)
    assert played("a b", 100, chance=1.0) == played("a b", 100)
    assert played("a b", 100, chance=0.0) == []


def test_nth_round_transformations():
    single = turns.parse("4th do mirror, scale 0.5 every 3rd do reverse")
    assert [(turn.nth, [t.word for t in turn.do]) for turn in single] == [
        (4, ["mirror", "scale"]),
        (3, ["reverse"]),
    ]
    first = course("a b", turns=single)
    message = [" ".join(t.word for t in first.transforms(2 * n)) for n in range(12)]
    assert message == [
        *("", "", "reverse", "mirror scale", "", "reverse"),
        *("", "mirror scale", "reverse", "", "", "mirror scale reverse"),
    ]
    assert all(first.transforms(2 * n) == first.transforms(2 * n + 1) for n in range(12))
    cycles = course("a b c", turns=single, euclid=rhythm.Euclid(3, 8))
    assert [cycles.round_index(n) for n in range(9)] == [0, 0, 0, 1, 1, 1, 2, 2, 2]


@pytest.mark.parametrize(
    "text",
    ["a b c", "choose a (b c)", "shuffle a b (c d)", "walk a b c", "(choose a b) (walk c d)"],
)
@pytest.mark.parametrize("skip", [1, 2, 5, 100])
def test_pattern_with_skip_equals_later_places(text, skip):
    """No draw depends on those before: play from, resume and render agree."""
    complete, rest = course(text, chance=0.7), course(text, chance=0.7, skip=skip)
    for place in range(50):
        assert rest.played_name(place) == complete.played_name(place + skip)
        assert rest.position(place) == complete.position(place + skip)


def test_draws_by_seed_and_name():
    first = played("choose a b", 40)
    assert first == played("choose a b", 40)
    assert first != played("choose a b", 40, seed=8)
    other = PlaceSequence(Pattern(order.parse("choose a b")), Draws(7, "leo/choose a b"))
    assert [name for _, name in first] != [other.played_name(n) for n in range(40)]


# --- when ----------------------------------------------------------------------------------------


def beats(text, every="1", tempo=FLAT, start=0.0, length=lambda name: None, **more):
    item = {name: more.pop(name) for name in ("euclid", "swing", "skip") if name in more}
    apart = None if every is None else parse_length(every)
    return entry_place_beats(
        tempo, start, course(text, **item), step_length=apart, length_of_name=length, **more
    )


@pytest.mark.parametrize(
    ("text", "options", "expected"),
    [
        ("a b", {}, [0, 1]),
        ("a b", {"every": "1/2", "times": 2}, [0, 0.5, 1, 1.5]),
        ("a b", {"every": "1bar", "start": 1.0, "times": 2}, [1, 5, 9, 13]),
        ("a b", {"every": "500ms", "times": 2}, [0, 0.5, 1, 1.5]),  # a beat is a second
        ("a b", {"end_beat": 3}, [0, 1, 2]),
        ("a b", {"end_beat": 3.5}, [0, 1, 2, 3]),
        ("a b", {"end_beat": 6, "times": 2}, [0, 1, 2, 3]),
        ("a (b c)", {"end_beat": 4, "start": 2.0}, [2, 3, 3.5]),
        # A Euclidean rhythm lasts a bar unless `every` says how long a step is.
        ("a", {"every": None, "euclid": rhythm.Euclid(3, 8)}, [0, 1.5, 3]),
        ("a", {"every": None, "euclid": rhythm.Euclid(3, 8, 2), "times": 2},
         [0.5, 2, 3, 4.5, 6, 7]),
        ("a", {"every": "1/4", "euclid": rhythm.Euclid(3, 8), "times": 2},
         [0, 0.75, 1.5, 2, 2.75, 3.5]),
        # Plain names follow each other.
        ("a b", {"every": None, "length": lambda name: Length(0.0, {"a": 2.0, "b": 0.5}[name]),
                 "times": 2}, [0, 2, 2.5, 4.5]),
        ("a b", {"every": None, "length": lambda name: Length(seconds=0.25), "end_beat": 0.6},
         [0, 0.25, 0.5]),
        # What is skipped leaves its time out.
        ("a b c", {"skip": 2, "times": 2}, [0, 1, 2, 3]),
    ],
)  # fmt: skip
def test_pattern_beats_of_places(text, options, expected):
    assert list(beats(text, **options)) == pytest.approx(expected)


def test_pattern_beats_follow_the_tempo():
    result = beats("a (b c)", every="250ms", tempo=RAMP, times=8)
    instants = [RAMP.seconds(beat) for beat in result]
    assert instants == pytest.approx([0.25 * (2 * n + i) for n in range(8) for i in (0, 1, 1.5)])


def test_pattern_beats_of_endless_line_on_demand():
    complete = beats("walk a b c", every="1/16", end_beat=62_000.0)
    assert len(complete) == 992_000
    assert complete[991_999] == pytest.approx(62_000 - 1 / 16)
    assert complete[-1] == complete[991_999]
    assert complete[10:12] == [10 / 16, 11 / 16]


@pytest.mark.parametrize(
    ("text", "options", "words_"),
    [
        ("a b", {"every": None}, "write `every`"),
        ("a ~", {"every": None, "length": lambda name: Length(beats=1.0)}, "write `every`"),
        ("a b", {"every": None, "length": lambda name: Length()}, "no duration"),
        ("a b", {"every": "0"}, "above 0"),
        ("a b", {"skip": 2}, "leaves out every place"),
        ("a", {"every": "1/1000", "end_beat": 1e6}, "more than 1,000,000 occurrences"),
    ],
)
def test_pattern_options_without_beats_are_refused(text, options, words_):
    with pytest.raises(TextError, match=re.escape(words_)):
        beats(text, **options)


# --- as written ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "marked", "words_", "suggestion"),
    [
        ("a (b c", "(", "not closed", None),
        ("a b) c", ")", "has no '(' before it", None),
        ("a () b", "(", "has no names", None),
        ("(choose) b", "(", "'choose' has no names", None),
        ("a *2", "a", None, None),
        ("*2 a", "*", "repeats the name", None),
        ("a*0", "0", "not a number of repetitions", None),
        ("a*x", "x", "not a number of repetitions", None),
        ("a*99999", "99999", "not a number of repetitions", None),
        ("(a*200)*200", "a", "more than 10,000 places", None),
        ("a b-!c", "b-!c", "not the name", None),
        ("a choose b", "choose", "must be at the beginning", None),
        ("((((((((((a))))))))))", "(", "nested more than 8 deep", None),
    ],
)
def test_parse_order_mistake_place(text, marked, words_, suggestion):
    if words_ is None:
        assert [name for _, name in played(text)] == ["a", "a"]
        return
    with pytest.raises(TextError) as caught:
        order.parse(text)
    error = caught.value
    assert text[error.offset : error.offset + error.length].startswith(marked)
    assert words_ in error.message
    assert error.suggestion == suggestion


@pytest.mark.parametrize(
    ("text", "marked", "words_"),
    [
        ("knock lean evry 1", "evry", "unknown word"),
        ("knock euclid 3", "euclid", "needs a value: euclid 3 8"),
        ("knock euclid 3 8 rotate", "euclid", "needs a value: euclid 3 8 rotate 2"),
        ("knock every 4th scale 2", "4th", "not written like 4th do mirror"),
        ("knock every 4th do miror", "miror", "unknown transformation"),
        ("knock every 4th do", "o", "needs a transformation"),
        ("knock every 4th do mirror every 1 every 3rd do reverse", "every", "written twice"),
        ("knock chance", "chance", "needs a value: chance 0.6"),
        ("knock (lean every 1", "(", "not closed"),
    ],
)
def test_parse_pattern_line_mistake_place(text, marked, words_):
    with pytest.raises(TextError) as caught:
        words.parse(text, 100)
    error = caught.value
    assert text[error.offset - 100 :].startswith(marked)
    assert words_ in error.message


def test_parse_words_of_pattern_line():
    text = (
        "(knock lean)*2 ~ every 1/2 every 4th do mirror, scale 2 every 3rd do reverse chance 60% "
        "euclid 3 8 rotate 2 swing 2/3 skip 5 until C do scale 0.5"
    )
    play = words.parse(text)
    assert play.played == ("(knock lean)*2 ~", 0)
    assert {name: word.text for name, word in play.options.items()} == {
        "every": "1/2",
        "nth": "4th do mirror, scale 2 every 3rd do reverse",
        "chance": "60%",
        "euclid": "3 8 rotate 2",
        "swing": "2/3",
        "skip": "5",
        "until": "C",
    }
    assert all(text[word.offset :].startswith(word.text) for word in play.options.values())
    assert [t.word for t in play.transforms] == ["scale"]


def test_pattern_words_as_gesture_names():
    for name in ("chance", "swing", "skip", "walk", "choose"):
        assert words.parse(f"{name} every 1").played.text == name
        assert words.parse(f"{name} every 1").pattern is None or played(name) == [(0, name)]


@given(st.text(alphabet="ab~()*2 choosewalk", max_size=40))
def test_parse_of_random_pattern_text(text):
    try:
        result = order.parse(text)
    except TextError as error:
        assert 0 <= error.offset <= len(text)  # noqa: PT017
        return
    first = PlaceSequence(Pattern(result), Draws(1, ""))
    index = [first.position(n) for n in range(3 * result.places)]
    assert index == sorted(index)
