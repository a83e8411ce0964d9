"""Sets where instruments sound: positions between channels, rooms, fades."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from math import acos, cos

from ergon.notation.clock.tempo import TempoMap
from ergon.notation.tables import quantities as q
from ergon.notation.text import document, edit
from ergon.scores.edits import structure
from ergon.scores.edits.lists import items, place
from ergon.scores.edits.positions import written
from ergon.scores.edits.texts import Texts
from ergon.scores.reading.mixing import Fade
from ergon.scores.reading.outputs import Route
from ergon.scores.reading.piece import Piece

_SOON = 0.02  # [s] to silence, before a fade in


def set_route_fields(texts: Texts, piece: Piece, name: str, fields: Mapping[str, str]) -> Texts:
    """Set fields (`pan`, `gain`) of the routes of an instrument. Raises EditError."""
    texts = structure.routed(texts, piece)
    for path in _routes(texts, name):
        for field, text in fields.items():
            texts = texts.put((*path, field), text)
    return texts


def without_route_field(texts: Texts, piece: Piece, name: str, field: str) -> Texts:
    """Remove a field of the routes of an instrument. Raises EditError if none has it."""
    texts = structure.routed(texts, piece)
    nodes = items(texts, "mix", "route")
    numbers = [
        number
        for number, node in enumerate(nodes)
        if structure.is_of(node, name) and isinstance(node, document.Mapping) and node.get(field)
    ]
    if not numbers:
        raise edit.EditError(f"no route of {name} has a {field}")
    for number in numbers:
        texts = texts.remove((*place(texts, "mix", number, "route"), field))
    return texts


def move_pan(texts: Texts, piece: Piece, name: str, pan: float, begin: float, end: float) -> Texts:
    """Move an instrument between two beats to a place between its channels. Raises EditError."""
    texts = structure.routed(texts, piece)
    members = {name, *piece.families.get(name, ())}
    part_route = next((route for route in piece.mix.routes if route.part in members), None)
    pan_before = 0.0 if part_route is None else pan_of(part_route, piece.tempo_map, begin)
    points: list[edit.Tree] = [
        {"at": written(piece, begin), "pan": f"{pan_before:.12g}"},
        {"at": written(piece, end), "pan": f"{pan:.12g}"},
    ]
    for path in _routes(texts, name):
        texts = texts.put((*path, "pan"), edit.flow(points))
    return texts


def pan_of(route: Route, tempo: TempoMap, beat: float) -> float:
    """The place of a route between its channels on a beat, from -1 to 1; 0 without a pan."""
    if route.pan is not None:
        return 2.0 * route.pan[1] ** 2 - 1.0
    instant = tempo.seconds(beat)
    point_before: tuple[float, float] | None = None
    for t, point in sorted(
        ((tempo.seconds(tempo.resolve(point.at)), point) for point in route.pan_path),
        key=lambda pair: pair[0],
    ):
        if t > instant:
            if point_before is None:
                return point.pan
            begin, low = point_before
            u = (instant - begin) / (t - begin)
            u = u * u * (3.0 - 2.0 * u) if point.is_smooth else u
            angles = [acos(-place) for place in (low, point.pan)]
            return -cos(angles[0] + (angles[1] - angles[0]) * u)
        point_before = t, point.pan
    return 0.0 if point_before is None else point_before[1]


def send(texts: Texts, piece: Piece, name: str, room: str, level: str) -> Texts:
    """Send an instrument to a room. Raises EditError."""
    texts = structure.routed(texts, piece)
    for path in _routes(texts, name):
        texts = texts.put((*path, "send", room), level)
    return texts


def room(texts: Texts, piece: Piece, name: str, fields: Mapping[str, str]) -> Texts:
    """Add a room, or set fields of one. Raises EditError."""
    if not any(mix_room.name == name for mix_room in piece.mix.rooms):
        room_fields: dict[str, edit.Tree] = {**({} if "t60" in fields else {"t60": "2s"}), **fields}
        return texts.put(("mix", "rooms", name), edit.flow(room_fields))
    for field, text in fields.items():
        texts = texts.put(("mix", "rooms", name, field), text)
    return texts


def fade(
    texts: Texts, piece: Piece, name: str | None, beat: float, end: float, *, is_in: bool
) -> Texts:
    """Fade an instrument (None: everything) in or out, between two beats. Raises EditError."""
    if name is None:
        master_fade = piece.mix.master.fade if piece.mix.master else ()
        path = ("mix", "master", "fade")
        return texts.put(path, edit.flow(_points(piece, master_fade, beat, end, is_in=is_in)))
    texts = structure.routed(texts, piece)
    members = {name, *piece.families.get(name, ())}
    fade_points = next((route.fade for route in piece.mix.routes if route.part in members), ())
    points_text = edit.flow(_points(piece, fade_points, beat, end, is_in=is_in))
    for route in _routes(texts, name):
        texts = texts.put((*route, "fade"), points_text)
    return texts


def level(fade: Fade, tempo: TempoMap, beat: float) -> float:
    """The level of a fade on a beat, as a ratio."""
    instant = tempo.seconds(beat)
    point_before: tuple[float, float] | None = None
    for t, gain, is_smooth in sorted(
        (
            (tempo.seconds(tempo.resolve(fade_point.at)), fade_point.gain, fade_point.is_smooth)
            for fade_point in fade
        ),
        key=lambda fade_point: fade_point[0],
    ):
        if t > instant:
            if point_before is None:
                return gain
            begin, low = point_before
            u = (instant - begin) / (t - begin)
            u = u * u * (3.0 - 2.0 * u) if is_smooth else u
            if low > 0.0 and gain > 0.0:
                return q.level_between(low, gain, u)
            return low + (gain - low) * u
        point_before = t, gain
    return 1.0 if point_before is None else point_before[1]


def fades_from(texts: Texts, piece: Piece, start: float) -> Texts:
    """The fades from the beat `start` on, with positions counted from there."""
    tempo = piece.tempo_map

    def within(fade: Fade) -> list[edit.Tree]:
        points_written: list[edit.Tree] = [{"at": "0", "gain": _ratio(level(fade, tempo, start))}]
        for point in fade:
            beat = tempo.resolve(point.at)
            if start < beat:
                curve = "smooth" if point.is_smooth else "line"
                offset_text = f"{beat - start:.12g}"
                points_written.append(
                    {"at": offset_text, "gain": _ratio(point.gain), "curve": curve}
                )
        return points_written

    if piece.mix.master is not None and piece.mix.master.fade:
        texts = texts.put(("mix", "master", "fade"), edit.flow(within(piece.mix.master.fade)))
    panned = {_written(piece, route): route for route in piece.mix.routes if route.pan_path}
    for name, route in panned.items():
        texts = _pan_from(texts, piece, name, route, start)
    for name in dict.fromkeys(route.part for route in piece.mix.routes if route.fade):
        route = next(
            part_route
            for part_route in piece.mix.routes
            if part_route.part == name and part_route.fade
        )
        for path in _routes(texts, _written(piece, route)):
            texts = texts.put((*path, "fade"), edit.flow(within(route.fade)))
    return texts


def _pan_from(texts: Texts, piece: Piece, name: str, route: Route, start: float) -> Texts:
    """The pan of an instrument from the beat `start` on, with positions counted from there."""
    tempo = piece.tempo_map
    points: list[edit.Tree] = [{"at": "0", "pan": f"{pan_of(route, tempo, start):.12g}"}]
    for point in route.pan_path:
        beat = tempo.resolve(point.at)
        if start < beat:
            curve = "smooth" if point.is_smooth else "line"
            beats_after = f"{beat - start:.12g}"
            points.append({"at": beats_after, "pan": f"{point.pan:.12g}", "curve": curve})
    for path in _routes(texts, name):
        texts = texts.put((*path, "pan"), edit.flow(points))
    return texts


def _written(piece: Piece, route: Route) -> str:
    """The name of a route's instrument; for a note, that of the instrument it belongs to."""
    return next(
        (family_name for family_name, notes in piece.families.items() if route.part in notes),
        route.part,
    )


def _points(piece: Piece, fade: Fade, beat: float, end: float, *, is_in: bool) -> list[edit.Tree]:
    tempo = piece.tempo_map
    points_written: list[edit.Tree] = []
    if fade or not is_in:
        points_written.append(
            {"at": written(piece, beat), "gain": _ratio(level(fade, tempo, beat))}
        )
    else:
        soon = tempo.beats(tempo.seconds(beat) + _SOON)
        points_written.append({"at": written(piece, beat), "gain": "0dB"})
        points_written.append({"at": written(piece, soon), "gain": "x0"})
    return [*points_written, {"at": written(piece, end), "gain": "0dB" if is_in else "x0"}]


def _ratio(level: float) -> str:
    return f"x{level:.12g}"


def _routes(texts: Texts, name: str) -> Iterator[edit.Path]:
    """The paths of the routes of an instrument."""
    for number, node in enumerate(items(texts, "mix", "route")):
        if structure.is_of(node, name):
            yield place(texts, "mix", number, "route")
