"""How a gesture is played: fields that gestures and the entries of parts have alike."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from ergon.notation.clock.occurrences import MAX_OCCURRENCES
from ergon.notation.tables import kinds as k
from ergon.notation.tables.fields import Field
from ergon.notation.tables.shapes import Either, ListOf, Text, choice
from ergon.scores.gesture.transforms import parse_chain, parse_do
from ergon.scores.pattern.order import Group
from ergon.scores.pattern.pattern import Pattern
from ergon.scores.pattern.rhythm import parse_euclid, parse_swing
from ergon.scores.reading.piece import UNSAID, Manner

DO = Either(
    scalar=Text(parse_chain, "transformations, such as scale 0.5, mirror", types=("string",)),
    sequence=ListOf(Text(parse_do, "a transformation, such as scale 0.5", types=("string",))),
)
# What holds where neither says a thing is DEFAULT_MANNER.
OF_GESTURE = (
    Field(
        "touch",
        choice("open", "tracked"),
        "how the key follows: by ergons on the free key, or exactly",
        shown="open",
    ),
    Field("ergons", choice("event", "particle"), "impulses, or masses with a BUT", shown="event"),
    Field("grain", k.DURATION, "time between ergons", shown="every audio sample"),
    Field("join", k.PAUSE, "duration of the path from the key to the first point", shown="20ms"),
    Field("force_limit", k.FORCE, "the strongest force of one ergon", shown="none"),
    Field("layer", k.TRUTH, "play over the earlier gesture instead of cutting it", shown="false"),
)
_EUCLID = Text(
    parse_euclid,
    "pulses and steps, such as 3 8 or 3 8 rotate 2",
    "^[0-9]+ +[0-9]+( +rotate +[0-9]+)?$",
)
_SWING = Text(parse_swing, "a share of two steps, such as 0.6, 2/3 or 60%")
_SKIP = k.integer(0, MAX_OCCURRENCES, "5")
# How the places of a pattern follow each other, of gestures and of strikes.
OF_PATTERN = (
    Field("chance", k.CHANCE, "chance of each place of the pattern", shown="1"),
    Field("euclid", _EUCLID, "a Euclidean rhythm: pulses and steps", shown="every step"),
    Field("swing", _SWING, "share that the first of two steps takes of both", shown="0.5"),
    Field("skip", _SKIP, "places that are left out at the beginning", shown="0"),
)
PATTERN_FIELDS = tuple(field.name for field in OF_PATTERN)


def pattern_of(given: Mapping[str, Any], order: Group) -> Pattern:
    """An order with the rhythm and the chance that were written beside it."""
    said = {name: given[name] for name in PATTERN_FIELDS if name in given}
    return Pattern(order, turns=given.get("nth", ()), **said)


OF_ENTRY = tuple(replace(field, shown=None) for field in OF_GESTURE)  # unsaid: the gesture's own
_NAMES = frozenset(field.name for field in OF_GESTURE)


def manner(given: Mapping[str, Any]) -> Manner:
    """The manner that was written; None where nothing was."""
    if _NAMES.isdisjoint(given):  # most rows of most tables
        return UNSAID
    return Manner(**{name: value for name, value in given.items() if name in _NAMES})
