"""Patterns: what is played in which place, when, and what chance has to do with it."""

from __future__ import annotations

import re
from itertools import islice, pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ergon.notation.clock.positions import Length, parse_length, parse_position
from ergon.notation.clock.tempo import Entry, TempoMap
from ergon.notation.text.errors import Collector, TextError
from ergon.notation.text.values import Time
from ergon.scores.pattern import order, rhythm, turns, words
from ergon.scores.pattern.draws import Draws
from ergon.scores.pattern.pattern import Course, Pattern
from ergon.scores.pattern.steps import steps
from ergon.scores.reading.load import load
from ergon.scores.reading.piece import Piece
from ergon.scores.staging.hands import Window
from ergon.scores.staging.stage import Span, prepare
from ergon.scores.staging.striking import Striking

FLAT = TempoMap()
RAMP = TempoMap([Entry(parse_position("0"), 60.0, 120.0, Length(beats=64))])


def course(text: str, seed: int = 7, **more) -> Course:
    return Course(Pattern(order.parse(text), **more), Draws(seed, f"ada/{text}"))


def played(text: str, rounds: int = 1, seed: int = 7, **more) -> list[tuple[float, str]]:
    """(step, name) of all that some rounds play."""
    one = course(text, seed, **more)
    places = range(one.places_of(rounds))
    return [(one.position(n), name) for n in places if (name := one.played(n)) is not None]


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
def test_a_pattern_plays_its_items_in_turn(text, expected):
    assert played(text) == [(pytest.approx(step), name) for step, name in expected]


def test_rounds_follow_each_other():
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
    found = "".join("x" if i in rhythm_.positions() else "." for i in range(rhythm_.steps))
    assert found == expected


@given(st.integers(1, 40), st.integers(0, 40), st.integers(0, 80))
def test_pulses_are_spread_as_evenly_as_possible(pulses, more, rotate):
    steps_ = pulses + more
    found = rhythm.Euclid(pulses, steps_, rotate % steps_).positions()
    assert len(set(found)) == pulses
    gaps = {(b - a) % steps_ or steps_ for a, b in zip(found, (*found[1:], found[0]), strict=True)}
    assert max(gaps) - min(gaps) <= 1


def test_names_go_on_over_the_pulses_of_a_rhythm():
    found = played("a b c", 3, euclid=rhythm.Euclid(5, 8))
    pulses = [cycle * 8 + at for cycle in range(3) for at in (0, 2, 3, 5, 6)]
    assert found == list(zip(pulses, "abcabcabcabcabc", strict=True))
    assert played("(a b)", 1, euclid=rhythm.Euclid(3, 8)) == [
        (at + part, name) for at in (0, 3, 6) for part, name in ((0, "a"), (0.5, "b"))
    ]


@pytest.mark.parametrize("share", [0.5, 0.6, 2 / 3, 0.75])
def test_swing_moves_every_second_step(share):
    found = [step for step, _ in played("a (b c)", 2, swing=share)]
    assert found == pytest.approx([0, 2 * share, 1 + share, 2, 2 + 2 * share, 3 + share])


def test_a_choice_is_one_of_its_items_each_as_often():
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
        own = [(at - step, name) for at, name in mixed if step <= at < step + 1]
        assert own in ([(0, "a")], [(0, "b"), (0.5, "c")])


def test_a_shuffle_plays_all_in_an_order_of_its_own():
    rounds = [
        "".join(name for _, name in played("shuffle a b c", 1, seed=seed)) for seed in range(200)
    ]
    assert {"".join(sorted(one)) for one in rounds} == {"abc"}
    assert len(set(rounds)) == 6
    many = [name for _, name in played("shuffle a b c", 200)]
    assert len({"".join(many[i : i + 3]) for i in range(0, 600, 3)}) == 6
    spans = played("shuffle a (b c)*2", 40)
    assert [step for step, _ in spans] == list(range(200))  # five steps whatever their order


def test_a_walk_goes_to_a_neighbour():
    path = ["abcd".index(name) for _, name in played("walk a b c d", 600)]
    assert path[0] == 0
    assert set(path) == {0, 1, 2, 3}
    assert {b - a for a, b in pairwise(path)} == {-1, 0, 1}


def test_chance_leaves_places_out_and_keeps_the_others():
    everything = played("a b", 1000)
    some = played("a b", 1000, chance=0.6)
    assert set(some) < set(everything)
    assert len(some) / len(everything) == pytest.approx(0.6, abs=0.04)
    assert played("a b", 100, chance=1.0) == played("a b", 100)
    assert played("a b", 100, chance=0.0) == []


