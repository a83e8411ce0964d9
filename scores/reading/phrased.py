"""A phrase as a rhythm text: one round is one cycle, each entry a step that ends at the next."""

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

_CYCLE_PARTS_MAX = 10_000  # finest grid of entries in a beat or a second
_WEIGHT_SCALE = 1_000  # large weights are written with so many parts
_ROUNDING = 1e-9


class _Notes(NamedTuple):
    """What is struck together from one instant to another, in parts of a cycle."""

    begin: Fraction
    end: Fraction
    note_words: tuple[str, ...]


def rhythm_of_phrase(strikes: Strikes) -> Rhythm:
    """A phrase that strikes play, as a rhythm whose words strike nothing yet.

    Raises TextError if it has entries that a rhythm has not.
    """
    assert strikes.length is not None
    cycle = strikes.every or strikes.length
    unit = _length_unit(cycle, strikes.hits)
    total = _exact_fraction(getattr(cycle, unit))
    return Rhythm(
        _rhythm_text(list(_notes_of_round(strikes.hits, unit, total)), total), "", cycle, {}
    )


def _length_unit(cycle: Length, hits: Sequence[Hit]) -> str:
    """The field of `Length` in which everything is written."""
    lengths = [cycle, *(length for hit in hits for length in (hit.at, hit.duration))]
    used_units = {
        f.name for length in lengths for f in fields(Length) if getattr(length, f.name, 0.0)
    }
    if len(used_units) != 1:
        message = "a rhythm needs entries and a length of the phrase in one unit: all in beats, in "
        raise TextError(f"{message}bars or in seconds")
    return used_units.pop()


def _exact_fraction(value: float) -> Fraction:
    exact = Fraction(value).limit_denominator(_CYCLE_PARTS_MAX)
    if abs(float(exact) - value) > _ROUNDING * max(1.0, abs(value)):
        raise TextError(f"{value!r} is no simple fraction, as steps of a rhythm are; use quantise")
    return exact


def _notes_of_round(
    hits: Sequence[Hit], length_unit: str, round_length: Fraction
) -> Iterator[_Notes]:
    """The notes of a round in order; those without an end last until the next ones."""
    notes_by_span: dict[tuple[Fraction, Fraction | None], dict[str, None]] = {}
    for phrase_hit in hits:
        if phrase_hit.jitter != Length():
            raise TextError("a rhythm has exact instants and no jitter; leave one of the two out")
        note_begin = _exact_fraction(getattr(phrase_hit.at, length_unit))
        if not 0 <= note_begin < round_length:
            message = (
                f"{quote(phrase_hit.struck_text)} lies outside the round that is repeated; a "
                "rhythm repeats "
            )
            raise TextError(f"{message}a round that has all of its entries")
        note_length = (
            None
            if phrase_hit.duration is None
            else _exact_fraction(getattr(phrase_hit.duration, length_unit))
        )
        struck_words = dict.fromkeys(
            _word_text(name, phrase_hit.level) for name in phrase_hit.struck_text.split()
        )
        notes_by_span.setdefault((note_begin, note_length), {}).update(struck_words)
    note_begins = sorted({begin for begin, _ in notes_by_span})
    next_begin = dict(zip(note_begins, [*note_begins[1:], round_length], strict=True))
    for (note_begin, note_length), note_words in sorted(
        notes_by_span.items(), key=lambda group: group[0][0]
    ):
        end = (
            next_begin[note_begin]
            if note_length is None
            else min(note_begin + note_length, round_length)
        )
        if end > note_begin:
            yield _Notes(note_begin, end, tuple(note_words))


def _word_text(name: str, level: Level) -> str:
    level_word = f"{tuning.spelled(name)}:{_level_text(level)}"
    if not WORD.fullmatch(level_word):
        raise TextError(
            f"{quote(level_word)} is no word of a rhythm; write one level, such as mf or 2mNs"
        )
    return level_word


def _level_text(written_level: Level) -> str:
    """A level as short as it can be written."""
    if (
        written_level.is_strength
        and written_level.factor == 1.0
        and written_level.low == written_level.high
    ):
        for mark_index, word in enumerate(DYNAMICS):
            if written_level.low == mark_index / (len(DYNAMICS) - 1):
                return word
        midi_velocity = round(127 * written_level.low)
        if midi_velocity and velocity(midi_velocity) == written_level:
            return f"v{midi_velocity}"
    return written_level.written


def _rhythm_text(round_notes: Sequence[_Notes], round_length: Fraction) -> str:
    """Steps in as many lines as notes sound at the same time."""
    note_lines: list[list[_Notes]] = []
    for notes in round_notes:
        free_line = next(
            (note_line for note_line in note_lines if note_line[-1].end <= notes.begin), None
        )
        if free_line is None:
            note_lines.append([notes])
        else:
            free_line.append(notes)
    return ", ".join(_line_text(note_line, round_length) for note_line in note_lines)


def _line_text(round_notes: Sequence[_Notes], round_length: Fraction) -> str:
    weighted_steps: list[tuple[str, Fraction]] = []
    last_end = Fraction(0)
    for notes_begin, notes_end, notes_words in round_notes:
        if notes_begin > last_end:
            weighted_steps.append(("~", notes_begin - last_end))
        weighted_steps.append(
            (
                f"[{','.join(notes_words)}]" if len(notes_words) > 1 else notes_words[0],
                notes_end - notes_begin,
            )
        )
        last_end = notes_end
    if last_end < round_length:
        weighted_steps.append(("~", round_length - last_end))
    denominator = lcm(*(width.denominator for _, width in weighted_steps))
    step_weights = [int(width * denominator) for _, width in weighted_steps]
    step_weights = [weight // gcd(*step_weights) for weight in step_weights]
    if max(step_weights) > MAX_NUMBER * _WEIGHT_SCALE:
        raise TextError("the entries lie too unevenly for a rhythm; use quantise")
    scale = 1 if max(step_weights) <= MAX_NUMBER else _WEIGHT_SCALE
    return " ".join(
        word if weight == scale else f"{word}@{weight / scale:.12g}"
        for (word, _), weight in zip(weighted_steps, step_weights, strict=True)
    )
