"""Renames what a score defines, in every place that names it."""

from __future__ import annotations

import re
from collections.abc import Callable, Container, Iterator
from dataclasses import replace

from ergon.instruments.members import PATTERN
from ergon.notation.tables import notes
from ergon.notation.tables.shapes import Reference, Shape
from ergon.notation.tables.value_kinds import AXES
from ergon.notation.text import document
from ergon.notation.text.document import Node, Scalar
from ergon.notation.text.edit import EditError
from ergon.notation.text.errors import quote
from ergon.scores.edits.structure import definition_path
from ergon.scores.edits.texts import Texts
from ergon.scores.pattern import words
from ergon.scores.pattern.rhythm_text import WORD
from ergon.scores.reading.digest import digest_of
from ergon.scores.reading.melody import EntriesShape, StruckNamesShape
from ergon.scores.reading.piece import Piece
from ergon.scores.reading.rhythms import RHYTHM_SHAPE
from ergon.scores.reading.sections import SCORE_RECORD
from ergon.scores.reading.sounding import SoundingNames

_PART_SECTIONS = "keys", "instruments"
_OTHER_SECTIONS = ("gestures", "phrases", "takes", "players", "blocks", *_PART_SECTIONS)
_WORD_PATTERN = re.compile(r"\S+")
_MEMBER_SUFFIX = re.compile(rf"\.(?:{PATTERN})\Z")

Span = tuple[int, int]  # start and end offset


def rename(score_texts: Texts, piece: Piece, old_name: str, new_name: str) -> Texts:
    """Rename a gesture, a phrase, a take, a player, a block, a key or an instrument, wherever it is
    named.

    Raises EditError.
    """
    renamed_text, copied_end = "", 0
    for start, stop in reference_spans(score_texts, piece, old_name, new_name):
        renamed_text, copied_end = (
            f"{renamed_text}{score_texts.text[copied_end:start]}{new_name}",
            stop,
        )
    changed_texts = score_texts.with_text(renamed_text + score_texts.text[copied_end:])
    section_name, _ = definition_path(score_texts, old_name)
    if section_name in (*_PART_SECTIONS, "phrases"):
        _check_same_piece(
            piece,
            changed_texts,
            SoundingNames({new_name: old_name} if section_name in _PART_SECTIONS else {}),
            old_name,
        )
    return changed_texts


def reference_spans(score_texts: Texts, piece: Piece, old_name: str, new_name: str) -> list[Span]:
    """Where a score names what `rename` gives the name `new_name`, in order. Raises EditError."""
    section_name, _ = definition_path(score_texts, old_name)
    if section_name not in _OTHER_SECTIONS or "." in old_name:
        raise EditError(
            f"{old_name} is not the name of a gesture, phrase, take, player, block, key or "
            "instrument"
        )
    names_by_section: dict[str, Container[str]] = {"players": piece.players, "blocks": piece.blocks}
    names_by_section["phrases"] = piece.phrases
    parts = {*piece.keys, *piece.instruments, *piece.families}
    names_by_section |= dict.fromkeys(
        _PART_SECTIONS, parts | {part.partition(".")[0] for part in parts}
    )
    if new_name in names_by_section.get(section_name, {*piece.gestures, *piece.takes}):
        raise EditError(f"the name {quote(new_name)} is in use")
    root = score_texts.document().root
    assert isinstance(root, document.Mapping)
    spans = (
        _spans_of_part(root, piece, section_name, old_name)
        if section_name in _PART_SECTIONS
        else _spans_of_name(root, section_name, old_name)
    )
    return sorted({*spans})


def _check_same_piece(
    piece: Piece, changed_texts: Texts, sounding_names: SoundingNames, old_name: str
) -> None:
    """Raise EditError if the renamed text is not the same piece: then some use of the name was not
    found.
    """
    piece_after = changed_texts.load().piece
    restored_piece = None if piece_after is None else sounding_names.sounding_piece(piece_after)
    if restored_piece is None or digest_of(replace(restored_piece, takes={})) != digest_of(
        replace(piece, takes={})
    ):
        raise EditError(
            f"`rename` cannot find every use of {old_name}, so nothing was changed; rename it in "
            "the file, then type `load`"
        )


# --- keys and instruments -----------------------------------------------------------------------


def _spans_of_part(
    root_node: document.Mapping, piece: Piece, section_name: str, old_name: str
) -> Iterator[Span]:
    """Where a key or an instrument is named in a score."""
    section_node = root_node.get(section_name)
    if isinstance(section_node, document.Mapping) and old_name in section_node.entries:
        word, _ = section_node.entries[old_name]
        yield word.start, word.end
    yield from _spans_in_blocks(root_node.get("blocks"), old_name)
    yield from _references(root_node, SCORE_RECORD, old_name, _modules_by_owner(piece), ())


