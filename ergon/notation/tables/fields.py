"""Records: tables of the names that may be written, their values and their meanings."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

from ergon.notation.tables.shapes import (
    MAX_NAME,
    MISSING,
    NAME,
    Context,
    Shape,
    Text,
    lost_indentation,
    name_help,
    report_lost,
    wrong_shape,
)
from ergon.notation.text import document
from ergon.notation.text.document import Node, Scalar
from ergon.notation.text.errors import TextError, quote, with_article
from ergon.notation.text.spelling import nearest
from ergon.notation.text.values import Place

_NO_ENTRY = (None, None)
_SHORT_NAME_LENGTH = 3  # characters: a shorter name resembles too many others
_NO_ARTICLE = ("rates", "strikes", "accuracy", "render", "mix", "master")


@dataclass(frozen=True)
class Field:
    """One name that may be written, its meaning, and its default."""

    name: str
    shape: Shape
    doc: str
    default: Any = None
    required: bool = False
    shown: str | None = None  # the default in words, where the value would not tell


@dataclass(slots=True)
class Values:
    """The values read from a record, by name, and their nodes for places in messages."""

    record: Record
    node: Node
    context: Context
    by_name: dict[str, Any] = field(default_factory=dict)
    nodes: dict[str, Node] = field(default_factory=dict)
    free: dict[str, Any] = field(default_factory=dict)
    kind: str = ""  # the written kind, in a record with kinds
    n_unknown: int = 0  # names that mean nothing here, reported
    misspelt: set[str] = field(default_factory=set)  # fields that some of them resemble
    is_foreign: bool = False  # one of them was a field of another kind of file

    def __getitem__(self, name: str) -> Any:
        """The value given, or the default."""
        return self.by_name[name] if name in self.by_name else self.record.by_name[name].default

    def written(self, *names: str) -> list[str]:
        """The names among these that are written, with a valid value or not."""
        return [name for name in names if name in self.nodes]

    def place_of(self, name: str) -> Place:
        """Where a field's value is written; else where the record is."""
        node = self.nodes.get(name)
        return node.place if node is not None else self.place

    @property
    def place(self) -> Place:
        """Where the name of the record is written, or its beginning."""
        return self.context.place or self.node.place

    def error(self, code: str, message: str, name: str = "", **more: Any) -> None:
        """Report about a field."""
        self.context.error(code, message, self.place_of(name), **more)


def _entries_without_cut_numbers(
    entries: Mapping[str, tuple[Scalar, Node]], record_values: Values
) -> Iterator[tuple[str, tuple[Scalar, Node]]]:
    """The entries, without numbers that a decimal comma cut in two (`{t60: 4,5s}`): these are
    reported.
    """
    pending_entry: tuple[str, tuple[Scalar, Node]] | None = None
    for entry_word, (key_node, child) in entries.items():
        if pending_entry is not None:
            pending_value = pending_entry[1][1]
            cut_text = pending_value.text if isinstance(pending_value, Scalar) else ""
            if (
                cut_text[-1:].isdigit()
                and entry_word[:1].isdigit()
                and pending_value.end + 1 == key_node.start
            ):
                joined_number = f"{cut_text}.{entry_word}"
                message = (
                    f"{record_values.context.label(pending_entry[0])}: a comma ends a value here; "
                )
                message += "write '.' as the decimal point"
                place = replace(pending_value.place, length=key_node.end - pending_value.start)
                record_values.context.error("E201", message, place, suggestion=joined_number)
                record_values.misspelt.add(pending_entry[0])
                pending_entry = None
                continue
            yield pending_entry
        pending_entry = entry_word, (key_node, child)
    if pending_entry is not None:
        yield pending_entry


def _identity(values: Values) -> Any:
    return values


