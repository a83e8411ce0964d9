"""A phrase as a rhythm text: a round is a cycle, entries are steps as long as it is to the next."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import fields
from fractions import Fraction
from math import gcd, lcm
from typing import NamedTuple

from ergon.notation.clock.positions import Length
from ergon.notation.tables import tuning
from ergon.notation.tables.strengths import DYNAMICS, Level, velocity
from ergon.notation.text.errors import TextError, quote
from ergon.scores.pattern.rhythm_signs import MAX_NUMBER
from ergon.scores.pattern.rhythm_text import WORD
from ergon.scores.reading.piece import Hit, Strikes
from ergon.scores.reading.rhythms import Rhythm

_PARTS = 10_000  # of a beat or a second, at most, in which entries lie
_FINE = 1_000  # large weights are written with so many parts
_ROUNDING = 1e-9


class _Notes(NamedTuple):
    """What is struck together from one instant to another, in parts of a cycle."""

    begin: Fraction
    end: Fraction
    words: tuple[str, ...]


def phrased(strikes: Strikes) -> Rhythm:
    """A phrase that strikes play, as a rhythm whose words strike nothing yet.

    Raises TextError if it has entries that a rhythm has not.
    """
    assert strikes.length is not None
    cycle = strikes.every or strikes.length
    unit = _unit(cycle, strikes.hits)
    total = _exact(getattr(cycle, unit))
    return Rhythm(_text(list(_notes(strikes.hits, unit, total)), total), "", cycle, {})


def _unit(cycle: Length, hits: Sequence[Hit]) -> str:
    """The field of `Length` in which everything is written."""
    lengths = [cycle, *(length for hit in hits for length in (hit.at, hit.lasting))]
    units_used = {
        f.name for length in lengths for f in fields(Length) if getattr(length, f.name, 0.0)
    }
    if len(units_used) != 1:
        message = "a rhythm needs entries and a length of the phrase in one unit: all in beats, in "
        raise TextError(f"{message}bars or in seconds")
    return units_used.pop()


def _exact(value: float) -> Fraction:
    exact = Fraction(value).limit_denominator(_PARTS)
    if abs(float(exact) - value) > _ROUNDING * max(1.0, abs(value)):
        raise TextError(f"{value!r} is no simple fraction, as steps of a rhythm are; use quantise")
    return exact


def _notes(hits: Sequence[Hit], unit: str, total: Fraction) -> Iterator[_Notes]:
    """The notes of a round in order; those without an end last until the next ones."""
    groups: dict[tuple[Fraction, Fraction | None], dict[str, None]] = {}
    for hit in hits:
        if hit.jitter != Length():
            raise TextError("a rhythm has exact instants and no jitter; leave one of the two out")
        begin = _exact(getattr(hit.at, unit))
        if not 0 <= begin < total:
            message = (
                f"{quote(hit.what)} lies outside the round that is repeated; a rhythm repeats "
            )
            raise TextError(f"{message}a round that has all of its entries")
        lasting = None if hit.lasting is None else _exact(getattr(hit.lasting, unit))
        struck = dict.fromkeys(_word(name, hit.level) for name in hit.what.split())
        groups.setdefault((begin, lasting), {}).update(struck)
    begins = sorted({begin for begin, _ in groups})
    following = dict(zip(begins, [*begins[1:], total], strict=True))
    for (begin, lasting), words in sorted(groups.items(), key=lambda group: group[0][0]):
        end = following[begin] if lasting is None else min(begin + lasting, total)
        if end > begin:
            yield _Notes(begin, end, tuple(words))


def _word(name: str, level: Level) -> str:
    word = f"{tuning.spelled(name)}:{_level(level)}"
    if not WORD.fullmatch(word):
        raise TextError(
            f"{quote(word)} is no word of a rhythm; write one level, such as mf or 2mNs"
        )
    return word


def _level(level: Level) -> str:
    """A level as short as it can be written."""
    if level.is_strength and level.factor == 1.0 and level.low == level.high:
        for number, word in enumerate(DYNAMICS):
            if level.low == number / (len(DYNAMICS) - 1):
                return word
        number = round(127 * level.low)
        if number and velocity(number) == level:
            return f"v{number}"
    return level.written


def _text(notes: Sequence[_Notes], total: Fraction) -> str:
    """Steps in as many lines as notes sound at the same time."""
    lines: list[list[_Notes]] = []
    for group in notes:
        line = next((line for line in lines if line[-1].end <= group.begin), None)
        if line is None:
            lines.append([group])
        else:
            line.append(group)
    return ", ".join(_line(line, total) for line in lines)


def _line(notes: Sequence[_Notes], total: Fraction) -> str:
    steps: list[tuple[str, Fraction]] = []
    last_end = Fraction(0)
    for begin, end, words in notes:
        if begin > last_end:
            steps.append(("~", begin - last_end))
        steps.append((f"[{','.join(words)}]" if len(words) > 1 else words[0], end - begin))
        last_end = end
    if last_end < total:
        steps.append(("~", total - last_end))
    parts = lcm(*(width.denominator for _, width in steps))
    weights = [int(width * parts) for _, width in steps]
    weights = [weight // gcd(*weights) for weight in weights]
    if max(weights) > MAX_NUMBER * _FINE:
        raise TextError("the entries lie too unevenly for a rhythm; use quantise")
    scale = 1 if max(weights) <= MAX_NUMBER else _FINE
    return " ".join(
        word if weight == scale else f"{word}@{weight / scale:.12g}"
        for (word, _), weight in zip(steps, weights, strict=True)
    )
