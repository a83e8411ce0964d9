"""Words of phrasing on rhythms: what each plays, to exact instants, and the laws it keeps."""

from __future__ import annotations

from collections import Counter
from fractions import Fraction
from itertools import pairwise
from random import Random

import pytest
from sweep import crossed, few

from ergon.notation.text.errors import TextError
from ergon.scores.pattern.cycle_forms import Pattern, apply
from ergon.scores.pattern.cycle_transforms import parse_transforms
from ergon.scores.pattern.cycles import Event, Fragment, chance_from
from ergon.scores.pattern.struck import Struck, single_notes
from ergon.scores.reading.rhythms import compiled_in_tuning, compiled_rhythm

CHANCE = chance_from(3, "strikes/s")


def strokes(text: str, do: str, cycle: int = 0) -> list[Event[Struck]]:
    return compiled_rhythm(text, do).onsets(cycle, CHANCE)


def shown(text: str, do: str, cycle: int = 0) -> list[str]:
    """The strokes of a cycle: from when to when they sound, word, semitones, factor, delay."""
    lines = []
    for event in strokes(text, do, cycle):
        what, begin = event.value, event.begin - cycle
        stop = begin + (event.end - event.begin) * what.length
        pitch = f"{what.semitones:+d}" if what.semitones else ""
        factor = f" x{what.factor:.4g}" if what.factor != 1.0 else ""
        delay = f" {1000 * what.delay:g}ms" if what.delay else ""
        lines.append(f"{begin}-{stop} {what.word}{pitch}{factor}{delay}")
    return lines