@dataclass(frozen=True)
class Record(Shape):
    """Fixed fields; `kinds` are names of which one is written; `free` reads other names."""

    noun: str
    doc: str
    fields: tuple[Field, ...]
    build: Callable[[Values], Any] = _identity
    kinds: Mapping[str, Shape] = field(default_factory=dict)
    kind_required: bool = False
    free: Shape | None = None
    # Planned fields: name → sentence.
    refusal_by_name: Mapping[str, str] = field(default_factory=dict)
    # Fields of other files: name → help.
    help_by_foreign_name: Mapping[str, str] = field(default_factory=dict)
    synonyms: Mapping[str, str] = field(default_factory=dict)  # foreign name → field
    advice_by_name: Mapping[str, str] = field(default_factory=dict)  # what is no field: name → help
    # Fields that a lone value in place of the group may mean, each by the pattern of its texts.
    value_pattern_by_field: Mapping[str, str] = field(default_factory=dict)
    group_help: str = ""  # the help for what is not such a group
    by_name: dict[str, Field] = field(default_factory=dict, init=False)

    def __post_init__(self) -> None:
        """Index the table."""
        self.by_name.update({field.name: field for field in self.fields})

    def read(self, node: Node, name: str, context: Context) -> Any:
        """Read a node."""
        if isinstance(node, Scalar) and node.is_empty:
            named_entries: dict[str, tuple[Scalar, Node]] = {}
        elif isinstance(node, document.Mapping):
            named_entries = node.entries
            for line in node.lines.values():
                line.node.document.let, line.node.document.lets = node.document.let, None
        else:
            names = ", ".join([*self.by_name, *self.kinds][:12])
            help_text = self.group_help or f"a group of fields is written: {names}"
            return wrong_shape(self, node, name, context, help_text, self._group_text(node))
        is_nameless = not context.name and self.noun not in ("score", "module")
        if is_nameless or not (context.owner or self.noun == "score"):
            context = replace(context, owner=self.noun)
        record_values = Values(self, node, context)
        # No name begins with a digit: such a key is the rest of a number.
        has_numeric_key = any(word[:1].isdigit() for word in named_entries)
        checked_entries = (
            _entries_without_cut_numbers(named_entries, record_values)
            if has_numeric_key
            else named_entries.items()
        )
        lost_word = lost_indentation(named_entries, self._is_lost)
        for entry_word, (key_node, child_node) in checked_entries:
            if lost_word is not None and entry_word == lost_word[0]:
                report_lost(context, *lost_word, named_entries[lost_word[1]][0])
                return MISSING
            if (known_field := self.by_name.get(entry_word)) is not None:
                record_values.nodes[entry_word] = child_node
                if context.memory is None:
                    field_value = known_field.shape.read(child_node, entry_word, context)
                else:
                    read_value = partial(known_field.shape.read, child_node, entry_word, context)
                    let_node = named_entries.get("let", _NO_ENTRY)[1]  # values that others may name
                    field_value = context.memory.recall(
                        (child_node, entry_word, let_node), read_value
                    )
                if field_value is not MISSING:
                    record_values.by_name[entry_word] = field_value
            elif entry_word in self.kinds:
                self._read_kind(record_values, entry_word, key_node, child_node)
            else:
                self._read_unknown(record_values, entry_word, key_node, child_node)
        return self.build(record_values) if self._is_complete(record_values) else MISSING

    def _group_text(self, node: Node) -> str | None:
        """The group that a lone value stands for: `{bpm: 96}`; None if that is not known."""
        text = node.text.strip() if isinstance(node, Scalar) else ""
        for name, pattern in self.value_pattern_by_field.items():
            if match := re.fullmatch(pattern, text):
                return f"{{{name}: {match[1]}}}"
        return None

    def _read_kind(
        self, record_values: Values, entry_word: str, key_node: Scalar, child_node: Node
    ) -> None:
        if record_values.kind:
            message = (
                f"{record_values.context.label('')} has two kinds, {record_values.kind} and "
                f"{entry_word}; keep one"
            )
            record_values.context.error("E111", message, key_node.place)
            return
        record_values.kind = entry_word
        record_values.nodes[entry_word] = child_node
        record_values.by_name[entry_word] = self.kinds[entry_word].read(
            child_node, entry_word, record_values.context
        )

    def _is_lost(self, owner_name: str, entry_word: str) -> bool:
        """Whether a name, which means nothing here, was to be indented below an empty field."""
        if (
            owner_name not in self.by_name
            or self.free is not None
            or not NAME.fullmatch(entry_word)
        ):
            return False
        if entry_word in self.by_name[owner_name].shape.field_names():
            return entry_word not in self.field_names()
        explained_names = (
            *self.refusal_by_name,
            *self.help_by_foreign_name,
            *self.synonyms,
            *self.advice_by_name,
        )
        is_misspelt = (
            len(entry_word) > _SHORT_NAME_LENGTH
            and nearest(entry_word, self.field_names()) is not None
        )
        return (
            not is_misspelt
            and entry_word not in self.field_names()
            and entry_word not in explained_names
        )

    def _read_unknown(
        self, record_values: Values, entry_word: str, key_node: Scalar, child_node: Node
    ) -> None:
        context = record_values.context
        known_names = (*self.by_name, *self.kinds)
        if entry_word in self.refusal_by_name:
            context.error(
                "E108", f"{quote(entry_word)}: {self.refusal_by_name[entry_word]}", key_node.place
            )
        elif self.free is not None and self._is_free(self.free, entry_word, child_node):
            record_values.nodes[entry_word] = child_node
            free_value = self.free.read(child_node, entry_word, context)
            if free_value is not MISSING:
                record_values.free[entry_word] = free_value
        else:
            record_values.n_unknown += 1
            noun = "section" if not context.owner else "field"
            owner_text = f" in {context.owner}" if context.owner else ""
            message = f"unknown {noun} {quote(entry_word)}{owner_text}"
            if entry_word in self.help_by_foreign_name:
                if not record_values.is_foreign:  # report a file of the wrong kind once
                    context.error(
                        "E101", message, key_node.place, help=self.help_by_foreign_name[entry_word]
                    )
                record_values.is_foreign = True
                return
            if entry_word in self.synonyms:
                record_values.misspelt.add(self.synonyms[entry_word])
                context.error("E101", message, key_node.place, suggestion=self.synonyms[entry_word])
                return
            if entry_word in self.advice_by_name:
                context.error("E101", message, key_node.place, help=self.advice_by_name[entry_word])
                return
            cut_value = _cut_value(record_values, entry_word, key_node, child_node)
            if cut_value is not None:
                advice = f"a comma ends a value between braces; write it in quotes: {cut_value}"
                context.error("E101", message, key_node.place, help=advice)
                return
            if suggestion := nearest(entry_word, known_names):
                record_values.misspelt.add(suggestion)
            if (help_text := name_help(entry_word)) is not None:  # name and value in one word
                record_values.misspelt.add(entry_word.partition(":")[0])
            elif (
                noun == "section"
                and isinstance(child_node, document.Mapping)
                and record_values.nodes
            ):
                help_text = (
                    "a name of your own, such as an instrument, stands indented in its section"
                )
            context.error(
                "E101", message, key_node.place, word=entry_word, names=known_names, help=help_text
            )

    def _is_free(self, free: Shape, entry_word: str, child_node: Node) -> bool:
        """Whether an unknown name is a free name. A name that resembles a field, with a value that
        `free` cannot read, is a misspelt field.
        """
        if not NAME.fullmatch(entry_word) or len(entry_word) > MAX_NAME:
            return False
        if not isinstance(free, Text) or nearest(entry_word, self.by_name) is None:
            return True
        try:
            free.parse(child_node.text if isinstance(child_node, Scalar) else "")
        except TextError:
            return False
        return True

    def _is_complete(self, values: Values) -> bool:
        is_complete = True
        for declared in self.fields:
            if (
                declared.required
                and declared.name not in values.nodes
                and declared.name not in values.misspelt
            ):
                message = (
                    f"{values.context.label('')} has no '{declared.name}': {declared.shape.words()}"
                )
                values.context.error("E103", message, values.place)
            is_complete &= not declared.required or declared.name in values.by_name
        if self.kind_required and not values.kind and not values.n_unknown:
            examples = ", ".join(list(self.kinds)[:16])
            message = f"{values.context.label('')} has no kind (one of {examples})"
            values.context.error("E103", message, values.place)
        if self.kind_required and (not values.kind or values.by_name[values.kind] is MISSING):
            is_complete = False
        return is_complete

    def schema(self) -> dict[str, Any]:
        """As JSON Schema."""
        properties = {
            field.name: {
                **field.shape.schema(),
                "description": f"{field.doc} ({field.shape.words()})",
            }
            for field in self.fields
        }
        properties |= {kind: shape.schema() for kind, shape in self.kinds.items()}
        schema: dict[str, Any] = {
            "type": ["object", "null"],
            "properties": properties,
            "additionalProperties": self.free.schema() if self.free else False,
        }
        if required_names := [field.name for field in self.fields if field.required]:
            schema["required"] = required_names
        return schema

    def words(self) -> str:
        """In words."""
        return self.noun if self.noun in _NO_ARTICLE else with_article(self.noun)

    def field_names(self) -> Collection[str]:
        """The names of its fields and kinds."""
        return (*self.by_name, *self.kinds)

    def inner(self, name: str | int) -> Shape | None:
        """The shape of a field, of a kind, or of a free name."""
        if name in self.by_name:
            return self.by_name[str(name)].shape
        return self.kinds.get(str(name), self.free)


def _cut_value(
    record_values: Values, entry_word: str, key_node: Scalar, child_node: Node
) -> str | None:
    """The field in quotes of which an entry without a value is the rest, behind a comma."""
    field_name, field_node = next(reversed(record_values.nodes.items()), ("", child_node))
    if not (isinstance(field_node, Scalar) and isinstance(child_node, Scalar)):
        return None
    value = f"{field_node.text}, {entry_word}"
    is_rest = (
        child_node.is_empty
        and " " in value.replace(", ", ",")
        and field_node.place.line == key_node.place.line
    )
    return f'{field_name}: "{value}"' if is_rest else None
