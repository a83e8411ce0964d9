"""The tables of strikes and phrases."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any

from ergon.instruments.space.fields import DIRECTION
from ergon.instruments.transpose import INTERVAL_SHAPE
from ergon.notation.tables import value_kinds
from ergon.notation.tables.compound import ListOf
from ergon.notation.tables.fields import Field, Record, Values
from ergon.notation.tables.shapes import MISSING, Context, Reference, Shape, Text, wrong_shape
from ergon.notation.tables.strengths import LEVELS
from ergon.notation.text import document
from ergon.notation.text.document import Mapping, Node, Scalar
from ergon.scores.gesture.transforms import MEANINGS as GESTURE_MEANINGS
from ergon.scores.pattern.cycle_table import MEANINGS as RHYTHM_MEANINGS
from ergon.scores.reading import phrase_do
from ergon.scores.reading.foreign_words import ADVICE_BY_WORD, FIELD_SYNONYMS
from ergon.scores.reading.melody import ENTRY_RECORD, PHRASE_ENTRY_RECORD, EntriesShape
from ergon.scores.reading.patterns import PATTERN_TABLE
from ergon.scores.reading.rhythms import RHYTHM_SHAPE
from ergon.scores.reading.sweep_fields import PASSING_FIELDS


@dataclass(frozen=True)
class TransformationsShape(Shape):
    """Transformations as texts: what they mean depends on whether a phrase or a rhythm plays."""

    def read(self, node: Node, name: str, context: Context) -> Any:
        """Read a node."""
        do_nodes = node.items if isinstance(node, document.Sequence) else [node]
        text_nodes = [item for item in do_nodes if isinstance(item, Scalar)]
        if len(text_nodes) < len(do_nodes) or not text_nodes:
            return wrong_shape(self, node, name, context)
        return tuple(text_nodes)

    def schema(self) -> dict[str, Any]:
        """As JSON Schema."""
        return {"type": ["string", "array"], "items": {"type": ["string"]}}

    def words(self) -> str:
        """In words."""
        return "transformations, such as scale 0.5, or every 4 rev"

    def vocabulary(self) -> dict[str, str]:
        """Words of rhythms, and those of gestures that are for the entries of a phrase."""
        return {**GESTURE_MEANINGS, **RHYTHM_MEANINGS}


_TARGETS_SHAPE = ListOf(
    Reference("modules, such as sky.all", ("modules", "instruments")), 1, single=True
)
STRIKES_RECORD = Record(
    "strikes",
    "ergons that hit modules directly, without a key",
    (
        Field("to", _TARGETS_SHAPE, "what; of a melody the instrument whose notes are struck"),
        Field("at", value_kinds.WHEN, "when they begin"),
        Field(
            "for", value_kinds.LENGTH, "how long; of `sweep` and `path` once over the instrument"
        ),
        Field("until", value_kinds.WHEN, "when they end, instead of `for`"),
        Field(
            "rate", value_kinds.HERTZ, "mean strikes a second for each target, by chance (Poisson)"
        ),
        Field("every", value_kinds.LENGTH, "time between strikes, instead of `rate`"),
        Field(
            "times",
            value_kinds.TIMES,
            "number of strikes; of whole rounds, with `notes` or `euclid`",
        ),
        *PATTERN_TABLE,
        Field("impulse", LEVELS, "how strongly, from a range by chance; a pattern in turn"),
        Field(
            "notes",
            Text(str, "notes, such as A3 C4 E4", has_values=True),
            "pitch of a CEL at each strike",
        ),
        Field(
            "entries",
            EntriesShape(ENTRY_RECORD),
            "a melody, instead of all these: strikes one by one",
        ),
        Field(
            "play",
            Reference("a phrase, or a take of MIDI or MusicXML"),
            "what is played, `every` so often",
        ),
        Field("rhythm", RHYTHM_SHAPE, "a text of words, notes and rests, which is one cycle"),
        Field("cycle", value_kinds.LENGTH, "length of a cycle of the rhythm", shown="1bar"),
        *PASSING_FIELDS,
        Field("transpose", INTERVAL_SHAPE, "how much higher the notes of the phrase are"),
        Field(
            "do",
            TransformationsShape(),
            "transformations of a phrase, a rhythm, or strikes by the clock, left to right",
        ),
        Field("mass", value_kinds.MASS, "mass of the ergon, with `speed` instead of `impulse`"),
        Field("speed", value_kinds.SPEED, "speed of the ergon"),
        Field(
            "lasts",
            value_kinds.CONTACT_TIME,
            "how long each strike lasts; 0s: an instant",
            shown="0.19ms",
        ),
        Field("along", DIRECTION, "direction of the push on points in space, axis by axis"),
    ),
    synonyms=FIELD_SYNONYMS["strikes"],
    advice_by_name=ADVICE_BY_WORD["strikes"],
)


def _phrase_of_values(phrase_values: Values) -> Any:
    if phrase_values.written("entries", "like") or "entries" in phrase_values.misspelt:
        return phrase_values
    shape = phrase_values.record.by_name["entries"].shape
    message = f"{phrase_values.context.label('')} has no 'entries': {shape.words()}"
    phrase_values.context.error("E103", message, phrase_values.place)
    return MISSING


PHRASE_RECORD = Record(
    "phrase",
    "a melody with a length of its own, which `strikes` play",
    (
        Field("entries", EntriesShape(PHRASE_ENTRY_RECORD), "its strikes; needed without `like`"),
        Field(
            "length", value_kinds.LENGTH, "its length", shown="to the beat after its last strike"
        ),
        Field("to", _TARGETS_SHAPE, "the instrument whose notes are struck"),
        Field("impulse", LEVELS, "how strongly strikes are that say nothing"),
        Field("like", Reference("a phrase", ("phrases",)), "begin with another phrase"),
        Field("do", phrase_do.DO, "transformations, left to right (after those of `like`)"),
    ),
    _phrase_of_values,
    advice_by_name=ADVICE_BY_WORD["phrase"],
)


@dataclass(frozen=True)
class MelodyShape(Shape):
    """A record, or its `entries` alone as a list or a table."""

    record: Record

    def read(self, node: Node, name: str, context: Context) -> Any:
        """Read a node."""
        is_entries_alone = not isinstance(node, Mapping) and not (
            isinstance(node, Scalar) and node.is_empty
        )
        if not is_entries_alone:
            return self.record.read(node, name, context)
        melody_values = Values(self.record, node, context)
        entries = self.record.by_name["entries"].shape.read(node, name, context)
        if entries is MISSING:
            return MISSING
        melody_values.by_name["entries"], melody_values.nodes["entries"] = entries, node
        return melody_values

    def schema(self) -> dict[str, Any]:
        """As JSON Schema."""
        record_schema = self.record.schema()
        return {**self.record.by_name["entries"].shape.schema(), **record_schema, "type": _ANY_TYPE}

    def words(self) -> str:
        """In words."""
        return f"{self.record.words()}, or its entries alone"

    def field_names(self) -> Collection[str]:
        """The names of fields of the record."""
        return self.record.field_names()

    def chosen(self, node: Node) -> Shape:
        """The record, unless the node is its entries alone."""
        is_entries_alone = not isinstance(node, Mapping) and not (
            isinstance(node, Scalar) and node.is_empty
        )
        return (
            self.record.by_name["entries"].shape.chosen(node) if is_entries_alone else self.record
        )


_ANY_TYPE = ["object", "array", "string", "null"]
