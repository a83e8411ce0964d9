"""Entries of a part, in a list or in a table: read, ended, removed, added."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf

from ergon.notation.clock.meter import SAME
from ergon.notation.text import document, edit
from ergon.notation.text.document import Node, Scalar
from ergon.notation.text.edit import EditError
from ergon.notation.text.errors import TextError, quote
from ergon.scores.edits.texts import SECTIONS, ListEdit, Texts
from ergon.scores.gesture.transforms import parse_transform
from ergon.scores.pattern import words
from ergon.scores.pattern.search import n_before
from ergon.scores.pattern.steps import PlaceBeats
from ergon.scores.pattern.turn_chain import split_chain
from ergon.scores.reading.piece import Piece
from ergon.scores.reading.playing import Play


@dataclass(frozen=True, slots=True)
class Entry:
    """An entry of a part: each field as its text, and its transformations."""

    fields: Mapping[str, str]  # at, play and options, in the order written
    transforms: tuple[str, ...] = ()

    def with_fields(self, **fields: str | None) -> Entry:
        """The entry with other fields; None removes one."""
        merged_fields = {**self.fields, **fields}
        return replace(
            self, fields={name: text for name, text in merged_fields.items() if text is not None}
        )

    def from_position(self, position: str) -> Entry:
        """The entry from a position on."""
        return replace(self, fields={"at": position, **self.fields})

    def with_step(self, step_text: str) -> Entry:
        """The entry with a time between repetitions that `fast` and `slow` do not change."""
        return replace(
            self.with_fields(every=step_text),
            transforms=tuple(map(_gesture_transform_text, self.transforms)),
        )

    def flow_text(self) -> str:
        """The entry as an item of a list."""
        tree: dict[str, edit.Tree] = dict(self.fields)
        if self.transforms:
            tree["do"] = list(self.transforms)
        return edit.flow(tree)

    def row_text(self) -> str:
        """The entry as the words of a row, after its position."""
        texts = [self.fields["play"]]
        for field_name, field_text in self.fields.items():
            if field_name == words.NTH_OPTION:
                texts += ["every", field_text]
            elif field_name in words.OPTION_EXAMPLES and field_name != "at":
                is_flag = words.OPTION_EXAMPLES[field_name] is None
                texts += (
                    ([field_name] if field_text == "true" else [])
                    if is_flag
                    else [field_name, field_text]
                )
        return " ".join([*texts, *(["do", ", ".join(self.transforms)] if self.transforms else [])])


def _gesture_transform_text(transform: str) -> str:
    """A transformation of gestures alone: `stretch` in place of `fast` and `slow`."""
    if transform.split()[:1] not in (["fast"], ["slow"]):
        return transform
    try:
        return f"stretch {parse_transform(transform).time_factor!r}"
    except TextError as error:
        raise EditError(f"{quote(transform)} cannot be written out: {error.message}") from None


@dataclass(frozen=True, slots=True)
class PlacedEntry:
    """An entry in its place: its number in the list or its line in the table, and when it plays."""

    number: int
    entry: Entry
    play: Play
    begin_beat: float  # [beats of the piece]
    start_beats: Sequence[float] | None  # None: only the recording holds them
    row_text: str | None = None  # row of a table as written

    def is_continuing(self, beat: float, piece: Piece) -> bool:
        """Whether an entry began before a beat and begins again on it or later."""
        if self.begin_beat >= beat - SAME:
            return False
        if self.start_beats is not None:
            return bool(self.start_beats) and self.start_beats[-1] >= beat - SAME
        if self.play.until is not None:
            return piece.tempo_map.resolve(self.play.until) > beat + SAME
        return self.play.times not in (None, 1)

    def count_before(self, before_beat: float) -> int:
        """The number of beginnings of the entry, or of places of its pattern, that lie before a
        beat.
        """
        return n_before(self.start_beats or (), before_beat - SAME)

    def entry_between(
        self, first_index: int, stop_index: int, write_position: Callable[[float], str]
    ) -> Entry:
        """The entry with only its beginnings from number `first_index` to before `stop_index`;
        `write_position` writes beats.
        """
        start_beats = self.start_beats or ()
        if not isinstance(start_beats, PlaceBeats):
            n_starts = stop_index - first_index
            excerpt = self.entry.with_fields(
                at=write_position(start_beats[first_index]), until=None, times=str(n_starts)
            )
            return excerpt if n_starts > 1 else excerpt.with_fields(every=None, times=None)
        return self.entry.with_fields(
            **start_beats.excerpt_fields(first_index, stop_index, write_position)
        )


def entry_of_play(play_words: words.PlayWords, play_text: str) -> Entry:
    """The entry of a play that was read from a text, without its position."""
    play_options = {name: word.text for name, word in play_words.options.items()}
    transforms = tuple(
        play_text[transformation.offset : transformation.offset + transformation.length]
        for transformation in play_words.transforms
    )
    return Entry({"play": play_words.played.text, **play_options}, transforms)


def placed_entries(
    score_texts: Texts, piece: Piece, player: str, since_beat: float = -inf
) -> list[PlacedEntry]:
    """The entries of a player's part, in the order written; only those that may begin on beat
    `since_beat` or later.
    """
    earliest_start = since_beat - SAME
    entry_numbers = [
        number
        for number, (_, starts) in enumerate(_plays_of_player(piece, player))
        if starts is None
        or (starts.last_beat if isinstance(starts, PlaceBeats) else starts[-1] if starts else inf)
        >= earliest_start
    ]
    return [*_placed_entries(score_texts, piece, player, entry_numbers)]


def newest_first(texts: Texts, piece: Piece, player: str) -> Iterator[PlacedEntry]:
    """The entries of a player's part, the last one written first."""
    return _placed_entries(
        texts, piece, player, reversed(range(len(_plays_of_player(piece, player))))
    )


