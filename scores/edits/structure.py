"""Adds and removes instruments, keys, links, players and routes of a score."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ergon.instruments.model import Instrument
from ergon.notation.tables.compound import NamesOf
from ergon.notation.text import document, edit
from ergon.notation.text.document import Node, Scalar
from ergon.notation.text.edit import EditError
from ergon.notation.text.errors import quote
from ergon.notation.text.values import Place
from ergon.scores.edits.lists import entry_path, section_entries, without_entry
from ergon.scores.edits.names import free_name
from ergon.scores.edits.texts import Texts
from ergon.scores.reading.piece import Piece
from ergon.scores.reading.sections import SCORE_RECORD

USUAL_LOUDNESS = "-20LUFS"  # loudness of a stroke at mf by default
LINKS_INSTRUMENT = "links"  # the instrument that holds links between others

Fields = Mapping[str, str]


def add_instrument(
    score_texts: Texts,
    piece: Piece,
    instrument_name: str,
    base_name: str,
    instrument_fields: Fields,
    semitones: float = 0.0,
) -> Texts:
    """Add an instrument like another (`bell`), or one from a file (`bell/bell`), heard on all
    channels until a route says otherwise.

    Its own `instrument_fields` replace those of the other. Raises EditError.
    """
    fields_written: dict[str, edit.Tree] = {
        "from" if "/" in base_name else "like": base_name,
        **instrument_fields,
    }
    if semitones:
        fields_written["transpose"] = f"{semitones:g}st"
    score_texts = score_texts.put(("instruments", instrument_name), edit.flow(fields_written))
    return routed_to_all(score_texts, piece, instrument_name)


def routed_to_all(score_texts: Texts, piece: Piece, instrument_name: str) -> Texts:
    """Route an instrument that is new in a piece to all channels, at the usual loudness if it says
    how loud it is. One without outputs that need a route has none.
    """
    instrument = _new_instrument(score_texts, instrument_name)
    if (
        instrument is None
        or not instrument.outputs
        or any(output.nearest for output in instrument.outputs)
    ):
        return score_texts
    score_texts = with_default_routes(score_texts, piece)
    route_tree: dict[str, edit.Tree] = {
        "from": instrument_name,
        "to": [str(channel_index + 1) for channel_index in range(_channel_count(piece))],
    }
    if instrument.loudness is not None and piece.mix.reference() is not None:
        route_tree["level"] = USUAL_LOUDNESS
    return score_texts.append(("mix", "route"), edit.flow(route_tree))


def _new_instrument(texts: Texts, name: str) -> Instrument | None:
    """The instrument of a name, or its first note; None if the texts are refused for it."""
    piece = texts.load().piece
    return None if piece is None else piece.playable_instrument(name)


def _channel_count(piece: Piece) -> int:
    channel_numbers = (max(route.to) for route in piece.routes() if route.to != "nearest")
    return max(1, piece.mix.channels, *channel_numbers)


def add_key(texts: Texts, name: str, model_key: str) -> Texts:
    """Add a key like another. Raises EditError."""
    return texts.put(("keys", name), edit.flow({"like": model_key}))


def add_player(score_texts: Texts, piece: Piece, player_name: str, key_name: str) -> Texts:
    """Let a player play a key; a new player has no part yet. Raises EditError."""
    if player_name not in piece.players:
        return score_texts.put(("players", player_name), edit.flow({"key": key_name}))
    if piece.players[player_name].hand != "virtual":
        raise EditError(f"{player_name} is a real hand, whose key is that of its device")
    return score_texts.put(("players", player_name, "key"), key_name)


def add_link(
    score_texts: Texts, link_kind: str, end_paths: Sequence[str], link_fields: Fields
) -> tuple[Texts, str]:
    """Join two modules by a link of a kind; returns the link's name too. Raises EditError."""
    links_node = _node(score_texts, ("instruments", LINKS_INSTRUMENT, "modules"))
    taken_names = links_node.entries if isinstance(links_node, document.Mapping) else {}
    link_name = free_name(link_kind.lower(), taken_names, is_numbered=True)
    link_tree: dict[str, edit.Tree] = {link_kind: {"between": [*end_paths], **link_fields}}
    path = ("instruments", LINKS_INSTRUMENT, "modules", link_name)
    return score_texts.put(path, edit.flow(link_tree)), f"{LINKS_INSTRUMENT}.{link_name}"


