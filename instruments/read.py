"""The tables of instruments, and the modules that are made from what was read."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from functools import partial, reduce
from itertools import chain
from typing import Any

from ergon import _core
from ergon.instruments.matter import from_material
from ergon.instruments.modal import retuned_modes, with_levels_at_places, with_listed_modes
from ergon.instruments.model import Form, Instrument, Module, Output, Places, Placing
from ergon.instruments.module_kinds import KINDS, POINT_KINDS, tables, with_optional_fields
from ergon.instruments.outputs import OutputsShape
from ergon.instruments.playing import LEVEL_DOC, LOUDNESS_SHAPE, READY_SHAPE, play_table, read_acts
from ergon.instruments.space import Space
from ergon.instruments.space.checks import check as check_in_space
from ergon.instruments.transpose import (
    INTERVAL_SHAPE,
    interval_between,
    named_pitch,
    transposed_value,
)
from ergon.notation.tables import tuning, value_kinds
from ergon.notation.tables.compound import ListOf, NamesOf, schema_of_types
from ergon.notation.tables.fields import Field, Record, Values
from ergon.notation.tables.named_values import named_amounts
from ergon.notation.tables.notes import Notes, check_note
from ergon.notation.tables.shapes import (
    MISSING,
    Context,
    Name,
    Reference,
    Shape,
    choice,
    wrong_shape,
)
from ergon.notation.tables.tuning_fields import TUNING
from ergon.notation.tables.value_kinds import AXES
from ergon.notation.text import document
from ergon.notation.text.document import Node
from ergon.notation.text.errors import TextError
from ergon.notation.text.memory import Recall, make_anew

# Steps of work for a module that is written: it is read, looked up, and put into the network.
_INTERRUPT_STEPS_PER_MODULE = 80_000
MODULES_DOC = "the network: names, each with one kind of module, and loops that make them"


def module_table(form: Form) -> Record:
    """`m: {CEL: {…}}`: each name has one kind of module.

    No field is required here, because `like:` or `from:` may supply it;
    `has_required_fields` checks the rest later.
    """
    kinds = {name: with_optional_fields(table) for name, table in tables(form).items()}
    return Record("module", "one module", (), kinds=kinds, kind_required=True)


def member_table(instrument_form: Form) -> Record:
    """The fields that one note of an instrument may have of its own."""
    member_fields = (
        Field(
            "modules",
            NamesOf(module_table(instrument_form), "module", has_loops=True),
            "fields of its modules",
        ),
        Field("f", value_kinds.PITCHES, "another pitch for a single generator"),
        Field("transpose", INTERVAL_SHAPE, "how much higher it is than its note"),
        Field("t60", value_kinds.DURATIONS, "another decay for a single generator"),
        Field(
            "M",
            value_kinds.MASS_OR_NUMBER if instrument_form == "ca" else value_kinds.MASS,
            "another mass for a single generator",
        ),
    )
    kinds = {
        name: with_optional_fields(table)
        for name, table in tables(instrument_form, POINT_KINDS).items()
    }
    return Record("member", "what one note has of its own", member_fields, kinds=kinds)


@dataclass(frozen=True)
class MembersShape(Shape):
    """`{F3: {modules: …}}`: the fields that single notes have of their own."""

    item: Record

    def read(self, node: Node, name: str, context: Context) -> Any:
        """Read a node."""
        if not isinstance(node, document.Mapping):
            return wrong_shape(self, node, name, context)
        members_by_note: dict[str, Any] = {}
        for entry_word, (entry_key, child) in node.entries.items():
            try:
                check_note(entry_word)
            except TextError as error:
                context.text_error(error, entry_key, name)
                continue
            inside = Context(context.collector, context.owner, context.name, entry_key.place)
            value = self.item.read(child, "", inside)
            if value is not MISSING:
                members_by_note[entry_word] = value
        return members_by_note

    def schema(self) -> dict[str, Any]:
        """As JSON Schema."""
        return {"type": ["object"], "additionalProperties": self.item.schema()}

    def words(self) -> str:
        """In words."""
        return "notes, each with fields, such as F3: {t60: 3s}"


PLACING_RECORD = Record(
    "place",
    "where it lies among loudspeakers, for `nearest`",
    (
        Field("across", value_kinds.DISTANCE, "how large a body of 1 m is there", 1.0, shown="1m"),
        Field(
            "at",
            ListOf(value_kinds.POSITION, 2, 2),
            "its middle: to the right, to the front",
            (0.0, 0.0),
        ),
        Field(
            "height", value_kinds.POSITION, "how high it lies", shown="on the plan of the layout"
        ),
    ),
)


_ROUTE_ADVICE = (
    "how an instrument is heard stands in its route: "
    "`mix: {route: [{from: bell, to: 1, gain: -6dB, pan: 0.3}]}`"
)
_SILENT_DOC = (
    f"{_ROUTE_ADVICE}; without a route it is silent, and at the prompt `mute bell` and `solo bell`"
)
_PEDAL_ADVICE = (
    "an instrument has no pedal: its `play` may have a `release`, which ends notes, and the pedal "
    "of a MIDI file (controller 64) delays it"
)
_BEGIN_ADVICE = (
    "an instrument begins with one of a file by `from: FILE/NAME`, such as "
    "`bell: {from: bells/church}`, or with another of this score by `like: NAME`"
)
_FIELDS_ELSEWHERE = {
    **dict.fromkeys(("use", "instrument", "preset", "patch"), _BEGIN_ADVICE),
    **dict.fromkeys(("gain", "volume", "pan", "to", "reverb", "send", "channel"), _ROUTE_ADVICE),
    **dict.fromkeys(("mute", "solo"), _SILENT_DOC),
    **dict.fromkeys(("pedal", "sustain"), _PEDAL_ADVICE),
}


def instrument_table(instrument_form: Form) -> Record:
    """The fields of an instrument of a form."""
    instrument_fields = (
        Field(
            "like",
            Reference("an instrument", ("instruments",)),
            "begin with another one's modules and outputs",
        ),
        Field("from", Reference("file/name"), "an instrument of a file that `use:` names"),
        Field(
            "modules", NamesOf(module_table(instrument_form), "module", has_loops=True), MODULES_DOC
        ),
        Field("out", OutputsShape(), "what is heard of it", shown="nothing"),
        Field("f", value_kinds.PITCHES, "its pitch; what it begins with is retuned as a whole"),
        Field(
            "transpose", INTERVAL_SHAPE, "how much higher than what it begins with, or is written"
        ),
        Field("tuning", TUNING, "of the notes of this instrument", shown="that of the score"),
        Field("notes", Notes(), "one of it at each note; its members are called by them"),
        Field(
            "members",
            MembersShape(member_table(instrument_form)),
            "what single members have of their own",
        ),
        Field("t60", value_kinds.DURATIONS, "another decay for a single generator"),
        Field(
            "M",
            value_kinds.MASS_OR_NUMBER if instrument_form == "ca" else value_kinds.MASS,
            "another mass for a single generator",
        ),
        Field("units", choice("si", "ca"), "`ca`: M, K, Z of the discrete network", "si"),
        Field("at", value_kinds.RATE, "the rate of that network"),
        Field("place", PLACING_RECORD, "where it lies among loudspeakers, for `nearest`"),
        Field("rate", value_kinds.RATE, "its own: audio divided by a whole number", shown="audio"),
        Field("space", value_kinds.integer(1, 3, "3"), "how many axes its masses move along", 1),
        Field(
            "gravity", value_kinds.GRAVITY, "gravity in space, against the last axis", shown="none"
        ),
        Field(
            "play",
            play_table(module_table(instrument_form)),
            "how it is played; the first act is usual",
        ),
        Field("ready", READY_SHAPE, "acts whose modules are built in advance"),
        Field("level", LOUDNESS_SHAPE, LEVEL_DOC, shown="unknown"),
    )
    kinds = {
        name: with_optional_fields(table)
        for name, table in tables(instrument_form, POINT_KINDS).items()
    }
    return Record(
        "instrument",
        "a CORDIS-ANIMA network",
        instrument_fields,
        kinds=kinds,
        advice_by_name=_FIELDS_ELSEWHERE,
    )


@dataclass(frozen=True)
class InstrumentShape(Shape):
    """An instrument; its `units:` and `space:` say how its numbers are read."""

    forms: Mapping[Form, Record]

    def read(self, node: Node, name: str, context: Context) -> Any:
        """Read a node."""
        instrument_tuning = context.tunings.get(context.name)
        if instrument_tuning is None:
            return self.chosen(node).read(node, name, context)
        named_amounts(node.document)  # `let` is in the tuning of the score
        with tuning.used(instrument_tuning):
            return self.chosen(node).read(node, name, context)

    def schema(self) -> dict[str, Any]:
        """As JSON Schema, including fields that only one form has."""
        first, *others = (table.schema() for table in self.forms.values())
        return reduce(_merged_schema, others, first)

    def words(self) -> str:
        """In words."""
        return self.forms["si"].words()

    def field_names(self) -> Collection[str]:
        """The names of fields of every form."""
        return self.forms["si"].field_names()

    def chosen(self, node: Node) -> Shape:
        """The table of the form in which the node is written."""
        return self.forms[form(node)]


def form(instrument_node: Node) -> Form:
    """The form in which an instrument is written."""

    def text(field: str) -> str:
        field_node = (
            instrument_node.get(field) if isinstance(instrument_node, document.Mapping) else None
        )
        return field_node.text.strip() if isinstance(field_node, document.Scalar) else ""

    if text("space") not in ("", "1"):
        return "space"
    return "ca" if text("units") == "ca" else "si"


def _merged_schema(base_schema: dict[str, Any], other_schema: dict[str, Any]) -> dict[str, Any]:
    """A schema with the properties and types that another has in addition."""
    first_type, their = base_schema.get("type"), other_schema.get("type")
    if isinstance(first_type, list) and isinstance(their, list) and not {*first_type} & {*their}:
        return schema_of_types(other_schema, base_schema)
    merged_schema = {
        key: _merged_schema(value, other_schema[key])
        if isinstance(value, dict) and isinstance(other_schema.get(key), dict)
        else value
        for key, value in base_schema.items()
    }
    if "properties" in merged_schema:
        merged_schema["properties"] = {
            **other_schema.get("properties", {}),
            **merged_schema["properties"],
        }
    return merged_schema


INSTRUMENT_SHAPE = InstrumentShape(
    {form_name: instrument_table(form_name) for form_name in ("si", "ca", "space")}
)


def has_required_fields(kind: str, values: Values, axes: int = 1) -> bool:
    """Whether all required fields of a module are there, after `like:` is followed; reports an
    error if not.
    """
    tables = KINDS[kind].tables
    # Under `units: ca` some kinds have more fields, and other fields are required.
    is_discrete = values.record.by_name.keys() != KINDS[kind].table.by_name.keys()
    table = tables["space" if axes > 1 else "ca" if is_discrete else "si"]
    required = [field for field in table.fields if field.required]
    for field in required:
        if field.name not in values.nodes and field.name not in values.misspelt:
            message = f"{values.context.label('')} has no '{field.name}': {field.shape.words()}"
            values.context.error("E103", message, values.place)
    return all(field.name in values.by_name for field in required)


def read_modules(
    module_values: Values, axes: int = 1, recall: Recall = make_anew
) -> tuple[Module, ...]:
    """The modules of a key or an instrument; modules that were refused are left out.

    `recall` gives those of values that were read before.
    """
    return _modules_of(module_values["modules"] or {}, axes, recall)


def _modules_of(bodies: Mapping[str, Any], axes: int, recall: Recall) -> tuple[Module, ...]:
    module_groups = (
        # Keep the values alive in the cache: their id() is its key and must not be reused.
        recall(("module", name, id(body), axes), partial(_values_and_modules, name, body, axes))[1]
        for name, body in bodies.items()
        if body is not MISSING
    )
    return tuple(chain.from_iterable(module_groups))


def _values_and_modules(
    module_name: str, module_values: Values, n_axes: int
) -> tuple[Values, tuple[Module, ...]]:
    """The values of a module, and the modules that they make: none if they were refused."""
    _core.poll(_INTERRUPT_STEPS_PER_MODULE)
    fields = _completed_values(
        module_values.kind, module_values.by_name[module_values.kind], n_axes
    )
    if fields is None or not has_required_fields(module_values.kind, fields, n_axes):
        return module_values, ()
    return module_values, with_ground_point(
        make_module(module_name, module_values.kind, fields, n_axes)
    )


def with_ground_point(module: Module) -> tuple[Module, ...]:
    """A module; for a DRY with `to`, preceded by the fixed point on which it rubs."""
    end_name = module.fields.get("to")
    if module.kind != "DRY" or end_name is None:
        return (module,)
    ground = Module(f"{module.name} ground", "SOL", {"X0": 0.0}, module.place)
    ends = (Name(ground.name, module.place), end_name)
    return ground, replace(module, fields={**module.fields, "to": None, "between": ends})


def _completed_values(kind: str, values: Values, axes: int = 1) -> Values | None:
    """The fields of a module with those computed from others; None if an error was reported."""
    if axes > 1:
        return values
    complete_fields = {"BANK": with_listed_modes, "MODES": with_levels_at_places}.get(kind)
    return from_material(kind, values) if complete_fields is None else complete_fields(values)


def make_module(module_name: str, kind_name: str, values: Values, n_axes: int = 1) -> Module:
    """A module with all its fields, with defaults filled in; checks the fields against each
    other.
    """
    if n_axes > 1:
        return _in_space(module_name, kind_name, values, n_axes)
    return _built_module(
        module_name,
        kind_name,
        {field.name: values[field.name] for field in values.record.fields},
        values,
    )


def _in_space(module_name: str, kind_name: str, module_values: Values, axis_count: int) -> Module:
    module_fields = {field.name: module_values[field.name] for field in module_values.record.fields}
    if kind_name in POINT_KINDS:
        module_fields["axes"] = axis_count
    check_in_space(kind_name, module_fields, module_values, axis_count)
    return _built_module(module_name, kind_name, module_fields, module_values)


def _built_module(
    module_name: str, kind_name: str, written_fields: dict[str, object], module_values: Values
) -> Module:
    """A module of the fields that are built from those that are written."""
    module_kind = KINDS[kind_name]
    for source_field in module_kind.source_fields:
        written_fields.pop(source_field, None)
    module_kind.complete(module_values, written_fields)
    module_kind.check(module_values)
    built_kind, written_kind = (
        (module_kind.built_kind, kind_name) if module_kind.built_kind else (kind_name, "")
    )
    return Module(
        module_name,
        built_kind,
        written_fields,
        module_values.place,
        Places(module_values.nodes),
        written_kind,
    )


def make_instrument(instrument_values: Values, recall: Recall = make_anew) -> Instrument:
    """An instrument from its values, with `like:` and `from:` already followed; `recall` gives
    modules that were read before.
    """
    built: list[Module] = []
    space = _space(instrument_values)
    axis_count = 1 if space is None else space.axes
    if instrument_values.kind:
        body_values = instrument_values.by_name[instrument_values.kind]
        if body_values is not MISSING and axis_count == 1:
            body_values = _with_own_pitch(instrument_values, body_values)
        if (
            body_values is not MISSING
            and body_values is not None
            and has_required_fields(instrument_values.kind, body_values, axis_count)
        ):
            built.append(make_module("", instrument_values.kind, body_values, axis_count))
    elif extra_fields := [
        name
        for name in instrument_values.written("t60", "M")
        if instrument_values.by_name.get(name, MISSING) is not MISSING
    ]:
        message = (
            f"{instrument_values.context.label(extra_fields[0])}: only an instrument of one "
            "generator has this field"
        )
        instrument_values.error("E111", message, extra_fields[0])
    elif (
        instrument_values.written("f")
        and (f := instrument_values["f"]) is not None
        and f[0] != f[1]
    ):
        instrument_values.error(
            "E202", f"{instrument_values.context.label('f')}: only a BANK has a range", "f"
        )
    built += read_modules(instrument_values, axis_count, recall)
    if not instrument_values.kind and not instrument_values.written("modules"):
        instrument_values.error("E103", f"{instrument_values.context.label('')} has no modules")
    if instrument_values.kind and instrument_values.written("modules"):
        message = (
            f"{instrument_values.context.label('modules')}: the instrument is a "
            f"{instrument_values.kind} already; keep one of the two"
        )
        instrument_values.error("E111", message, "modules")
    built_outputs = tuple(
        Output(
            output.name,
            output.kind,
            output.names,
            output.nearest,
            output.place,
            output.is_distance,
        )
        for output in instrument_values["out"] or ()
    )
    pitch = None if instrument_values.kind else named_pitch(instrument_values)
    instrument_arguments = (
        tuple(built),
        built_outputs,
        _ca_rate(instrument_values),
        instrument_values.place,
    )
    placing = _placing(instrument_values["place"])
    return Instrument(
        instrument_values.context.name,
        *instrument_arguments,
        pitch=pitch,
        placing=placing,
        space=space,
        acts=read_acts(instrument_values, partial(_modules_of, axes=axis_count, recall=recall)),
        loudness=instrument_values["level"],
    )


# Fields of an instrument of one axis that one in space does not have.
_SINGLE_AXIS = ("f", "t60", "M", "transpose", "notes", "members", "units", "at", "place", "rate")


def _space(space_values: Values) -> Space | None:
    """The space of an instrument; None if its masses move along one axis. Reports fields that do
    not fit.
    """
    axis_count = space_values["space"] if "space" in space_values.by_name else 1
    is_written = space_values.record is INSTRUMENT_SHAPE.forms["space"]
    if is_written and axis_count == 1:  # refused already
        axis_count = len(AXES)
    if axis_count > 1 and not is_written:
        message = f"{space_values.context.label('')} begins with an instrument in space; write "
        space_values.error("E103", f"{message}`space: {axis_count}` in it too")
    if axis_count == 1:
        if space_values.written("gravity"):
            message = (
                f"{space_values.context.label('gravity')}: only an instrument in space has this "
                "field"
            )
            space_values.error("E111", f"{message}; write space: 2 or 3", "gravity")
        return None
    for name in space_values.written(*_SINGLE_AXIS):
        message = f"{space_values.context.label(name)}: an instrument in space has no such field"
        space_values.error("E111", message, name)
    return Space(axis_count, space_values["gravity"] or 0.0)


def _placing(placing_values: Values | None) -> Placing | None:
    if placing_values is None:
        return None
    position = placing_values["at"] if len(placing_values["at"]) == 2 else (0.0, 0.0)
    return Placing(placing_values["across"], position, placing_values["height"])


def _ca_rate(instrument_values: Values) -> float | None:
    _refuse_materials(instrument_values)
    if instrument_values["units"] != "ca":
        if instrument_values.written("at"):
            instrument_values.error(
                "E111",
                f"{instrument_values.context.label('at')}: only `units: ca` has this field",
                "at",
            )
        return None
    if not instrument_values.written("at"):
        message = (
            f"{instrument_values.context.label('units')}: `ca` needs the rate of the network, "
        )
        instrument_values.error("E103", message + "such as at: 44100Hz", "units")
    return instrument_values["at"] or 44100.0


def _refuse_materials(values: Values) -> None:
    """Refuse materials under `units: ca`, whose M, K and Z are plain numbers."""
    bodies = [values, *(values["modules"] or {}).values()] if values["units"] == "ca" else []
    for body in bodies:
        body_fields = body.by_name.get(body.kind) if isinstance(body, Values) else None
        if isinstance(body_fields, Values) and body_fields.written("material"):
            message = (
                f"{body_fields.context.label('material')}: under `units: ca` M, K and Z are those "
                "of "
            )
            message += "a discrete network, which no material sets; write them, or use SI units"
            body_fields.error("E111", message, "material")


def _with_own_pitch(instrument_values: Values, body_values: Values) -> Values | None:
    """The generator's values with the instrument's own `f`, `t60` and `M`.

    A body of a material that has a pitch gets the new one; if its size is incomplete, `f`
    completes it.
    """
    if instrument_values.kind == "MODES":
        retuned_values = retuned_modes(
            body_values,
            instrument_values,
            lambda f, to: transposed_value("f", f, interval_between(min(f), to)),
        )
        return _completed_values("MODES", retuned_values)
    body_values = from_material(instrument_values.kind, body_values, quietly=True) or body_values
    body_fields, body_nodes = dict(body_values.by_name), dict(body_values.nodes)
    for field_name in instrument_values.written("f", "t60", "M"):
        if field_name not in instrument_values.by_name:
            continue
        field_value = instrument_values.by_name[field_name]
        is_range = isinstance(field_value, tuple)
        if is_range and instrument_values.kind != "BANK":
            if field_value[0] != field_value[1]:
                message = f"{instrument_values.context.label(field_name)}: only a BANK has a range"
                instrument_values.error("E202", message, field_name)
            field_value = field_value[0]
        body_fields[field_name], body_nodes[field_name] = (
            field_value,
            instrument_values.nodes[field_name],
        )
    values_at_pitch = Values(
        body_values.record,
        body_values.node,
        body_values.context,
        body_fields,
        body_nodes,
        body_values.free,
        body_values.kind,
    )
    return _completed_values(instrument_values.kind, values_at_pitch)