def test_every_nth_round_has_transformations_of_its_own():
    own = turns.parse("4th do mirror, scale 0.5 every 3rd do reverse")
    assert [(turn.nth, [t.word for t in turn.do]) for turn in own] == [
        (4, ["mirror", "scale"]),
        (3, ["reverse"]),
    ]
    one = course("a b", turns=own)
    said = [" ".join(t.word for t in one.do(2 * n)) for n in range(12)]
    assert said == [
        *("", "", "reverse", "mirror scale", "", "reverse"),
        *("", "mirror scale", "reverse", "", "", "mirror scale reverse"),
    ]
    assert all(one.do(2 * n) == one.do(2 * n + 1) for n in range(12))
    cycles = course("a b c", turns=own, euclid=rhythm.Euclid(3, 8))
    assert [cycles.round(n) for n in range(9)] == [0, 0, 0, 1, 1, 1, 2, 2, 2]


@pytest.mark.parametrize(
    "text",
    ["a b c", "choose a (b c)", "shuffle a b (c d)", "walk a b c", "(choose a b) (walk c d)"],
)
@pytest.mark.parametrize("skip", [1, 2, 5, 100])
def test_what_is_entered_in_the_middle_plays_what_it_would_have_played(text, skip):
    """No draw depends on those before: play from, resume and render agree."""
    whole, rest = course(text, chance=0.7), course(text, chance=0.7, skip=skip)
    for place in range(50):
        assert rest.played(place) == whole.played(place + skip)
        assert rest.position(place) == whole.position(place + skip)


def test_draws_depend_on_the_seed_and_on_who_plays_what():
    one = played("choose a b", 40)
    assert one == played("choose a b", 40)
    assert one != played("choose a b", 40, seed=8)
    other = Course(Pattern(order.parse("choose a b")), Draws(7, "leo/choose a b"))
    assert [name for _, name in one] != [other.played(n) for n in range(40)]


# --- when ----------------------------------------------------------------------------------------


def beats(text, every="1", tempo=FLAT, at=0.0, length=lambda name: None, **more):
    own = {name: more.pop(name) for name in ("euclid", "swing", "skip") if name in more}
    apart = None if every is None else parse_length(every)
    return steps(tempo, at, course(text, **own), every=apart, length=length, **more)


@pytest.mark.parametrize(
    ("text", "options", "expected"),
    [
        ("a b", {}, [0, 1]),
        ("a b", {"every": "1/2", "times": 2}, [0, 0.5, 1, 1.5]),
        ("a b", {"every": "1bar", "at": 1.0, "times": 2}, [1, 5, 9, 13]),
        ("a b", {"every": "500ms", "times": 2}, [0, 0.5, 1, 1.5]),  # a beat is a second
        ("a b", {"until": 3}, [0, 1, 2]),
        ("a b", {"until": 3.5}, [0, 1, 2, 3]),
        ("a b", {"until": 6, "times": 2}, [0, 1, 2, 3]),
        ("a (b c)", {"until": 4, "at": 2.0}, [2, 3, 3.5]),
        # A Euclidean rhythm lasts a bar unless `every` says how long a step is.
        ("a", {"every": None, "euclid": rhythm.Euclid(3, 8)}, [0, 1.5, 3]),
        ("a", {"every": None, "euclid": rhythm.Euclid(3, 8, 2), "times": 2},
         [0.5, 2, 3, 4.5, 6, 7]),
        ("a", {"every": "1/4", "euclid": rhythm.Euclid(3, 8), "times": 2},
         [0, 0.75, 1.5, 2, 2.75, 3.5]),
        # Plain names follow each other.
        ("a b", {"every": None, "length": lambda name: Time({"a": 2.0, "b": 0.5}[name], 0.0),
                 "times": 2}, [0, 2, 2.5, 4.5]),
        ("a b", {"every": None, "length": lambda name: Time(0.0, 0.25), "until": 0.6},
         [0, 0.25, 0.5]),
        # What is skipped leaves its time out.
        ("a b c", {"skip": 2, "times": 2}, [0, 1, 2, 3]),
    ],
)  # fmt: skip
def test_places_have_their_beats(text, options, expected):
    assert list(beats(text, **options)) == pytest.approx(expected)


