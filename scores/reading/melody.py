"""Melodies: strikes one by one, as a list or a table `at  what  impulse`, and phrases of them."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import floor
from typing import Any, NamedTuple

from ergon.instruments.model import Target
from ergon.instruments.names import PartNames
from ergon.notation.clock.positions import Length, Position
from ergon.notation.tables import notes, tuning
from ergon.notation.tables import value_kinds as k
from ergon.notation.tables.expressions import (
    has_name,
    is_computed,
    note_of,
)
from ergon.notation.tables.fields import Field, Record, Values
from ergon.notation.tables.quantities import note_slip
from ergon.notation.tables.shapes import (
    MISSING,
    Context,
    ListOf,
    Name,
    Reference,
    Shape,
    Text,
    wrong_shape,
)
from ergon.notation.tables.strengths import LEVEL, Level, is_level
from ergon.notation.tables.tuning import Tuning
from ergon.notation.text import document
from ergon.notation.text.document import Node, Scalar
from ergon.notation.text.errors import TextError, quote
from ergon.notation.text.values import Place
from ergon.scores.gesture.transforms import Transform
from ergon.scores.pattern import words
from ergon.scores.reading.foreign_words import ELSEWHERE, MEANT

MAX_ROWS = 100_000  # of one melody
_STILL = Length()
MAX_CHORD = 256  # names of one strike
_WORD = re.compile(r"\S+")
_HELP = "an entry says `what` is struck; `to`, beside `entries`, is whose notes they are"


@dataclass(frozen=True, slots=True)
class Row:
    """A strike as written: time, names of what is struck, and level (None: as the row before)."""

    at: Position | Length
    what: tuple[Name, ...]
    level: Level | None
    place: Place
    before: tuple[Name, ...] = ()  # what was written, where a transposition has changed it
    jitter: Length = _STILL  # how far chance moves it, earlier or later
    lasting: Length | None = None  # None: it has no end
    swells: bool = False  # to the next level that is written
    act: str = ""  # by which notes are played, if the instrument has it; "": the usual one


class WhatShape(Reference):
    """Names separated by spaces, or as a list."""

    def read(self, node: Node, name: str, context: Context) -> Any:
        """Read a node."""
        items = node.items if isinstance(node, document.Sequence) else [node]
        struck_names: list[Name] = []
        for item in items:
            if not isinstance(item, Scalar):
                return wrong_shape(self, item, name, context)
            for word in _WORD.finditer(item.text):
                struck = _struck(word.group(), word.start(), item, name, context)
                if struck is None:
                    return MISSING
                struck_names.append(struck)
        if not 1 <= len(struck_names) <= MAX_CHORD:
            message = f"{context.label(name)}: from 1 to {MAX_CHORD} names are expected"
            context.error("E106", message, node.place)
            return MISSING
        return tuple(struck_names)

    def schema(self) -> dict[str, Any]:
        """As JSON Schema."""
        return {"type": ["string", "array"], "items": {"type": ["string"]}}


def _is_impulse(word: str, node: Scalar, *, is_alone: bool) -> bool:
    """Whether the last word of a row is an impulse, not a name of what is struck. A ratio is an
    impulse, unless it is alone.
    """
    if notes.word_of(word) is not None and (is_alone or "/" not in word):
        return False
    if is_level(word) and not (is_alone and word[:1].isalpha()):
        return True
    try:
        return is_computed(word, node.document) and note_of(word, node.document) is None
    except TextError:
        return not is_alone or not has_name(word, node.document)


def _struck(word: str, start: int, node: Scalar, name: str, context: Context) -> Name | None:
    """The name that a word strikes: the word itself, or the note that it stands for."""
    try:
        note = note_of(word, node.document)
    except TextError as error:
        error.offset += start
        context.text_error(error, node, name)
        return None
    return Name(note or word, node.place_at(start, len(word)))


class Swelling(NamedTuple):
    """A level, and whether it leads to the next one that is written: `p ->`."""

    level: Level
    swells: bool


def _swelling(text: str) -> Swelling:
    word = text.rstrip()
    swells = word.endswith("->")
    return Swelling(LEVEL.parse(word[:-2].rstrip() if swells else text), swells)


SWELLING = replace(
    LEVEL,
    parse=_swelling,
    what=f"{LEVEL.what}; p -> leads to the next one",
    pattern=f"{(LEVEL.pattern or '$')[:-1]}( *->)?$",
)


def _row(values: Values) -> Row:
    level, swells = values["impulse"] or (None, False)
    return Row(values["at"], values["what"], level, values.node.place, swells=swells)


def _entry(position_kind: Text, doc: str) -> Record:
    fields = (
        Field("at", position_kind, doc, required=True),
        Field("what", WhatShape("notes or modules, such as D3, or D3 F3"), "what", required=True),
        Field("impulse", SWELLING, "how strongly", shown="that of the strike before"),
    )
    doc, foreign = "a strike of a melody: a note, a chord, a module", {"to": _HELP}
    return Record(
        "strike",
        doc,
        fields,
        _row,
        foreign=foreign,
        meant=MEANT["strike"],
        elsewhere=ELSEWHERE["strike"],
    )


ENTRY = _entry(k.WHEN, "where in the piece")
PHRASE_ENTRY = _entry(k.LENGTH, "how long after the beginning of the phrase")


@dataclass(frozen=True)
class Entries(Shape):
    """A list of strikes, or a table with rows such as `1|1  D3 F3  2mNs`."""

    entry: Record

    def read(self, node: Node, name: str, context: Context) -> Any:
        """Read a node."""
        if isinstance(node, document.Sequence):
            return _checked(ListOf(self.entry, 1, MAX_ROWS).read(node, name, context), context)
        if not isinstance(node, Scalar) or node.is_empty:
            return wrong_shape(self, node, name, context)
        entries_read, is_broken = [], False
        for number, (row, offset) in enumerate(words.rows(node.text)):
            if number >= MAX_ROWS:
                context.error("E105", f"the table has more than {MAX_ROWS:,} rows", node.place)
                return MISSING
            read = self._row(row, offset, node, context)
            is_broken |= read is None
            entries_read += [read] if read is not None else []
        if not entries_read and not is_broken:
            context.error("E106", f"{context.label(name)}: the table has no row", node.place)
            return MISSING
        return MISSING if is_broken else _checked(tuple(entries_read), context)

    def _row(self, row: str, offset: int, node: Scalar, context: Context) -> Row | None:
        cells = [(word.group(), offset + word.start()) for word in _WORD.finditer(row)]
        (position_text, start), option_cells = cells[0], cells[1:]
        impulse, swells = None, bool(option_cells) and option_cells[-1][0] == "->"
        if swells:
            word, start_of_arrow = option_cells.pop()
            if not option_cells or not is_level(option_cells[-1][0]):
                message = "`->` leads from a level to the next one: write p -> in this row"
                place = node.place_at(start_of_arrow, len(word))
                context.error("E204", message, place)
                return None
        if option_cells and _is_impulse(option_cells[-1][0], node, is_alone=len(option_cells) == 1):
            impulse = self._value("impulse", *option_cells.pop(), node, context)
        when = self._value("at", position_text, start, node, context)
        if not 1 <= len(option_cells) <= MAX_CHORD:
            message = "a row has a time, what is struck and an impulse, such as 1|1  D3 F3  2mNs"
            context.error("E204", message, node.place_at(start, len(position_text)))
            return None
        names = [_struck(word, place, node, "what", context) for word, place in option_cells]
        if when is MISSING or impulse is MISSING or None in names:
            return None
        struck = tuple(name for name in names if name is not None)
        level = impulse and impulse.level
        return Row(when, struck, level, node.place_at(start, len(position_text)), swells=swells)

    def _value(self, field: str, word: str, offset: int, node: Scalar, context: Context) -> Any:
        shape = self.entry.by_name[field].shape
        assert isinstance(shape, Text)
        try:
            return shape.read_word(word, node.document)
        except TextError as error:
            error.offset += offset
            context.text_error(error, node, field)
            return MISSING

    def chosen(self, node: Node) -> Shape:
        """The list of strikes, unless a table is written."""
        return ListOf(self.entry, 1, MAX_ROWS) if isinstance(node, document.Sequence) else self

    def schema(self) -> dict[str, Any]:
        """As JSON Schema."""
        array = ListOf(self.entry, 1).schema()
        return {**array, "type": ["array", "string"]}

    def words(self) -> str:
        """In words."""
        example = "1|1" if self.entry is ENTRY else "1/2"
        return f"a list of strikes, or a table below '|' with rows such as {example}  D3 F3  2mNs"


def _checked(rows: Any, context: Context) -> Any:
    """Rows, unless one swells to no level, or to one of another kind."""
    if rows is MISSING:
        return MISSING
    rows_read = [row for row in rows if isinstance(row, Row)]
    for number, row in enumerate(rows_read):
        if not row.swells or row.level is None:
            continue
        end = next(
            (
                later_row.level
                for later_row in rows_read[number + 1 :]
                if later_row.level is not None
            ),
            None,
        )
        if end is None:
            message = "`->` leads to the next level, and no entry after this one has a level"
        elif end.is_strength != row.level.is_strength or not (_is_one(row.level) and _is_one(end)):
            message = "`->` leads from one level to another of its kind, such as p -> and f"
        else:
            continue
        context.error("E204", message, row.place)
        return MISSING
    return rows


def _is_one(level: Level) -> bool:
    return level.low == level.high and level.factor == 1.0


# --- phrases ------------------------------------------------------------------------------------


def length_of(rows: Sequence[Row], written_length: Length | None) -> Length | None:
    """The length of a phrase; if none is written, up to the next whole beat; None if entries are
    not all in beats.
    """
    if written_length is not None:
        return written_length
    last_beat = 0.0
    for row in rows:
        assert isinstance(row.at, Length)
        if row.at.bars or row.at.seconds:
            return None
        last_beat = max(last_beat, row.at.beats)
    return Length(beats=floor(last_beat) + 1.0)


def transformed(
    rows: Sequence[Row],
    length: Length,
    chain: Iterable[Transform],
    mirrored: Callable[[Row, Row], Row],
) -> tuple[tuple[Row, ...], Length]:
    """Rows of a phrase after transformations, left to right, and its length. Raises TextError."""
    rows_out = tuple(rows)
    for transform in chain:
        if transform.word == "mirror":
            rows_out = tuple(mirrored(row, rows_out[0]) for row in rows_out)
            continue
        act = _ACTS.get(transform.word)
        if act is None:
            transform_names = ", ".join([*_ACTS, "mirror"])
            message = (
                f"'{transform.word}' moves the points of a gesture; a phrase has {transform_names}"
            )
            raise TextError(message, offset=transform.offset, length=transform.length)
        rows_out = tuple(act(rows_out, transform))
        if transform.word == "stretch":
            length = length.times(transform.amount)
        if transform.word == "from":
            length = _length_after(length, transform)
            if not rows_out or not length.is_some:
                message = "'from' begins after the last entry of this phrase"
                raise TextError(message, offset=transform.offset, length=transform.length)
    return rows_out, length


def _scale(rows: Sequence[Row], t: Transform) -> Iterator[Row]:
    for row in rows:
        yield replace(row, level=row.level and row.level.scaled(t.amount))


def _stretch(rows: Sequence[Row], t: Transform) -> Iterator[Row]:
    for row in rows:
        lasting = row.lasting and row.lasting.times(t.amount)
        yield replace(row, at=_length(row).times(t.amount), lasting=lasting)


def _shift(rows: Sequence[Row], t: Transform) -> Iterator[Row]:
    for row in rows:
        length = _length(row)
        beats, seconds = length.beats + t.time.beats, length.seconds + t.time.seconds
        yield replace(row, at=Length(length.bars, beats, seconds))


def _reverse(rows: Sequence[Row], t: Transform) -> Iterator[Row]:
    """The rows in reverse order, within the same time span."""
    lengths = [(a.bars, a.beats, a.seconds) for a in map(_length, rows)]
    if sum(any(unit) for unit in zip(*lengths, strict=True)) > 1:
        message = "'reverse' needs entries in one unit: all in beats, in bars or in seconds"
        raise TextError(message, offset=t.offset, length=t.length)
    start_and_end = [low + high for low, high in zip(min(lengths), max(lengths), strict=True)]
    for row, length in sorted(
        zip(rows, lengths, strict=True), key=lambda pair: pair[1], reverse=True
    ):
        yield replace(row, at=Length(*(a - b for a, b in zip(start_and_end, length, strict=True))))


def _quantise(rows: Sequence[Row], t: Transform) -> Iterator[Row]:
    for row in rows:
        length = _length(row)
        if length.bars or length.seconds:
            message = "'quantise' moves beats; the entries of this phrase are in bars or seconds"
            raise TextError(message, offset=t.offset, length=t.length)
        yield replace(row, at=Length(beats=floor(length.beats / t.amount + 0.5) * t.amount))


def _from(rows: Sequence[Row], t: Transform) -> Iterator[Row]:
    """Rows from an instant on, which becomes the beginning; every row has its own impulse
    already.
    """
    for row in rows:
        later_length = _length_after(_length(row), t)
        if min(later_length.beats, later_length.seconds) >= 0.0:
            yield replace(row, at=later_length)


def _length_after(length: Length, t: Transform) -> Length:
    """A length minus the time of `from`, in the same unit."""
    other_unit = length.seconds if t.time.beats else length.beats
    if length.bars or other_unit:
        message = "'from' needs entries and a length in its own unit: all in beats or in seconds"
        raise TextError(message, offset=t.offset, length=t.length)
    return Length(0.0, length.beats - t.time.beats, length.seconds - t.time.seconds)


def _jitter(rows: Sequence[Row], t: Transform) -> Iterator[Row]:
    if t.x:
        message = "a phrase has instants and no positions to move; write jitter 4ms 0mm"
        raise TextError(message, offset=t.offset, length=t.length)
    for row in rows:
        yield replace(row, jitter=Length(0.0, t.time.beats, t.time.seconds))


def _length(row: Row) -> Length:
    assert isinstance(row.at, Length)
    return row.at


_ACTS: Mapping[str, Callable[[Sequence[Row], Transform], Iterator[Row]]] = {
    "scale": _scale,
    "stretch": _stretch,
    "reverse": _reverse,
    "shift": _shift,
    "quantise": _quantise,
    "from": _from,
    "jitter": _jitter,
}


# --- notes --------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class NoteTargets:
    """The targets of the words of a melody: notes of the instruments `to`, or modules by full
    names.
    """

    part_names: PartNames
    to: tuple[Name, ...]
    _known: dict[str, list[Target]] = field(default_factory=dict, init=False, compare=False)

    def mirrored(self, row: Row, first_row: Row) -> Row:
        """A row mirrored in pitch about the first note of a phrase. Raises TextError."""
        heights = (self._note(word) for word in first_row.what)
        about = next((height for height in heights if height is not None), None)
        if about is None:
            raise TextError(f"{quote(' '.join(first_row.what))} has no note to mirror about")
        mirrored_names = [
            self.moved(word, 2 * (about - (self._note(word) or 0))) for word in row.what
        ]
        return self.renamed(row, mirrored_names)

    def renamed(self, row: Row, new_names: Sequence[Name]) -> Row:
        """A row with other notes; `before` keeps those that were written."""
        return replace(row, what=tuple(new_names), before=row.before or row.what)

    def moved(self, word: Name, semitones: float) -> Name:
        """A note, or a module of one, moved by so many semitones, of which an integer is keys of a
        scale. Raises TextError.
        """
        note = self._note(word)
        if note is None:
            raise TextError(f"{quote(word)} has no note that could be transposed")
        if not notes.LOWEST <= note + semitones <= notes.HIGHEST:
            raise TextError(f"{quote(word)} lies outside the notes from C-1 to B9")
        words = tuning.spelled(word).split(".")
        place = self._place(words)
        with tuning.used(self._tuning(words)):
            words[place] = notes.moved(words[place], semitones)
        return Name(".".join(words), word.place)

    def has_act(self, act: str) -> bool:
        """Whether a note of the instruments has an act that lasts as long as a note."""
        members = (member for name in self.to for member in self.part_names.members(name))
        return any(True for member in members for _ in self.part_names.drawn_act(member, act))

    def targets(self, row: Row, label: str) -> tuple[Target, ...]:
        """The MATs that a row strikes; reports what cannot be reached."""
        pairs = zip(row.what, row.before or row.what, strict=True)
        names = [
            name for word, name_before in pairs for name in self._names(word, name_before, label)
        ]
        if row.act:
            names = [
                name
                for struck_name in names
                for name in self.part_names.drawn_act(struck_name, row.act)
            ]
        return tuple(target for name in names for target in self._reached(name, label))

    def _reached(self, name: Name, label: str) -> list[Target]:
        """The targets of a name, kept for further rows, which differ only in their place."""
        known_targets = self._known.get(name)
        if known_targets is not None:
            return [
                Target(t.part, t.module, t.first, t.count, t.text, name.place)
                for t in known_targets
            ]
        targets_struck = self.part_names.struck(name, label)
        if targets_struck:  # else each row reports what is missing
            self._known[name] = targets_struck
        return targets_struck

    def _names(self, word: Name, word_before: Name, label: str) -> list[Name]:
        if notes.word_of(word) is None:
            slip = note_slip(word) if self.to else None
            if slip is None or word.partition(".")[0] in self.part_names.parts:
                return [word]
            message = f"{label}: {slip.message}"
            self.part_names.collector.error("E201", message, word.place, suggestion=slip.suggestion)
            return []
        if not self.to:
            message = f"{label}: {quote(word)} is a note; write `to`, whose notes are struck"
            self.part_names.collector.error("E103", message, word.place)
            return []
        names_read = []
        for to in self.to:
            family = self.part_names.family(to)
            if family is None:
                message = f"{label}: {quote(to)} has no notes; write `notes` in the instrument"
                if self.part_names.is_known(to):
                    self.part_names.collector.error("E304", message, to.place)
                else:
                    self.part_names.target(to, "mats", label)
                continue
            instrument, name_rest = family
            note = instrument.note(word)
            if note is None:
                known_notes = [part.rpartition(".")[2] for part in instrument.parts.values()]
                message = f"{label}: {quote(to)} has no note {quote(word)}"
                note_range = (
                    f"; its notes are {known_notes[0]} to {known_notes[-1]}" if known_notes else ""
                )
                if word == word_before:
                    self.part_names.collector.error(
                        "E301", message + note_range, word.place, word=word, names=known_notes
                    )
                else:
                    message += f", to which {quote(word_before)} is moved{note_range}"
                    self.part_names.collector.error("E301", message, word.place)
                continue
            names_read.append(Name(".".join(filter(None, (note, name_rest))), word.place))
        return names_read

    def _note(self, word: str) -> float | None:
        """The note of a name in semitones or keys; None if it has none. Raises TextError."""
        words = tuning.spelled(word).split(".")
        place = self._place(words)
        if place is None:
            return None
        with tuning.used(self._tuning(words)):
            return notes.step(words[place])

    def _tuning(self, words: Sequence[str]) -> Tuning | None:
        """The tuning of the note of a name: of its instrument, or of those that a note is for."""
        return self.part_names.tuning_of(".".join(words)) if words[1:] else tuning.written()

    def _place(self, words: list[str]) -> Any:
        """The index of the word in a name that is its note; None if there is none."""
        if len(words) == 1:
            return 0 if tuning.is_pitch(words[0]) else None
        for count in range(1, len(words)):
            is_family = ".".join(words[:count]) in self.part_names.families
            if is_family and tuning.is_pitch(words[count]):
                return count
        return None
