"""Version edits that add, join and remove instruments, links, keys and players."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from ergon.notation.text import edit
from ergon.notation.text.edit import EditError
from ergon.repl.language.matter import Build, Link, Remove, Rename, Takes
from ergon.repl.language.mixing import Fade, Filter, MovePan, Room, Route
from ergon.repl.session import midi_maps
from ergon.repl.session.edit_table import edits_texts, makes_edit, with_texts
from ergon.repl.session.version import Faders, NotTakenError, Version
from ergon.scores.edits import families, renaming, space, structure
from ergon.scores.edits.texts import Texts

if TYPE_CHECKING:
    from ergon.repl.session.waiting_lines import VersionEdit
    from ergon.scores.reading.piece import Piece


@edits_texts(Build)
def _build(command: Build, version: Version, beat: float) -> Texts:
    piece = version.piece
    if families.is_defined(piece, command.name) or command.name in piece.available:
        raise NotTakenError(
            f"{command.name} exists: {_name_in_use_advice(version.texts, command.name)}"
        )
    base_name = families.instrument_base(piece, command.base)
    arguments = base_name, command.fields, command.semitones
    return structure.add_instrument(version.texts, piece, command.name, *arguments)


def _name_in_use_advice(score_texts: Texts, used_name: str) -> str:
    """What to do where a name is in use."""
    try:
        structure.definition_path(score_texts, used_name)
    except EditError:
        return "a file that the score uses has it; play it, or choose another name"
    return f"`remove {used_name}` first"


@edits_texts(Link)
def _link(command: Link, version: Version, beat: float) -> Texts:
    end_paths = command.a, command.b
    texts, piece = families.with_definitions(version.texts, version.piece, end_paths)
    texts = structure.add_link(texts, command.kind, end_paths, command.fields)[0]
    return families.with_routes(texts, piece, end_paths)


@edits_texts(Takes)
def _take_key(command: Takes, version: Version, beat: float) -> Texts:
    edited_texts, piece = version.texts, version.piece
    if command.key not in piece.keys:
        model_key = command.like or next(iter(piece.keys), None)
        if model_key is None:
            raise NotTakenError(
                "the score has no key to copy; write a key in the file and type `reload`"
            )
        edited_texts = structure.add_key(edited_texts, command.key, model_key)
    elif command.like is not None:
        raise NotTakenError(f"{command.key} exists already: leave out 'like {command.like}'")
    return structure.add_player(edited_texts, piece, command.player, command.key)


@edits_texts(Route)
def _route(command: Route, version: Version, beat: float) -> Texts:
    edited_texts, piece, command_words = version.texts, version.piece, command.words
    edited_texts, piece = families.with_definitions(edited_texts, piece, [command.name])
    if command.channels is not None:
        edited_texts = structure.route_instrument(
            edited_texts, piece, command.name, list(command.channels), None
        )
    route_fields = {
        name: command_words[name].text
        for name in ("gain", "pan")
        if getattr(command, name) is not None
    }
    edited_texts = space.set_route_fields(edited_texts, piece, command.name, route_fields)
    return (
        edited_texts
        if command.send is None
        else space.send_to_room(edited_texts, piece, command.name, *command.send)
    )


@edits_texts(MovePan)
def _move_pan(command: MovePan, version: Version, beat: float) -> Texts:
    end_beat = version.piece.tempo_map.after(beat, command.over)
    texts, piece = families.with_definitions(version.texts, version.piece, [command.name])
    return space.move_pan(texts, piece, command.name, command.pan, beat, end_beat)


@edits_texts(Filter)
def _filter(command: Filter, version: Version, beat: float) -> Texts:
    edited_texts, piece = families.with_definitions(version.texts, version.piece, [command.name])
    if not command.fields:
        return space.without_route_field(edited_texts, piece, command.name, command.kind)
    filter_text = command.fields.get("")
    field_text = edit.flow(dict(command.fields)) if filter_text is None else filter_text
    return space.set_route_fields(edited_texts, piece, command.name, {command.kind: field_text})


@edits_texts(Room)
def _room(command: Room, version: Version, beat: float) -> Texts:
    return space.with_room(version.texts, version.piece, command.name, command.fields)


@edits_texts(Fade)
def _fade(command: Fade, version: Version, beat: float) -> Texts:
    texts, piece = version.texts, version.piece
    end_beat = piece.tempo_map.after(beat, command.over)
    return space.with_fade(texts, piece, command.name, beat, end_beat, fades_in=command.is_in)


@edits_texts(Remove)
def _remove(command: Remove, version: Version, beat: float) -> Texts:
    edited_texts = structure.remove_named(version.texts, version.piece, command.name)
    if using_entries := structure.entries_with_mistakes(edited_texts):
        strikes = (entry.name for entry in using_entries if entry.section == "strikes")
        first_strikes = next(strikes, None)
        raise NotTakenError(
            f"cannot remove {command.name}, because it is used by "
            f"{', '.join(map(str, using_entries))}; "
            "change or remove that first",
            None if first_strikes in (None, command.name) else f"remove {first_strikes}",
        )
    return edited_texts


@makes_edit(Rename)
def _rename(command: Rename) -> VersionEdit:
    """Give something another name. A block keeps its rule; an instrument or key sounds on, with its
    level and its controllers.
    """
    old_name, new_name = command.old, command.name

    def edit(version: Version, beat: float) -> Version:
        piece = version.piece
        edited_version = with_texts(
            version, renaming.rename(version.texts, piece, old_name, new_name)
        )
        maps = midi_maps.rename_in_maps(version.maps, old_name, new_name)
        edited_version = replace(
            edited_version, renames=(*version.renames, (old_name, new_name)), maps=maps
        )
        if old_name in piece.blocks:
            return replace(
                edited_version,
                rules={
                    new_name if name == old_name else name: rule
                    for name, rule in version.rules.items()
                },
            )
        if old_name not in {*piece.keys, *piece.instruments, *piece.families}:
            return edited_version
        return replace(
            edited_version,
            faders=_renamed_faders(version.faders, piece, old_name, new_name),
            sounds_as=version.sounds_as.with_renamed_part(old_name, new_name),
        )

    return edit


def _renamed_faders(faders: Faders, piece: Piece, old_name: str, new_name: str) -> Faders:
    """The faders under the new name of an instrument and its notes."""
    new_names = {
        old_name: new_name,
        **{name: new_name + name[len(old_name) :] for name in piece.families.get(old_name, ())},
    }
    return replace(
        faders,
        gains={new_names.get(name, name): gain for name, gain in faders.gains.items()},
        muted=frozenset(new_names.get(name, name) for name in faders.muted),
        solo=frozenset(new_names.get(name, name) for name in faders.solo),
    )
