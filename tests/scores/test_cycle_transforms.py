"""Transformations of rhythms: what each does, how they are read, where their mistakes are."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from ergon.notation.text.errors import TextError
from ergon.scores.pattern.cycle_forms import CycleTransform, apply
from ergon.scores.pattern.cycle_table import FORM_BY_WORD
from ergon.scores.pattern.cycle_transforms import parse_transforms
from ergon.scores.pattern.cycles import Cycles, chance_from
from ergon.scores.pattern.rhythm_text import parse
from ergon.scores.pattern.struck import Struck

PAGE = Path(__file__).parents[2] / "docs" / "rhythm.md"


def transformed(text: str, transforms: str) -> Cycles[Struck]:
    return apply(parse(text, Struck), parse_transforms(transforms))


def shown(text: str, transforms: str, cycle: int = 0) -> str:
    """The strokes of a cycle: instant from its beginning, word, semitones and factor."""
    strokes = []
    for event in transformed(text, transforms).onsets(cycle):
        what = event.value
        pitch = f"{what.semitones:+d}" if what.semitones else ""
        factor = f"x{what.factor:.3g}" if what.factor != 1.0 else ""
        strokes.append(f"{event.begin - cycle} {what.word}{pitch}{factor}")
    return ", ".join(strokes)


def mistake(transforms: str, text: str = "a b c d", start: int = 0) -> TextError:
    with pytest.raises(TextError) as caught:
        apply(parse(text, Struck), parse_transforms(transforms, start))
    return caught.value


@pytest.mark.parametrize(
    ("transforms", "cycles"),  # of `a b c d`
    [
        ("rev", ["0 d, 1/4 c, 1/2 b, 3/4 a"] * 2),
        ("palindrome", ["0 a, 1/4 b, 1/2 c, 3/4 d", "0 d, 1/4 c, 1/2 b, 3/4 a"] * 2),
        ("fast 2", ["0 a, 1/8 b, 1/4 c, 3/8 d, 1/2 a, 5/8 b, 3/4 c, 7/8 d"]),
        ("fast 3/2", ["0 a, 1/6 b, 1/3 c, 1/2 d, 2/3 a, 5/6 b",
                      "0 c, 1/6 d, 1/3 a, 1/2 b, 2/3 c, 5/6 d"]),
        ("slow 2", ["0 a, 1/2 b", "0 c, 1/2 d", "0 a, 1/2 b"]),
        ("early 1/4", ["0 b, 1/4 c, 1/2 d, 3/4 a"]),
        ("late 0.25", ["0 d, 1/4 a, 1/2 b, 3/4 c"]),
        ("swing 2", ["0 a, 5/12 b, 1/2 c, 11/12 d"]),
        ("swing 1/4 2", ["0 a, 3/8 b, 1/2 c, 7/8 d"]),
        ("ply 2", ["0 a, 1/8 a, 1/4 b, 3/8 b, 1/2 c, 5/8 c, 3/4 d, 7/8 d"]),
        ("iter 4", ["0 a, 1/4 b, 1/2 c, 3/4 d", "0 b, 1/4 c, 1/2 d, 3/4 a",
                    "0 c, 1/4 d, 1/2 a, 3/4 b", "0 d, 1/4 a, 1/2 b, 3/4 c"]),
        ("chunk 4 scale 2", ["0 ax2, 1/4 b, 1/2 c, 3/4 d", "0 a, 1/4 bx2, 1/2 c, 3/4 d"]),
        ("every 2 rev", ["0 d, 1/4 c, 1/2 b, 3/4 a", "0 a, 1/4 b, 1/2 c, 3/4 d"] * 2),
        ("whenmod 3 2 rev", ["0 a, 1/4 b, 1/2 c, 3/4 d"] * 2 + ["0 d, 1/4 c, 1/2 b, 3/4 a"]),
        ("sometimes 0 rev", ["0 a, 1/4 b, 1/2 c, 3/4 d"]),
        ("sometimes 1 rev", ["0 d, 1/4 c, 1/2 b, 3/4 a"]),
        ("degrade 0", ["0 a, 1/4 b, 1/2 c, 3/4 d"]),
        ("degrade 1", [""]),
        ("off 1/8 transpose 12st", ["0 a, 1/8 a+12, 1/4 b, 3/8 b+12, "
                                    "1/2 c, 5/8 c+12, 3/4 d, 7/8 d+12"]),
        ("superimpose rev", ["0 a, 0 d, 1/4 b, 1/4 c, 1/2 c, 1/2 b, 3/4 d, 3/4 a"]),
        ("mask t ~ t t", ["0 a, 1/2 c, 3/4 d"]),
        ("mask <t f>", ["0 a, 1/4 b, 1/2 c, 3/4 d", ""]),
        ("struct t(3,8)", ["0 a, 3/8 b, 3/4 d"]),
        ("struct [t, ~ t]", ["0 a, 1/2 c"]),
        ("euclid 3 8", ["0 a, 1/32 b, 1/16 c, 3/32 d, 3/8 a, 13/32 b, 7/16 c, 15/32 d, "
                        "3/4 a, 25/32 b, 13/16 c, 27/32 d"]),
        ("slow 4, euclid 3 8 2", ["1/8 a, 1/2 a, 3/4 a", "1/8 b, 1/2 b, 3/4 b"]),
        ("slow 4, echo 3 1/8 0.5", ["0 a, 1/8 ax0.5, 1/4 ax0.25"]),
        ("transpose 12st, transpose -5st", ["0 a+7, 1/4 b+7, 1/2 c+7, 3/4 d+7"]),
        ("scale 0.5, scale 0.5", ["0 ax0.25, 1/4 bx0.25, 1/2 cx0.25, 3/4 dx0.25"]),
        ("every 2 (rev, fast 2)", ["0 d, 1/8 c, 1/4 b, 3/8 a, 1/2 d, 5/8 c, 3/4 b, 7/8 a",
                                   "0 a, 1/4 b, 1/2 c, 3/4 d"]),
        ("every 2 rev, fast 2", ["0 d, 1/8 c, 1/4 b, 3/8 a, 1/2 a, 5/8 b, 3/4 c, 7/8 d"] * 2),
        ("every 2 every 3 rev", ["0 d, 1/4 c, 1/2 b, 3/4 a"] + ["0 a, 1/4 b, 1/2 c, 3/4 d"] * 3),
        # A beat that lasts keeps the words of its time: backwards it begins with the last.
        ("every 2 struct [t, t(1,2)], rev", ["0 d, 1/2 b", "0 d, 1/4 c, 1/2 b, 3/4 a"]),
    ],
)  # fmt: skip
def test_apply_onsets(transforms, cycles):
    assert [shown("a b c d", transforms, cycle) for cycle in range(len(cycles))] == cycles


@pytest.mark.parametrize(
    ("transforms", "share"),
    [
        ("sometimes transpose 1st", 0.5),
        ("sometimes 0.3 transpose 1st", 0.3),
        ("often transpose 1st", 0.75),
        ("rarely transpose 1st", 0.25),
        ("degrade 0.4, transpose 1st", 0.6),
        ("degrade, transpose 1st", 0.5),
    ],
)
def test_apply_share_by_chance(transforms, share):
    events = [e for c in range(50) for e in transformed("a*16", transforms).onsets(c)]
    changed = sum(event.value.semitones for event in events)
    assert changed == pytest.approx(800 * share, abs=5 * (800 * share * (1 - share)) ** 0.5)


def test_draws_of_different_operators():
    numbers = []

    def chance(number: int, _: object) -> float:
        numbers.append(number)
        return 0.9

    transforms = "degrade, sometimes struct t?, euclid 3 8, degrade"
    transformed("a?!2", transforms).onsets(0, chance)
    # In each of three pulses two of the text, two of transformations and that of the rhythm.
    assert len(set(numbers)) == 3 * 5 + 1


def test_draws_by_seed_and_voice():
    plays = {
        key: transformed("a*16?", "sometimes rev, degrade 0.2").onsets(5, chance_from(*key))
        for key in [(1, "ada"), (1, "ben"), (2, "ada")]
    }
    again = transformed("a*16?", "sometimes rev, degrade 0.2").onsets(5, chance_from(1, "ada"))
    assert plays[1, "ada"] == again
    assert len({tuple(events) for events in plays.values()}) == 3


def test_leaves_after_changes():
    part = transformed("a [b|c]", "every 4 transpose 12st, off 1/8 scale 0.5")
    assert {(leaf.word, leaf.semitones, leaf.factor) for leaf in part.leaves} == {
        (word, semitones, factor)
        for word in "abc"
        for semitones in (0, 12)
        for factor in (1.0, 0.5)
    }


def test_parse_places():
    (first, second) = parse_transforms("every 4 (rev, fast 2),  degrade 0.4 ", 100)
    assert isinstance(first, CycleTransform)
    assert (first.word, first.values, first.offset, first.length) == ("every", (4,), 100, 21)
    assert [(inner.word, inner.offset, inner.length) for inner in first.inner_transforms] == [
        ("rev", 109, 3),
        ("fast", 114, 6),
    ]
    assert (second.word, second.values, second.offset) == ("degrade", (0.4,), 124)


@pytest.mark.parametrize("word", FORM_BY_WORD)
def test_examples_of_transformation_table(word):
    form = FORM_BY_WORD[word]
    (transform,) = parse_transforms(form.example)
    assert transform.word == word
    assert form.description[0].islower()
    assert not form.description.endswith(".")
    plain = [[(e.begin, e.value) for e in parse("a*8 c4.maj", Struck).onsets(c)] for c in range(16)]
    changed = transformed("a*8 c4.maj", form.example)
    assert [[(e.begin, e.value) for e in changed.onsets(c)] for c in range(16)] != plain


# --- mistakes -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("transforms", "place", "part"),
    [
        ("", (0, 1), "a transformation is missing"),
        ("rev,", (3, 1), "a transformation is missing"),
        ("rev, , rev", (5, 1), "a transformation is missing"),
        ("every 4 ()", (9, 1), "a transformation is missing"),
        ("(rev)", (0, 1), "a transformation is missing"),
        ("revv", (0, 4), "unknown transformation 'revv'"),
        ("every 4 revv", (8, 4), "unknown transformation 'revv'"),
        ("jux rev", (0, 3), "strokes have no sides"),
        ("chop 4", (0, 4), "no recording"),
        ("rev 2", (4, 1), "'2' does not belong to 'rev'"),
        ("rev fast 2", (4, 4), "a comma divides transformations"),
        ("swing 4 rev", (8, 3), "'rev' does not belong to 'swing'"),
        ("fast (2)", (0, 4), "'fast' needs a factor"),
        ("rev (fast 2)", (4, 1), "'(' does not belong to 'rev'"),
        ("every rev", (0, 5), "'every' needs a number"),
        ("every 4", (0, 5), "'every' needs a transformation after it"),
        ("superimpose, rev", (0, 11), "'superimpose' needs a transformation"),
        ("every 4 (rev", (8, 1), "this '(' is not closed"),
        ("every 4 rev)", (11, 1), "')' has no '('"),
        ("fast", (0, 4), "'fast' needs a factor"),
        ("fast two", (5, 3), "'two' is not a factor"),
        ("fast 0", (5, 1), "'0' is not a factor"),
        ("fast -1", (5, 2), "'-1' is not a factor"),
        ("slow 1001", (5, 4), "'1001' is not a factor"),
        ("early 1/0", (6, 3), "not a share of a cycle"),
        ("late 0.123456789", (5, 11), "not a share of a cycle"),
        ("ply 1.5", (4, 3), "not a number from 1"),
        ("every 0 rev", (6, 1), "not a number from 1"),
        ("whenmod 4 rev", (0, 7), "'whenmod' needs a number from 0"),
        ("degrade 2", (8, 1), "a probability from 0 to 1"),
        ("sometimes 2 rev", (10, 1), "a probability from 0 to 1"),
        ("transpose 5", (10, 1), "an interval such as -5st, 50cents or 3/2"),
        ("transpose 50Hz", (10, 4), "an interval such as -5st, 50cents or 3/2"),
        ("transpose 0/2", (10, 3), "an interval such as -5st, 50cents or 3/2"),
        ("transpose 128st", (10, 5), "an interval such as -5st, 50cents or 3/2, up to 127st"),
        ("scale 101", (6, 3), "a factor from 0 to 100"),
        ("echo 3", (0, 4), "'echo' needs a share of a cycle"),
        ("echo 33 1/8 0.7", (5, 2), "a number of copies from 1 to 32"),
        ("euclid 3", (0, 6), "'euclid' needs a number of steps"),
        ("rev, euclid 9 8", (5, 10), "1 to 8 pulses"),
        ("struct", (0, 6), "'struct' needs a rhythm"),
        ("mask , rev", (0, 4), "'mask' needs a rhythm"),
        ("struct t q", (9, 1), "'q' is not a beat"),
        ("every 4 struct [t, t", (15, 1), "this '[' is not closed"),
        ("struct t*0", (9, 1), "a number above 0"),
    ],
)
def test_parse_mistake_place(transforms, place, part):
    error = mistake(transforms, start=500)
    assert part in error.message
    assert (error.offset - 500, error.length) == place


@pytest.mark.parametrize(
    ("word", "near"),
    [("reverse", "rev"), ("hurry", "fast"), ("stut", "echo"), ("degradeBy", "degrade"),
     ("Rev", "rev"), ("sometime", "sometimes"), ("palindrom", "palindrome"), ("zzz", None)],
)  # fmt: skip
def test_parse_suggestions(word, near):
    assert mistake(word).suggestion == near


@pytest.mark.parametrize(
    ("transforms", "place"),
    [
        ("fast 1000, fast 1000", (11, 9)),
        ("ply 1000, ply 5", (10, 5)),
        (", ".join(["superimpose rev"] * 16), (170, 15)),
        (", ".join(["sometimes early 1/7"] * 16), (210, 19)),
        ("echo 32 1/8 1, echo 32 1/8 1, echo 32 1/8 1", (30, 13)),
        ("struct t*1000, struct t*1000", (15, 13)),
    ],
)
def test_apply_too_large(transforms, place):
    error = mistake(transforms)
    assert "steps" in error.message
    assert (error.offset, error.length) == place


def test_apply_too_many_leaves():
    doubled = ", ".join(f"every 2 transpose {n}st" for n in (1, 2, 4, 8, 16, 32, 64, 100, 101, 102))
    assert "different strokes" in mistake(doubled, "a!64 b!64 c!64 d!64 <e f g h i j k>").message


def test_parse_too_many():
    assert "at most 32" in mistake(", ".join(["rev"] * 33)).message
    assert "at most 32" in mistake("every 2 " * 33 + "rev").message
    assert "4,000 characters" in mistake("rev " * 1_001).message


@pytest.mark.parametrize("transforms", ["every 2 " * 31 + "rev", ", ".join(["rev"] * 32)])
def test_apply_largest(transforms):
    assert len(transformed("a b", transforms).onsets(0)) == 2


# --- the page -----------------------------------------------------------------------------------


def test_transformation_page_lists_words_of_table():
    text, _ = PAGE.read_text(encoding="utf-8").split("## What a hand plays")
    rows = re.findall(r"^\| `([a-z]+)[^`]*` \| `([^`]+)` \|", text, re.MULTILINE)
    assert [name for name, _ in rows] == list(FORM_BY_WORD)
    for name, example in rows:
        assert parse_transforms(example)[0].word == name
