"""What a scene is played on: keys, instruments and players that a score lacks are brought in."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

from ergon.notation.text import edit
from ergon.notation.text.edit import EditError
from ergon.scores.edits import structure
from ergon.scores.edits.lists import section_entries
from ergon.scores.edits.texts import Texts
from ergon.scores.reading.piece import Piece

if TYPE_CHECKING:
    from ergon.instruments.model import Module
    from ergon.scores.edits.scenes import Scene

# Sections of names, in the order in which one needs those before it.
_COPIED_SECTIONS = ("let", "laws", "keys", "instruments", "players")
_NAME = re.compile(r"[A-Za-z][\w-]*")


class _UsedFile(NamedTuple):
    """A file that a score uses, and its prefix."""

    prefix: str
    file: str


def with_scene_parts(score_texts: Texts, piece: Piece, scene: Scene) -> Texts:
    """The texts with what a scene plays and they lack, written and routed as in the scene; the
    same object if they lack nothing. Parts that both pieces have do not change. Raises
    EditError.
    """
    needed_names = _played_names(scene.piece)
    known_names = {*piece.keys, *piece.instruments, *piece.families, *piece.players}
    missing_names = needed_names - known_names
    if not missing_names:
        return score_texts
    _refuse_shared_keys(piece, scene, missing_names)
    scene_entries = {
        section: _entries_by_name(scene.texts, section) for section in _COPIED_SECTIONS
    }
    known_entry_names = {
        section: _entries_by_name(score_texts, section).keys() for section in _COPIED_SECTIONS
    }
    missing_entries = {
        section: {
            entry_name: entry
            for entry_name, entry in scene_entries[section].items()
            if entry_name not in (*known_entry_names[section], *known_names)
        }
        for section in _COPIED_SECTIONS
    }
    missing_parts = _with_dependencies(missing_names, missing_entries)
    new_texts = replace(score_texts, overlay={**scene.texts.overlay, **score_texts.overlay})
    new_texts = _with_files(new_texts, scene)
    for section_name in _COPIED_SECTIONS:
        for name, entry in missing_entries[section_name].items():
            if name in missing_parts:
                new_texts = new_texts.put((section_name, name), edit.flow(entry))
    new_texts = _with_links(new_texts, piece, scene, needed_names)
    return _with_routes(new_texts, piece, scene, missing_parts)


def _played_names(piece: Piece) -> set[str]:
    """The players that play in a scene, their keys, what these touch, and what is struck or led."""
    family = piece.note_families()
    players = {play.player for play in piece.parts}
    key_names = {piece.players[name].key for name in players}
    struck_parts = {part for strikes in piece.strikes for part in strikes.parts}
    automated_parts = {
        name.partition(".")[0] for name in (entry.name for entry in piece.automation)
    }
    linked_parts = {
        part.name
        for part in piece.instruments.values()
        if any(key_names & {*_end_parts(module)} for module in part.modules)
    }
    parts = {family.get(part, part) for part in struck_parts | automated_parts | linked_parts}
    return players | key_names | parts


def _end_parts(module: Module) -> Iterator[str]:
    """The parts at the ends of a link."""
    for end in module.ends:
        yield end.part


def _refuse_shared_keys(piece: Piece, scene: Scene, missing_names: Iterable[str]) -> None:
    """Refuse a player whose key another one plays here. Raises EditError."""
    players = {player.key: player.name for player in piece.players.values()}
    for name in missing_names:
        if name in scene.piece.players and (key := scene.piece.players[name].key) in players:
            message = f"this score has no player {name}, who plays {key} in the scene, and {key} is"
            raise EditError(f"{message} played by {players[key]}")


def _entries_by_name(texts: Texts, section: str) -> Mapping[str, edit.Tree]:
    tree = edit.tree(texts.section(section))
    return tree if isinstance(tree, dict) else {}


def _with_dependencies(
    part_names: set[str], missing_entries: Mapping[str, Mapping[str, edit.Tree]]
) -> set[str]:
    """Names with all that their entries name and that is lacking too."""
    entries = {
        name: entry for section in missing_entries.values() for name, entry in section.items()
    }
    unread_names, all_names = [*part_names], set(part_names)
    while unread_names:
        new_names = {*_names_in(entries.get(unread_names.pop()))} & entries.keys() - all_names
        all_names |= new_names
        unread_names += new_names
    return all_names


def _names_in(value_tree: edit.Tree) -> Iterator[str]:
    """The names in the texts of a value."""
    if isinstance(value_tree, dict):
        for name, tree_value in value_tree.items():
            yield name
            yield from _names_in(tree_value)
    elif isinstance(value_tree, list):
        for tree_value in value_tree:
            yield from _names_in(tree_value)
    elif value_tree is not None:
        yield from _NAME.findall(value_tree)


def _with_files(score_texts: Texts, scene: Scene) -> Texts:
    """The texts with the files that a scene uses and they do not. Raises EditError."""
    score_files, scene_files = _used_files(score_texts), _used_files(scene.texts)
    new_files = [used_file for used_file in scene_files if used_file not in score_files]
    known_prefixes = {used_file.prefix for used_file in score_files if used_file.prefix}
    if clashing_file := next(
        (used_file for used_file in new_files if used_file.prefix in known_prefixes), None
    ):
        message = (
            f"the scene uses {clashing_file.file} as {clashing_file.prefix}, which is another "
            "file here"
        )
        raise EditError(message)
    if not new_files:
        return score_texts
    if all(used_file.prefix for used_file in (*score_files, *new_files)):
        for used_file in new_files:
            score_texts = score_texts.put(("use", used_file.prefix), edit.quoted(used_file.file))
        return score_texts
    use_rows: list[edit.Tree] = [
        {used_file.prefix: used_file.file} if used_file.prefix else used_file.file
        for used_file in (*score_files, *new_files)
    ]
    return score_texts.put(("use",), edit.flow(use_rows))


def _used_files(score_texts: Texts) -> list[_UsedFile]:
    """The files that a score uses."""
    used_files = []
    for node in section_entries(score_texts, "use"):
        use_row = edit.tree(node)
        if isinstance(use_row, dict):
            used_files += [
                _UsedFile(prefix, file) for prefix, file in use_row.items() if isinstance(file, str)
            ]
        elif isinstance(use_row, str):
            used_files.append(_UsedFile("", use_row))
    return used_files


def _with_links(score_texts: Texts, piece: Piece, scene: Scene, needed_names: set[str]) -> Texts:
    """The texts with the links that an instrument of both has in the scene alone, between what the
    scene plays.
    """
    for instrument_name, instrument in scene.piece.instruments.items():
        score_part = piece.instruments.get(instrument_name)
        if score_part is None:
            continue
        known_modules = {module.name for module in score_part.modules}
        entry = _entries_by_name(scene.texts, "instruments").get(instrument_name)
        entry_modules = entry.get("modules") if isinstance(entry, dict) else None
        for link_module in instrument.modules:
            end_parts = {*_end_parts(link_module)}
            is_new = (
                link_module.name not in known_modules and end_parts and end_parts <= needed_names
            )
            if is_new and isinstance(entry_modules, dict) and link_module.name in entry_modules:
                path = "instruments", instrument_name, "modules", link_module.name
                score_texts = score_texts.put(path, edit.flow(entry_modules[link_module.name]))
    return score_texts


def _with_routes(score_texts: Texts, piece: Piece, scene: Scene, new_names: set[str]) -> Texts:
    """The texts with the routes of a scene for new instruments, and the rooms that these need."""
    routed_scene = structure.with_default_routes(scene.texts, scene.piece)
    rows = [
        route_row
        for node in section_entries(routed_scene, "mix", "route")
        if isinstance(route_row := edit.tree(node), dict)
    ]
    new_rows = [row for row in rows if str(row.get("from")).partition(".")[0] in new_names]
    if not new_rows:
        return score_texts
    score_texts = structure.with_default_routes(score_texts, piece)
    scene_mix = _entries_by_name(scene.texts, "mix")
    rooms = scene_mix.get("rooms")
    known_rooms = {room.name for room in piece.mix.rooms}
    for route_row in new_rows:
        sends = route_row.get("send")
        for room in sends if isinstance(sends, dict) else ():
            if room not in known_rooms and isinstance(rooms, dict) and room in rooms:
                score_texts = score_texts.put(("mix", "rooms", room), edit.flow(rooms[room]))
                known_rooms.add(room)
        score_texts = score_texts.append(("mix", "route"), edit.flow(route_row))
    return score_texts
