"""The scope of a line: the names that it may use."""

from __future__ import annotations

import itertools
from collections.abc import Container, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from ergon.instruments.model import Form, Instrument, Module
from ergon.instruments.module_kinds import KINDS, POINT_KINDS
from ergon.instruments.spread import GAP
from ergon.instruments.transpose import CENTS_SHAPE
from ergon.notation.tables import value_kinds
from ergon.notation.tables.shapes import Text
from ergon.scores.edits import families
from ergon.scores.gesture import space_path
from ergon.scores.reading.automatable import (
    FACTOR,
    GLIDE_PARAMETERS,
    INTERVAL_OR_FACTOR,
    pitched_module,
)
from ergon.scores.reading.families import library
from ergon.scores.reading.piece import Piece
from ergon.scores.reading.playing import Gesture

SCORE_SUFFIXES = (".yaml", ".yml")
MIDI_SUFFIXES = (".mid", ".midi", ".rmi")
_FILES_MAX = 10_000  # files of a folder that are listed
_INITIAL_FIELDS = ("X0", "V0")  # they set how a mass starts: no effect once it moves


@dataclass(frozen=True, slots=True)
class Scope:
    """The names of a session, each with a hint; `targets` are the parameters that `set` may change.

    `folder` has the scores that a line may name.
    """

    players: Mapping[str, str] = field(default_factory=dict)
    gestures: Mapping[str, str] = field(default_factory=dict)
    takes: Mapping[str, str] = field(default_factory=dict)
    keys: Mapping[str, str] = field(default_factory=dict)
    marks: Mapping[str, str] = field(default_factory=dict)
    instruments: Mapping[str, str] = field(default_factory=dict)
    targets: Mapping[str, Text] = field(default_factory=dict)
    folder: Path | None = None
    strikes: Mapping[str, str] = field(default_factory=dict)
    # Instruments of files that nothing plays yet, by the names by which a line plays them.
    available: Mapping[str, str] = field(default_factory=dict)
    # The modules with masses of every instrument that a line may play.
    modules: Mapping[str, Sequence[str]] = field(default_factory=dict)
    # The families of the library and those in use: their instruments, each with a hint.
    families: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    blocks: Mapping[str, str] = field(default_factory=dict)
    rooms: Mapping[str, str] = field(default_factory=dict)
    phrases: Mapping[str, str] = field(default_factory=dict)
    paths: Mapping[str, str] = field(default_factory=dict)  # in space: their axes are gestures
    # The acts of each instrument that says how it is played.
    acts: Mapping[str, Sequence[str]] = field(default_factory=dict)


def playable_instruments(scope: Scope) -> Mapping[str, str]:
    """Every instrument that a line may play."""
    return {**scope.instruments, **scope.available}


def unused_family(instrument_name: str, scope: Scope) -> str | None:
    """The family that an instrument is to be brought in from; None if a line may play that name,
    or no family has it.
    """
    families_with_name = (
        family for family, members in scope.families.items() if instrument_name in members
    )
    return (
        None if instrument_name in playable_instruments(scope) else next(families_with_name, None)
    )


def scores_in(folder: Path | None) -> list[Path]:
    """The score files in a folder, by name; none if it cannot be read."""
    return files_in(folder, SCORE_SUFFIXES)


def files_in(folder: Path | None, suffixes: Container[str]) -> list[Path]:
    """The files in a folder whose names end so, by name; none if it cannot be read."""
    if folder is None:
        return []
    try:
        paths = itertools.islice(folder.iterdir(), _FILES_MAX)
        return sorted(path for path in paths if path.suffix in suffixes)
    except OSError:
        return []


def scope_of(piece: Piece, folder: Path | None = None) -> Scope:
    """The names of a piece, and of the scores in a folder."""
    unplayed_instruments = families.unplayed_instruments(piece)
    return Scope(
        players={
            player.name: f"{player.hand} hand on {player.key}" for player in piece.players.values()
        },
        gestures={name: _gesture_hint(gesture) for name, gesture in piece.gestures.items()},
        takes={
            name: f"take, {take.path.name}" if take.path else "input of the sound card"
            for name, take in piece.takes.items()
        },
        keys={name: "key" for name in piece.keys},
        marks={mark.name: f"mark, {mark.at.text}" for mark in piece.marks},
        instruments={
            **{name: "instrument" for name in piece.instruments},
            **{name: f"instrument of {len(notes)} notes" for name, notes in piece.families.items()},
        },
        targets=dict(_target_shapes(piece)),
        folder=folder,
        available={name: _file_hint(full_name) for name, full_name in unplayed_instruments.items()},
        modules={**_module_names(piece), **_unplayed_modules(piece, unplayed_instruments)},
        families=_family_names(piece),
        strikes={strikes.name: "strikes" for strikes in piece.strikes},
        rooms={room.name: "room" for room in piece.mix.rooms},
        phrases={name: "phrase" for name in piece.phrases},
        paths=dict.fromkeys(
            filter(None, map(_path_name, piece.gestures.values())), "path in space"
        ),
        acts=dict(_act_names(piece)),
        blocks={name: f"block, {_line_count_text(block)}" for name, block in piece.blocks.items()},
    )


