"""Words of phrasing: length, repeated strokes, grace notes, chords that are spread."""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction

from ergon.scores.pattern import cycle_arguments as read
from ergon.scores.pattern import phrasing as act
from ergon.scores.pattern.cycle_forms import CycleTransform, Form, Pattern
from ergon.scores.pattern.struck import Repeats

_GRACE_IMPULSE_RATIO = 0.5  # the impulse of a grace note, as a factor of that of its stroke
# The factors of the first and the last stroke of a roll.
_DEFAULT_SWELL_FACTORS = (Fraction(1, 4), Fraction(1))
_DEFAULT_ROLL_SHARE = Fraction(1, 4)  # default share of a chord's length for `rolled`


def _tremolo(t: CycleTransform, part: Pattern) -> Pattern:
    if isinstance(t.value, Repeats):
        return act.repeated(t.value, part)
    return act.tremolo(t.value, part)


def _roll(t: CycleTransform, changed_pattern: Pattern) -> Pattern:
    strokes, *factors = t.values
    first_level, last_level = [
        float(factor) for factor in [*factors, *_DEFAULT_SWELL_FACTORS[len(factors) :]]
    ]
    if isinstance(strokes, Repeats):
        return act.repeated(
            strokes._replace(first_factor=first_level, last_factor=last_level), changed_pattern
        )
    return act.tremolo(strokes, changed_pattern, first_level, last_level)


def _grace(t: CycleTransform, changed_pattern: Pattern) -> Pattern:
    time, *other_values = t.values
    semitones = other_values[0] if other_values else 0
    factor = other_values[1] if len(other_values) > 1 else _GRACE_IMPULSE_RATIO
    return act.grace(time, semitones, factor, changed_pattern)


def _arp(t: CycleTransform, part: Pattern) -> Pattern:
    order, *step = t.values
    return act.arp(order, step[0] if step else None, part)


PHRASING: Mapping[str, Form] = {
    "legato": Form(
        "each stroke lasts so much of the time until the next one of its line",
        "legato 0.3",
        lambda t, p: act.legato(t.value, p),
        ((read.LENGTH,),),
    ),
    "tremolo": Form(
        "each stroke so many times within its time, or at a rate, all as strong",
        "tremolo 12Hz",
        _tremolo,
        ((read.REPEATS,),),
    ),
    "roll": Form(
        "as tremolo, from a quarter of the impulse to all of it, or between two factors",
        "roll 8",
        _roll,
        ((read.REPEATS,), (read.REPEATS, read.SWELL), (read.REPEATS, read.SWELL, read.SWELL)),
    ),
    "grace": Form(
        "before each stroke a short and softer one, by an interval higher",
        "grace 1/32 -1st",
        _grace,
        (
            (read.CYCLE_STEP,),
            (read.CYCLE_STEP, read.SEMITONES),
            (read.CYCLE_STEP, read.SEMITONES, read.FACTOR),
        ),
    ),
    "arp": Form(
        "the notes of each chord one after another, in an order; a second value is their step",
        "arp up",
        _arp,
        ((read.ORDER,), (read.ORDER, read.CYCLE_STEP)),
    ),
    "rolled": Form(
        "the notes of each chord begin one after another in a quarter of its time, or a share",
        "rolled 1/8",
        lambda t, p: act.rolled(t.values[0] if t.values else _DEFAULT_ROLL_SHARE, p),
        ((), (read.SIGNED_SHARE,)),
    ),
    "strum": Form(
        "the notes of each chord a short time after one another, from the lowest; -20ms from "
        "the highest",
        "strum 20ms",
        lambda t, p: act.strum(t.value, p),
        ((read.SECONDS,),),
    ),
}
