"""Sets where instruments sound: positions between channels, rooms, fades."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from math import acos, cos

from ergon.notation.clock.tempo import TempoMap
from ergon.notation.tables import quantities
from ergon.notation.text import document, edit
from ergon.scores.edits import structure
from ergon.scores.edits.lists import entry_path, section_entries
from ergon.scores.edits.positions import position_text
from ergon.scores.edits.texts import Texts
from ergon.scores.reading.mixing import Fade
from ergon.scores.reading.outputs import Route
from ergon.scores.reading.piece import Piece

_SILENCE_SECONDS = 0.02  # [s] to silence, before a fade in


def set_route_fields(
    score_texts: Texts, piece: Piece, instrument_name: str, route_fields: Mapping[str, str]
) -> Texts:
    """Set fields (`pan`, `gain`) of the routes of an instrument. Raises EditError."""
    score_texts = structure.with_default_routes(score_texts, piece)
    for path in _route_paths(score_texts, instrument_name):
        for field, text in route_fields.items():
            score_texts = score_texts.put((*path, field), text)
    return score_texts


def without_route_field(
    score_texts: Texts, piece: Piece, instrument_name: str, field_name: str
) -> Texts:
    """Remove a field of the routes of an instrument. Raises EditError if none has it."""
    score_texts = structure.with_default_routes(score_texts, piece)
    nodes = section_entries(score_texts, "mix", "route")
    route_indices = [
        route_index
        for route_index, node in enumerate(nodes)
        if structure.is_route_of(node, instrument_name)
        and isinstance(node, document.Mapping)
        and node.get(field_name)
    ]
    if not route_indices:
        raise edit.EditError(f"no route of {instrument_name} has a {field_name}")
    for route_index in route_indices:
        score_texts = score_texts.remove(
            (*entry_path(score_texts, "mix", route_index, "route"), field_name)
        )
    return score_texts


def move_pan(
    score_texts: Texts,
    piece: Piece,
    instrument_name: str,
    pan: float,
    begin_beat: float,
    end_beat: float,
) -> Texts:
    """Move an instrument between two beats to a place between its channels. Raises EditError."""
    score_texts = structure.with_default_routes(score_texts, piece)
    members = {instrument_name, *piece.families.get(instrument_name, ())}
    part_route = next((route for route in piece.mix.routes if route.part in members), None)
    old_pan = 0.0 if part_route is None else pan_of(part_route, piece.tempo_map, begin_beat)
    pan_points: list[edit.Tree] = [
        {"at": position_text(piece, begin_beat), "pan": f"{old_pan:.12g}"},
        {"at": position_text(piece, end_beat), "pan": f"{pan:.12g}"},
    ]
    for path in _route_paths(score_texts, instrument_name):
        score_texts = score_texts.put((*path, "pan"), edit.flow(pan_points))
    return score_texts


def pan_of(route: Route, tempo: TempoMap, from_beat: float) -> float:
    """The place of a route between its channels on a beat, from -1 to 1; 0 without a pan."""
    if route.pan is not None:
        return 2.0 * route.pan[1] ** 2 - 1.0
    beat_instant = tempo.seconds(from_beat)
    previous_point: tuple[float, float] | None = None
    for point_instant, pan_point in sorted(
        ((tempo.seconds(tempo.resolve(point.at)), point) for point in route.pan_path),
        key=lambda pair: pair[0],
    ):
        if point_instant > beat_instant:
            if previous_point is None:
                return pan_point.pan
            previous_instant, previous_pan = previous_point
            share = (beat_instant - previous_instant) / (point_instant - previous_instant)
            share = share * share * (3.0 - 2.0 * share) if pan_point.is_smooth else share
            angles = [acos(-place) for place in (previous_pan, pan_point.pan)]
            return -cos(angles[0] + (angles[1] - angles[0]) * share)
        previous_point = point_instant, pan_point.pan
    return 0.0 if previous_point is None else previous_point[1]


def send_to_room(
    score_texts: Texts, piece: Piece, instrument_name: str, room: str, level_text: str
) -> Texts:
    """Send an instrument to a room. Raises EditError."""
    score_texts = structure.with_default_routes(score_texts, piece)
    for path in _route_paths(score_texts, instrument_name):
        score_texts = score_texts.put((*path, "send", room), level_text)
    return score_texts


def with_room(score_texts: Texts, piece: Piece, room_name: str, fields: Mapping[str, str]) -> Texts:
    """Add a room, or set fields of one. Raises EditError."""
    if not any(mix_room.name == room_name for mix_room in piece.mix.rooms):
        room_fields: dict[str, edit.Tree] = {**({} if "t60" in fields else {"t60": "2s"}), **fields}
        return score_texts.put(("mix", "rooms", room_name), edit.flow(room_fields))
    for field, text in fields.items():
        score_texts = score_texts.put(("mix", "rooms", room_name, field), text)
    return score_texts


def with_fade(
    score_texts: Texts,
    piece: Piece,
    instrument_name: str | None,
    from_beat: float,
    end_beat: float,
    *,
    fades_in: bool,
) -> Texts:
    """Fade an instrument (None: everything) in or out, between two beats. Raises EditError."""
    if instrument_name is None:
        master_fade = piece.mix.master.fade if piece.mix.master else ()
        path = ("mix", "master", "fade")
        return score_texts.put(
            path,
            edit.flow(_fade_points(piece, master_fade, from_beat, end_beat, fades_in=fades_in)),
        )
    score_texts = structure.with_default_routes(score_texts, piece)
    members = {instrument_name, *piece.families.get(instrument_name, ())}
    fade_points = next((route.fade for route in piece.mix.routes if route.part in members), ())
    points_text = edit.flow(
        _fade_points(piece, fade_points, from_beat, end_beat, fades_in=fades_in)
    )
    for route_path in _route_paths(score_texts, instrument_name):
        score_texts = score_texts.put((*route_path, "fade"), points_text)
    return score_texts


def fade_level(fade: Fade, tempo: TempoMap, beat: float) -> float:
    """The level of a fade on a beat, as a ratio."""
    beat_instant = tempo.seconds(beat)
    previous_point: tuple[float, float] | None = None
    for point_instant, point_gain, is_smooth in sorted(
        (
            (tempo.seconds(tempo.resolve(fade_point.at)), fade_point.gain, fade_point.is_smooth)
            for fade_point in fade
        ),
        key=lambda fade_point: fade_point[0],
    ):
        if point_instant > beat_instant:
            if previous_point is None:
                return point_gain
            previous_instant, previous_gain = previous_point
            share = (beat_instant - previous_instant) / (point_instant - previous_instant)
            share = share * share * (3.0 - 2.0 * share) if is_smooth else share
            if previous_gain > 0.0 and point_gain > 0.0:
                return quantities.level_between(previous_gain, point_gain, share)
            return previous_gain + (point_gain - previous_gain) * share
        previous_point = point_instant, point_gain
    return 1.0 if previous_point is None else previous_point[1]


def with_excerpt_fades(score_texts: Texts, piece: Piece, start_beat: float) -> Texts:
    """The fades from the beat `start_beat` on, with positions counted from there."""
    tempo = piece.tempo_map

    def excerpt_points(fade: Fade) -> list[edit.Tree]:
        fade_points: list[edit.Tree] = [
            {"at": "0", "gain": _ratio_text(fade_level(fade, tempo, start_beat))}
        ]
        for fade_point in fade:
            point_beat = tempo.resolve(fade_point.at)
            if start_beat < point_beat:
                curve = "smooth" if fade_point.is_smooth else "line"
                offset_text = f"{point_beat - start_beat:.12g}"
                fade_points.append(
                    {"at": offset_text, "gain": _ratio_text(fade_point.gain), "curve": curve}
                )
        return fade_points

    if piece.mix.master is not None and piece.mix.master.fade:
        score_texts = score_texts.put(
            ("mix", "master", "fade"), edit.flow(excerpt_points(piece.mix.master.fade))
        )
    panned_routes = {
        _written_instrument_name(piece, route): route
        for route in piece.mix.routes
        if route.pan_path
    }
    for instrument_name, route in panned_routes.items():
        score_texts = _pan_from(score_texts, piece, instrument_name, route, start_beat)
    for instrument_name in dict.fromkeys(route.part for route in piece.mix.routes if route.fade):
        route = next(
            part_route
            for part_route in piece.mix.routes
            if part_route.part == instrument_name and part_route.fade
        )
        for path in _route_paths(score_texts, _written_instrument_name(piece, route)):
            score_texts = score_texts.put((*path, "fade"), edit.flow(excerpt_points(route.fade)))
    return score_texts


def _pan_from(
    score_texts: Texts, piece: Piece, instrument_name: str, route: Route, start_beat: float
) -> Texts:
    """The pan of an instrument from the beat `start_beat` on, with positions counted from there."""
    tempo = piece.tempo_map
    pan_points: list[edit.Tree] = [{"at": "0", "pan": f"{pan_of(route, tempo, start_beat):.12g}"}]
    for pan_point in route.pan_path:
        point_beat = tempo.resolve(pan_point.at)
        if start_beat < point_beat:
            curve = "smooth" if pan_point.is_smooth else "line"
            offset_text = f"{point_beat - start_beat:.12g}"
            pan_points.append({"at": offset_text, "pan": f"{pan_point.pan:.12g}", "curve": curve})
    for path in _route_paths(score_texts, instrument_name):
        score_texts = score_texts.put((*path, "pan"), edit.flow(pan_points))
    return score_texts


def _written_instrument_name(piece: Piece, route: Route) -> str:
    """The name of a route's instrument; for a note, that of the instrument it belongs to."""
    return next(
        (family_name for family_name, notes in piece.families.items() if route.part in notes),
        route.part,
    )


def _fade_points(
    piece: Piece, fade: Fade, from_beat: float, end_beat: float, *, fades_in: bool
) -> list[edit.Tree]:
    tempo = piece.tempo_map
    fade_points: list[edit.Tree] = []
    if fade or not fades_in:
        fade_points.append(
            {
                "at": position_text(piece, from_beat),
                "gain": _ratio_text(fade_level(fade, tempo, from_beat)),
            }
        )
    else:
        silent_beat = tempo.beats(tempo.seconds(from_beat) + _SILENCE_SECONDS)
        fade_points.append({"at": position_text(piece, from_beat), "gain": "0dB"})
        fade_points.append({"at": position_text(piece, silent_beat), "gain": "x0"})
    return [
        *fade_points,
        {"at": position_text(piece, end_beat), "gain": "0dB" if fades_in else "x0"},
    ]


def _ratio_text(ratio: float) -> str:
    return f"x{ratio:.12g}"


def _route_paths(score_texts: Texts, instrument_name: str) -> Iterator[edit.Path]:
    """The paths of the routes of an instrument."""
    for route_index, node in enumerate(section_entries(score_texts, "mix", "route")):
        if structure.is_route_of(node, instrument_name):
            yield entry_path(score_texts, "mix", route_index, "route")