def route_instrument(
    score_texts: Texts,
    piece: Piece,
    instrument_name: str,
    channels: Sequence[str],
    gain: str | None,
) -> Texts:
    """Route an instrument to channels, in place of its earlier routes. Raises EditError."""
    score_texts = with_default_routes(score_texts, piece)
    channel_tree: edit.Tree = "nearest" if channels == ["nearest"] else [*channels]
    family = next(
        (
            family_name
            for family_name, members in piece.families.items()
            if instrument_name in members
        ),
        None,
    )
    routes = section_entries(score_texts, "mix", "route")
    if family is not None and any(_is_route_from(node, family) for node in routes):
        raise EditError(f"{instrument_name} is routed with all notes of {family}: route {family}")
    route_numbers = [
        number for number, node in enumerate(routes) if is_route_of(node, instrument_name)
    ]
    for number in reversed(route_numbers[1:]):
        score_texts = score_texts.remove(("mix", "route", number))
    if route_numbers:
        path = entry_path(score_texts, "mix", route_numbers[0], "route")
        score_texts = score_texts.put((*path, "to"), edit.flow(channel_tree))
        return score_texts if gain is None else score_texts.put((*path, "gain"), gain)
    route_fields: dict[str, edit.Tree] = {"from": instrument_name, "to": channel_tree}
    return score_texts.append(
        ("mix", "route"),
        edit.flow(route_fields if gain is None else {**route_fields, "gain": gain}),
    )


def remove_named(score_texts: Texts, piece: Piece, removed_name: str) -> Texts:
    """Remove a named thing, and what belongs to it alone.

    A player is removed with the part, a key with its couplings, an instrument with its routes; of
    strikes and an instrument of one name, the strikes. Raises EditError.
    """
    section_name, path = definition_path(score_texts, removed_name)
    if section_name == "instruments" and _has_path(score_texts, ("strikes", removed_name)):
        return score_texts.remove(("strikes", removed_name))
    if section_name == "players" and _has_path(score_texts, ("parts", removed_name)):
        score_texts = score_texts.remove(("parts", removed_name))
    if section_name == "keys":
        for entry_index in reversed(range(len(piece.duet))):
            if removed_name in (piece.duet[entry_index].a.part, piece.duet[entry_index].b.part):
                score_texts = without_entry(score_texts, "duet", entry_index)
    if section_name == "instruments" and len(path) == 2:
        routes = section_entries(score_texts, "mix", "route")
        for entry_index in reversed(range(len(routes))):
            if is_route_of(routes[entry_index], removed_name):
                if len(section_entries(score_texts, "mix", "route")) == 1:
                    raise EditError(
                        f"{removed_name} is the last instrument that is heard: route another"
                    )
                score_texts = score_texts.remove(("mix", "route", entry_index))
    parent_node = _node(score_texts, path[:-1])
    if (
        len(path) > 2
        and isinstance(parent_node, document.Mapping)
        and len(parent_node.entries) == 1
    ):
        return remove_named(score_texts, piece, path[1])  # an instrument needs a module
    return score_texts.remove(path)


@dataclass(frozen=True, slots=True)
class SectionEntry:
    """A named entry of a section, or a module of one, such as `bell.m`; without a name, the section
    itself or a file.
    """

    section: str
    name: str = ""

    def __str__(self) -> str:
        """`strikes 'verse'`."""
        if not self.name:
            return self.section
        if "." in self.name:
            return f"module {quote(self.name)}"
        shape = SCORE_RECORD.by_name[self.section].shape
        assert isinstance(shape, NamesOf)
        return f"{shape.noun} {quote(self.name)}"