def _modules_by_owner(piece: Piece) -> dict[str, set[str]]:
    """The names of modules by the name of their key or instrument: inside it, such a name means the
    module.
    """
    modules_by_owner: dict[str, set[str]] = {}
    for part, module in piece.modules():
        for owner in (part, part.rpartition(".")[0]):
            modules_by_owner.setdefault(owner, set()).add(module.name)
    return modules_by_owner


def _references(
    value_node: Node,
    value_shape: Shape | None,
    old_name: str,
    modules_by_owner: dict[str, set[str]],
    path: tuple[str, ...],
) -> Iterator[Span]:
    """Where values below a node name a part; `path` has the names that lead to the node."""
    value_shape = None if value_shape is None else value_shape.chosen(value_node)
    if isinstance(value_node, document.Mapping):
        for word, (_, child_node) in value_node.entries.items():
            inner_shape = None if value_shape is None else value_shape.inner(word)
            yield from _references(
                child_node, inner_shape, old_name, modules_by_owner, (*path, word)
            )
    elif isinstance(value_node, document.Sequence):
        for number, child_node in enumerate(value_node.items):
            inner_shape = None if value_shape is None else value_shape.inner(number)
            yield from _references(child_node, inner_shape, old_name, modules_by_owner, path)
    elif isinstance(value_node, Scalar) and isinstance(value_shape, EntriesShape):
        for row, offset in words.rows(value_node.text):
            _, *placed_cells = [
                (cell.group(), offset + cell.start()) for cell in _WORD_PATTERN.finditer(row)
            ]
            yield from _spans_of_words(value_node, placed_cells, old_name)
    elif isinstance(value_node, Scalar) and value_shape is RHYTHM_SHAPE:
        yield from _spans_of_words(
            value_node,
            [
                (word_match.group(), word_match.start())
                for word_match in WORD.finditer(value_node.text)
            ],
            old_name,
        )
    elif isinstance(value_node, Scalar) and isinstance(value_shape, StruckNamesShape):
        yield from _spans_of_words(
            value_node,
            [
                (word_match.group(), word_match.start())
                for word_match in _WORD_PATTERN.finditer(value_node.text)
            ],
            old_name,
        )
    elif isinstance(value_node, Scalar) and isinstance(value_shape, Reference):
        is_in_part = len(path) > 1 and path[0] in _PART_SECTIONS
        is_module = is_in_part and _MEMBER_SUFFIX.sub("", value_node.text) in modules_by_owner.get(
            path[1], ()
        )
        if {"modules", *_PART_SECTIONS} & {*value_shape.sections} and not (
            is_module and path[-1] != "like"
        ):
            yield from _spans_of_words(value_node, [(value_node.text, 0)], old_name)


def _spans_of_words(
    text_node: Scalar, placed_words: list[tuple[str, int]], old_name: str
) -> Iterator[Span]:
    """Where words of a text name a part, or something reached through it; each word has its
    offset.
    """
    for word, offset in placed_words:
        if re.split("[.:]", word)[0] == old_name and notes.word_of(word) is None:
            yield _span(text_node, offset, len(old_name))


def _span(node: Scalar, offset: int, span_length: int) -> Span:
    """The start and end of a word, given its offset in the text of a node."""
    node_document, place = node.document, node.place_at(offset, span_length)
    start, _ = node_document.line_span(place.line - node_document.first_row - 1)
    return start + place.column - 1, start + place.column - 1 + span_length


# --- gestures, takes, players, blocks -----------------------------------------------------------


