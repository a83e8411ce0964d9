"""Curves by which the velocity of a MIDI note becomes a share of what an instrument can do."""

from __future__ import annotations

import math
import re
from bisect import bisect_right
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache

from ergon.notation.tables.shapes import Text
from ergon.notation.tables.strengths import Level
from ergon.notation.text.errors import TextError, quote
from ergon.notation.text.spelling import nearest

HARDEST = 127
MAX_POINTS = 127
_POINT = re.compile(r"([01]?\.?[0-9]{1,8}|[01]\.)@([0-9]{1,3})")
_WORD = re.compile(r"\S+")
LAWS: Mapping[str, Callable[[Fraction], Fraction]] = {
    "even": lambda x: x,
    "square": lambda x: x * x,
    "root": lambda x: Fraction(math.sqrt(x)),
}


@dataclass(frozen=True, slots=True)
class Curve:
    """A law by name, or straight lines between points: shares at rising velocities."""

    law: str = "even"
    velocities: tuple[int, ...] = ()
    shares: tuple[Fraction, ...] = ()

    def share(self, velocity: int, softest: int = 0) -> Fraction:
        """The share from 0 to 1 of a velocity from 1 to 127; a law is 0 at the `softest`."""
        if not self.velocities:
            return LAWS[self.law](Fraction(velocity - softest, HARDEST - softest))
        point_index = bisect_right(self.velocities, velocity)
        if point_index in (0, len(self.velocities)):
            return self.shares[min(point_index, len(self.velocities) - 1)]
        velocity_below, velocity_above = self.velocities[point_index - 1 : point_index + 1]
        share_below, share_above = self.shares[point_index - 1 : point_index + 1]
        return share_below + (share_above - share_below) * Fraction(
            velocity - velocity_below, velocity_above - velocity_below
        )

    def level(self, velocity: int) -> Level:
        """The strength of a velocity."""
        strength = float(self.share(velocity))
        return Level(strength, strength, is_strength=True)


EVEN = Curve()


def parse_curve(curve_text: str) -> Curve:
    """Read `square`, or points such as `0.2@1 0.6@64 1@127`. Raises TextError."""
    words_with_offsets = [(match.group(), match.start()) for match in _WORD.finditer(curve_text)]
    if len(words_with_offsets) == 1 and words_with_offsets[0][0] in LAWS:
        return Curve(words_with_offsets[0][0])
    if not words_with_offsets or len(words_with_offsets) > MAX_POINTS:
        message = f"a curve is {', '.join(LAWS)}, or 1 to {MAX_POINTS} points: 0.2@1 1@127"
        raise TextError(message, length=max(1, len(curve_text)))
    velocities: list[int] = []
    point_shares: list[Fraction] = []
    for point_word, offset in words_with_offsets:
        point_match = _POINT.fullmatch(point_word)
        share = Fraction(point_match[1]) if point_match else None
        velocity = int(point_match[2]) if point_match else 0
        if share is None or share > 1 or not 1 <= velocity <= HARDEST:
            message = (
                f"{quote(point_word)} is neither {', '.join(LAWS)} nor a point: a strength from 0 "
            )
            message += "to 1 at a velocity from 1 to 127, such as 0.6@64"
            suggestion = nearest(point_word, LAWS)
            raise TextError(message, offset=offset, length=len(point_word), suggestion=suggestion)
        if velocities and velocity <= velocities[-1]:
            message = (
                f"the velocity of {quote(point_word)} is not above {velocities[-1]}, that of the "
            )
            raise TextError(message + "point before it", offset=offset, length=len(point_word))
        velocities.append(velocity)
        point_shares.append(share)
    return Curve("", tuple(velocities), tuple(point_shares))


VELOCITY_CURVE = Text(
    lru_cache(parse_curve),
    "even, square, root, or points: strengths at velocities, such as 0.2@1 0.6@64 1@127",
    r"^(even|square|root|[01]?\.?[0-9]+@[0-9]+( +[01]?\.?[0-9]+@[0-9]+)*)$",
    types=("string",),
    has_values=True,
)
