"""Looks up the routes of a mix: each must lead from an existing output to existing rooms."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from math import sqrt

from ergon.instruments.kinds.outputs import MOVEMENT_NAMES
from ergon.instruments.model import Instrument
from ergon.instruments.names import PartNames
from ergon.notation.tables.quantities import ratio_of
from ergon.notation.tables.shapes import Name
from ergon.notation.text.errors import quote
from ergon.scores.reading.mixing import Room
from ergon.scores.reading.outputs import Mix, Route
from ergon.scores.reading.playing import Key


def routed_mix(
    mix: Mix, parts_by_name: Mapping[str, Key | Instrument], part_names: PartNames
) -> Mix:
    """A mix whose routes name instruments of `parts_by_name`, as `part_names` knows them."""
    is_relative = mix.reference() is not None
    for route in mix.routes if not is_relative else ():
        if route.level is not None:
            message = f"route: the level of {quote(route.part)} is not known in SI units; remove "
            message += "`reference: SI` from the master, or write a gain here"
            part_names.collector.error("E111", message, route.place)
    note_routes = (
        note_route for route in mix.routes for note_route in _note_routes(route, part_names)
    )
    checked_routes = (
        _checked_route(route, parts_by_name, part_names, mix.rooms) for route in note_routes
    )
    return replace(mix, routes=tuple(route for route in checked_routes if route is not None))


def _note_routes(route: Route, part_names: PartNames) -> Iterable[Route]:
    """A route, or one from each note of an instrument that has notes."""
    name = Name(part_names.spelled(route.part), route.place)
    return (replace(route, part=member_name) for member_name in part_names.member_names(name))


def _checked_route(
    route: Route,
    parts_by_name: Mapping[str, Key | Instrument],
    part_names: PartNames,
    rooms: Sequence[Room],
) -> Route | None:
    """A route from an instrument, or from one of its outputs; None if there is no such
    instrument.
    """
    part_path, output_name = str(route.part), None
    if part_path not in parts_by_name and "." in part_path:
        part_path, _, output_name = part_path.rpartition(".")
    instrument = parts_by_name.get(part_path)
    if not isinstance(instrument, Instrument):
        if part_path not in part_names.refused_parts:
            message = f"route: no instrument is called {quote(route.part)}"
            names = tuple(
                name
                for name, part_object in parts_by_name.items()
                if isinstance(part_object, Instrument)
            )
            word = str(route.part)
            part_names.collector.error("E301", message, route.place, word=word, names=names)
        return None
    out_names = tuple(output.name for output in instrument.outputs)
    if part_path in part_names.refused_parts:
        return None
    if not out_names or (output_name is not None and output_name not in out_names):
        message = f"route: {quote(part_path)} has no output" + (
            f" {quote(output_name)}" if output_name else ""
        )
        output_paths = tuple(f"{part_path}.{name}" for name in out_names if name)
        part_names.collector.error(
            "E301", message, route.place, word=str(route.part), names=output_paths
        )
    part_names.referenced_parts.add(part_path)
    levelled_route = _route_with_level(
        replace(route, part=part_path, out=output_name), instrument, part_names
    )
    _check_route(levelled_route, instrument, rooms, part_names)
    return levelled_route


def _route_with_level(route: Route, instrument: Instrument, part_names: PartNames) -> Route:
    """A route with the ratio that leads to its level: the channels share the power."""
    if route.level is None:
        return route
    if instrument.loudness is None:
        message = f"route: {quote(route.part)} has no `level`, the loudness of a stroke at mf; "
        message += "write a gain here"
        part_names.collector.error("E304", message, route.place)
        return route
    channel_count = 1 if route.to == "nearest" or route.is_panned else len(route.to)
    ratio = ratio_of(route.level - instrument.loudness) / sqrt(channel_count)
    return replace(route, level_ratio=ratio)


def _check_route(
    route: Route, instrument: Instrument, rooms: Sequence[Room], part_names: PartNames
) -> None:
    """Check a route: its rooms must exist, `radiate` needs accelerations, and `nearest` needs
    masses.
    """
    room_names = tuple(room.name for room in rooms)
    for room_name, _ in route.sends:
        if room_name not in room_names:
            message = f"route: no room is called {quote(room_name)}"
            part_names.collector.error(
                "E301", message, room_name.place, word=room_name, names=room_names
            )
    routed_outputs = [output for output in instrument.outputs if route.out in (None, output.name)]
    non_radiating_output = next(
        (output for output in routed_outputs if not output.kind_facts.radiates), None
    )
    if route.radiation is not None and non_radiating_output is not None:
        message = (
            f"route: `radiate` takes an acceleration, and {route.part} gives "
            f"{non_radiating_output.kind}"
        )
        help_text = (
            "listen by SOA: the pressure of a small source is proportional to its acceleration"
        )
        part_names.collector.error("E304", message, route.place, help=help_text)
    non_movement_kinds = [
        output.kind for output in routed_outputs if not output.kind_facts.is_movement
    ]
    if route.to == "nearest" and any(
        not output.is_movement and output.nearest is None for output in routed_outputs
    ):
        refused_kind = non_movement_kinds[0] if non_movement_kinds else "a distance"
        message = (
            "route: `nearest` needs masses, which have positions, and "
            f"{route.part} gives {refused_kind}"
        )
        help_text = f"name channels, `to: [1, 2]`, or listen to masses by {MOVEMENT_NAMES}"
        part_names.collector.error("E304", message, route.place, help=help_text)