def test_beats_follow_the_tempo():
    found = beats("a (b c)", every="250ms", tempo=RAMP, times=8)
    instants = [RAMP.seconds(beat) for beat in found]
    assert instants == pytest.approx([0.25 * (2 * n + i) for n in range(8) for i in (0, 1, 1.5)])


def test_a_line_without_end_is_worked_out_where_it_is_asked_for():
    whole = beats("walk a b c", every="1/16", until=62_000.0)
    assert len(whole) == 992_000
    assert whole[991_999] == pytest.approx(62_000 - 1 / 16)
    assert whole[-1] == whole[991_999]
    assert whole[10:12] == [10 / 16, 11 / 16]


@pytest.mark.parametrize(
    ("text", "options", "words_"),
    [
        ("a b", {"every": None}, "write `every`"),
        ("a ~", {"every": None, "length": lambda name: Time(1.0, 0.0)}, "write `every`"),
        ("a b", {"every": None, "length": lambda name: Time(0.0, 0.0)}, "no duration"),
        ("a b", {"every": "0"}, "above 0"),
        ("a b", {"skip": 2}, "leaves out every place"),
        ("a", {"every": "1/1000", "until": 1e6}, "more than 1,000,000 occurrences"),
    ],
)
def test_what_has_no_beats_is_refused(text, options, words_):
    with pytest.raises(TextError, match=re.escape(words_)):
        beats(text, **options)


# --- as written ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "marked", "words_", "suggestion"),
    [
        ("a (b c", "(", "not closed", None),
        ("a b) c", ")", "closes no group", None),
        ("a () b", "(", "has no names", None),
        ("(choose) b", "(", "'choose' has no names", None),
        ("a *2", "a", None, None),
        ("*2 a", "*", "repeats the name", None),
        ("a*0", "0", "not a number of repetitions", None),
        ("a*x", "x", "not a number of repetitions", None),
        ("a*99999", "99999", "not a number of repetitions", None),
        ("(a*200)*200", "a", "more than 10,000 places", None),
        ("a b-!c", "b-!c", "not the name", None),
        ("a choose b", "choose", "stands at the beginning", None),
        ("((((((((((a))))))))))", "(", "nested more than 8 deep", None),
    ],
)
def test_mistakes_have_a_place(text, marked, words_, suggestion):
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
def test_mistakes_in_a_line_have_a_place(text, marked, words_):
    with pytest.raises(TextError) as caught:
        words.parse(text, 100)
    error = caught.value
    assert text[error.offset - 100 :].startswith(marked)
    assert words_ in error.message


def test_every_word_of_a_pattern():
    text = (
        "(knock lean)*2 ~ every 1/2 every 4th do mirror, scale 2 every 3rd do reverse chance 60% "
        "euclid 3 8 rotate 2 swing 2/3 skip 5 until C do scale 0.5"
    )
    play = words.parse(text)
    assert play.what == ("(knock lean)*2 ~", 0)
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
    assert [t.word for t in play.do] == ["scale"]


def test_words_of_patterns_may_be_names_of_gestures():
    for name in ("chance", "swing", "skip", "walk", "choose"):
        assert words.parse(f"{name} every 1").what.text == name
        assert words.parse(f"{name} every 1").order is None or played(name) == [(0, name)]


@given(st.text(alphabet="ab~()*2 choosewalk", max_size=40))
def test_any_text_is_read_or_refused(text):
    try:
        found = order.parse(text)
    except TextError as error:
        assert 0 <= error.offset <= len(text)  # noqa: PT017
        return
    one = Course(Pattern(found), Draws(1, ""))
    at = [one.position(n) for n in range(3 * found.places)]
    assert at == sorted(at)


# --- in a score ----------------------------------------------------------------------------------

SCORE = """\
ergon: 1
seed: 5
tempo: [{{at: 1|1, bpm: 120, meter: 4/4}}]
keys: {{k: {{M: 400g, K: 60N/m, Z: 1.2Ns/m, travel: -15mm..15mm}}}}
players: {{p: {{key: k}}}}
gestures:
  knock: 0mm@0 smooth 6mm@60ms 0mm@160ms
  lean: 0mm@0 smooth 3mm@1/8 smooth 0mm@1/4
  tap: 0mm@0 smooth 4mm@60ms 0mm@160ms
parts:
  p: {part}
"""
TABLE = """|
    # at  what
    1|1   knock lean ~ (tap tap) every 1 times 2
    4|1   choose knock tap every 1/2 times 8 chance 0.6 every 4th do mirror
    7|1   knock euclid 3 8 rotate 2 times 2
    10|1  shuffle knock lean tap every 1/2 until 14|1 swing 2/3 do jitter 4ms 0.2mm
"""
LIST = """
  - {at: 1|1, play: knock lean ~ (tap tap), every: 1, times: 2}
  - {at: 4|1, play: choose knock tap, every: 1/2, times: 8, chance: 0.6, nth: 4th do mirror}
  - {at: 7|1, play: knock, euclid: 3 8 rotate 2, times: 2}
  - {at: 10|1, play: shuffle knock lean tap, every: 1/2, until: 14|1, swing: 2/3,
     do: [jitter 4ms 0.2mm]}
"""


