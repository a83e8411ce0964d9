"""The places that strokes from outside the score strike: by MIDI notes, and by `hear`."""

from __future__ import annotations

import contextlib
import itertools
from collections.abc import Iterator
from functools import lru_cache
from typing import TYPE_CHECKING

from ergon.instruments.names import Part, PartNames
from ergon.notation.tables import tuning
from ergon.notation.tables.notes import pitch
from ergon.notation.tables.shapes import Name
from ergon.notation.tables.strengths import Reach
from ergon.notation.tables.tuning import Tuning
from ergon.notation.tables.velocities import Curve
from ergon.notation.text.errors import Collector, TextError
from ergon.repl.language.commands import Hear, MapNotes
from ergon.repl.session.version import NotTakenError

if TYPE_CHECKING:
    from ergon.instruments.model import Act, Target
    from ergon.repl.session.version import Version
    from ergon.scores.reading.piece import Piece
    from ergon.scores.staging.stage import StrikePoints

_MAX_STRUCK = 128  # as many as there are notes

Place = tuple[str, str, int]  # part, module and member of a MAT that is struck
Struck = tuple[Place, Reach | None]  # with the range of its strengths, if it is played by them

# The engine's numbers of struck places: each place keeps its number as long as this process runs,
# so that a strike finds it in every version.
_numbers: dict[Place, int] = {}
_next_number = itertools.count(1)


def place_number(place: Place) -> int:
    """The engine's number of a struck place."""
    if place not in _numbers:
        _numbers.setdefault(place, next(_next_number))  # another thread may number it now
    return _numbers[place]


def strike_points(version: Version) -> StrikePoints:
    """The engine's numbers of all places that are struck from outside.

    A map is left out while the score does not have its target.
    """
    places: dict[Place, None] = {}
    for mapped in version.maps.values():
        with contextlib.suppress(NotTakenError):
            if isinstance(mapped, MapNotes):
                for note in range(mapped.low, mapped.high + 1):
                    places.update(
                        dict.fromkeys(place for place, _ in _sounding(version, mapped, note))
                    )
                    places.update(dict.fromkeys(p for p, _ in _released(version, mapped, note)))
            elif isinstance(mapped, Hear):
                places.update(dict.fromkeys(place for place, _ in struck_once(version, mapped)))
                places.update(dict.fromkeys(place for place, _ in dampers(version, mapped)))
    return [
        (part, module, member, place_number((part, module, member)))
        for part, module, member in places
    ]


# --- what `hear` strikes -------------------------------------------------------------------------


def strokes(version: Version, hear: Hear) -> Iterator[tuple[Place, float]]:
    """The places that `hear` strikes, each with its impulse [N·s]. Raises NotTakenError."""
    for place, reach in struck_once(version, hear):
        if hear.level.is_strength and reach is None:
            raise NotTakenError(f"{hear.target} does not say how it is played; write an impulse")
        yield place, hear.level.impulse(reach, max)


def struck_once(version: Version, hear: Hear) -> Iterator[Struck]:
    """The places that `hear` strikes, at whatever level. Raises NotTakenError."""
    for act in _acts_of(version.piece, hear):
        for target in act.targets:
            for place in _members(target, hear.target):
                yield _as_sounding(version, place), act.reach
    if not _is_act(version.piece, hear.target):
        if hear.notes:
            raise NotTakenError(f"{hear.target} is a module, and has no notes")
        for place in _members(_check_target(version.piece, hear.target), hear.target):
            yield _as_sounding(version, place), None


def dampers(version: Version, hear: Hear) -> Iterator[tuple[Place, float]]:
    """The places that the end of the stroke strikes, each with its impulse [N·s]; its beginning
    strikes them by the opposite. Raises NotTakenError.
    """
    for act in _acts_of(version.piece, hear):
        yield from _damped(version, act, hear.target)


