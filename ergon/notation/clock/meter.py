"""Meters: how many beats a bar has, and where bars begin.

A beat is the meter's lower number: in 7/8 a bar has seven beats, each an eighth, and bpm counts
eighths. `3+2+2/8` is 7/8 with its groups written out.
"""

import math
import re
from bisect import bisect_right
from dataclasses import dataclass

from ergon.notation.text.errors import TextError
from ergon.notation.text.numbers import stripped

MAX_BEATS = 256  # in one bar
SAME = 1e-9  # beats that are rounding, not music
_METER = re.compile(r"([0-9]{1,3}(?:\+[0-9]{1,3})*+)/([0-9]{1,3})")
_UNITS = (1, 2, 4, 8, 16, 32, 64)


@dataclass(frozen=True, slots=True)
class Meter:
    """`beats` beats to the bar, each 1/`unit` of a whole note; `groups` sum to `beats`."""

    beats: int = 4
    unit: int = 4
    groups: tuple[int, ...] = (4,)

    def __str__(self) -> str:
        """As a composer writes it."""
        return f"{'+'.join(map(str, self.groups))}/{self.unit}"


def parse_meter(text: str) -> Meter:
    """Read `4/4`, `7/8` or `3+2+2/8`. Raises TextError."""
    trimmed_text, text_start = stripped(text)
    meter_match = _METER.fullmatch(trimmed_text)
    if meter_match is None:
        raise TextError(
            f"'{trimmed_text[:40]}' is not a meter such as 4/4 or 3+2+2/8",
            offset=text_start,
            length=max(1, len(trimmed_text)),
        )
    beat_groups = tuple(int(group) for group in meter_match[1].split("+"))
    if min(beat_groups) < 1 or sum(beat_groups) > MAX_BEATS:
        raise TextError(
            f"a bar has from 1 to {MAX_BEATS} beats", offset=text_start, length=len(meter_match[1])
        )
    if int(meter_match[2]) not in _UNITS:
        raise TextError(
            "the unit of a meter is 1, 2, 4, 8, 16, 32 or 64",
            offset=text_start + meter_match.start(2),
            length=len(meter_match[2]),
        )
    return Meter(sum(beat_groups), int(meter_match[2]), beat_groups)


class Bars:
    """Which bar a beat is in. Bars and their beats count from 1; beats of the piece from 0."""

    def __init__(self) -> None:
        """Start in 4/4."""
        self._bars = [1]
        self._starts = [0.0]
        self._meters = [Meter()]

    def change(self, begin: float, meter: Meter) -> None:
        """Set `meter` from beat `begin` on; calls come in order of time. Raises TextError if
        `begin` is not on a bar line.
        """
        if begin > self._starts[-1] + SAME:
            bar, beat = self.bar_beat(begin)
            if beat > 1.0 + SAME:
                raise TextError(f"a meter begins on a bar line, not at {bar}|{beat:g}")
            self._starts.append(self.start(bar))
            self._bars.append(bar)
            self._meters.append(meter)
        else:
            self._meters[-1] = meter

    def bar_beat(self, beats: float) -> tuple[int, float]:
        """(bar, beat) of a beat of the piece; before the start, bars go on 0, -1, ..."""
        meter_index = max(0, bisect_right(self._starts, beats + SAME) - 1)
        beats_per_bar = self._meters[meter_index].beats
        beats_into_meter = beats - self._starts[meter_index]
        n_bars = int((beats_into_meter + SAME) // beats_per_bar)
        return self._bars[meter_index] + n_bars, max(
            0.0, beats_into_meter - n_bars * beats_per_bar
        ) + 1.0

    def start(self, bar: float) -> float:
        """The beat of the piece on which `bar` begins; bar 2.5 begins halfway through bar 2."""
        return self.bar(bar)[0]

    def bar(self, bar: float) -> tuple[float, int]:
        """The beat of the piece on which `bar` begins, and how many beats it has."""
        meter_index = max(0, bisect_right(self._bars, bar) - 1)
        beats = self._meters[meter_index].beats
        return self._starts[meter_index] + (bar - self._bars[meter_index]) * beats, beats

    def after_quarters(self, piece_beats: float, quarters: float) -> float:
        """The beat of the piece that lies `quarters` quarter notes after another."""
        meter_index = max(0, bisect_right(self._starts, piece_beats + SAME) - 1)
        while meter_index + 1 < len(self._starts):
            unit = self._meters[meter_index].unit
            quarters_left_in_meter = (self._starts[meter_index + 1] - piece_beats) * 4.0 / unit
            if quarters <= quarters_left_in_meter:
                break
            piece_beats, quarters, meter_index = (
                self._starts[meter_index + 1],
                quarters - quarters_left_in_meter,
                meter_index + 1,
            )
        return piece_beats + quarters * self._meters[meter_index].unit / 4.0

    def quarters(self, beats: float) -> float:
        """How many quarter notes lie before a beat of the piece."""
        spans = zip(self._starts, (*self._starts[1:], math.inf), self._meters, strict=True)
        return sum(
            (min(beats, stop) - start) * 4.0 / meter.unit
            for start, stop, meter in spans
            if start == 0.0 or start < beats
        )

    def unit(self, beats: float) -> int:
        """The note that a beat of the piece is: 4 for a quarter."""
        return self._meters[max(0, bisect_right(self._starts, beats + SAME) - 1)].unit

    @property
    def has_quarters(self) -> bool:
        """Whether every beat is a quarter note."""
        return all(meter.unit == 4 for meter in self._meters)

    def changes(self) -> list[tuple[float, int, Meter]]:
        """Every meter as (beat of the piece, bar, meter)."""
        return list(zip(self._starts, self._bars, self._meters, strict=True))
