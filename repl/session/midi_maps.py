"""Maps of MIDI controllers and notes to parameters, levels and places that are struck."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from math import isfinite
from typing import TYPE_CHECKING

from ergon.notation.tables.notes import name
from ergon.notation.tables.strengths import MEZZO_FORTE
from ergon.notation.tables.tuning import is_pitch
from ergon.notation.tables.velocities import LAWS
from ergon.repl.language.hearing import Hear
from ergon.repl.language.mapping import BPM_UNIT, EVEN_CURVE, MapControl, MapNotes
from ergon.repl.language.midi import is_source
from ergon.repl.session.struck_places import maps_of, places_of_line, places_of_note
from ergon.repl.session.version import NotTakenError

if TYPE_CHECKING:
    from ergon.repl.session.journal import JournalEvent
    from ergon.repl.session.version import Version

MAX_MAPS = 256
MAX_HEAR = 16  # places of the last `hear` commands that stay ready
_MIDI_MAX = 127
_WORD_PATTERN = re.compile(r"[\w.-]{1,200}")  # a name of a score, with its dots
_UNIT_PATTERN = re.compile(r"[A-Za-z0-9/]{0,8}")

Map = MapControl | MapNotes | Hear  # `hear` needs its places as a map of notes does


def with_map(version: Version, new_map: Map) -> Mapping[str, Map]:
    """The maps of a version with a new one, which replaces one of the same name. Raises
    NotTakenError.
    """
    if isinstance(new_map, MapNotes) and new_map.gesture is None:
        for note in range(new_map.low, new_map.high + 1):
            places_of_note(version.piece, new_map, note)
    maps = dict(version.maps)
    if isinstance(new_map, Hear):
        for _ in places_of_line(version, new_map):  # refuses places that do not exist yet
            pass
        maps_to_replace = [
            name
            for name, midi_map in maps.items()
            if isinstance(midi_map, Hear) and name != new_map.name
        ]
        for name in maps_to_replace[: max(0, len(maps_to_replace) - MAX_HEAR + 1)]:
            del maps[name]
    elif len(player_maps(maps)) >= MAX_MAPS and new_map.name not in maps:
        raise NotTakenError(f"a session has at most {MAX_MAPS} maps; `unmap` one first")
    return {**maps, new_map.name: new_map}


def player_maps(maps: Mapping[str, Map]) -> dict[str, MapControl | MapNotes]:
    """The maps that a player made, without those of `hear`."""
    return {name: midi_map for name, midi_map in maps.items() if not isinstance(midi_map, Hear)}


def without_map(version: Version, map_name: str) -> Mapping[str, Map]:
    """The maps of a version without one of them. Raises NotTakenError."""
    if map_name not in player_maps(version.maps):
        known_names = ", ".join(player_maps(version.maps)) or "there are none"
        raise NotTakenError(f"nothing is mapped to {map_name}; the maps: {known_names}")
    return {
        other_name: midi_map
        for other_name, midi_map in version.maps.items()
        if other_name != map_name
    }


def rename_in_maps(maps: Mapping[str, Map], old_name: str, new_name: str) -> Mapping[str, Map]:
    """The maps after a renaming."""

    def rename_path(text: str | None) -> str | None:
        first_word, dot, path_rest = (text or "").partition(".")
        return f"{new_name}{dot}{path_rest}" if first_word == old_name and text else text

    renamed_maps: list[Map] = []
    for midi_map in maps.values():
        if isinstance(midi_map, MapControl):
            renamed_maps.append(
                replace(
                    midi_map,
                    target=rename_path(midi_map.target),
                    sounding=rename_path(midi_map.sounding),
                )
            )
            continue
        midi_map = replace(midi_map, target=rename_path(midi_map.target) or midi_map.target)
        if isinstance(midi_map, MapNotes):
            midi_map = replace(midi_map, gesture=rename_path(midi_map.gesture))
        renamed_maps.append(midi_map)
    return {midi_map.name: midi_map for midi_map in renamed_maps}


def note_lines(version: Version, note_number: int) -> Iterator[str]:
    """The lines that a note types: those that run a block, or let a player play a gesture."""
    piece = version.piece
    for note_map in maps_of(version, note_number):
        if note_map.gesture is not None:
            if note_map.target in piece.players:
                yield f"{note_map.target} plays {note_map.gesture} now"
        elif note_map.impulse is None and note_map.target in piece.blocks:
            yield f"run {note_map.target} now"


def line_at_position(source_name: str, position: float, version: Version) -> str | None:
    """The line that sets the target of a controller at a share (0 to 1) of its range; None
    without a map.
    """
    control = version.maps.get(source_name)
    return line_of_value(control, position) if isinstance(control, MapControl) else None


def line_of_value(control: MapControl, position: float) -> str:
    """The line that sets the target of a map, at a share (0 to 1) of its range."""
    low, high = control.range
    target_value = low + (high - low) * position
    if control.unit == BPM_UNIT:
        return f"tempo {target_value:.6g} now"
    if control.target is not None:
        return f"set {control.target} {target_value:.6g}{control.unit} over 50ms now"
    level_name = "" if control.sounding is None else f"{control.sounding} "
    return f"gain {level_name}{target_value:.6g}dB now"


def maps_field(maps: Mapping[str, Map]) -> dict[str, object]:
    """The journal field for maps; empty if there are none."""
    return {"maps": [_map_row(control_map) for control_map in maps.values()]} if maps else {}


def _map_row(midi_map: Map) -> list[object]:
    if isinstance(midi_map, Hear):
        return ["hear", midi_map.target, *midi_map.notes]
    if isinstance(midi_map, MapNotes):
        impulse = None if midi_map.impulse is None else [*midi_map.impulse]
        return [
            "notes",
            midi_map.low,
            midi_map.high,
            midi_map.target,
            impulse,
            midi_map.gesture,
            midi_map.curve,
        ]
    return [
        "control",
        midi_map.source,
        midi_map.target,
        midi_map.sounding,
        midi_map.unit,
        *midi_map.range,
    ]


def read_maps(journal_event: JournalEvent) -> Mapping[str, Map]:
    """The maps in a journal's event. Raises JournalError."""
    map_rows: list[object] = journal_event.get("maps", list, [])
    if len(map_rows) > MAX_MAPS + MAX_HEAR:
        journal_event.refuse("it has more maps than a session can have")
    maps = [_read_row(journal_event, row) for row in map_rows]
    return {control_map.name: control_map for control_map in maps}