def entries_with_mistakes(score_texts: Texts) -> list[SectionEntry]:
    """The entries of a score in which there are mistakes, in the order of the text, each once."""
    errors = [
        diagnostic
        for diagnostic in score_texts.load().diagnostics
        if diagnostic.severity == "error"
    ]
    score_document = score_texts.document() if errors else None
    entries = (
        SectionEntry(error.place.file)
        if score_document is None or error.place.file != score_document.file
        else _entry_at(score_document, error.place)
        for error in errors
    )
    return [*dict.fromkeys(entries)]


def _entry_at(score_document: document.Document, place: Place) -> SectionEntry:
    """The entry of the score in which a place lies."""
    text_index = score_document.line_span(place.line - 1)[0] + place.column - 1
    assert isinstance(score_document.root, document.Mapping)
    section_name = _entry_name_before(score_document.root, text_index)
    section_node = score_document.root.entries[section_name][1]
    if not isinstance(SCORE_RECORD.by_name[section_name].shape, NamesOf) or not isinstance(
        section_node, document.Mapping
    ):
        return SectionEntry(section_name)
    entry_name = _entry_name_before(section_node, text_index)
    body = section_node.entries[entry_name][1]
    modules = body.get("modules") if isinstance(body, document.Mapping) else None
    if isinstance(modules, document.Mapping) and modules.start <= text_index < modules.end:
        entry_name = f"{entry_name}.{_entry_name_before(modules, text_index)}"
    return SectionEntry(section_name, entry_name)


def _entry_name_before(node: document.Mapping, index: int) -> str:
    """The entry that begins last before a character; an entry reaches up to the next one."""
    name_starts = ((word.start, name) for name, (word, _) in node.entries.items())
    return max((start, name) for start, name in name_starts if start <= index)[1]


def with_default_routes(score_texts: Texts, piece: Piece) -> Texts:
    """Write out the default routes of a score that has none: each output has a channel of its
    own.
    """
    if piece.mix.routes:
        return score_texts
    family = piece.note_families()
    channels_by_output = {}  # the notes of an instrument share its outputs
    for route in piece.routes():
        output_name = ".".join(filter(None, (family.get(route.part, route.part), route.out)))
        channels_by_output[output_name] = [str(channel) for channel in route.to]
    for output_name, output_channels in channels_by_output.items():
        score_texts = score_texts.append(
            ("mix", "route"), edit.flow({"from": output_name, "to": [*output_channels]})
        )
    return score_texts


def definition_path(score_texts: Texts, defined_name: str) -> tuple[str, tuple[str, ...]]:
    """The section in which the score itself defines a name, and its path. Raises EditError."""
    part_name, _, module_name = defined_name.partition(".")
    for section_name in (
        "players",
        "gestures",
        "phrases",
        "takes",
        "keys",
        "instruments",
        "strikes",
        "marks",
        "blocks",
    ):
        if _has_path(score_texts, (section_name, defined_name)):
            return section_name, (section_name, defined_name)
        if module_name and _has_path(
            score_texts, (section_name, part_name, "modules", module_name)
        ):
            return section_name, (section_name, part_name, "modules", module_name)
    raise EditError(
        f"{defined_name} is written in a file that the score uses; change that file, then `reload`"
    )


def _has_path(texts: Texts, path: Sequence[str]) -> bool:
    return _node(texts, path) is not None


def _node(texts: Texts, path: Sequence[str]) -> Node | None:
    """The node at a path of names; None if nothing is written there."""
    node = texts.section(path[0])
    for name in path[1:]:
        node = node.get(name) if isinstance(node, document.Mapping) else None
    return node


def _is_route_from(route: Node, name: str) -> bool:
    source = route.get("from") if isinstance(route, document.Mapping) else None
    return isinstance(source, Scalar) and source.text == name


def is_route_of(route: Node, owner_name: str) -> bool:
    """Whether a route is from an instrument, or from one of its outputs or notes."""
    source = route.get("from") if isinstance(route, document.Mapping) else None
    return isinstance(source, Scalar) and (
        source.text == owner_name or source.text.startswith(f"{owner_name}.")
    )
