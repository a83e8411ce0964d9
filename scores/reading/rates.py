"""Rates of a key's or an instrument's own: whole fractions of the audio rate."""

from __future__ import annotations

from ergon.notation.tables.fields import Values
from ergon.scores.reading.sections import RATE

_WHOLE = 1e-6  # by so much a fraction may be off a whole one: what the digits of a rate leave


class Rates:
    """The audio rate [Hz], and what it is divided by for keys and for single parts."""

    def __init__(self, score: Values) -> None:
        """Read `rates:`; reports a rate of gestures that is no fraction."""
        rates = score["rates"]
        self.audio: float = rates["audio"] if rates else RATE
        is_said = rates is not None and rates.written("gesture")
        self.gesture = _every(self.audio, rates, "gesture") if is_said else 1

    def of_key(self, values: Values) -> int:
        """Frames from kick to kick of a key; 1: at every frame."""
        return self._own(values) or self.gesture

    def of_instrument(self, values: Values) -> int:
        """Frames from kick to kick of an instrument; 1: at every frame."""
        return self._own(values) or 1

    def _own(self, values: Values) -> int | None:
        return _every(self.audio, values, "rate") if values.written("rate") else None


def _every(audio: float, values: Values, name: str) -> int:
    """What the audio rate is divided by; 1 after a report."""
    rate = values[name]
    if not isinstance(rate, float):
        return 1  # reported already
    frames = max(1, round(audio / rate))
    if abs(audio / rate - frames) <= _WHOLE * frames:
        return frames
    subject = "rates: gesture" if name == "gesture" else values.context.of(name)
    relation = "above" if rate > audio else "not a divisor of"
    message = f"{subject}: {rate:.10g} Hz is {relation} the audio rate, {audio:.10g} Hz"
    values.error("E311", message, name, suggestion=f"{audio / frames:.10g}Hz")
    return 1
