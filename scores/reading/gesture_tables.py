"""The tables of gestures and takes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ergon.instruments.transpose import INTERVAL_SHAPE
from ergon.notation.tables import value_kinds
from ergon.notation.tables.compound import Either
from ergon.notation.tables.fields import Field, Record, Values
from ergon.notation.tables.shapes import Context, Reference, Shape, choice, wrong_shape
from ergon.notation.tables.velocities import VELOCITY_CURVE
from ergon.notation.text.document import Node, Scalar
from ergon.scores.gesture.points import CURVES
from ergon.scores.reading.playing_options import DO, GESTURE_FIELDS

CURVE_SHAPE = choice(*CURVES)


@dataclass(frozen=True)
class UnreadText(Shape):
    """A text that is read later, when the fields beside it are known."""

    what: str

    def read(self, node: Node, name: str, context: Context) -> Any:
        """Give the scalar itself."""
        return node if isinstance(node, Scalar) else wrong_shape(self, node, name, context)

    def schema(self) -> dict[str, Any]:
        """As JSON Schema."""
        return {"type": ["string"]}

    def words(self) -> str:
        """In words."""
        return self.what


GESTURE_RECORD = Record(
    "gesture",
    "a narrative gesture: a notation alone, or these fields",
    (
        Field(
            "notation", UnreadText("points x@t, such as 0mm@0 smooth 6mm@1/8"), "points in one line"
        ),
        Field(
            "points", UnreadText("a table below '|': rows of t, x and a curve"), "points in rows"
        ),
        Field("curve", CURVE_SHAPE, "the way into points without a curve word", "smooth"),
        Field("like", Reference("a gesture", ("gestures",)), "begin with another gesture"),
        Field("do", DO, "transformations, left to right (after those of `like`)"),
        *GESTURE_FIELDS,
    ),
)


@dataclass(frozen=True)
class GestureShape(Shape):
    """A gesture: a notation alone, or a table of fields."""

    def read(self, node: Node, name: str, context: Context) -> Any:
        """Read a node."""
        if not isinstance(node, Scalar) or node.is_empty:
            return GESTURE_RECORD.read(node, name, context)
        gesture_values = Values(GESTURE_RECORD, node, context)
        # A literal block ('|') without '@' is a table of points.
        field = "points" if node.style == "|" and "@" not in node.text else "notation"
        gesture_values.by_name[field] = gesture_values.nodes[field] = node
        return gesture_values

    def schema(self) -> dict[str, Any]:
        """As JSON Schema."""
        return Either(UnreadText(""), GESTURE_RECORD).schema()

    def words(self) -> str:
        """In words."""
        return "points such as 0mm@0 smooth 6mm@1/8, or a gesture's fields"

    def chosen(self, node: Node) -> Shape:
        """The table of fields, unless the node is a notation alone."""
        return self if isinstance(node, Scalar) and not node.is_empty else GESTURE_RECORD


OSC = "osc"  # an input whose values come by OSC
TAKE_RECORD = Record(
    "take",
    "a captured movement",
    (
        Field(
            "file",
            value_kinds.PATH,
            "a recording (.take), CSV, TSV, WAV, npz, C3D, BVH, TRC, SDIF, MIDI or MusicXML; of an "
            "input a WAV file, heard where no card is",
        ),
        Field(
            "input",
            value_kinds.integer_or(OSC, 1, 64, "1"),
            "an input of the sound card, or values that come by OSC, which drives ENX or ENF",
        ),
        Field("gain", value_kinds.FULL_SCALE, "what full scale of an input is"),
        Field("highpass", value_kinds.HERTZ, "cutoff of an input's high-pass filter", shown="20Hz"),
        Field(
            "clamp",
            value_kinds.FULL_SCALE,
            "the most that an input gives, either way",
            shown="`gain`",
        ),
        Field("glide", value_kinds.PAUSE, "time from one value by OSC to the next", shown="20ms"),
        Field(
            "channel",
            value_kinds.TITLE,
            "the column, player, point and axis (hand.x), channel of MIDI or part of MusicXML",
            shown="the only one; of notes all",
        ),
        Field(
            "velocity", value_kinds.IMPULSES, "impulses of the softest and the hardest note of MIDI"
        ),
        Field(
            "bend",
            INTERVAL_SHAPE,
            "how far the pitch wheel of MIDI goes where its file says nothing",
        ),
        Field("depth", value_kinds.TRAVEL, "how far such notes press a key that plays them"),
        Field("curve", VELOCITY_CURVE, "how strong a MIDI note of a velocity is", shown="even"),
        Field("trim", value_kinds.TRIM, "the part that is used; its beginning becomes time 0"),
        Field("smooth", value_kinds.HERTZ, "cutoff of a low-pass filter, run forward and backward"),
        Field("rate", value_kinds.HERTZ, "sample rate of a file without a column t [s]"),
        Field(
            "unit",
            value_kinds.SIZE,
            "what 1.0 means in a file without units (BVH, SDIF, tables; WAV: 1m)",
        ),
    ),
)
