"""The places that strokes from outside the score strike: by MIDI notes, and by `hear`."""

from __future__ import annotations

import contextlib
import itertools
from collections.abc import Iterator
from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple

from ergon.instruments.model import PRESS
from ergon.instruments.names import PartContents, PartNames
from ergon.notation.tables import tuning
from ergon.notation.tables.notes import pitch
from ergon.notation.tables.shapes import Name
from ergon.notation.tables.strengths import ImpulseRange, Level
from ergon.notation.tables.strengths import velocity as velocity_level
from ergon.notation.tables.tuning import Tuning
from ergon.notation.tables.velocities import Curve
from ergon.notation.text.errors import Collector, TextError
from ergon.repl.language.hearing import Hear
from ergon.repl.language.mapping import MapNotes
from ergon.repl.session.version import NotTakenError

if TYPE_CHECKING:
    from ergon.instruments.model import Act, Target
    from ergon.repl.session.version import Version
    from ergon.scores.reading.piece import Piece
    from ergon.scores.staging.stage import StrikePoints

_STRUCK_MATS_MAX = 128  # one for each MIDI note

Place = tuple[str, str, int]  # part, module and member of a MAT that is struck
PlaceAndRange = tuple[
    Place, ImpulseRange | None
]  # with the impulses of its softest and hardest stroke


class Stroke(NamedTuple):
    """What the beginning of a note strikes, and its impulse [N·s].

    If it `lasts_as_note`, the end of the note strikes it by the opposite impulse.
    """

    place: Place
    impulse: float
    lasts_as_note: bool = False


# The engine's numbers of struck places: each place keeps its number as long as this process runs,
# so that a strike finds it in every version.
_place_numbers: dict[Place, int] = {}
_number_counter = itertools.count(1)


def place_number(struck_place: Place) -> int:
    """The engine's number of a struck place."""
    if struck_place not in _place_numbers:
        # Another thread may number it now.
        _place_numbers.setdefault(struck_place, next(_number_counter))
    return _place_numbers[struck_place]


def strike_points(version: Version) -> StrikePoints:
    """The engine's numbers of all places that are struck from outside.

    A map is left out while the score does not have its target.
    """
    numbered_places: dict[Place, None] = {}
    for midi_map in version.maps.values():
        with contextlib.suppress(NotTakenError):
            if isinstance(midi_map, MapNotes):
                for note_number in range(midi_map.low, midi_map.high + 1):
                    numbered_places.update(
                        (place, None) for place, _ in _note_places(version, midi_map, note_number)
                    )
                    acts = _played_acts(version.piece, midi_map, note_number)
                    acts += _pressing_acts(version.piece, midi_map, note_number)
                    numbered_places.update(
                        (act_place, None)
                        for act_place in _act_places(version, acts, midi_map.target)
                    )
            elif isinstance(midi_map, Hear):
                numbered_places.update(
                    (place, None) for place, _ in places_of_line(version, midi_map)
                )
                acts = _acts_of(version.piece, midi_map)
                numbered_places.update(
                    (act_place, None) for act_place in _act_places(version, acts, midi_map.target)
                )
    return [
        (part, module, member, place_number((part, module, member)))
        for part, module, member in numbered_places
    ]


def _act_places(version: Version, acts: list[Act], path: str) -> Iterator[Place]:
    """All places that acts strike."""
    for act in acts:
        for targets in (act.targets, *(hold.targets for hold in act.holds)):
            for target in targets:
                for place in _member_mats(target, path):
                    yield _sounding_place(version, place)


# --- what `hear` strikes -------------------------------------------------------------------------


def strokes_of_line(version: Version, hear: Hear) -> Iterator[Stroke]:
    """What `hear` strikes. Raises NotTakenError."""
    for act in _acts_of(version.piece, hear):
        yield from _act_strokes(version, act, hear.level, hear.target)
    if not _is_act(version.piece, hear.target):
        for struck_place, _ in places_of_line(version, hear):
            if hear.level.is_strength:
                message = f"{hear.target} does not say how it is played; write an impulse"
                raise NotTakenError(message)
            yield Stroke(struck_place, hear.level.impulse(None, max))


def places_of_line(version: Version, hear: Hear) -> Iterator[PlaceAndRange]:
    """The places that `hear` strikes, at whatever level. Raises NotTakenError."""
    for act in _acts_of(version.piece, hear):
        for target in act.targets:
            for struck_place in _member_mats(target, hear.target):
                yield _sounding_place(version, struck_place), act.reach
    if not _is_act(version.piece, hear.target):
        if hear.notes:
            raise NotTakenError(f"{hear.target} is a module, and has no notes")
        for struck_place in _member_mats(_check_target(version.piece, hear.target), hear.target):
            yield _sounding_place(version, struck_place), None


