"""Maps of MIDI controllers and notes to parameters, levels and places that are struck."""

from __future__ import annotations

import contextlib
import itertools
import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from math import isfinite
from typing import TYPE_CHECKING

from ergon.instruments.names import Part, PartNames
from ergon.notation.tables.notes import number
from ergon.notation.tables.shapes import Name
from ergon.notation.tables.strengths import Reach
from ergon.notation.tables.strengths import velocity as strength_of_velocity
from ergon.notation.text.errors import Collector
from ergon.repl.language.commands import BPM_UNIT, MapControl, MapNotes
from ergon.repl.session.version import NotTakenError

if TYPE_CHECKING:
    from ergon.instruments.model import Act, Target
    from ergon.live.midi_messages import Control
    from ergon.repl.session.journal import JournalEvent
    from ergon.repl.session.version import Version
    from ergon.scores.reading.piece import Piece
    from ergon.scores.staging.stage import StrikePoints

MAX_MAPS = 256
_MAX_STRUCK = 128  # as many as there are notes
_MIDI_MAX = 127
_WORD = re.compile(r"[\w.-]{1,200}")  # a name of a score, with its dots
_UNIT = re.compile(r"[A-Za-z0-9/]{0,8}")

Map = MapControl | MapNotes
Place = tuple[str, str, int]  # part, module and member of a MAT that is struck
Struck = tuple[Place, Reach | None]  # with the range of its strengths, if it is played by them

# The engine's numbers of struck places: each place keeps its number as long as this process runs,
# so that a strike finds it in every version.
_numbers: dict[Place, int] = {}
_next_number = itertools.count(1)


def with_map(version: Version, new: Map) -> Mapping[str, Map]:
    """The maps of a version with a new one, which replaces one of the same name. Raises
    NotTakenError.
    """
    if isinstance(new, MapNotes):
        for note in range(new.low, new.high + 1):
            struck_by(version.piece, new, note)
    if len(version.maps) >= MAX_MAPS and new.name not in version.maps:
        raise NotTakenError(f"a session has at most {MAX_MAPS} maps; `unmap` one first")
    return {**version.maps, new.name: new}


def without_map(version: Version, name: str) -> Mapping[str, Map]:
    """The maps of a version without one of them. Raises NotTakenError."""
    if name not in version.maps:
        known = ", ".join(version.maps) or "there are none"
        raise NotTakenError(f"nothing is mapped to {name}; the maps: {known}")
    return {other: own for other, own in version.maps.items() if other != name}


def struck_by(piece: Piece, notes: MapNotes, note: int) -> list[Struck]:
    """What a note of a range strikes. Raises NotTakenError.

    An instrument that is played by its strengths is struck by its usual act, one with notes at
    its note. Of other targets the lowest note strikes the first MAT and the next note the second;
    a single MAT is struck by every note.
    """
    if notes.impulse is None and notes.target in piece.blocks:
        return []
    if notes.impulse is None:
        return [
            (place, act.reach)
            for act in _acts(piece, notes.target, note)
            for target in act.targets
            for place in _members(target, notes.target)
        ]
    members = _members(_check_target(piece, notes.target), notes.target)
    member = note - notes.low if len(members) > 1 else 0
    return [(members[member], None)] if member < len(members) else []


def _acts(piece: Piece, target: str, note: int) -> list[Act]:
    """The act by which an instrument is played at a note; none if it does not have the note.
    Raises NotTakenError.
    """
    name, _, act_name = target.partition(".")
    part = name
    if name in piece.families:
        numbered = {number(member.rpartition(".")[2]): member for member in piece.families[name]}
        if note not in numbered:
            return []
        part = numbered[note]
    instrument = piece.instruments.get(part)
    acts = {} if instrument is None else {act.name: act for act in instrument.acts}
    if act_name and act_name not in acts:
        known = ", ".join(acts) or "there is none"
        raise NotTakenError(f"{name} has no act {act_name}; the acts: {known}")
    if not acts:
        raise NotTakenError(f"{name} does not say how it is played; write impulses, as 1mNs..20mNs")
    act = acts[act_name] if act_name else next(iter(acts.values()))
    known_modules = {module.name for module in instrument.modules} if instrument else set()
    if not {module.name for module in act.modules} <= known_modules:
        raise NotTakenError(f"{part} has nothing for {act.name} yet; play it by a line first")
    return [act]


def _members(target: Target, text: str) -> list[Place]:
    """The MATs of a target, in their order. Raises NotTakenError."""
    if target.first == "centre":
        return [(target.part, target.module, -1)]
    if target.count > _MAX_STRUCK:
        raise NotTakenError(
            f"{text} has {target.count:,} masses, and notes strike {_MAX_STRUCK} at most; "
            "name some of them"
        )
    first = target.first
    return [(target.part, target.module, first + i) for i in range(target.count)]


def _sounding(version: Version, notes: MapNotes, note: int) -> list[Struck]:
    """What a note strikes, as the engine knows it. Raises NotTakenError."""
    struck = struck_by(version.piece, notes, note)
    return [
        ((version.sounds_as.of(part), module, member), reach)
        for (part, module, member), reach in struck
    ]


def rename_in_maps(maps: Mapping[str, Map], old: str, new: str) -> Mapping[str, Map]:
    """Maps in which a renamed key or instrument has its new name."""

    def called(text: str | None) -> str | None:
        head, dot, rest = (text or "").partition(".")
        return f"{new}{dot}{rest}" if head == old else text

    found: dict[str, Map] = {}
    for name, own in maps.items():
        if isinstance(own, MapNotes):
            found[name] = replace(own, target=called(own.target) or own.target)
        else:
            found[name] = replace(own, target=called(own.target), sounding=called(own.sounding))
    return found