def with_name(scope: Scope, section_name: str, new_name: str) -> Scope:
    """The scope with a name added to one section, because a line above defines it."""
    known_section = getattr(scope, section_name)
    if new_name in known_section:
        return scope
    added_section: Any = {section_name: {**known_section, new_name: "defined above"}}
    return replace(scope, **added_section)


def _family_names(piece: Piece) -> dict[str, dict[str, str]]:
    """Families that ship, and those that the score uses."""
    known_families = {
        name: {member.name: member.comment for member in members}
        for name, members in library().items()
    }
    for family in piece.used:
        known_families.setdefault(family, {})
    for full_name in piece.available:
        family, _, instrument_name = full_name.rpartition(".")
        if family in known_families:
            known_families[family].setdefault(instrument_name, "")
    return known_families


def _file_hint(full_name: str) -> str:
    family = full_name.rpartition(".")[0]
    return f"instrument of {family}" if family else "instrument of a file"


def _module_names(piece: Piece) -> dict[str, list[str]]:
    """The modules with masses of every instrument in the network."""
    instrument_by_name = {name: piece.instruments.get(name) for name in piece.instruments}
    instrument_by_name |= {
        name: piece.instruments.get(members[0]) for name, members in piece.families.items()
    }
    return {
        name: _modules_with_masses(instrument)
        for name, instrument in instrument_by_name.items()
        if instrument is not None
    }


def _unplayed_modules(piece: Piece, full_name_by_name: Mapping[str, str]) -> dict[str, list[str]]:
    return {
        name: _modules_with_masses(piece.available[full_name])
        for name, full_name in full_name_by_name.items()
    }


def _modules_with_masses(instrument: Instrument) -> list[str]:
    """The named modules of an instrument that have masses."""
    return [
        module.name for module in instrument.modules if module.name and module.kind in POINT_KINDS
    ]


def _line_count_text(block: Sequence[str]) -> str:
    return f"{len(block)} line{'s' if len(block) > 1 else ''}"


def _path_name(gesture: Gesture) -> str:
    """The name of the path in space of which a gesture is one axis; "" if it is not one."""
    is_path = gesture.written is not None and space_path.axis_count(gesture.written.text) > 1
    return gesture.name.rpartition(".")[0] if is_path else ""


def _gesture_hint(gesture: Gesture) -> str:
    n_points = len(gesture.points)
    return f"gesture, {n_points} point{'s' if n_points > 1 else ''}"


def _act_names(piece: Piece) -> Iterator[tuple[str, Sequence[str]]]:
    full_name_by_name = {
        name: name for name in (*piece.instruments, *piece.families)
    } | families.unplayed_instruments(piece)
    for instrument_name, full_name in full_name_by_name.items():
        instrument = piece.playable_instrument(full_name)
        if instrument is not None and instrument.acts:
            yield instrument_name, tuple(act.name for act in instrument.acts)


def _target_shapes(piece: Piece) -> Iterator[tuple[str, Text]]:
    """The fields with a quantity of every written module; all members of a module share them."""
    for key in piece.keys.values():
        for part_module in key.modules:
            yield from _field_targets(key.name, part_module, "si")
    for instrument in piece.instruments.values():
        if pitched_module(instrument) is not None:
            yield f"{instrument.name}.f", value_kinds.PITCH
        yield f"{instrument.name}.transpose", CENTS_SHAPE
        for part_module in instrument.modules:
            yield from _field_targets(instrument.name, part_module, instrument.form)
    for family_name, members in piece.families.items():
        yield f"{family_name}.transpose", CENTS_SHAPE
        if (member := piece.instruments.get(members[0])) is not None:
            if pitched_module(member) is not None:
                yield f"{family_name}.f", INTERVAL_OR_FACTOR
            for part_module in member.modules:
                yield from _field_targets(family_name, part_module, member.form)


def _field_targets(
    part_name: str, written_module: Module, module_form: Form
) -> Iterator[tuple[str, Text]]:
    module_path = ".".join(filter(None, (part_name, written_module.name)))
    if written_module.kind == "BANK":  # each member has its own
        yield from ((f"{module_path}.{name}", FACTOR) for name in GLIDE_PARAMETERS["BANK"])
    for table_field in KINDS[written_module.kind].tables[module_form].fields:
        shape = (
            value_kinds.POSITION if table_field.shape is GAP else table_field.shape
        )  # one for all of its points
        if (
            isinstance(shape, Text)
            and shape in QUANTITY_SHAPES
            and table_field.name not in _INITIAL_FIELDS
        ):
            yield f"{module_path}.{table_field.name}", shape
    for name in written_module.fields.get("constants", ()):
        yield (
            f"{module_path}.{name}",
            value_kinds.NUMBER if module_form == "ca" else value_kinds.CONSTANT,
        )


# Kinds of fields that hold one number, which can glide.
QUANTITY_SHAPES = frozenset(
    (
        value_kinds.MASS,
        value_kinds.MASS_OR_NUMBER,
        value_kinds.STIFFNESS,
        value_kinds.DAMPING,
        value_kinds.POSITION,
        value_kinds.HARDENING,
        value_kinds.PITCH,
        value_kinds.DURATION,
        value_kinds.NUMBER,
        value_kinds.RATIO,
        value_kinds.POSITIVE,
        value_kinds.UNIT_RATIO,
        value_kinds.EXPONENT,
        value_kinds.CONSTANT,
    )
)
