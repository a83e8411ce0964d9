"""Rhythms over the steps of a pattern: which steps are played, and how even they are."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import lru_cache

from ergon.notation.tables import quantities
from ergon.notation.text.errors import TextError
from ergon.notation.text.numbers import stripped

MAX_STEPS = 256  # steps of a Euclidean rhythm
EVEN_SWING = 0.5  # the share of the first of two steps that are not swung
_EUCLID = re.compile(r"([0-9]{1,4})\s+([0-9]{1,4})(?:\s+rotate\s+([0-9]{1,4}))?")
_SWING_MIN, _SWING_MAX = 0.25, 0.9


@dataclass(frozen=True, slots=True)
class Euclid:
    """`pulses` spread over `steps` as evenly as possible, begun `rotate` steps later."""

    pulses: int
    steps: int
    rotate: int = 0

    def positions(self) -> tuple[int, ...]:
        """The steps that are pulses, rising, from 0."""
        return _bjorklund_positions(self)


def parse_euclid(text: str) -> Euclid:
    """Read `3 8` or `3 8 rotate 2`. Raises TextError."""
    trimmed_word, text_start = stripped(text)
    match = _EUCLID.fullmatch(trimmed_word)
    if match is None:
        message = f"'{trimmed_word[:40]}' is not a Euclidean rhythm such as 3 8 or 3 8 rotate 2"
        raise TextError(message, offset=text_start, length=max(1, len(trimmed_word)))
    pulses, n_steps, rotate = int(match[1]), int(match[2]), int(match[3] or 0)
    if not 1 <= n_steps <= MAX_STEPS:
        message = f"a Euclidean rhythm has 1 to {MAX_STEPS} steps"
        raise TextError(message, offset=text_start + match.start(2), length=len(match[2]))
    if not 1 <= pulses <= n_steps:
        message = f"a rhythm of {n_steps} steps has 1 to {n_steps} pulses"
        raise TextError(message, offset=text_start, length=len(match[1]))
    return Euclid(pulses, n_steps, rotate % n_steps)


def parse_swing(swing_text: str) -> float:
    """Read the share of two steps that the first one takes: `0.6`, `2/3`, `60%`.

    Raises TextError.
    """
    ratio = quantities.quantity(swing_text, quantities.CHANCE)
    if not _SWING_MIN <= ratio <= _SWING_MAX:
        message = (
            f"'{swing_text.strip()}' is not a swing: the first of two steps takes "
            f"from {_SWING_MIN:g} to {_SWING_MAX:g}"
            " of both, 0.5 is even, 2/3 is a triplet"
        )
        raise TextError(message, length=max(1, len(swing_text)), code="E202")
    return ratio


def swung_position(step_index: int, step_fraction: float, swing_ratio: float) -> float:
    """Where a point of a step is, if the first of every two steps takes the share `swing_ratio` of
    both.
    """
    if swing_ratio == EVEN_SWING:
        return step_index + step_fraction
    pair_start = step_index - step_index % 2
    if step_index % 2:
        return pair_start + 2.0 * swing_ratio + step_fraction * (2.0 - 2.0 * swing_ratio)
    return pair_start + step_fraction * 2.0 * swing_ratio


@lru_cache(maxsize=64)
def _bjorklund_positions(rhythm: Euclid) -> tuple[int, ...]:
    """Bjorklund's algorithm: append the left-over groups to the others, one each, until at most one
    is left over.
    """
    pulses, n_steps = rhythm.pulses, rhythm.steps
    head_groups: list[list[bool]] = [[True] for _ in range(pulses)]
    tail_groups: list[list[bool]] = [[False] for _ in range(n_steps - pulses)]
    is_first = True
    while len(tail_groups) > 1 or (tail_groups and is_first):
        is_first = False
        n_pairs = min(len(head_groups), len(tail_groups))
        unpaired = head_groups[n_pairs:] or tail_groups[n_pairs:]
        head_groups, tail_groups = (
            [head_groups[i] + tail_groups[i] for i in range(n_pairs)],
            unpaired,
        )
    beats = [beat for group in (*head_groups, *tail_groups) for beat in group]
    indices = (index for index, beat in enumerate(beats) if beat)
    return tuple(sorted((index - rhythm.rotate) % n_steps for index in indices))
