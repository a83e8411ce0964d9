"""How a gesture is played: the fields that gestures and entries of parts have in common."""

from __future__ import annotations

from dataclasses import replace
from typing import TypedDict

from ergon.notation.tables import value_kinds
from ergon.notation.tables.compound import Either, ListOf
from ergon.notation.tables.fields import Field
from ergon.notation.tables.shapes import Text, choice
from ergon.scores.gesture.transforms import MEANINGS, parse_chain, parse_transform
from ergon.scores.pattern import turn_chain
from ergon.scores.reading.playing import NO_OPTIONS, ErgonMode, PlayingOptions, TouchMode

HAND_WORDS = MEANINGS | {
    word: f"{form.description}, such as {form.example}"
    for word, form in turn_chain.TURN_FORMS.items()
}
DO = Either(
    scalar=Text(
        parse_chain,
        "transformations, such as scale 0.5, mirror",
        types=("string",),
        has_values=True,
        meanings=MEANINGS,
    ),
    sequence=ListOf(
        Text(
            parse_transform,
            "a transformation, such as scale 0.5",
            types=("string",),
            has_values=True,
            meanings=MEANINGS,
        )
    ),
)
# The `do` of what a player plays.
PLAY_DO = Either(
    scalar=Text(
        turn_chain.parse_chain,
        "transformations, such as rev, every 4 mirror",
        types=("string",),
        has_values=True,
        meanings=HAND_WORDS,
    ),
    sequence=ListOf(
        Text(
            turn_chain.parse_change,
            "a transformation, such as every 4 rev",
            types=("string",),
            has_values=True,
            meanings=HAND_WORDS,
        )
    ),
)
# An option that neither the gesture nor the entry writes is that of DEFAULT_OPTIONS.
GESTURE_FIELDS = (
    Field(
        "touch",
        choice("open", "tracked"),
        "how the key follows: by ergons on the free key, or exactly",
        shown="open",
    ),
    Field("ergons", choice("event", "particle"), "impulses, or masses with a BUT", shown="event"),
    Field("grain", value_kinds.DURATION, "time between ergons", shown="every audio sample"),
    Field(
        "join",
        value_kinds.PAUSE,
        "duration of the path from the key to the first point",
        shown="20ms",
    ),
    Field("force_limit", value_kinds.FORCE, "the strongest force of one ergon", shown="none"),
    Field(
        "layer",
        value_kinds.BOOLEAN,
        "play over the earlier gesture instead of cutting it",
        shown="false",
    ),
)
ENTRY_FIELDS = tuple(
    replace(field, shown=None) for field in GESTURE_FIELDS
)  # default: the gesture's own
_OPTION_NAMES = frozenset(field.name for field in GESTURE_FIELDS)


class OptionValues(TypedDict, total=False):
    """What is written of GESTURE_FIELDS or of ENTRY_FIELDS."""

    touch: TouchMode
    ergons: ErgonMode
    grain: float
    join: float
    force_limit: float
    layer: bool


def playing_options(option_values: OptionValues) -> PlayingOptions:
    """The options that were written; an option that was not is None."""
    if _OPTION_NAMES.isdisjoint(option_values):  # most rows of most tables
        return NO_OPTIONS
    return PlayingOptions(
        touch=option_values.get("touch"),
        ergons=option_values.get("ergons"),
        grain=option_values.get("grain"),
        join=option_values.get("join"),
        force_limit=option_values.get("force_limit"),
        layer=option_values.get("layer"),
    )
