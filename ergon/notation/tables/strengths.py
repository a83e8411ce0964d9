"""How strongly something is struck: an impulse, or a strength within the range of an instrument.

A strength is a number from 0 (as soft as the instrument is played) to 1 (as hard). `ppp` to `fff`
are eight even steps of it, `v64` is a MIDI velocity, and decibels count from `f`.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

from ergon import _core
from ergon.notation.tables import quantities as q
from ergon.notation.tables.shapes import Text
from ergon.notation.text.errors import TextError, quote
from ergon.notation.text.spelling import nearest

DYNAMICS = ("ppp", "pp", "p", "mp", "mf", "f", "ff", "fff")
_ITALIAN = {
    "pianissimo": "pp",
    "piano": "p",
    "soft": "p",
    "mezzopiano": "mp",
    "mezzoforte": "mf",
    "forte": "f",
    "loud": "f",
    "fortissimo": "ff",
}
_N_STEPS = len(DYNAMICS) - 1  # steps from one dynamic word to the next, from 0 to 1
_FORTE = DYNAMICS.index("f") / _N_STEPS  # the strength at 0 dB
_VELOCITY = re.compile(r"v([0-9]{1,3})")
_PLAIN_NUMBER = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+|/[0-9]+)?")
_ACCENT = "!"
MAX_STEPS = 1_000  # levels of one pattern
MAX_TEXT = 16_000  # characters of one pattern


class ImpulseRange(NamedTuple):
    """The impulses [N·s] that are the strengths 0 and 1 of an instrument.

    If it `turns`, as a bow does, each second stroke goes backwards.
    """

    soft: float
    hard: float
    turns: bool = False

    def impulse(self, strength: float) -> float:
        """The impulse [N·s] of a strength s: soft·(hard/soft)^s."""
        return self.soft * _core.pow(self.hard / self.soft, strength)

    def strength(self, impulse: float) -> float:
        """The strength, from 0 to 1, whose impulse [N·s] is nearest to the size of one."""
        size = min(self.hard, max(self.soft, abs(impulse)))
        share = _core.ln(size / self.soft) / _core.ln(self.hard / self.soft)
        return min(1.0, max(0.0, share))


@dataclass(frozen=True, slots=True)
class Level:
    """Impulses [N·s] between two values; or strengths between two values, whose impulses are
    multiplied by a factor.
    """

    low: float
    high: float
    is_strength: bool = False
    factor: float = 1.0

    def scaled(self, factor: float) -> Level:
        """The level times a factor."""
        if self.is_strength:
            return replace(self, factor=self.factor * factor)
        return replace(self, low=self.low * factor, high=self.high * factor)

    def impulse(
        self, impulse_range: ImpulseRange | None, draw: Callable[[float, float], float]
    ) -> float:
        """An impulse [N·s]; `draw` is a uniform draw between two values that differ.

        A strength s is soft·(hard/soft)^s of its reach.
        """
        drawn_level = self.low if self.low == self.high else draw(self.low, self.high)
        if not self.is_strength:
            return drawn_level
        assert impulse_range is not None
        return impulse_range.impulse(drawn_level) * self.factor

    @property
    def written(self) -> str:
        """The level as a text that is read as the same level."""
        if not self.is_strength:
            low, high = (f"{end!r}Ns" for end in (self.low, self.high))
            return low if low == high else f"{low}..{high}"
        level_text = f"{self.low!r}" if self.low == self.high else f"{self.low!r}..{self.high!r}"
        return level_text if self.factor == 1.0 else f"{level_text}x{self.factor!r}"


@dataclass(frozen=True, slots=True)
class Levels:
    """A pattern of levels, one for each strike in turn; or a line from one strength to another."""

    steps: tuple[Level, ...]
    is_line: bool = False  # the two steps are its ends

    @property
    def has_strengths(self) -> bool:
        """Whether any level is a strength, which only an instrument with `play` has."""
        return any(step.is_strength for step in self.steps)

    def scaled(self, factor: float) -> Levels:
        """All levels times a factor."""
        return replace(self, steps=tuple(step.scaled(factor) for step in self.steps))

    def step(self, number: int, count: int) -> Level:
        """The level of strike `number` (from 0) of `count` strikes."""
        if not self.is_line:
            return self.steps[number % len(self.steps)]
        first_level, last_level = self.steps
        progress = min(1.0, number / (count - 1)) if count > 1 else 0.0
        level_value = first_level.low + (last_level.low - first_level.low) * progress
        return Level(level_value, level_value, first_level.is_strength)


MEZZO_FORTE = Level(*(DYNAMICS.index("mf") / _N_STEPS,) * 2, is_strength=True)


def velocity(midi_velocity: int) -> Level:
    """The strength of a MIDI velocity from 1 to 127."""
    strength = midi_velocity / 127.0
    return Level(strength, strength, is_strength=True)


def is_level(level_word: str) -> bool:
    """Whether a word begins like a level, and is no name: `mf`, `f!`, `v64`, `0.5`, `2mNs`, or is
    the arrow between two.
    """
    if level_word[:1] in "+-.0123456789":
        return True
    first_word = level_word.partition("..")[0].rstrip(_ACCENT)
    return first_word in DYNAMICS or _VELOCITY.fullmatch(first_word) is not None


def level(level_text: str) -> Level:
    """A level: `2mNs`, `1mNs..4mNs`, `mf`, `p..f`, `f!`, `0.6`, `v64`, `-6dB`. Raises TextError."""
    level_word = level_text.strip()
    if ".." not in level_word:
        return _parse_end(level_word)
    level_words = level_word.split("..")
    if len(level_words) != 2 or not all(level_words):
        message = "a range has two ends: 1mNs..4mNs, or p..f"
        raise TextError(message, length=max(1, len(level_text)), code="E204")
    low_level = _parse_end(level_words[0].strip())
    try:
        high_level = _parse_end(level_words[1].strip())
    except TextError as error:
        error.offset += level_text.index("..") + 2
        raise
    if low_level.is_strength != high_level.is_strength:
        message = "one end is an impulse and one a strength: write 1mNs..4mNs, or p..f"
        raise TextError(message, length=len(level_text), code="E204")
    if "dB" in level_word:
        message = "decibels have no range: write two strengths, such as p..f"
        raise TextError(message, length=len(level_text), code="E204")
    if low_level.low > high_level.low:
        reversed_range = f"{level_words[1].strip()}..{level_words[0].strip()}"
        message = f"{quote(level_word)} goes from the stronger to the weaker"
        raise TextError(message, length=len(level_text), suggestion=reversed_range, code="E202")
    return Level(low_level.low, high_level.low, low_level.is_strength, high_level.factor)


def _parse_end(end_word: str) -> Level:
    strength = _strength(end_word)
    if strength is not None:
        return Level(strength, strength, is_strength=True)
    if "x" in end_word:  # `written` writes a strength with a factor so
        strength_text, _, factor_text = end_word.partition("x")
        strength = _strength(strength_text)
        if strength is not None:
            factor = q.quantity(factor_text, q.RATIO)
            return Level(strength, strength, is_strength=True, factor=factor)
    if end_word.endswith("dB"):
        return Level(_FORTE, _FORTE, is_strength=True, factor=q.gain(end_word))
    if end_word[:1].isalpha():
        message = f"{quote(end_word)} is neither an impulse such as 2mNs nor a strength such as mf"
        suggestion = _ITALIAN.get(end_word.lower()) or nearest(end_word, DYNAMICS)
        raise TextError(message, length=max(1, len(end_word)), suggestion=suggestion, code="E201")
    if _PLAIN_NUMBER.fullmatch(end_word) and float(end_word.partition("/")[0]) != 0.0:
        message = (
            f"{quote(end_word)} has no unit: write {end_word}mNs or {end_word}Ns; a strength is a "
            "number "
        )
        message += "from 0 to 1, or a word from ppp to fff"
        raise TextError(message, length=len(end_word), suggestion=f"{end_word}mNs", code="E203")
    impulse = q.quantity(end_word, q.IMPULSE)
    return Level(impulse, impulse)


def _strength(strength_word: str) -> float | None:
    """A strength from 0 to 1; None if the word is something else."""
    accent_steps = 1 if strength_word.endswith(_ACCENT) else 0  # steps
    strength_word = strength_word.removesuffix(_ACCENT)
    if strength_word in DYNAMICS:
        return min(_N_STEPS, DYNAMICS.index(strength_word) + accent_steps) / _N_STEPS
    match = _VELOCITY.fullmatch(strength_word)
    if match is not None:
        velocity_number = int(match[1])
        if not 1 <= velocity_number <= 127:
            message = f"a MIDI velocity lies from v1 to v127, not {strength_word}"
            raise TextError(message, length=len(strength_word), code="E202")
        return min(1.0, velocity_number / 127.0 + accent_steps / _N_STEPS)
    if _PLAIN_NUMBER.fullmatch(strength_word):
        strength = q.quantity(strength_word, q.NUMBER)
        if 0.0 <= strength <= 1.0:
            return min(1.0, strength + accent_steps / _N_STEPS)
    return None


def levels(levels_text: str) -> Levels:
    """A pattern of levels: `2mNs`, `f p mf p`, or a line such as `p -> f`. Raises TextError."""
    if len(levels_text) > MAX_TEXT:
        raise TextError(f"the text has more than {MAX_TEXT:,} characters", length=1, code="E202")
    words_with_offsets = [(match.group(), match.start()) for match in _TOKEN.finditer(levels_text)]
    if not words_with_offsets:
        message = "an impulse or a strength is expected, such as 2mNs or mf"
        raise TextError(message, length=max(1, len(levels_text)), code="E201")
    if len(words_with_offsets) > MAX_STEPS:
        message = f"a pattern has at most {MAX_STEPS:,} levels"
        raise TextError(message, offset=words_with_offsets[MAX_STEPS][1], code="E105")
    arrow_offsets = [offset for word, offset in words_with_offsets if word == "->"]
    levels_of_words = []
    for level_word, word_offset in words_with_offsets:
        if level_word == "->":
            continue
        try:
            levels_of_words.append(level(level_word))
        except TextError as error:
            error.offset += word_offset
            raise
    if not arrow_offsets:
        return Levels(tuple(levels_of_words))
    is_pair = (
        len(words_with_offsets) == 3
        and len(levels_of_words) == 2
        and words_with_offsets[1][0] == "->"
    )
    is_same_kind = is_pair and levels_of_words[0].is_strength == levels_of_words[1].is_strength
    has_plain_ends = all(step.low == step.high and step.factor == 1.0 for step in levels_of_words)
    if not (is_same_kind and has_plain_ends):
        message = "a line goes from one level to another of its kind, such as p -> f"
        raise TextError(message, offset=arrow_offsets[0], length=2, code="E204")
    return Levels(tuple(levels_of_words), is_line=True)


# A quantity may have a space before its unit: `2 mNs`.
_TOKEN = re.compile(r"->|[^\s]+(?:\s+(?:[munµμ]?Ns|dB)(?=\s|\.\.|$))?(?:\.\.\S+)?")

_DYNAMIC = r"(ppp|pp|p|mp|mf|f|ff|fff)!?|v[0-9]{1,3}"
_AMOUNT = rf"({_DYNAMIC}|[+-]?[0-9.]+([eE][+-]?[0-9]+)?(/[0-9]+)? *(Ns|mNs|uNs|µNs|μNs|dB)?!?)"
_SINGLE = rf"{_AMOUNT}(\.\.{_AMOUNT})?"
MEANINGS = {
    word: f"strength {number}/{_N_STEPS} of the instrument's range"
    for number, word in enumerate(DYNAMICS)
}
LEVELS = Text(
    lru_cache(4096)(levels),
    "an impulse or a strength, such as 2mNs, 1uNs..4uNs, mf, or a pattern of them: f p mf p",
    rf"^{_SINGLE}( +(-> +)?{_SINGLE})*$",
    is_value=True,
    meanings=MEANINGS,
)
LEVEL = Text(
    lru_cache(4096)(level),
    "an impulse or a strength, such as 2mNs, 1uNs..4uNs, mf or p..f",
    rf"^{_SINGLE}$",
    is_value=True,
    meanings=MEANINGS,
)