def _hear_notes(written_notes: list[object]) -> tuple[str, ...] | None:
    """The notes of `hear`: words of pitches, or numbers, as journals had them before there were
    tunings; None if something else is among them.
    """
    note_words = []
    for written_note in written_notes:
        if isinstance(written_note, str) and is_pitch(written_note):
            note_words.append(written_note)
        elif isinstance(written_note, int) and 0 <= written_note <= _MIDI_MAX:
            note_words.append(name(written_note))
        else:
            return None
    return tuple(note_words)


def _read_row(journal_event: JournalEvent, row: object) -> Map:
    match row:
        case ["hear", str(target_text), *notes] if _WORD_PATTERN.fullmatch(target_text):
            note_words = _hear_notes(notes)
            if note_words is not None:
                return Hear(target_text, note_words, MEZZO_FORTE)
        case [
            "note",
            low_number,
            high_number,
            target_text,
        ]:  # journals before maps had curves
            return _read_row(
                journal_event,
                ["notes", low_number, high_number, target_text, None, None, EVEN_CURVE],
            )
        case ["note", low_number, high_number, target_text, weak, strong]:
            return _read_row(
                journal_event,
                ["notes", low_number, high_number, target_text, [weak, strong], None, EVEN_CURVE],
            )
        case ["cc", int(number), *rest]:
            return _read_row(journal_event, ["control", f"cc {number}", *rest])
        case [
            "notes",
            int(low_number),
            int(high_number),
            str(target_text),
            [float(), float()] | None as impulse,
            str() | None as gesture,
            str(curve_name),
        ] if (
            0 <= low_number <= high_number <= _MIDI_MAX
            and _WORD_PATTERN.fullmatch(target_text)
            and _WORD_PATTERN.fullmatch(gesture or "none")
            and isfinite(sum(impulse or ()))
            and curve_name in LAWS
        ):
            impulse_range = None if impulse is None else (impulse[0], impulse[1])
            return MapNotes(
                low_number, high_number, target_text, impulse_range, gesture, curve_name
            )
        case [
            "control",
            str(source_name),
            str() | None as target_text,
            str() | None as sounding,
            str(unit_name),
            float(low_number),
            float(high_number),
        ] if (
            is_source(source_name)
            and _WORD_PATTERN.fullmatch(target_text or "all")
            and _WORD_PATTERN.fullmatch(sounding or "all")
            and _UNIT_PATTERN.fullmatch(unit_name)
            and isfinite(low_number + high_number)
        ):
            return MapControl(
                source_name, target_text, (low_number, high_number), unit_name, sounding
            )
    journal_event.refuse("the field 'maps' has the wrong type or value")