def _check_target(piece: Piece, text: str) -> Target:
    collector = Collector()
    parts = {
        name: Part(name, {module.name: module for module in own.modules})
        for name, own in piece.instruments.items()
    }
    found = PartNames(collector, parts).target(Name(text, piece.place), "mats", "map")
    if found is None:
        raise NotTakenError(collector.finish()[0].message)
    return found


def place_number(place: Place) -> int:
    """The engine's number of a struck place."""
    if place not in _numbers:
        _numbers.setdefault(place, next(_next_number))  # another thread may number it now
    return _numbers[place]


def strike_points(version: Version) -> StrikePoints:
    """The engine's numbers of all places that notes may strike.

    A map is left out while the score does not have its target.
    """
    found: dict[Place, None] = {}
    for own in version.maps.values():
        if isinstance(own, MapNotes):
            try:
                for note in range(own.low, own.high + 1):
                    found.update(dict.fromkeys(place for place, _ in _sounding(version, own, note)))
                    found.update(dict.fromkeys(p for p, _ in _released(version, own, note)))
            except NotTakenError:
                continue
    return [
        (part, module, member, place_number((part, module, member)))
        for part, module, member in found
    ]


def _maps_of(version: Version, note: int) -> Iterator[MapNotes]:
    """The maps whose range has a note."""
    for new in version.maps.values():
        if isinstance(new, MapNotes) and new.low <= note <= new.high:
            yield new


def struck_places(version: Version, note: int, velocity: int) -> Iterator[tuple[Place, float]]:
    """The places that a note strikes, each with its impulse [N·s]."""
    for notes in _maps_of(version, note):
        with contextlib.suppress(NotTakenError):
            for place, reach in _sounding(version, notes, note):
                if notes.impulse is None:
                    yield place, strength_of_velocity(velocity).impulse(reach, max)
                else:
                    weak, strong = notes.impulse
                    yield place, weak + (strong - weak) * (velocity - 1) / (_MIDI_MAX - 1)


def released_places(version: Version, note: int) -> Iterator[tuple[Place, float]]:
    """The places that the end of a note strikes, each with its impulse [N·s]; its beginning strikes
    them by the opposite.
    """
    for notes in _maps_of(version, note):
        with contextlib.suppress(NotTakenError):
            yield from _released(version, notes, note)


def _released(version: Version, notes: MapNotes, note: int) -> Iterator[tuple[Place, float]]:
    if notes.impulse is not None or notes.target in version.piece.blocks:
        return
    for act in _acts(version.piece, notes.target, note):
        if (release := act.release) is None:
            continue
        for target in release.targets:
            for part, module, member in _members(target, notes.target):
                yield (version.sounds_as.of(part), module, member), release.impulse


def run_lines(version: Version, note: int) -> Iterator[str]:
    """The lines that run the blocks to which a note is mapped."""
    for notes in _maps_of(version, note):
        if notes.impulse is None and notes.target in version.piece.blocks:
            yield f"run {notes.target} now"


def controller_line(moved: Control, version: Version) -> str | None:
    """The line that sets the value of a moved controller; None if it has no map."""
    own = version.maps.get(f"cc {moved.number}")
    if not isinstance(own, MapControl):
        return None
    low, high = own.range
    x = low + (high - low) * moved.value / _MIDI_MAX
    if own.unit == BPM_UNIT:
        return f"tempo {x:.6g} now"
    if own.target is not None:
        return f"set {own.target} {x:.6g}{own.unit} over 50ms now"
    name = "" if own.sounding is None else f"{own.sounding} "
    return f"gain {name}{x:.6g}dB now"


def maps_field(maps: Mapping[str, Map]) -> dict[str, object]:
    """The journal field for maps; empty if there are none."""
    return {"maps": [_row(own) for own in maps.values()]} if maps else {}


def _row(own: Map) -> list[object]:
    if isinstance(own, MapNotes):
        return ["note", own.low, own.high, own.target, *(own.impulse or ())]
    return ["cc", own.number, own.target, own.sounding, own.unit, *own.range]


def read_maps(event: JournalEvent) -> Mapping[str, Map]:
    """The maps in a journal's event. Raises JournalError."""
    rows: list[object] = event.get("maps", list, [])
    if len(rows) > MAX_MAPS:
        event.refuse("it has more maps than a session can have")
    found = [_read_row(event, row) for row in rows]
    return {own.name: own for own in found}


def _read_row(event: JournalEvent, row: object) -> Map:
    match row:
        case ["note", int(low), int(high), str(target), float(weak), float(strong)] if (
            0 <= low <= high <= _MIDI_MAX and _WORD.fullmatch(target) and isfinite(weak + strong)
        ):
            return MapNotes(low, high, target, (weak, strong))
        case ["note", int(low), int(high), str(target)] if (
            0 <= low <= high <= _MIDI_MAX and _WORD.fullmatch(target)
        ):
            return MapNotes(low, high, target, None)
        case [
            "cc",
            int(number),
            str() | None as target,
            str() | None as sounding,
            str(unit),
            float(low),
            float(high),
        ] if (
            0 <= number <= _MIDI_MAX
            and _WORD.fullmatch(target or "all")
            and _WORD.fullmatch(sounding or "all")
            and _UNIT.fullmatch(unit)
            and isfinite(low + high)
        ):
            return MapControl(number, target, (low, high), unit, sounding)
    event.refuse("the field 'maps' has the wrong type or value")
