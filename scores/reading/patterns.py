"""The fields of a pattern: those that parts, strikes and automation have in common."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ergon.notation.clock.occurrences import MAX_OCCURRENCES
from ergon.notation.tables import value_kinds as k
from ergon.notation.tables.fields import Field
from ergon.notation.tables.shapes import Text
from ergon.scores.pattern.order import Group
from ergon.scores.pattern.pattern import Pattern
from ergon.scores.pattern.rhythm import parse_euclid, parse_swing

_EUCLID = Text(
    parse_euclid,
    "pulses and steps, such as 3 8 or 3 8 rotate 2",
    "^[0-9]+ +[0-9]+( +rotate +[0-9]+)?$",
    has_values=True,
)
_SWING = Text(parse_swing, "a share of two steps, such as 0.6, 2/3 or 60%", is_value=True)
_SKIP = k.integer(0, MAX_OCCURRENCES, "5")
# Rhythm and chance of the places of a pattern; gestures and strikes have the same fields.
PATTERN_TABLE = (
    Field("chance", k.CHANCE, "chance of each place of the pattern", shown="1"),
    Field("euclid", _EUCLID, "a Euclidean rhythm: pulses and steps", shown="every step"),
    Field("swing", _SWING, "share that the first of two steps takes of both", shown="0.5"),
    Field("skip", _SKIP, "places that are left out at the beginning", shown="0"),
)
PATTERN_FIELDS = tuple(field.name for field in PATTERN_TABLE)


def pattern_of(fields: Mapping[str, Any], order: Group) -> Pattern:
    """An order with the rhythm and the chance that were written beside it."""
    pattern_fields = {name: fields[name] for name in PATTERN_FIELDS if name in fields}
    return Pattern(order, turns=fields.get("nth", ()), **pattern_fields)