def _acts_of(piece: Piece, hear: Hear) -> list[Act]:
    """The acts of the notes that are heard, one for each. Raises NotTakenError."""
    if not _is_act(piece, hear.target):
        return []
    instrument_name = hear.target.partition(".")[0]
    note_members = piece.families.get(instrument_name)
    if note_members is None:
        if hear.notes:
            message = (
                f"{instrument_name} has no notes; write `hear {hear.target}`, or make one that "
                "has: "
            )
            raise NotTakenError(
                f"{message}`{instrument_name}-notes = {instrument_name} notes=C3..C5`"
            )
        return [_act_of_part(piece, hear.target, instrument_name)]
    if not hear.notes:
        return [_act_of_part(piece, hear.target, note_members[len(note_members) // 2])]
    struck_acts = []
    for note_word in hear.notes:
        member_name = _member_of(piece, instrument_name, note_word)
        if member_name is None:
            range_text = f"{_note_of(note_members[0])} to {_note_of(note_members[-1])}"
            raise NotTakenError(
                f"{instrument_name} has no note {note_word}; its notes are {range_text}"
            )
        struck_acts.append(_act_of_part(piece, hear.target, member_name))
    return struck_acts


def _is_act(piece: Piece, path: str) -> bool:
    """Whether a path names an instrument that says how it is played, or one of its acts."""
    name, _, act_name = path.partition(".")
    instrument = piece.playable_instrument(name)
    acts = () if instrument is None else instrument.acts
    return bool(acts) and (not act_name or any(act.name == act_name for act in acts))


def _note_of(member: str) -> str:
    """The note in the name of a member: `C4` of `vib.C4`."""
    return member.rpartition(".")[2]


# --- what notes strike ---------------------------------------------------------------------------


def places_of_note(piece: Piece, map_notes: MapNotes, note_number: int) -> list[PlaceAndRange]:
    """What a note of a range strikes. Raises NotTakenError.

    An instrument that is played by its strengths is struck by its usual act, one with notes at
    its note. Of other targets the lowest note strikes the first MAT and the next note the second;
    a single MAT is struck by every note.
    """
    if _types_lines(piece, map_notes):
        return []
    if map_notes.impulse is None:
        return [
            (place, act.reach)
            for act in _acts_at_note(piece, map_notes.target, note_number)
            for target in act.targets
            for place in _member_mats(target, map_notes.target)
        ]
    struck_mats = _member_mats(_check_target(piece, map_notes.target), map_notes.target)
    mat_index = note_number - map_notes.low if len(struck_mats) > 1 else 0
    return [(struck_mats[mat_index], None)] if mat_index < len(struck_mats) else []


def _types_lines(piece: Piece, map_notes: MapNotes) -> bool:
    """Whether notes run a block or let a player play, instead of striking."""
    return map_notes.gesture is not None or (
        map_notes.impulse is None and map_notes.target in piece.blocks
    )


def maps_of(version: Version, note_number: int) -> Iterator[MapNotes]:
    """The maps whose range has a note."""
    for note_map in version.maps.values():
        if isinstance(note_map, MapNotes) and note_map.low <= note_number <= note_map.high:
            yield note_map


def struck_places(version: Version, note_number: int, velocity: int) -> Iterator[Stroke]:
    """What a note strikes."""
    for map_notes in maps_of(version, note_number):
        level_curve = Curve(map_notes.curve)
        with contextlib.suppress(NotTakenError):
            if map_notes.impulse is None:
                for act in _played_acts(version.piece, map_notes, note_number):
                    yield from _act_strokes(
                        version, act, level_curve.level(velocity), map_notes.target
                    )
                continue
            for struck_place, _ in _note_places(version, map_notes, note_number):
                softest, loudest = map_notes.impulse
                impulse = softest + (loudest - softest) * float(level_curve.share(velocity, 1))
                yield Stroke(struck_place, impulse)


def pressed_places(
    version: Version, note_number: int, pressure_value: int
) -> Iterator[tuple[Place, float]]:
    """The places that press on the note of a key, each with the impulse [N·s] that presses as
    strongly as the key is pressed, 0 to 127.
    """
    for map_notes in maps_of(version, note_number):
        with contextlib.suppress(NotTakenError):
            for act in _pressing_acts(version.piece, map_notes, note_number):
                impulse = (
                    velocity_level(pressure_value).impulse(act.reach, max)
                    if pressure_value
                    else 0.0
                )
                for place in _act_places(version, [act], map_notes.target):
                    yield place, impulse


def _played_acts(piece: Piece, map_notes: MapNotes, note_number: int) -> list[Act]:
    """The acts with which a note plays an instrument. Raises NotTakenError."""
    if map_notes.impulse is not None or _types_lines(piece, map_notes):
        return []
    return _acts_at_note(piece, map_notes.target, note_number)


def _pressing_acts(piece: Piece, map_notes: MapNotes, note_number: int) -> list[Act]:
    """The acts with which the pressure on the key of a note plays its instrument, if any.
    Raises NotTakenError.
    """
    instrument_name = map_notes.target.partition(".")[0]
    part_name = instrument_name
    if map_notes.impulse is not None or _types_lines(piece, map_notes):
        return []
    if instrument_name in piece.families:
        part_name = _member_of(piece, instrument_name, note_number) or ""
    instrument = piece.instruments.get(part_name)
    acts = () if instrument is None else instrument.acts
    return [
        _act_of_part(piece, f"{instrument_name}.{PRESS}", part_name)
        for act in acts
        if act.name == PRESS
    ]


def _note_places(version: Version, map_notes: MapNotes, note_number: int) -> list[PlaceAndRange]:
    """What a note strikes, as the engine knows it. Raises NotTakenError."""
    places_and_ranges = places_of_note(version.piece, map_notes, note_number)
    return [
        (_sounding_place(version, place), impulse_range)
        for place, impulse_range in places_and_ranges
    ]


# --- both ----------------------------------------------------------------------------------------


def _sounding_place(version: Version, place: Place) -> Place:
    part, module, member = place
    return version.sounds_as.sounding_name(part), module, member


def _act_strokes(version: Version, act: Act, stroke_level: Level, path: str) -> Iterator[Stroke]:
    """What a note of an act strikes at a level, as the engine knows it: first what lasts as long
    as the note. Raises NotTakenError.
    """
    impulse = stroke_level.impulse(act.reach, max)
    for hold in act.holds:
        hold_impulse = hold.impulse(act.reach.strength(impulse))
        for target in hold.targets:
            for struck_place in _member_mats(target, path):
                yield Stroke(
                    _sounding_place(version, struck_place), hold_impulse, lasts_as_note=True
                )
    for target in act.targets:
        for struck_place in _member_mats(target, path):
            yield Stroke(_sounding_place(version, struck_place), impulse, act.is_drawn)


def _acts_at_note(piece: Piece, target_path: str, note_number: int) -> list[Act]:
    """The act that plays an instrument at a note; none if it does not have the note.
    Raises NotTakenError.
    """
    instrument_name = target_path.partition(".")[0]
    part_name = (
        _member_of(piece, instrument_name, note_number)
        if instrument_name in piece.families
        else instrument_name
    )
    return [] if part_name is None else [_act_of_part(piece, target_path, part_name)]


def _member_of(piece: Piece, instrument_name: str, note: int | str) -> str | None:
    """The member of an instrument with notes that has a pitch, or that a MIDI note plays, by the
    tuning of the instrument; None if there is none.
    """
    instrument_tuning = piece.tuning_of(instrument_name)
    with tuning.used(instrument_tuning):
        try:
            note_height = pitch(note if isinstance(note, str) else tuning.current().key_word(note))
        except TextError:  # a key that the keyboard map leaves out
            return None
    members = _members_by_pitch(piece.families[instrument_name], instrument_tuning)
    return None if note_height is None else tuning.part_at_height(members, note_height)


@lru_cache(64)
def _members_by_pitch(members: tuple[str, ...], family_tuning: Tuning | None) -> dict[float, str]:
    with tuning.used(family_tuning):
        return {pitch(_note_of(member)) or 0.0: member for member in members}


def _act_of_part(piece: Piece, target: str, part_name: str) -> Act:
    """The act that plays a part of an instrument. Raises NotTakenError."""
    instrument_name, _, act_name = target.partition(".")
    instrument = piece.instruments.get(part_name)
    acts = {} if instrument is None else {act.name: act for act in instrument.acts}
    if act_name and act_name not in acts:
        act_list = ", ".join(acts) or "there is none"
        raise NotTakenError(f"{instrument_name} has no act {act_name}; the acts: {act_list}")
    if not acts:
        raise NotTakenError(
            f"{instrument_name} does not say how it is played; write impulses, as 1mNs..20mNs"
        )
    played_act = acts[act_name] if act_name else next(iter(acts.values()))
    known_modules = {module.name for module in instrument.modules} if instrument else set()
    if not {module.name for module in played_act.modules} <= known_modules:
        raise NotTakenError(
            f"{part_name} has nothing for {played_act.name} yet; play it by a line first"
        )
    return played_act


def _member_mats(strike_target: Target, target_text: str) -> list[Place]:
    """The MATs of a target, in their order. Raises NotTakenError."""
    if strike_target.first == "centre":
        return [(strike_target.part, strike_target.module, -1)]
    if strike_target.count > _STRUCK_MATS_MAX:
        raise NotTakenError(
            f"{target_text} has {strike_target.count:,} masses, and notes strike "
            f"{_STRUCK_MATS_MAX} at most; name some of them"
        )
    first_member = strike_target.first
    return [
        (strike_target.part, strike_target.module, first_member + member_index)
        for member_index in range(strike_target.count)
    ]


def _check_target(piece: Piece, target_text: str) -> Target:
    collector = Collector()
    parts_by_name = {
        name: PartContents(name, {module.name: module for module in instrument.modules})
        for name, instrument in piece.instruments.items()
    }
    with tuning.used(piece.tuning_of(target_text)):
        strike_target = PartNames(collector, parts_by_name).target(
            Name(target_text, piece.place), "mats", "map"
        )
    if strike_target is None:
        raise NotTakenError(collector.finish()[0].message)
    return strike_target