def piece(part: str, seed: int = 5) -> Piece:
    loaded = load("s.yaml", text=SCORE.format(part=part).replace("seed: 5", f"seed: {seed}"))
    assert loaded.piece is not None, loaded.diagnostics
    return loaded.piece


def staged(of: Piece, spans=None) -> list[tuple[str, float, tuple[float, ...]]]:
    gestures = prepare(of, spans=spans).hands.gestures
    beat = of.tempo_map.beats
    return [(g.name, round(beat(g.start), 9), tuple(g.x)) for g in gestures]


def test_a_table_and_a_list_say_the_same():
    assert staged(piece(TABLE)) == staged(piece(LIST))
    assert piece(TABLE).digest() == piece(LIST).digest()
    assert piece(TABLE).digest() != piece(TABLE.replace("chance 0.6", "chance 0.5")).digest()


def test_patterns_become_gestures_on_a_key():
    found = staged(piece(TABLE))
    bars = [[(name, at - 4 * bar) for name, at, _ in found if 4 * bar <= at < 4 * bar + 4]
            for bar in range(13)]  # fmt: skip
    once = [("knock", 0), ("lean", 1), ("tap", 3), ("tap", 3.5)]
    assert bars[:2] == [once, once]
    assert bars[6:8] == [[("knock", 0.5), ("knock", 2), ("knock", 3)]] * 2
    assert {name for name, _ in bars[3]} == {"knock", "tap"}
    assert 2 <= len(bars[3]) <= 7
    for name, at, x in found:
        if 12 <= at < 16:  # the 4th and the 8th round are mirrored
            assert (min(x) < 0.0) == (at in (13.5, 15.5)), name
    swung_ = [round(at % 1, 6) for _, at, _ in found if at >= 36]
    assert set(swung_) == {0.0, round(2 / 3, 6)}
    assert [name for name, _ in bars[9]] != [name for name, _ in bars[10]]


def test_another_seed_draws_anew():
    for_five, for_six = staged(piece(TABLE)), staged(piece(TABLE, 6))
    assert [g for g in for_five if g[1] < 12] == [g for g in for_six if g[1] < 12]
    assert for_five != for_six
    # What is staged with another seed is what a score with that seed says.
    from ergon.scores.staging.stage import stage

    other = stage(piece(TABLE), seed=6)
    beat = other.piece.tempo_map.beats
    again = [(g.name, round(beat(g.start), 9), tuple(g.x)) for g in other.gestures]
    assert again == for_six


@pytest.mark.parametrize("cuts", [(3.0, 13.2, 37.1), (12.5, 24.0, 40.0)])
def test_windows_add_up_to_the_whole(cuts):
    """A session stages stretch by stretch what a render stages at once."""
    of = piece(TABLE)
    edges = (float("-inf"), *cuts, float("inf"))
    spans = [Span(of, Window(since, until)) for since, until in pairwise(edges)]
    assert sorted(staged(of, spans)) == sorted(staged(of))


def test_another_line_changes_no_draw():
    before = staged(piece(TABLE))
    more = TABLE + "    20|1  choose knock lean every 1 times 8 chance 0.5 do jitter 1ms 0.1mm\n"
    assert [g for g in staged(piece(more)) if g[1] < 76] == before


@pytest.mark.parametrize(
    ("row", "code", "words_", "column"),
    [
        ("1|1  knock laen every 1", "E301", "no gesture or take is called 'laen'", 16),
        ("1|1  knock ~ lean", "E103", "write `every`", 10),
        ("1|1  knock every 1 chance 1.5", "E202", "above the maximum of 1", 31),
        ("1|1  knock euclid 9 8", "E204", "a rhythm of 8 steps has 1 to 8 pulses", 23),
        ("1|1  knock every 1 swing 0.1", "E202", "is no swing", 30),
        ("1|1  knock (lean every 1", "E204", "not closed", 16),
        ("1|1  choose knock lean", "E103", "write `every`", 10),
    ],
)
def test_mistakes_in_a_score_have_their_place(row, code, words_, column):
    loaded = load("s.yaml", text=SCORE.format(part=f"|\n    {row}\n"))
    assert loaded.piece is None
    found = loaded.diagnostics[0]
    assert (found.code, found.place.line, found.place.column) == (code, 12, column)
    assert words_ in found.message


