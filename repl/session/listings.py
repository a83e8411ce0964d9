"""What `instruments`, `gestures` and `scenes` list, a line for each."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from ergon.live.display import decibels_of
from ergon.notation.clock.meter import SAME
from ergon.notation.text.edit import EditError
from ergon.notation.text.spelling import nearest
from ergon.repl.language.scope import scores_in
from ergon.repl.session.disk import folder_of
from ergon.repl.session.scene_edits import read_scene
from ergon.repl.session.version import NotTakenError
from ergon.scores.gesture import space_path
from ergon.scores.reading import families
from ergon.scores.reading.families import Member

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ergon.scores.edits.scenes import Scene
    from ergon.scores.edits.texts import Texts
    from ergon.scores.reading.outputs import Route
    from ergon.scores.reading.piece import Piece
    from ergon.scores.reading.playing import Gesture

_SCENES_MAX = 50  # scores of a folder whose lengths are looked up


def instrument_lines(score_texts: Texts, piece: Piece) -> list[str]:
    """The instruments of a score with their routes; then the families."""
    part_by_name = {name: name for name in piece.instruments if name not in piece.note_families()}
    part_by_name |= {name: members[0] for name, members in piece.families.items()}
    routes_by_name = {name: _routes_text(piece, part) for name, part in part_by_name.items()}
    instrument_rows = _two_columns(routes_by_name) or ["no instrument yet"]
    instrument_counts = {
        name: f"{len(members)} instruments" if len(members) > 1 else "1 instrument"
        for name, members in _members_by_family(score_texts, piece).items()
    }
    used_family_texts = {
        name: f"{text}, in use" for name, text in instrument_counts.items() if name in piece.used
    }
    return [
        *instrument_rows,
        "families, by `use NAME`:",
        *_two_columns({**instrument_counts, **used_family_texts}, indent="  "),
    ]


def family_lines(score_texts: Texts, piece: Piece, family_name: str) -> list[str]:
    """The instruments of a family, with what each is. Raises NotTakenError."""
    members_by_family = _members_by_family(score_texts, piece)
    if family_name not in members_by_family:
        suggestion = nearest(family_name, members_by_family)
        message = f"no family of instruments is called {family_name}"
        raise NotTakenError(message, None if suggestion is None else f"instruments {suggestion}")
    return _two_columns({member.name: member.comment for member in members_by_family[family_name]})


def gesture_lines(piece: Piece) -> list[str]:
    """The gestures with their lengths and numbers of points, then the takes."""
    gesture_rows: dict[str, str] = {}
    for gesture_name, gesture in piece.gestures.items():
        path_name = gesture_name.rpartition(".")[0]
        axis_names = space_path.played_names(path_name, piece.gestures) if path_name else []
        if gesture_name in axis_names:
            gesture_rows[path_name] = f"a path in space, {_gesture_text(gesture)}"
        else:
            gesture_rows[gesture_name] = _gesture_text(gesture)
    for gesture_name, take in piece.takes.items():
        gesture_rows[gesture_name] = f"take, {take.path.name}" if take.path else "take, an input"
    return _two_columns(gesture_rows) or [
        "no gesture yet; `knock = 0@0 smooth 7@1/8 smooth 0@1/4` defines one"
    ]


def scene_lines(score_texts: Texts) -> list[str]:
    """The scores beside a score, with their lengths."""
    score_path = Path(score_texts.path).resolve()
    scene_names = [
        path.stem for path in scores_in(folder_of(score_texts)) if path.resolve() != score_path
    ]
    scene_rows = {}
    for number, scene_name in enumerate(dict.fromkeys(scene_names)):
        scene_rows[scene_name] = ""
        if number < _SCENES_MAX:
            try:
                scene_rows[scene_name] = _length_text(read_scene(score_texts, scene_name))
            except (NotTakenError, EditError) as error:
                scene_rows[scene_name] = f"cannot be played: {error}"
    return _two_columns(scene_rows) or ["no scene yet; `keep 8bar as verse-2` makes one"]


def _members_by_family(score_texts: Texts, piece: Piece) -> Mapping[str, Sequence[Member]]:
    """The families that ship, and the files that a score uses."""
    members_by_family = dict(families.library())
    score_names, _ = score_texts.names()
    for name in piece.used:
        if name in score_names.used_names:
            members_by_family[name] = families.members(score_names.used_names[name].document)
    return members_by_family


def _routes_text(piece: Piece, part: str) -> str:
    routes = [route for route in piece.routes() if route.part == part]
    route_texts = dict.fromkeys(", ".join(_route_text(route)) for route in routes)
    return "; ".join(route_texts) or "is not routed"


def _route_text(route: Route) -> Iterator[str]:
    """Where an output sounds, how loud, and from which place."""
    output_text = "" if route.out is None else f"{route.out} "
    channel_text = route.to if isinstance(route.to, str) else " ".join(map(str, route.to))
    yield f"{output_text}to {channel_text}"
    if route.gain != 1.0:
        yield f"{decibels_of(route.gain):.3g} dB"
    if route.pan is not None:
        yield f"pan {2.0 * route.pan[1] ** 2 - 1.0:.2g}"
    if route.pan_path:
        yield f"pan {' -> '.join(f'{point.pan:.2g}' for point in route.pan_path)}"
    for tone in route.tones:
        shelf_text = f" {tone.level:.3g} dB" if tone.level else ""
        yield f"{tone.kind} {tone.frequency:g} Hz{shelf_text}"
    if route.echo is not None:
        yield f"delay {1e3 * route.echo.time:g} ms"
    for room, gain in route.sends:
        yield f"{room} {decibels_of(gain):.3g} dB"


def _gesture_text(gesture: Gesture) -> str:
    last_position = gesture.points[-1].at
    length_texts = []
    if last_position.beats:
        length_texts.append(
            f"{last_position.beats:g} beat{'s' if last_position.beats != 1.0 else ''}"
        )
    if last_position.seconds or not length_texts:
        length_texts.append(f"{1e3 * last_position.seconds:g} ms")
    n_points = len(gesture.points)
    return f"{' + '.join(length_texts)}, {n_points} point{'s' if n_points > 1 else ''}"


def _length_text(scene: Scene) -> str:
    """`8 bars`, `8 bars and 2 beats`."""
    bar, beat_in_bar = scene.piece.tempo_map.bar_beat(scene.beats + SAME)
    bars, beats = bar - 1, round(beat_in_bar - 1.0, 3)
    text = f"{bars} bar{'s' if bars != 1 else ''}"
    return f"{text} and {beats:g} beats" if beats else text


def _two_columns(rows: Mapping[str, str], indent: str = "") -> list[str]:
    """Names and a text for each, in two columns."""
    width = min(max(map(len, rows), default=0), 20) + 2
    return [f"{indent}{name:<{width}}{text}".rstrip() for name, text in rows.items()]
