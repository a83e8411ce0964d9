"""Rates of keys, of instruments and of what is only seen: the audio rate by whole numbers."""

from __future__ import annotations

from ergon.notation.tables.fields import Values
from ergon.scores.reading.sections import RATE

_WHOLE = 1e-6  # by so much a fraction may be off a whole one: what the digits of a rate leave


class Rates:
    """The audio rate [Hz], and what it is divided by for keys and for single parts.

    `motion` is the least rate of what is only seen [Hz]; None: the audio rate.
    """

    def __init__(self, score: Values) -> None:
        """Read `rates:`; reports a rate of gestures that is no fraction, and one too high."""
        rates = score["rates"]
        self.audio: float = rates["audio"] if rates else RATE
        is_said = rates is not None and rates.written("gesture")
        self.gesture = _every(self.audio, rates, "gesture") if is_said else 1
        self.motion = _motion(self.audio, rates) if rates else None

    def of_key(self, values: Values) -> int:
        """Frames from kick to kick of a key; 1: at every frame."""
        return self._own(values) or self.gesture

    def of_instrument(self, values: Values) -> int:
        """Frames from kick to kick of an instrument; 1: at every frame."""
        return self._own(values) or 1

    def _own(self, values: Values) -> int | None:
        return _every(self.audio, values, "rate") if values.written("rate") else None


def _motion(audio: float, rates: Values) -> float | None:
    """The least rate of what is only seen; None where none is written, and after a report."""
    rate = rates["motion"] if rates.written("motion") else None
    if not isinstance(rate, float):
        return None
    if rate > audio:
        message = f"rates: motion: {rate:.10g} Hz is above the audio rate, {audio:.10g} Hz"
        rates.error("E311", message, "motion", suggestion=f"{audio:.10g}Hz")
        return None
    return rate


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