def test_a_single_name_is_what_it_was():
    plain, group = (
        piece("[{at: 1|1, play: knock, every: 1}]"),
        piece("|\n    1|1 (knock)*1 every 1"),
    )
    assert plain.parts[0].pattern is None
    assert staged(plain) == staged(group)


def test_lines_go_on_for_ever_at_little_cost():
    endless = "|\n    1|1  walk knock lean tap every 1/2 until 999|1\n"
    of = piece(endless)
    (places,) = of.starts
    assert len(places) == 7984
    late = staged(of, [Span(of, Window(3900.0, 3903.0))])
    assert [at for _, at, _ in late] == [3900 + n / 2 for n in range(6)]
    assert list(islice((name for name, *_ in late), 6)) == [
        of.parts[0].course(of.seed).played(7800 + n) for n in range(6)
    ]


# --- strikes -------------------------------------------------------------------------------------

STRUCK = """\
ergon: 1
seed: {seed}
tempo: [{{at: 1|1, bpm: 60, meter: 4/4}}]
instruments:
  sky: {{BANK: {{count: 5, f: 200Hz..2kHz, t60: 1s, M: 1g}}, out: {{SOX: sky.all}}}}
strikes:
  rain: {{to: sky.all, at: 1|1, impulse: 1mNs, {rain}}}
"""


class Struck:
    """A timeline that keeps what is struck."""

    def __init__(self) -> None:
        self.strikes: list[tuple[float, int]] = []

    def strike(self, mat: int, at: float, **more: object) -> None:
        self.strikes.append((at, mat))


def rain(text: str, within=(float("-inf"), float("inf")), seed: int = 3) -> list[tuple[float, int]]:
    loaded = load("s.yaml", text=STRUCK.format(rain=text, seed=seed))
    assert loaded.piece is not None, loaded.diagnostics
    struck, collector = Struck(), Collector()
    (one,) = loaded.piece.strikes
    Striking(loaded.piece, struck, one, range(5), 0, within).play(collector)
    assert not collector.has_errors()
    return struck.strikes


def test_strikes_fall_in_a_rhythm():
    found = rain("euclid: 3 8, for: 2bar")
    assert found == [(at, mat) for at in (0, 1.5, 3, 4, 5.5, 7) for mat in range(5)]
    found = rain("every: 1/2, times: 4, swing: 2/3")
    assert found == [(pytest.approx(at), mat) for at in (0, 2 / 3, 1, 5 / 3) for mat in range(5)]


def test_each_member_has_a_chance_of_its_own():
    found = rain("every: 1/4, times: 400, chance: 30%")
    assert len(found) / 2000 == pytest.approx(0.3, abs=0.03)
    each = [[at for at, mat in found if mat == member] for member in range(5)]
    assert len({tuple(own) for own in each}) == 5
    assert found == rain("every: 1/4, times: 400, chance: 30%")
    assert found != rain("every: 1/4, times: 400, chance: 30%", seed=4)


@pytest.mark.parametrize("cut", [10.0, 33.3, 60.0])
def test_windows_of_strikes_add_up_to_the_whole(cut):
    text = "every: 1/4, times: 400, chance: 30%, swing: 0.6, euclid: 5 7"
    assert rain(text, (0.0, cut)) + rain(text, (cut, 1e9)) == rain(text)


@pytest.mark.parametrize(
    ("text", "code", "words_"),
    [
        ("rate: 1Hz, for: 4, chance: 0.5", "E111", "strikes by chance have no steps"),
        ("chance: 0.5", "E103", "write `every`"),
        ("euclid: 3 8, every: 0, times: 2", "E305", "'every' must be above 0"),
        ("euclid: 3 8, every: 1, times: 2, skip: 9", "E305", "leaves out every place"),
    ],
)
def test_mistakes_in_strikes_are_told(text, code, words_):
    loaded = load("s.yaml", text=STRUCK.format(rain=text, seed=3))
    assert loaded.piece is None
    assert loaded.diagnostics[0].code == code
    assert words_ in loaded.diagnostics[0].message