@pytest.mark.parametrize(
    ("text", "do", "expected"),
    [
        # The time from a to b is a quarter, from b to the next a half and a quarter.
        ("a b ~ ~", "legato 1", "0-1/4 a, 1/4-1 b"),
        ("a b ~ ~", "legato 1/2", "0-1/8 a, 1/4-5/8 b"),
        ("a b ~ ~", "legato 0.3", "0-3/40 a, 1/4-19/40 b"),
        ("a ~ ~ b", "late 1/4, legato 1", "0-1/4 b, 1/4-1 a"),
        ("a _ _ b", "legato 1", "0-3/4 a, 3/4-1 b"),
        ("a@3 b", "rev", "0-1/4 b, 1/4-1 a"),  # a tie is a length
        # Lines are independent of each other; a chord in brackets is of one line.
        ("a ~ b ~, c ~ ~ ~", "legato 1", "0-1/2 a, 0-1 c, 1/2-1 b"),
        ("[a, b] c", "legato 1/2", "0-1/4 a, 0-1/4 b, 1/2-3/4 c"),
        ("a [~, b] ~", "legato 1", "0-1/3 a, 1/3-1 b"),
        ("a ~", "legato 1, legato 1/4", "0-1/4 a"),  # the last says it
        ("a b", "tremolo 3", "0-1/6 a, 1/6-1/3 a, 1/3-1/2 a, 1/2-2/3 b, 2/3-5/6 b, 5/6-1 b"),
        ("a", "tremolo 2, legato 1/2", "0-1/4 a, 1/2-3/4 a"),
        ("a", "legato 1/2, tremolo 2", "0-1/4 a, 1/2-3/4 a"),
        # From a quarter of the impulse to all of it: 1/4, 1/4^(1/2), 1.
        ("a ~", "roll 3", "0-1/6 a x0.25, 1/6-1/3 a x0.5, 1/3-1/2 a"),
        ("a", "roll 2 0.1", "0-1/2 a x0.1, 1/2-1 a"),
        ("a", "roll 3 1 1/100", "0-1/3 a, 1/3-2/3 a x0.1, 2/3-1 a x0.01"),
        ("a", "scale 2, roll 2 1/2", "0-1/2 a, 1/2-1 a x2"),
        ("a", "roll 1 0.1", "0-1 a"),
        ("~ c4", "grace 1/32 -1st", "15/32-1/2 c4-1 x0.5, 1/2-1 c4"),
        ("~ c4:f", "grace 1/16 2st 0.25", "7/16-1/2 c4:f+2 x0.25, 1/2-1 c4:f"),
        ("~ a", "grace 1/8", "3/8-1/2 a x0.5, 1/2-1 a"),
        ("a", "grace 1/8", "0-1 a, 7/8-1 a x0.5"),  # that of the next cycle's stroke
        ("~ a", "tremolo 2, grace 1/8", "3/8-1/2 a x0.5, 1/2-3/4 a, 3/4-1 a"),
        ("c4.maj ~", "arp up", "0-1/6 C4, 1/6-1/3 E4, 1/3-1/2 G4"),
        ("[g4,c4,e4]", "arp up", "0-1/3 c4, 1/3-2/3 e4, 2/3-1 g4"),
        ("g4, c4", "arp up", "0-1/2 c4, 1/2-1 g4"),
        ("c4.maj:f", "arp down", "0-1/3 G4:f, 1/3-2/3 E4:f, 2/3-1 C4:f"),
        ("c4.maj", "arp updown", "0-1/4 C4, 1/4-1/2 E4, 1/2-3/4 G4, 3/4-1 E4"),
        ("c4.maj ~", "arp up 1/8", "0-1/8 C4, 1/8-1/4 E4, 1/4-3/8 G4, 3/8-1/2 C4"),
        ("c4.maj ~", "arp up 3/16", "0-3/16 C4, 3/16-3/8 E4, 3/8-1/2 G4"),
        ("c4 e4", "arp updown", "0-1/2 c4, 1/2-1 e4"),  # a single note stays
        ("[kick, hat]", "arp down", "0-1/2 hat, 1/2-1 kick"),
        ("c4 ~", "superimpose transpose 12st, arp down", "0-1/4 c4+12, 1/4-1/2 c4"),
        ("c4.min7", "rolled", "0-1 C4, 1/16-1 Eb4, 1/8-1 G4, 3/16-1 Bb4"),
        ("c4.maj ~", "rolled -1/2", "0-1/2 G4, 1/12-1/2 E4, 1/6-1/2 C4"),
        ("c4.maj", "strum 20ms", "0-1 C4, 0-1 E4 20ms, 0-1 G4 40ms"),
        ("c4.maj", "strum -0.01s", "0-1 G4, 0-1 E4 10ms, 0-1 C4 20ms"),
        ("c4.maj c4", "strum 20ms, rev", "0-1/2 c4, 1/2-1 C4, 1/2-1 E4 20ms, 1/2-1 G4 40ms"),
    ],
)  # fmt: skip
def test_strokes_of_a_cycle(text, do, expected):
    flats = {"Eb4": "D#4", "Bb4": "A#4"}
    for flat, sharp in flats.items():
        expected = expected.replace(flat, sharp)
    assert shown(text, do, 5) == expected.split(", ")


# As Data/Tidal documents them: `arpeggiate` has these orders.
@pytest.mark.parametrize(
    ("order", "expected"),
    [
        ("up", "cegb"),
        ("down", "bgec"),
        ("updown", "cegbge"),
        ("downup", "bgeceg"),
        ("up&down", "cegbbgec"),
        ("down&up", "bgeccegb"),
        ("converge", "cbeg"),
        ("diverge", "gebc"),
        ("disconverge", "cbegebc"),
        ("pinkyup", "cbebgb"),
        ("pinkyupdown", "cbebgbgbeb"),
        ("thumbup", "cecgcb"),
        ("thumbupdown", "cecgcbcgce"),
    ],
)
def test_orders_of_arp(order, expected):
    played = strokes("c4.maj7", f"arp {order}")
    assert "".join(event.value.word[0].lower() for event in played) == expected
    width = Fraction(1, len(expected))
    assert [event.begin for event in played] == [n * width for n in range(len(expected))]


# --- laws ---------------------------------------------------------------------------------------