def _acts_of(piece: Piece, hear: Hear) -> list[Act]:
    """The acts of the notes that are heard, one for each. Raises NotTakenError."""
    if not _is_act(piece, hear.target):
        return []
    name = hear.target.partition(".")[0]
    members = piece.families.get(name)
    if members is None:
        if hear.notes:
            raise NotTakenError(f"{name} has no notes; write `hear {hear.target}`")
        return [_act(piece, hear.target, name)]
    if not hear.notes:
        return [_act(piece, hear.target, members[len(members) // 2])]
    struck = []
    for note in hear.notes:
        part = _member_of(piece, name, note)
        if part is None:
            ends = f"{_note_of(members[0])} to {_note_of(members[-1])}"
            raise NotTakenError(f"{name} has no note {note}; its notes are {ends}")
        struck.append(_act(piece, hear.target, part))
    return struck


def _is_act(piece: Piece, path: str) -> bool:
    """Whether a path names an instrument that says how it is played, or one of its acts."""
    name, _, act_name = path.partition(".")
    instrument = piece.playable(name)
    acts = () if instrument is None else instrument.acts
    return bool(acts) and (not act_name or any(act.name == act_name for act in acts))


def _note_of(member: str) -> str:
    """The note in the name of a member: `C4` of `vib.C4`."""
    return member.rpartition(".")[2]


# --- what notes strike ---------------------------------------------------------------------------


def struck_by(piece: Piece, notes: MapNotes, note: int) -> list[Struck]:
    """What a note of a range strikes. Raises NotTakenError.

    An instrument that is played by its strengths is struck by its usual act, one with notes at
    its note. Of other targets the lowest note strikes the first MAT and the next note the second;
    a single MAT is struck by every note.
    """
    if _types_lines(piece, notes):
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


def _types_lines(piece: Piece, notes: MapNotes) -> bool:
    """Whether notes run a block or let a player play, instead of striking."""
    return notes.gesture is not None or (notes.impulse is None and notes.target in piece.blocks)


def maps_of(version: Version, note: int) -> Iterator[MapNotes]:
    """The maps whose range has a note."""
    for new in version.maps.values():
        if isinstance(new, MapNotes) and new.low <= note <= new.high:
            yield new


def struck_places(version: Version, note: int, velocity: int) -> Iterator[tuple[Place, float]]:
    """The places that a note strikes, each with its impulse [N·s]."""
    for notes in maps_of(version, note):
        curve = Curve(notes.curve)
        with contextlib.suppress(NotTakenError):
            for place, reach in _sounding(version, notes, note):
                if notes.impulse is None:
                    yield place, curve.level(velocity).impulse(reach, max)
                else:
                    weak, strong = notes.impulse
                    yield place, weak + (strong - weak) * float(curve.share(velocity, 1))


def released_places(version: Version, note: int) -> Iterator[tuple[Place, float]]:
    """The places that the end of a note strikes, each with its impulse [N·s]; its beginning strikes
    them by the opposite.
    """
    for notes in maps_of(version, note):
        with contextlib.suppress(NotTakenError):
            yield from _released(version, notes, note)


def _released(version: Version, notes: MapNotes, note: int) -> Iterator[tuple[Place, float]]:
    if notes.impulse is not None or _types_lines(version.piece, notes):
        return
    for act in _acts(version.piece, notes.target, note):
        yield from _damped(version, act, notes.target)


def _sounding(version: Version, notes: MapNotes, note: int) -> list[Struck]:
    """What a note strikes, as the engine knows it. Raises NotTakenError."""
    struck = struck_by(version.piece, notes, note)
    return [(_as_sounding(version, place), reach) for place, reach in struck]


# --- both ----------------------------------------------------------------------------------------


def _as_sounding(version: Version, place: Place) -> Place:
    part, module, member = place
    return version.sounds_as.of(part), module, member


def _damped(version: Version, act: Act, path: str) -> Iterator[tuple[Place, float]]:
    """What the end of a note of an act strikes, as the engine knows it. Raises NotTakenError."""
    if act.release is None:
        return
    for target in act.release.targets:
        for place in _members(target, path):
            yield _as_sounding(version, place), act.release.impulse


def _acts(piece: Piece, target: str, note: int) -> list[Act]:
    """The act by which an instrument is played at a note; none if it does not have the note.
    Raises NotTakenError.
    """
    name = target.partition(".")[0]
    part = _member_of(piece, name, note) if name in piece.families else name
    return [] if part is None else [_act(piece, target, part)]


def _member_of(piece: Piece, name: str, note: int | str) -> str | None:
    """The member of an instrument with notes that has a pitch, or that a MIDI note plays, by the
    tuning of the instrument; None if there is none.
    """
    tuned = piece.tuning_of(name)
    with tuning.used(tuned):
        try:
            height = pitch(note if isinstance(note, str) else tuning.current().key_word(note))
        except TextError:  # a key that the keyboard map leaves out
            return None
    members = _by_pitch(piece.families[name], tuned)
    return None if height is None else tuning.nearby(members, height)


@lru_cache(64)
def _by_pitch(members: tuple[str, ...], tuned: Tuning | None) -> dict[float, str]:
    with tuning.used(tuned):
        return {pitch(_note_of(member)) or 0.0: member for member in members}


def _act(piece: Piece, target: str, part: str) -> Act:
    """The act by which a part of an instrument is played. Raises NotTakenError."""
    name, _, act_name = target.partition(".")
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
    return act


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


def _check_target(piece: Piece, text: str) -> Target:
    collector = Collector()
    parts = {
        name: Part(name, {module.name: module for module in instrument.modules})
        for name, instrument in piece.instruments.items()
    }
    with tuning.used(piece.tuning_of(text)):
        target = PartNames(collector, parts).target(Name(text, piece.place), "mats", "map")
    if target is None:
        raise NotTakenError(collector.finish()[0].message)
    return target