def _plays_of_player(piece: Piece, player: str) -> list[tuple[Play, Sequence[float] | None]]:
    plays_and_starts = zip(piece.parts, piece.starts, strict=True)
    return [
        play_and_starts
        for play_and_starts in plays_and_starts
        if play_and_starts[0].player == player
    ]


def _placed_entries(
    score_texts: Texts, piece: Piece, player: str, entry_numbers: Iterable[int]
) -> Iterator[PlacedEntry]:
    """Entries of a player's part, by their numbers."""
    part_node, plays_and_starts = _part_node(score_texts, player), _plays_of_player(piece, player)
    table_rows: list[tuple[int, Entry, str]] = []
    if isinstance(part_node, Scalar) and not part_node.is_empty:
        line_number = previous_offset = 0
        for table_row, row_offset in words.rows(part_node.text):
            line_number += part_node.text.count("\n", previous_offset, row_offset)
            previous_offset, parsed_row = row_offset, words.parse_row(table_row, row_offset)
            entry = entry_of_play(parsed_row.play, part_node.text)
            table_rows.append((line_number, entry.from_position(parsed_row.at.text), table_row))
    for entry_number in entry_numbers:
        part_play, starts = plays_and_starts[entry_number]
        begin_beat = piece.tempo_map.resolve(part_play.at)
        if isinstance(part_node, document.Sequence):
            yield PlacedEntry(
                entry_number,
                _entry_of_item(part_node.items[entry_number]),
                part_play,
                begin_beat,
                starts,
            )
        else:
            line_number, entry, table_row = table_rows[entry_number]
            yield PlacedEntry(line_number, entry, part_play, begin_beat, starts, table_row)


