"""Rooms, fades and radiation of a mix: their tables, and the objects that are read from them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from ergon.instruments.bodies import Decays
from ergon.notation.clock.positions import Position
from ergon.notation.tables import value_kinds
from ergon.notation.tables.compound import Either, ListOf, NamesOf
from ergon.notation.tables.fields import Field, Record, Values
from ergon.notation.tables.shapes import MISSING, Name, Shape, choice
from ergon.notation.text import document
from ergon.notation.text.document import Node
from ergon.notation.text.values import Place

SPEED_OF_SOUND = 343.0  # [m/s]
AIR_DENSITY = 1.204  # density [kg/m³]
_SINGLE_T60_FREQUENCIES = 200.0, 6000.0  # frequencies for a room with a single t60 [Hz]


@dataclass(frozen=True, slots=True)
class FadePoint:
    """A point of a fade: position, gain as a ratio, whether the way to it is smooth."""

    at: Position
    gain: float
    is_smooth: bool
    place: Place


Fade = tuple[FadePoint, ...]


@dataclass(frozen=True, slots=True)
class PanPoint:
    """A point of a pan: position, place from -1 to 1, whether the way to it is smooth."""

    at: Position
    pan: float
    is_smooth: bool
    place: Place


PanPath = tuple[PanPoint, ...]


@dataclass(frozen=True, slots=True)
class Radiation:
    """A disc of a radius [m] in a wall, heard at a distance [m]."""

    distance: float
    radius: float

    @property
    def gain(self) -> float:
        """Pressure [Pa] for an acceleration of 1 m/s²."""
        return AIR_DENSITY * self.radius * self.radius / (2.0 * self.distance)

    def delay(self, rate: float) -> int:
        """Frames that the sound takes."""
        return int(self.distance / SPEED_OF_SOUND * rate + 0.5)


@dataclass(frozen=True, slots=True)
class Room:
    """A room: mean path from wall to wall [m], decays as pairs of frequency [Hz] and time [s].

    Channels are counted from 1; an empty tuple means all channels.
    """

    name: str
    size: float
    t60: tuple[tuple[float, float], tuple[float, float]]
    to: tuple[int, ...]
    gain: float
    place: Place


def room_table(channels_shape: Shape) -> Record:
    """The fields of a room; `channels_shape` reads channels."""
    return Record(
        "room",
        "a room that routes send to: a feedback delay network",
        (
            Field(
                "size",
                value_kinds.ROOM_SIZE,
                "mean way of sound from wall to wall",
                10.0,
                shown="10m",
            ),
            Field(
                "t60",
                Either(value_kinds.DURATION, Decays()),
                "time to fall by 60 dB, or times at two frequencies",
                required=True,
            ),
            Field("to", channels_shape, "channels that hear it", shown="all"),
            Field("gain", value_kinds.GAIN, "level", 1.0, shown="0dB"),
        ),
    )


RADIATION_SHAPE = Record(
    "radiation",
    "a disc in a wall, heard at a distance",
    (
        Field("distance", value_kinds.DISTANCE, "from the disc to the ear", required=True),
        Field("radius", value_kinds.DISC, "of the disc", 0.05, shown="5cm"),
    ),
    lambda v: MISSING if v["distance"] is None else Radiation(v["distance"], v["radius"]),
)


def _fade_point(point_values: Values) -> Any:
    if point_values["at"] is None or point_values["gain"] is None:
        return MISSING
    is_smooth = point_values["curve"] == "smooth"
    return FadePoint(
        point_values["at"], point_values["gain"], is_smooth, point_values.place_of("at")
    )


FADE_SHAPE = ListOf(
    Record(
        "point of a fade",
        "a level at a position of the piece",
        (
            Field("at", value_kinds.WHEN, "where", required=True),
            Field("gain", value_kinds.GAIN, "level there; x0 is silence", required=True),
            Field("curve", choice("smooth", "line"), "the way to it", "smooth"),
        ),
        _fade_point,
    ),
    count_min=1,
    single=True,
)
SENDS_SHAPE = NamesOf(value_kinds.GAIN, "room")


def _pan_point(point_values: Values) -> Any:
    if point_values["at"] is None or point_values["pan"] is None:
        return MISSING
    is_smooth = point_values["curve"] == "smooth"
    return PanPoint(point_values["at"], point_values["pan"], is_smooth, point_values.place_of("at"))


_PAN_POINT_RECORD = Record(
    "point of a pan",
    "a place between two channels at a position of the piece",
    (
        Field("at", value_kinds.WHEN, "where in the piece", required=True),
        Field("pan", value_kinds.PAN, "place between the two channels there", required=True),
        Field("curve", choice("line", "smooth"), "the way to it", "line"),
    ),
    _pan_point,
)
PAN_SHAPE = Either(value_kinds.PAN, _PAN_POINT_RECORD, ListOf(_PAN_POINT_RECORD, count_min=1))


def fade_points(fade_value: Any) -> Fade:
    """The points that were read."""
    return tuple(point for point in fade_value or () if isinstance(point, FadePoint))


def pan_gains(pan_value: Any) -> tuple[float, float] | None:
    """Gains of the two channels by constant power: -1 is the first one alone, 1 the second. None
    for a pan that moves.
    """
    if not isinstance(pan_value, float):
        return None
    return (math.sqrt(0.5 * (1.0 - pan_value)), math.sqrt(0.5 * (1.0 + pan_value)))


def pan_path(path_value: Any) -> PanPath:
    """The points of a pan that moves."""
    points = path_value if isinstance(path_value, tuple | list) else (path_value,)
    return tuple(point for point in points if isinstance(point, PanPoint))


def sends(sends_value: Any, node: Node | None) -> tuple[tuple[Name, float], ...]:
    """Rooms by name, with the gain of what is sent there."""
    entries = node.entries if isinstance(node, document.Mapping) else {}
    return tuple(
        (Name(name, entries[name][0].place), gain)
        for name, gain in (sends_value or {}).items()
        if gain is not MISSING
    )


def rooms(values_by_name: Any) -> tuple[Room, ...]:
    """The rooms that were read."""
    return tuple(_valid_rooms(values_by_name or {}))


def _valid_rooms(values: Mapping[str, object]) -> Iterator[Room]:
    for room_name, room_values in values.items():
        if not isinstance(room_values, Values) or room_values["t60"] is None:
            continue
        t60 = room_values["t60"]
        if isinstance(t60, float):
            decay_pairs = (_SINGLE_T60_FREQUENCIES[0], t60), (_SINGLE_T60_FREQUENCIES[1], t60)
        elif len(t60) == 2:
            decay_pairs = t60
        else:
            message = (
                f"room {room_name}: t60: a room has decays at two frequencies; here {len(t60)}"
            )
            room_values.error("E106", message, "t60")
            continue
        yield Room(
            room_name,
            room_values["size"],
            decay_pairs,
            room_values["to"] or (),
            room_values["gain"],
            room_values.place,
        )
