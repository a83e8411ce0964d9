"""What a score may say already, and nothing uses yet: each is told, so that none is believed."""

from __future__ import annotations

from ergon.scores.tables.fields import Values
from ergon.scores.tables.shapes import Context
from ergon.scores.text.values import Place

_AT_AUDIO_RATE = "for now all runs at the audio rate"


def rate_of(context: Context, place: Place) -> None:
    """A rate of something's own (N403)."""
    context.error("N403", f"{context.of('rate')}: {_AT_AUDIO_RATE}", place)


def unused(score: Values) -> None:
    """Report rates (N403) that are accepted only."""
    rates = score["rates"]
    if rates and rates.written("gesture"):
        rates.error("N403", f"rates: gesture: {_AT_AUDIO_RATE}", "gesture")
    for section in ("keys", "instruments"):
        for values in (score[section] or {}).values():
            if isinstance(values, Values) and values.written("rate"):
                rate_of(values.context, values.place_of("rate"))