def _spans_of_name(root_node: document.Mapping, section_name: str, old_name: str) -> Iterator[Span]:
    """Where a gesture, phrase, take, player or block is named in a score, as spans."""
    section_node = root_node.get(section_name)
    if isinstance(section_node, document.Mapping) and old_name in section_node.entries:
        word, _ = section_node.entries[old_name]
        yield word.start, word.end
    if section_name == "blocks":
        return
    yield from _spans_in_blocks(root_node.get("blocks"), old_name)
    parts = root_node.get("parts")
    players = parts.entries if isinstance(parts, document.Mapping) else {}
    strikes = root_node.get("strikes")
    for _, named_node in strikes.entries.values() if isinstance(strikes, document.Mapping) else ():
        if section_name in ("phrases", "takes"):  # a take that is a MIDI file
            yield from _span_if_same(
                named_node.get("play") if isinstance(named_node, document.Mapping) else None,
                old_name,
            )
    if section_name == "phrases":
        phrases = root_node.get("phrases")
        for _, named_node in (
            phrases.entries.values() if isinstance(phrases, document.Mapping) else ()
        ):
            if isinstance(named_node, document.Mapping):
                yield from _span_if_same(named_node.get("like"), old_name)
                yield from _spans_in_phrase(named_node.get("entries"), old_name)
        return
    if section_name == "players":
        if old_name in players:
            yield players[old_name][0].start, players[old_name][0].end
        return
    for _, part_node in players.values():
        if isinstance(part_node, document.Sequence):
            for item in part_node.items:
                play_node = item.get("play") if isinstance(item, document.Mapping) else None
                yield from _spans_in_play(play_node, old_name)
        elif isinstance(part_node, Scalar):
            yield from _spans_in_table(part_node, old_name)
    gestures, players_node = root_node.get("gestures"), root_node.get("players")
    for table, field in ((gestures, "like"), (players_node, "standin")):
        for _, named_node in table.entries.values() if isinstance(table, document.Mapping) else ():
            yield from _span_if_same(
                named_node.get(field) if isinstance(named_node, document.Mapping) else None,
                old_name,
            )


def _spans_in_blocks(blocks: Node | None, name: str) -> Iterator[Span]:
    """Where lines of blocks contain a name."""
    name_pattern = re.compile(rf"(?<![\w./-]){re.escape(name)}(?![\w/-])")
    for _, block in blocks.entries.values() if isinstance(blocks, document.Mapping) else ():
        lines = block.items if isinstance(block, document.Sequence) else [block]
        for line in lines:
            for match in name_pattern.finditer(line.document.text, line.start, line.end):
                yield match.span()


def _spans_in_phrase(entries_node: Node | None, phrase_name: str) -> Iterator[Span]:
    """Spans at which entries of a phrase name another phrase, which replaces notes."""
    if isinstance(entries_node, document.Sequence):
        for item in entries_node.items:
            what_node = item.get("what") if isinstance(item, document.Mapping) else None
            if isinstance(what_node, document.Sequence) and len(what_node.items) == 1:
                what_node = what_node.items[0]
            yield from _span_if_same(what_node, phrase_name)
    elif isinstance(entries_node, Scalar):
        for row, row_offset in words.rows(entries_node.text):
            cell_matches = [*_WORD_PATTERN.finditer(row)]
            if len(cell_matches) > 1 and cell_matches[1].group() == phrase_name:
                yield _span(entries_node, row_offset + cell_matches[1].start(), len(phrase_name))


def _span_if_same(node: Node | None, name: str) -> Iterator[Span]:
    if isinstance(node, Scalar) and _is_named(node.text, name):
        yield node.start, node.end - len(node.text) + len(name)


def _is_named(word: str, name: str) -> bool:
    """Whether a word is a name, or an axis of the path that it names: `pour.x`."""
    path_name, _, axis = word.rpartition(".")
    return word == name or (path_name == name and axis in AXES)


def _spans_in_table(part_node: Scalar, old_name: str) -> Iterator[Span]:
    """Where rows of a table name what is played."""
    for row, offset in words.rows(part_node.text):
        offsets: list[int] = []
        play_words = words.parse_row(row, offset, _recording_offsets(old_name, offsets)).play
        yield from _spans_in_pattern(part_node, old_name, play_words, offsets)


def _spans_in_play(play_node: Node | None, old_name: str) -> Iterator[Span]:
    """Where the play of an entry names what is played."""
    if isinstance(play_node, Scalar) and not play_node.is_empty:
        offsets: list[int] = []
        yield from _spans_in_pattern(
            play_node,
            old_name,
            words.parse(play_node.text, 0, _recording_offsets(old_name, offsets)),
            offsets,
        )


def _recording_offsets(old_name: str, offsets: list[int]) -> Callable[[str, int], str]:
    """A function for reading patterns that records the offsets of a name in `offsets`."""

    def record(word: str, offset: int) -> str:
        if _is_named(word, old_name):
            offsets.append(offset)
        return word

    return record


def _spans_in_pattern(
    node: Scalar, name: str, play_words: words.PlayWords, offsets: list[int]
) -> Iterator[Span]:
    """The spans of a name in a play; in a pattern it stands at the offsets `offsets`."""
    for offset in (
        [play_words.played.offset]
        if _is_named(play_words.played.text, name)
        else sorted({*offsets})
    ):
        yield _span(node, offset, len(name))