def random_text(random: Random, depth: int = 1) -> str:
    steps = []
    for _ in range(random.randint(1, 3)):
        step = random.choice(["c4", "e4.min7", "g4", "d4.maj:f", "~", "a4"])
        if depth and random.random() < 0.5:
            inner, other = (random_text(random, depth - 1) for _ in range(2))
            brackets = ["[{0}]", "[{0}, {1}]", "<{0} {1}>", "<{0} | {1}>", "{{{0}}}%3"]
            step = random.choice(brackets).format(inner, other)
        steps.append(step + random.choice(["", "", "*2", "@3", "/2", "?", "(3,8)"]))
    return " ".join(steps)


TEXTS = [text for text in map(random_text, map(Random, range(40))) if "4" in text]
WORDS = ["legato 0.7", "tremolo 3", "roll 5 0.2", "grace 1/16 2st", "arp updown", "arp up 1/16",
         "rolled 1/3", "strum 15ms", "tremolo 9Hz"]  # fmt: skip


def ends(event: Event[Struck]) -> Fraction:
    return event.begin + (event.end - event.begin) * event.value.length


@pytest.mark.parametrize("text", TEXTS)
def test_legato_joins_ends_to_beginnings(text):
    played = [event for cycle in range(30) for event in strokes(text, "legato 1", cycle)]
    begins = sorted({event.begin for event in played})
    following = dict(pairwise(begins))
    checked = [event for event in played if event.begin < 20]
    for event in checked:
        assert ends(event) == min(following[event.begin], event.begin + 8)
    assert len(checked) > 5


def fragments(text: str, do: str) -> list[Fragment[Struck]]:
    """What begins in nine cycles."""
    seen = compiled_rhythm(text, do).query(Fraction(0), Fraction(9), CHANCE)
    return [f for f in seen if f.part_start == f.begin]


@pytest.mark.parametrize("text", TEXTS)
@pytest.mark.parametrize("count", [1, 2, 7])
def test_tremolo_fills_each_note(text, count):
    """As many strokes as said, end to end from the beginning of the note to its end."""
    expected = Counter(
        (f.begin + turn * (f.end - f.begin) / count, (f.end - f.begin) / count, f.value.word)
        for f in fragments(text, "")
        if (f.part_start, f.part_stop) == (f.begin, f.end)  # not of a note that another one cuts
        for turn in range(count)
    )
    played = Counter(
        (f.begin, f.end - f.begin, f.value.word) for f in fragments(text, f"tremolo {count}")
    )
    assert expected <= played
    assert expected


def pitches(chord: list[Fragment[Struck]]) -> set[str]:
    return {note.word for f in chord for note in single_notes(f.value)}


SPREADS = ["arp up", "arp converge", "rolled", "rolled -1/2", "strum 5ms"]


@pytest.mark.parametrize(("text", "do"), crossed(TEXTS, SPREADS))
def test_spread_chords_keep_their_notes(text, do):
    """Within the span of each chord its notes begin, and no others of its words."""
    spread = fragments(text, do)
    for chord in fragments(text, ""):
        if (chord.part_start, chord.part_stop) == (
            chord.begin,
            chord.end,
        ):  # not one that another cuts
            within = [
                f
                for f in spread
                if chord.begin <= f.begin < chord.end and f.value.offset == chord.value.offset
            ]
            assert pitches(within) == pitches([chord])


WINDOWED = [
    (text, do)
    for text in TEXTS
    for do in (*WORDS, "legato 1, arp up, degrade 0.3", "arp up, rev, tremolo 2")
]


@pytest.mark.parametrize(("text", "do"), few(WINDOWED, WINDOWED[::4]))
def test_phrasing_independent_of_window(text, do):
    """What a pattern plays does not depend on which parts of time are asked for."""
    cycles, random = compiled_rhythm(text, do), Random(text)
    cuts = sorted(
        {Fraction(random.randint(0, 96), 24) for _ in range(7)} | {Fraction(0), Fraction(4)}
    )
    parts = [
        (f.begin, f.end, f.value)
        for begin, end in pairwise(cuts)
        for f in cycles.query(begin, end, CHANCE)
        if f.part_start == f.begin
    ]
    together = [
        (f.begin, f.end, f.value)
        for f in cycles.query(Fraction(0), Fraction(4), CHANCE)
        if f.part_start == f.begin
    ]
    assert Counter(parts) == Counter(together)
    assert all(event.value.word in {leaf.word for leaf in cycles.leaves}
               for event in cycles.onsets(2, CHANCE))  # fmt: skip


