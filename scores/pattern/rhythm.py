"""Rhythms over the steps of a pattern: which steps are played, and how even they are."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import lru_cache

from ergon.notation.tables import quantities as q
from ergon.notation.text.errors import TextError
from ergon.notation.text.numbers import stripped

MAX_STEPS = 256  # of a Euclidean rhythm
EVEN = 0.5  # the share of the first of two steps that are not swung
_EUCLID = re.compile(r"([0-9]{1,4})\s+([0-9]{1,4})(?:\s+rotate\s+([0-9]{1,4}))?")
_LOW, _HIGH = 0.25, 0.9


@dataclass(frozen=True, slots=True)
class Euclid:
    """`pulses` spread over `steps` as evenly as possible, begun `rotate` steps later."""

    pulses: int
    steps: int
    rotate: int = 0

    def positions(self) -> tuple[int, ...]:
        """The steps that are pulses, rising, from 0."""
        return _positions(self)


def parse_euclid(text: str) -> Euclid:
    """Read `3 8` or `3 8 rotate 2`. Raises TextError."""
    word, start = stripped(text)
    match = _EUCLID.fullmatch(word)
    if match is None:
        message = f"'{word[:40]}' is not a Euclidean rhythm such as 3 8 or 3 8 rotate 2"
        raise TextError(message, offset=start, length=max(1, len(word)))
    pulses, steps, rotate = int(match[1]), int(match[2]), int(match[3] or 0)
    if not 1 <= steps <= MAX_STEPS:
        message = f"a Euclidean rhythm has 1 to {MAX_STEPS} steps"
        raise TextError(message, offset=start + match.start(2), length=len(match[2]))
    if not 1 <= pulses <= steps:
        message = f"a rhythm of {steps} steps has 1 to {steps} pulses"
        raise TextError(message, offset=start, length=len(match[1]))
    return Euclid(pulses, steps, rotate % steps)


def parse_swing(text: str) -> float:
    """Read the share of two steps that the first one takes: `0.6`, `2/3`, `60%`.

    Raises TextError.
    """
    share = q.quantity(text, q.CHANCE)
    if not _LOW <= share <= _HIGH:
        message = (
            f"'{text.strip()}' is not a swing: the first of two steps takes "
            f"from {_LOW:g} to {_HIGH:g}"
            " of both, 0.5 is even, 2/3 is a triplet"
        )
        raise TextError(message, length=max(1, len(text)), code="E202")
    return share


def swung(step: int, share_into: float, share: float) -> float:
    """Where a point of a step is, if the first of every two steps takes the share `share` of
    both.
    """
    if share == EVEN:
        return step + share_into
    pair_start = step - step % 2
    if step % 2:
        return pair_start + 2.0 * share + share_into * (2.0 - 2.0 * share)
    return pair_start + share_into * 2.0 * share


@lru_cache(maxsize=64)
def _positions(rhythm: Euclid) -> tuple[int, ...]:
    """Bjorklund's algorithm: append the left-over groups to the others, one each, until at most one
    is left over.
    """
    pulses, steps = rhythm.pulses, rhythm.steps
    heads: list[list[bool]] = [[True] for _ in range(pulses)]
    tails: list[list[bool]] = [[False] for _ in range(steps - pulses)]
    is_first = True
    while len(tails) > 1 or (tails and is_first):
        is_first = False
        n_pairs = min(len(heads), len(tails))
        unpaired = heads[n_pairs:] or tails[n_pairs:]
        heads, tails = [heads[i] + tails[i] for i in range(n_pairs)], unpaired
    beats = [beat for group in (*heads, *tails) for beat in group]
    indices = (index for index, beat in enumerate(beats) if beat)
    return tuple(sorted((index - rhythm.rotate) % steps for index in indices))