@dataclass(frozen=True, slots=True)
class PartEdit:
    """A change of one player's part: entries that end at a position, entries to remove, and new
    ones.
    """

    player: str
    end_position: str = ""
    ended_entries: Sequence[PlacedEntry] = ()
    removed_entries: Sequence[PlacedEntry] = ()
    added_entries: Sequence[Entry] = ()

    def as_list_edit(self) -> ListEdit:
        """This change as the edit of a list."""
        path = ("parts", self.player)

        def edited_list(list_document: document.Document, n_removed_before: int) -> str:
            for ended_entry in self.ended_entries:
                item_path = (*path, ended_entry.number - n_removed_before)
                try:
                    edited_text = edit.put(list_document, (*item_path, "until"), self.end_position)
                except EditError:  # an alias cannot be edited: write the entry out
                    edited_text = edit.put(
                        list_document,
                        item_path,
                        ended_entry.entry.with_fields(until=self.end_position).flow_text(),
                    )
                list_document = edit.read(edited_text, list_document.file)
            # Add new entries before others are removed: a list that never becomes empty keeps its
            # style.
            if self.added_entries:
                entry_texts = [entry.flow_text() for entry in self.added_entries]
                list_document = edit.read(
                    edit.extend(list_document, path, entry_texts, SECTIONS), list_document.file
                )
            if self.removed_entries:
                return edit.remove(
                    list_document,
                    *((*path, placed.number - n_removed_before) for placed in self.removed_entries),
                )
            return list_document.text

        numbers = [placed.number for placed in self.ended_entries]
        numbers += [
            placed.number - 1 for placed in self.removed_entries
        ]  # include an item that stays
        return ListEdit(path, min(numbers, default=None), edited_list)

    def as_table_edit(self, table_text: str) -> Callable[[document.Document], str]:
        """This change as the edit of a table."""
        path = ("parts", self.player)
        rows_by_line: dict[int, str | None] = {
            placed.number: _row_with_end(placed, self.end_position) for placed in self.ended_entries
        }
        rows_by_line |= dict.fromkeys(placed.number for placed in self.removed_entries)

        def edited_table(table_document: document.Document) -> str:
            edited_text = table_document.text
            for entry in self.added_entries:
                edited_text = edit.add_row(
                    edit.read(edited_text, table_document.file),
                    path,
                    _row_aligned_with_table(entry, table_text),
                )
            return (
                edit.put_rows(edit.read(edited_text, table_document.file), path, rows_by_line)
                if rows_by_line
                else edited_text
            )

        return edited_table


def with_part_edits(score_texts: Texts, *edits: PartEdit) -> Texts:
    """Change the parts of several players.

    New entries are written in the form of the part: list items or rows. Raises EditError.
    """
    list_edits: list[ListEdit] = []
    table_edits: list[Callable[[document.Document], str]] = []
    for part_edit in edits:
        if part_edit.ended_entries or part_edit.removed_entries or part_edit.added_entries:
            node = _part_node(score_texts, part_edit.player)
            if isinstance(node, Scalar) and not node.is_empty:
                table_edits.append(part_edit.as_table_edit(node.text))
            else:
                list_edits.append(part_edit.as_list_edit())
    score_texts = score_texts.edited_lists(list_edits) if list_edits else score_texts
    for table_edit in table_edits:
        score_texts = score_texts.edited("parts", table_edit)
    return score_texts


def _part_node(texts: Texts, player: str) -> Node | None:
    parts = texts.section("parts")
    return parts.get(player) if isinstance(parts, document.Mapping) else None


def _entry_of_item(item_node: Node) -> Entry:
    assert isinstance(item_node, document.Mapping)
    entry_fields = {
        name: child.text
        for name, (_, child) in item_node.entries.items()
        if isinstance(child, Scalar) and name != "do"
    }
    transforms_node = item_node.get("do")
    transforms: list[str] = []
    if isinstance(transforms_node, document.Sequence):
        transforms = [node.text for node in transforms_node.items if isinstance(node, Scalar)]
    elif isinstance(transforms_node, Scalar) and not transforms_node.is_empty:
        transforms = [*split_chain(transforms_node.text)]
    return Entry(entry_fields, tuple(transforms))


def _row_with_end(placed: PlacedEntry, end_position: str) -> str:
    """A row with an end at a position; its other words and their spaces do not change."""
    table_row = placed.row_text or ""
    until_text = words.parse_row(table_row).play.options.get("until")
    if until_text is None:
        return f"{table_row.strip()} until {end_position}"
    return (
        table_row[: until_text.offset]
        + end_position
        + table_row[until_text.offset + len(until_text.text) :]
    ).strip()


def _row_aligned_with_table(new_entry: Entry, table_text: str) -> str:
    """A row of an entry, aligned with the last row of its table."""
    column_width = 0
    for row, _ in words.rows(table_text):
        cell = re.match(r"\S+\s+", row.strip())
        column_width = cell.end() if cell else column_width
    position_text = new_entry.fields["at"]
    return f"{position_text.ljust(column_width - 1)} {new_entry.row_text()}"