@pytest.mark.parametrize("do", WORDS)
def test_strokes_of_cycle_alone(do):
    text = "c4.min7? [e4|g4]*2 <c4 | e4 | g4>, a4(3,8)"
    fresh = apply(compiled_rhythm(text, ""), parse_transforms(do))
    alone = fresh.onsets(11, CHANCE)
    played: Pattern = compiled_rhythm(text, do)
    for cycle in range(11):
        played.onsets(cycle, CHANCE)
    assert played.onsets(11, CHANCE) == alone
    others = [played.onsets(11, chance_from(*key)) for key in [(4, "strikes/s"), (3, "strikes/t")]]
    assert others[0] != others[1]


# --- random walks ---------------------------------------------------------------------------------


def test_walk_to_neighbours():
    walked = ["abcd".index(strokes("<a | b | c | d>", "", n)[0].value.word) for n in range(3000)]
    assert walked[0] == 0
    assert {b - a for a, b in pairwise(walked)} == {-1, 0, 1}
    # In the limit an end is visited half as often as a place between: 1/6, 1/3, 1/3, 1/6.
    shares = [walked.count(place) / len(walked) for place in range(4)]
    assert shares == pytest.approx([1 / 6, 1 / 3, 1 / 3, 1 / 6], abs=0.08)


def test_walk_without_do():
    text = "<a | [b b] | c>(3,8)"
    fresh = compiled_in_tuning.__wrapped__(text, "early 1/8", None)
    alone = fresh.onsets(500, chance_from(8, "strikes/w"))
    again = compiled_in_tuning.__wrapped__(text, "early 1/8", None)
    walked = [again.onsets(cycle, chance_from(8, "strikes/w")) for cycle in range(501)]
    assert walked[500] == alone
    assert len({len(events) for events in walked}) > 1


# --- mistakes -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("do", "place", "part", "near"),
    [
        ("legato", (0, 6), "'legato' needs a share of the time until the next stroke", None),
        ("legato 0", (7, 1), "is not a share of the time", None),
        ("legato 9", (7, 1), "up to 8", None),
        ("legto 1", (0, 5), "unknown transformation", "legato"),
        ("staccato", (0, 8), "unknown transformation", "legato"),
        ("tremolo 0", (8, 1), "a number of strokes from 1 to 1,000, or a rate", None),
        ("tremolo 200Hz", (8, 5), "up to 100Hz", None),
        ("tremolo 8hz", (8, 3), "a number of strokes", None),
        ("roll 8 0", (7, 1), "a factor from 1/1000", None),
        ("grace 0 1st", (6, 1), "a share of a cycle", None),
        ("grace 20ms", (6, 4), "a share of a cycle", None),
        ("grace 1/8 0.5", (10, 3), "an interval such as -5st", None),
        ("arp", (0, 3), "'arp' needs an order of notes", None),
        ("arp upp", (4, 3), "'upp' is not an order of notes", "up"),
        ('arp "up"', (4, 4), "is not an order of notes", "up"),
        ("arp up 0", (7, 1), "a share of a cycle", None),
        ("rolledBy 1/4", (0, 8), "unknown transformation", "rolled"),
        ("rolled 0", (7, 1), "a share of the length from -1 to 1", None),
        ("strum 1/8", (6, 3), "a time up to a second", None),
        ("strum 2s", (6, 2), "a time up to a second", None),
    ],
)
def test_phrasing_mistake_codes_and_places(do, place, part, near):
    with pytest.raises(TextError) as caught:
        parse_transforms(do)
    error = caught.value
    assert part in error.message
    assert (error.offset, error.length) == place
    assert error.suggestion == near


def test_strokes_above_maximum_are_refused():
    with pytest.raises(TextError, match="up to 4,160"):
        compiled_rhythm("c4*16", "legato 1, tremolo 65")
