"""The transformations of patterns in cycles by name: what each takes, and what it does."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from fractions import Fraction

from ergon.scores.pattern import cycle_arguments as read
from ergon.scores.pattern import cycle_operations as act
from ergon.scores.pattern.cycle_forms import CycleTransform, Form, Pattern
from ergon.scores.pattern.cycles import early, fast, late, mapped, slow
from ergon.scores.pattern.phrasing_table import PHRASING
from ergon.scores.pattern.rhythm import Euclid
from ergon.scores.pattern.struck import Struck

_DEFAULT_SWING_SHARE = Fraction(1, 3)  # default delay of `swing`, in slices: that of a triplet


# --- what each does -----------------------------------------------------------------------------


def _swing(t: CycleTransform, pattern: Pattern) -> Pattern:
    *amount, slices = t.values
    return act.swing(amount[0] if amount else _DEFAULT_SWING_SHARE, slices, pattern)


def _check_euclid(pulses: int, steps: int, _: int = 0) -> str | None:
    if pulses > steps:
        return f"a rhythm of {steps} steps has 1 to {steps} pulses; write for instance euclid 3 8"
    return None


def _euclid(t: CycleTransform, pattern: Pattern) -> Pattern:
    pulses, steps, *turns = t.values
    return act.euclid(Euclid(pulses, steps, sum(turns) % steps), pattern)


def _echo(t: CycleTransform, pattern: Pattern) -> Pattern:
    echo_count, time, factor = t.values

    def fade(struck: Struck, turn: int) -> Struck:
        return replace(struck, factor=struck.factor * factor**turn)

    return act.echo(echo_count, time, fade, pattern)


def _transpose(t: CycleTransform, pattern: Pattern) -> Pattern:
    interval = t.value
    return mapped(lambda struck: replace(struck, semitones=struck.semitones + interval), pattern)


def _scale(t: CycleTransform, pattern: Pattern) -> Pattern:
    factor = t.value
    return mapped(lambda struck: replace(struck, factor=struck.factor * factor), pattern)


def _sometimes(amount: float | None) -> Callable[[CycleTransform, Pattern], Pattern]:
    """A change of events with a probability; None: that of the argument."""

    def change(t: CycleTransform, pattern: Pattern) -> Pattern:
        probability = t.value if amount is None else amount
        return act.sometimes(t.number, probability, t.change, pattern)

    return change


_COUNT_ARGUMENTS = ((read.COUNT,),)
_SPEED_ARGUMENTS = ((read.SPEED,),)
_TIME_ARGUMENTS = ((read.TIME,),)
_PROBABILITY_ARGUMENTS = ((), (read.PROBABILITY,))

FORM_BY_WORD: Mapping[str, Form] = {
    "rev": Form("each cycle backwards", "rev", lambda t, p: act.rev(p)),
    "palindrome": Form(
        "every second cycle backwards", "palindrome", lambda t, p: act.palindrome(p)
    ),
    "fast": Form(
        "so many times as fast", "fast 2", lambda t, p: fast(t.value, p), _SPEED_ARGUMENTS
    ),
    "slow": Form(
        "so many times as slow", "slow 2", lambda t, p: slow(t.value, p), _SPEED_ARGUMENTS
    ),
    "early": Form(
        "earlier by a share of a cycle",
        "early 1/8",
        lambda t, p: early(t.value, p),
        _TIME_ARGUMENTS,
    ),
    "late": Form(
        "later by a share of a cycle", "late 1/8", lambda t, p: late(t.value, p), _TIME_ARGUMENTS
    ),
    "swing": Form(
        "the second half of each of so many slices of a cycle later, by a third of a slice "
        "or the share before the number",
        "swing 4",
        _swing,
        ((read.COUNT,), (read.SHARE, read.COUNT)),
    ),
    "ply": Form(
        "each stroke so many times within its time",
        "ply 2",
        lambda t, p: act.ply(t.value, p),
        _COUNT_ARGUMENTS,
    ),
    "iter": Form(
        "each cycle begins one of so many shares later in the rhythm than the one before",
        "iter 4",
        lambda t, p: act.iterate(t.value, p),
        _COUNT_ARGUMENTS,
    ),
    "chunk": Form(
        "a change of one of so many shares of a cycle: the first, then the second, and so on",
        "chunk 4 ply 2",
        lambda t, p: act.chunk(t.value, t.change, p),
        _COUNT_ARGUMENTS,
        True,
    ),
    "every": Form(
        "a change of the first of every so many cycles",
        "every 4 rev",
        lambda t, p: act.every(t.value, t.change, p),
        _COUNT_ARGUMENTS,
        True,
    ),
    "whenmod": Form(
        "a change of those of every so many cycles that have at least a number, from 0",
        "whenmod 4 3 fast 2",
        lambda t, p: act.whenmod(t.values[0], t.values[1], t.change, p),
        ((read.COUNT, read.COUNT_FROM_ZERO),),
        True,
    ),
    "sometimes": Form(
        "a change of half of the strokes, or of the share before it, by chance",
        "sometimes 0.3 transpose 12st",
        _sometimes(None),
        _PROBABILITY_ARGUMENTS,
        True,
    ),
    "often": Form(
        "a change of three quarters of the strokes, by chance",
        "often scale 0.5",
        _sometimes(0.75),
        takes_change=True,
    ),
    "rarely": Form(
        "a change of a quarter of the strokes, by chance",
        "rarely ply 2",
        _sometimes(0.25),
        takes_change=True,
    ),
    "degrade": Form(
        "without half of the strokes, or the share after it, by chance",
        "degrade 0.4",
        lambda t, p: act.degrade(t.number, t.value, p),
        _PROBABILITY_ARGUMENTS,
    ),
    "off": Form(
        "together with a changed copy, later by a share of a cycle",
        "off 1/8 transpose 12st",
        lambda t, p: act.superimpose_late(t.value, t.change, p),
        _TIME_ARGUMENTS,
        True,
    ),
    "superimpose": Form(
        "together with a changed copy",
        "superimpose fast 2",
        lambda t, p: act.superimpose(t.change, p),
        takes_change=True,
    ),
    "mask": Form(
        "only what begins during the beats of a rhythm",
        "mask t ~ t t",
        lambda t, p: act.mask(t.value, p),
        takes_rhythm=True,
    ),
    "struct": Form(
        "the beats of a rhythm, with the words that are played at that time",
        "struct t(3,8)",
        lambda t, p: act.struct(t.value, p),
        takes_rhythm=True,
    ),
    "euclid": Form(
        "all of a cycle within each pulse of a Euclidean rhythm",
        "euclid 3 8",
        _euclid,
        ((read.STEPS, read.STEPS), (read.STEPS, read.STEPS, read.COUNT_FROM_ZERO)),
        check=_check_euclid,
    ),
    "echo": Form(
        "so many times in all, each later by a share of a cycle and stronger by a factor",
        "echo 3 1/8 0.7",
        _echo,
        ((read.COPIES, read.TIME, read.FACTOR),),
    ),
    "transpose": Form(
        "higher by semitones, cents or a ratio", "transpose -5st", _transpose, ((read.SEMITONES,),)
    ),
    "scale": Form("stronger by a factor", "scale 0.5", _scale, ((read.FACTOR,),)),
    **PHRASING,
}
MEANINGS = {
    word: f"{form.description}, such as {form.example}" for word, form in FORM_BY_WORD.items()
}
