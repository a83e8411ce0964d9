"""The fields of a pattern: those that parts, strikes and automation have in common."""

from __future__ import annotations

from typing import TypedDict

from ergon.notation.clock.occurrences import MAX_OCCURRENCES
from ergon.notation.tables import value_kinds
from ergon.notation.tables.fields import Field
from ergon.notation.tables.shapes import Text
from ergon.scores.pattern.order import Group
from ergon.scores.pattern.pattern import Pattern
from ergon.scores.pattern.rhythm import EVEN_SWING, Euclid, parse_euclid, parse_swing
from ergon.scores.pattern.turns import Turn

_EUCLID_SHAPE = Text(
    parse_euclid,
    "pulses and steps, such as 3 8 or 3 8 rotate 2",
    "^[0-9]+ +[0-9]+( +rotate +[0-9]+)?$",
    has_values=True,
)
_SWING_SHAPE = Text(parse_swing, "a share of two steps, such as 0.6, 2/3 or 60%", is_value=True)
_SKIP_SHAPE = value_kinds.integer(0, MAX_OCCURRENCES, "5")
# Rhythm and chance of the places of a pattern; gestures and strikes have the same fields.
PATTERN_TABLE = (
    Field("chance", value_kinds.CHANCE, "chance of each place of the pattern", shown="1"),
    Field("euclid", _EUCLID_SHAPE, "a Euclidean rhythm: pulses and steps", shown="every step"),
    Field("swing", _SWING_SHAPE, "share that the first of two steps takes of both", shown="0.5"),
    Field("skip", _SKIP_SHAPE, "places that are left out at the beginning", shown="0"),
)
PATTERN_FIELDS = tuple(field.name for field in PATTERN_TABLE)


class PatternValues(TypedDict, total=False):
    """What is written of PATTERN_TABLE, and the changes of some rounds."""

    chance: float
    euclid: Euclid
    swing: float
    skip: int
    nth: tuple[Turn, ...]


def pattern_of(pattern_values: PatternValues, pattern_order: Group) -> Pattern:
    """An order with the rhythm and the chance that were written beside it."""
    return Pattern(
        pattern_order,
        euclid=pattern_values.get("euclid"),
        swing=pattern_values.get("swing", EVEN_SWING),
        chance=pattern_values.get("chance"),
        turns=pattern_values.get("nth", ()),
        skip=pattern_values.get("skip", 0),
    )
