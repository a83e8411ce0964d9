"""Filters and delays of routes: their tables, and the objects that are read from them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal

from ergon.notation.tables import quantities, value_kinds
from ergon.notation.tables.compound import Either
from ergon.notation.tables.fields import Field, Record, Values
from ergon.notation.tables.shapes import MISSING

FilterKind = Literal["lowpass", "lowshelf", "highshelf"]
DELAY_MAX = 10.0  # [s]


@dataclass(frozen=True, slots=True)
class Tone:
    """A filter of order 2: its frequency [Hz], and the level of a shelf [dB]."""

    kind: FilterKind
    frequency: float
    level: float = 0.0


@dataclass(frozen=True, slots=True)
class Echo:
    """A delay [s], and the ratio at which what leaves it goes into it again."""

    time: float
    feedback: float = 0.0

    def frames(self, rate: float) -> int:
        """Frames that it takes."""
        return int(self.time * rate + 0.5)


def _shelf_point(shelf_values: Values) -> Any:
    if shelf_values["f"] is None or shelf_values["gain"] is None:
        return MISSING
    if shelf_values["gain"] <= 0.0:
        shelf_values.error("E202", f"{shelf_values.context.label('gain')} must be above x0", "gain")
        return MISSING
    return shelf_values["f"], quantities.decibels_of(shelf_values["gain"])


def _echo_of_values(echo_values: Values) -> Any:
    if echo_values["time"] is None:
        return MISSING
    if echo_values["feedback"] >= 1.0:
        message = (
            f"{echo_values.context.label('feedback')} must be below 0dB, or echoes would not fall"
        )
        echo_values.error("E202", message, "feedback")
        return MISSING
    return Echo(echo_values["time"], echo_values["feedback"])


SHELF_RECORD = Record(
    "shelf",
    "a gain below or above a frequency",
    (
        Field("f", value_kinds.HERTZ, "where half of the level in dB is reached", required=True),
        Field("gain", value_kinds.GAIN, "level far below it (lowshelf) or above it", required=True),
    ),
    _shelf_point,
)
DELAY_SHAPE = Either(
    value_kinds.DURATION,
    Record(
        "delay",
        "a delay with echoes",
        (
            Field(
                "time", value_kinds.DURATION, "from the sound to what is heard of it", required=True
            ),
            Field("feedback", value_kinds.GAIN, "level of each echo beside the one before", 0.0),
        ),
        _echo_of_values,
    ),
)


def tones(values: Values) -> tuple[Tone, ...]:
    """The filters of a route, in the order in which a sound passes them."""
    return tuple(_read_tones(values))


def _read_tones(route_values: Values) -> Iterator[Tone]:
    if route_values["lowpass"] is not None:
        yield Tone("lowpass", route_values["lowpass"])
    shelves: tuple[FilterKind, ...] = "lowshelf", "highshelf"
    for kind in shelves:
        if route_values[kind] is not None:
            yield Tone(kind, *route_values[kind])


def echo(route_values: Values) -> Echo | None:
    """The delay of a route; a longer one than the engine has is reported."""
    written_delay = route_values["delay"]
    if written_delay is None:
        return None
    route_echo = Echo(written_delay) if isinstance(written_delay, float) else written_delay
    if route_echo.time > DELAY_MAX:
        message = (
            f"{route_values.context.label('delay')}: {route_echo.time:g} s is above the maximum of "
        )
        route_values.error("E202", f"{message}{DELAY_MAX:g} s", "delay")
        return None
    return route_echo
