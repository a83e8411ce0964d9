"""Rates of keys, of instruments and of parts that are only seen: the audio rate divided by whole
numbers.
"""

from __future__ import annotations

from ergon.notation.tables.fields import Values
from ergon.scores.reading.sections import DEFAULT_RATE_HZ

_TOLERANCE = 1e-6  # relative tolerance: rates are written with few digits


class Rates:
    """The audio rate [Hz], and its divisors for keys and for single parts.

    `motion` is the lowest rate of parts that are only seen [Hz]; None: the audio rate.
    """

    def __init__(self, score: Values) -> None:
        """Read `rates:`; reports a gesture rate that does not divide the audio rate, and a motion
        rate above it.
        """
        rates = score["rates"]
        self.audio: float = rates["audio"] if rates else DEFAULT_RATE_HZ
        is_written = rates is not None and rates.written("gesture")
        self.gesture_divisor = _rate_divisor(self.audio, rates, "gesture") if is_written else 1
        self.motion = _motion_rate(self.audio, rates) if rates else None

    def key_step_frames(self, values: Values) -> int:
        """Frames between two steps of a key's springs; 1: at every frame."""
        return self._part_divisor(values) or self.gesture_divisor

    def instrument_step_frames(self, values: Values) -> int:
        """Frames between two steps of an instrument's springs; 1: at every frame."""
        return self._part_divisor(values) or 1

    def _part_divisor(self, values: Values) -> int | None:
        return _rate_divisor(self.audio, values, "rate") if values.written("rate") else None


def _motion_rate(audio_rate: float, rates: Values) -> float | None:
    """The lowest rate of parts that are only seen; None if none is written, or if an error was
    reported.
    """
    motion_rate = rates["motion"] if rates.written("motion") else None
    if not isinstance(motion_rate, float):
        return None
    if motion_rate > audio_rate:
        message = (
            f"rates: motion: {motion_rate:.10g} Hz is above the audio rate, {audio_rate:.10g} Hz"
        )
        rates.error("E311", message, "motion", suggestion=f"{audio_rate:.10g}Hz")
        return None
    return motion_rate


def _rate_divisor(audio_rate: float, rate_values: Values, rate_name: str) -> int:
    """The divisor of the audio rate; 1 if an error was reported."""
    rate = rate_values[rate_name]
    if not isinstance(rate, float):
        return 1  # reported already
    divisor = max(1, round(audio_rate / rate))
    if abs(audio_rate / rate - divisor) <= _TOLERANCE * divisor:
        return divisor
    rate_label = (
        "rates: gesture" if rate_name == "gesture" else rate_values.context.label(rate_name)
    )
    relation = "above" if rate > audio_rate else "not a divisor of"
    message = f"{rate_label}: {rate:.10g} Hz is {relation} the audio rate, {audio_rate:.10g} Hz"
    rate_values.error("E311", message, rate_name, suggestion=f"{audio_rate / divisor:.10g}Hz")
    return 1
