"""Automation: parameters that glide, follow a pattern of values, or swing between two."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, cast

from ergon.instruments.model import Target
from ergon.notation.clock.positions import Length, Position
from ergon.notation.clock.tempo import TempoMap
from ergon.notation.tables import quantities, value_kinds
from ergon.notation.tables.fields import Field, Record, Values
from ergon.notation.tables.named_values import literal, parse_with_names
from ergon.notation.tables.shapes import Reference, Text, choice
from ergon.notation.text.document import Scalar
from ergon.notation.text.errors import TextError, quote
from ergon.notation.text.values import Place, Time
from ergon.scores.gesture.midi_course import Course
from ergon.scores.gesture.midi_source import SOURCES, parse_source
from ergon.scores.pattern.draws import Draws
from ergon.scores.pattern.pattern import Pattern, PlaceSequence
from ergon.scores.pattern.steps import PlaceBeats, entry_place_beats
from ergon.scores.pattern.values import Amount, ReadAmount, parse_values
from ergon.scores.reading.curves import CurvePoint, is_curve, parse_curve
from ergon.scores.reading.midi_uses import MidiUses
from ergon.scores.reading.patterns import PATTERN_TABLE, PatternValues, pattern_of

WaveShape = Literal["sine", "triangle", "ramp", "square"]
WAVE_SHAPES: tuple[WaveShape, ...] = ("sine", "triangle", "ramp", "square")


@dataclass(frozen=True, slots=True)
class Swing:
    """A slow oscillation from `low` to `high` and back, begun at a `phase` from 0 to 1."""

    low: Amount
    high: Amount
    period: Length
    shape: WaveShape
    phase: float


@dataclass(frozen=True, slots=True)
class Automation:
    """A parameter that follows a pattern of `amounts`, a swing, a curve or `moves` of a MIDI file
    between two positions.

    A glide (`to` with `over`) has one of the `points`, which is reached within `over`. Each of the
    `moves` is a value at a time after the beginning.
    """

    target: Target
    parameter: str
    at: Position
    until: Position | None
    every: Length | None
    times: int | None
    pattern: Pattern | None
    amounts: Mapping[str, Amount]
    swing: Swing | None
    place: Place
    begin_place: Place
    strikes_name: str = ""  # strikes that the values are for; set before they fall
    points: tuple[CurvePoint, ...] = field(default=(), metadata={"hash_omits_empty": True})
    over: Length | None = field(default=None, metadata={"hash_omits_empty": True})
    moves: tuple[tuple[Length, Amount], ...] = field(
        default=(), metadata={"hash_omits_empty": True}
    )

    # If all notes of an instrument change: the targets of the other notes that the piece plays.
    other_notes: tuple[Target, ...] = field(default=(), metadata={"hash_omits_empty": True})

    @property
    def modules(self) -> tuple[tuple[str, str], ...]:
        """The parts and their modules that change."""
        return tuple((target.part, target.module) for target in (self.target, *self.other_notes))

    @property
    def name(self) -> str:
        """The parameter as it is written: `bell.m.f`."""
        return f"{self.target.text}.{self.parameter}"

    def place_beats(self, tempo: TempoMap, seed: int) -> PlaceBeats:
        """When a pattern sets values. Raises TextError."""
        assert self.pattern is not None
        until_beat = None if self.until is None else tempo.resolve(self.until)
        place_sequence = PlaceSequence(
            self.pattern, Draws(seed, self.strikes_name or f"set/{self.name}")
        )
        begin = tempo.resolve(self.at)
        return entry_place_beats(
            tempo,
            begin,
            place_sequence,
            step_length=self.every,
            times=self.times,
            end_beat=until_beat,
        )


AUTOMATION_RECORD = Record(
    "automation",
    "a parameter that glides, follows a pattern of values or a MIDI file (`set`), or swings "
    "(`lfo`)",
    (
        Field(
            "set",
            Reference("a parameter, such as bell.m.f", ("modules",)),
            "what glides or follows a pattern",
        ),
        Field(
            "to",
            Text(
                str,
                "a value, a curve such as A3@0 smooth C4@2, or values such as A3 C4 E4",
                has_values=True,
            ),
            "the value that it glides to, its curve, or the pattern of its values",
        ),
        Field("over", value_kinds.LENGTH, "how long it glides to a value"),
        Field("curve", choice("line", "smooth"), "the way to that value", "line"),
        Field("every", value_kinds.LENGTH, "length of a step"),
        Field("times", value_kinds.TIMES, "number of rounds", shown="once, or until `until`"),
        *PATTERN_TABLE,
        Field("from", value_kinds.PATH, "a MIDI file that it follows"),
        Field("channel", value_kinds.integer(1, 16, "1"), "of that file", shown="all together"),
        Field(
            "by",
            Text(
                parse_source,
                "what moves in MIDI, such as cc 1, cc 1/33, bend or pressure",
                meanings=SOURCES,
            ),
            "what it follows of the file: a controller, two of them (14 bits), the pitch wheel, "
            "the pressure of a channel or of a key (pressure C4)",
        ),
        Field("start", value_kinds.RATIO, "quarter notes of the file that are left out", 0.0),
        Field("lfo", Reference("a parameter, such as bell.m.K", ("modules",)), "what swings"),
        Field(
            "range",
            Text(str, "two values or factors, such as 0.8..1.2", has_values=True),
            "between what",
        ),
        Field("period", value_kinds.LENGTH, "length of one swing"),
        Field("shape", choice(*WAVE_SHAPES), "the way from one end to the other and back", "sine"),
        Field("phase", value_kinds.UNIT_RATIO, "where in its period it begins", 0.0),
        Field("at", value_kinds.WHEN, "where it begins", required=True),
        Field("until", value_kinds.WHEN, "where the parameter has its own value again"),
    ),
    synonyms={"glide": "set", "ramp": "set"},
)
_PATTERN_NAMES = ("every", "times", *(field.name for field in PATTERN_TABLE))
_SET_NAMES = ("to", "over", "curve", *_PATTERN_NAMES)
_FILE_NAMES = ("from", "channel", "by", "start")
_LFO_NAMES = ("range", "period", "shape", "phase")
# By what an entry is called: the fields that it needs, and those that it may not have.
_FIELDS_BY_KIND = {
    "set": (("to",), (*_FILE_NAMES, *_LFO_NAMES)),
    "from": (("from", "by", "range"), (*_SET_NAMES, "period", "shape", "phase")),
    "lfo": (("range", "period"), (*_FILE_NAMES, *_SET_NAMES)),
}


def has_required_fields(automation_values: Values) -> bool:
    """Whether the fields of the written kind (`set` or `lfo`) are there, and no others; reports an
    error if not.
    """
    written_kinds = automation_values.written("set", "lfo")
    if len(written_kinds) != 1:
        automation_values.error("E103", "automation needs either `set` or `lfo`, and a parameter")
        return False
    follows_file = written_kinds[0] == "set" and bool(automation_values.written("from"))
    written_kind = "from" if follows_file else written_kinds[0]
    required_fields, contrary_fields = _FIELDS_BY_KIND[written_kind]
    for field_name in required_fields:
        if not automation_values.written(field_name):
            automation_values.error(
                "E103",
                f"automation: `{field_name}` is missing beside `{written_kind}`",
                written_kind,
            )
            return False
    for field_name in automation_values.written(*contrary_fields):
        automation_values.error(
            "E111", f"automation: `{field_name}` does not belong to `{written_kind}`", field_name
        )
        return False
    is_glide = automation_values.written("over") or is_curve(str(automation_values["to"] or ""))
    for field_name in (
        automation_values.written(*_PATTERN_NAMES)
        if is_glide
        else automation_values.written("curve")
    ):
        refusal_text = (
            "a glide has no steps" if is_glide else "only a glide `over` a length has a way"
        )
        automation_values.error(
            "E111", f"automation: {refusal_text}; remove `{field_name}`", field_name
        )
        return False
    if automation_values.written("over") and is_curve(str(automation_values["to"] or "")):
        automation_values.error(
            "E111", "automation: a curve has times of its own; remove `over`", "over"
        )
        return False
    return all(name in automation_values.by_name for name in (*written_kinds, *required_fields))


def build_automation(
    values: Values,
    automated_target: Target,
    parameter_name: str,
    read_amount: ReadAmount,
    midi_uses: MidiUses,
) -> Automation | None:
    """The automation of a known parameter, whose amounts `read_amount` reads; None if an error was
    reported. A file that it follows is noted in `midi_uses`.
    """
    fields, pattern, swing = values, None, None
    moves: tuple[tuple[Length, Amount], ...] = ()
    amounts: Mapping[str, Amount] = {}
    curve_points: tuple[CurvePoint, ...] = ()
    range_name = "range" if fields.written("range") else "to"
    try:
        if fields.written("from"):
            range_ends = parse_with_names(
                _field_node(fields, "range"), lambda text: parse_range(text, read_amount)
            )
            moves = _followed_values(
                range_ends, parameter_name, midi_uses.followed_course(fields), fields
            )
            if not moves:  # a mistake of the file was reported
                return None
        elif fields.written("set") and is_curve(fields["to"]):
            curve_points = parse_with_names(
                _field_node(fields, "to"), lambda text: parse_curve(text, read_amount)
            )
        elif fields["over"] is not None:
            curve_points = (_glide_point(fields, read_amount),)
            if not fields["over"].is_some:
                fields.error("E202", "automation: a glide takes a time above 0", "over")
                return None
        elif fields.written("set"):
            is_pitch = parameter_name == "f"
            value_order, amounts = parse_with_names(
                _field_node(fields, "to"),
                lambda text: parse_values(text, read_amount, is_pitch=is_pitch),
            )
            pattern = pattern_of(cast("PatternValues", fields.by_name), value_order)
            if fields["every"] is None and pattern.euclid is None:
                message = (
                    "automation: one value needs `over`, the length of the glide"
                    if value_order.places == 1
                    else "automation: the length of a step is missing; write `every`"
                )
                fields.error("E103", message, "to")
                return None
        else:
            low_amount, high_amount = parse_with_names(
                _field_node(fields, "range"), lambda text: parse_range(text, read_amount)
            )
            swing = Swing(
                low_amount, high_amount, fields["period"], fields["shape"], fields["phase"]
            )
            if not swing.period.is_some:
                fields.error("E202", "automation: the period must be above 0", "period")
                return None
    except TextError as error:
        fields.context.text_error(error, _field_node(fields, range_name), range_name)
        return None
    return Automation(
        automated_target,
        parameter_name,
        fields["at"],
        fields["until"],
        fields["every"],
        fields["times"],
        pattern,
        amounts,
        swing,
        fields.node.place,
        fields.place_of("at"),
        points=curve_points,
        over=fields["over"],
        moves=moves,
    )


def _followed_values(
    range_ends: tuple[Amount, Amount],
    parameter_name: str,
    controller_course: Course,
    automation_values: Values,
) -> tuple[tuple[Length, Amount], ...]:
    """The values of a parameter whose ends are those of a controller, from a place of its file on.

    Raises TextError for ends between which there is no way.
    """
    (low_amount, high_amount), start_quarter, range_length = (
        range_ends,
        automation_values["start"],
        len(str(automation_values["range"])),
    )
    if low_amount.is_factor != high_amount.is_factor:
        message = "write two values or two factors: there is no way from a value to a factor"
        raise TextError(message, length=range_length, code="E202")
    if parameter_name in ("f", "t60") and not min(low_amount.value, high_amount.value) > 0.0:
        raise TextError(f"{parameter_name} must stay above 0", length=range_length, code="E202")
    last_positions = [share for quarter, share in controller_course if quarter <= start_quarter][
        -1:
    ]
    shares_after = [
        (quarter - start_quarter, share)
        for quarter, share in controller_course
        if quarter > start_quarter
    ]
    return tuple(
        (
            Length(quarters=quarters_later),
            Amount(
                low_amount.value + (high_amount.value - low_amount.value) * share,
                low_amount.is_factor,
            ),
        )
        for quarters_later, share in (*((0.0, share) for share in last_positions), *shares_after)
    )


def _field_node(values: Values, name: str) -> Scalar:
    node = values.nodes[name]
    assert isinstance(node, Scalar)
    return node


def _glide_point(fields: Values, read_amount: ReadAmount) -> CurvePoint:
    """The point that a glide reaches. Raises TextError."""
    node = fields.nodes["to"]
    value_text = (literal(node) if isinstance(node, Scalar) else None) or fields["to"]
    return CurvePoint(Time(), _parse_final_amount(value_text, read_amount), fields["curve"])


def _parse_final_amount(glide_text: str, read_amount: ReadAmount) -> Amount:
    """The value that a glide ends with. Raises TextError."""
    words = glide_text.split()
    if len(words) > 1:
        message = "a glide goes to one value; several values need the length of a step: every 1"
        raise TextError(message, length=len(glide_text), code="E201")
    amount_word = glide_text.strip()
    amount = read_amount(amount_word)
    if not amount.value > 0.0:
        message = (
            f"{quote(amount_word)}: a glide must end above 0, because no factor leads away from 0"
        )
        raise TextError(message, length=max(1, len(amount_word)), code="E202")
    return amount


def parse_range(range_text: str, read_amount: ReadAmount) -> tuple[Amount, Amount]:
    """Read `0.8..1.2` (factors of the parameter's own value) or `1kN/m..3kN/m`, both ends by
    `read_amount`. Raises TextError.
    """
    low_text, dots, high_text = (part.strip() for part in range_text.partition(".."))
    if not dots or not low_text or not high_text:
        message = f"{quote(range_text.strip())} is not a range such as 0.8..1.2 or 1kN/m..3kN/m"
        raise TextError(message, length=max(1, len(range_text)), code="E201")
    range_ends = []
    for end_text in (low_text, high_text):
        try:
            is_ratio = _has_no_unit(low_text) and _has_no_unit(high_text)
            range_ends.append(
                Amount(quantities.quantity(end_text, quantities.RATIO), is_factor=True)
                if is_ratio
                else read_amount(end_text)
            )
        except TextError as error:
            error.offset += range_text.index(end_text)
            raise
    return range_ends[0], range_ends[1]


def _has_no_unit(word: str) -> bool:
    return all(character in "0123456789.eE+-/" for character in word)
