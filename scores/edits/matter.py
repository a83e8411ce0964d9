"""Sets a physical parameter or a gain, in the file where it is written."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

from ergon.common.decay import LN_1000
from ergon.instruments import following
from ergon.instruments.modal import Each
from ergon.instruments.model import Instrument, Module
from ergon.instruments.module_kinds import KINDS
from ergon.instruments.read import member_table
from ergon.instruments.transpose import (
    interval_between,
    keeps_pitch,
    named_pitch,
    transposed_value,
)
from ergon.notation.tables import notes, quantities, tuning, value_kinds
from ergon.notation.tables.fields import Values
from ergon.notation.tables.shapes import Text
from ergon.notation.text import document, edit
from ergon.notation.text.document import Scalar
from ergon.notation.text.edit import EditError
from ergon.notation.text.errors import TextError, quote
from ergon.scores.edits.lists import entry_path, section_entries
from ergon.scores.edits.texts import Texts
from ergon.scores.reading import automatable, overlay
from ergon.scores.reading.key_tables import KEY_RECORD
from ergon.scores.reading.piece import Piece

# Two equivalent pairs of fields: a CEL or a key has one of them.
_TUNED_FIELDS, _STIFFNESS_FIELDS = ("f", "t60"), ("K", "Z")
_CONTRADICTING_FIELDS = {
    "K": _TUNED_FIELDS,
    "Z": _TUNED_FIELDS,
    "f": _STIFFNESS_FIELDS,
    "t60": _STIFFNESS_FIELDS,
}
TRANSPOSE = "transpose"  # the interval by which an instrument is moved
_RETUNED_FIELDS = ("f", "t60", "M")  # fields beside `like` or `from` for a single generator
_UNIT_BY_FIELD = {
    **{"M": "kg", "K": "N/m", "Z": "Ns/m", "f": "Hz", "t60": "s", "gap": "m", "rest": "m"},
    **{"X0": "m", "V0": "m/s", "hardening": "N/m3", "stretching": "N/m3"},
}
_AMOUNT_PATTERN = re.compile(
    r"([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*([^\d\s.+-]*[^\s.+-]*)"
)

Changes = Mapping[str, str | None]  # fields and their new texts; None removes one


@dataclass(frozen=True, slots=True)
class _ValueOwner:
    """The fields of a module or a key: their values, and where each is written."""

    part: str  # the key or instrument, as the score calls it
    section: str
    written_values: Values  # the key or instrument as its own file has it, or a note of it
    base_path: tuple[str, ...]  # the path of `written_values`
    module: str  # "" if it has the name of its part
    kind: str  # "" for a key of M, K, Z
    resolved_values: Values  # the fields with `like` and `from` followed
    is_ca: bool

    @property
    def file(self) -> str:
        """The file in which the key or instrument is written."""
        return self.written_values.node.document.file

    def written_path(self, field_name: str) -> tuple[str, ...] | None:
        """The path of the mapping in which a field is written; None if `like` or `from` brought it
        in.
        """
        if self.module:
            modules = self.written_values["modules"]
            if isinstance(modules, dict) and self.module in modules:
                return (*self.base_path, "modules", self.module, self.kind)
            return None
        if not self.kind:
            return self.base_path
        if field_name in _RETUNED_FIELDS and (
            self.written_values.written(field_name) or not self.written_values.kind
        ):
            return self.base_path
        return (*self.base_path, self.kind) if self.written_values.kind else None


def set_value(score_texts: Texts, piece: Piece, target_path: str, value_text: str) -> Texts:
    """Set `bell.m.K`, `k1.M` or `gong.f` to a value, or multiply it (`x1.5`).

    A value that comes by `like` or `from` is written for this part alone. Setting K or Z
    replaces f and t60 by the equivalent K and Z, and vice versa, so the other one keeps its
    value. Raises EditError.
    """
    with tuning.used(piece.tuning_of(target_path)):
        return _set_value(score_texts, piece, target_path, value_text)


def _set_value(score_texts: Texts, piece: Piece, target_path: str, value_text: str) -> Texts:
    part_name, _, field_name = target_path.rpartition(".")
    if field_name == TRANSPOSE:
        return _set_transposition(score_texts, part_name, value_text)
    instrument = piece.instruments.get(part_name)
    if (
        field_name == "f"
        and instrument is not None
        and automatable.pitched_module(instrument) is not None
    ):
        return _set_pitch(score_texts, instrument, value_text)
    if field_name == "f" and part_name in piece.families:
        raise EditError(
            f"the notes of {quote(part_name)} have pitches of their own; move them all by an "
            f"interval: set {part_name}.{TRANSPOSE} 2st"
        )
    value_owner, field_name = _value_owner(score_texts, target_path)
    field_changes = _field_changes(value_owner, piece, target_path, field_name, value_text)
    field_path = value_owner.written_path(field_name)
    field_changes = _untransposed_changes(value_owner, field_path, field_changes)
    if field_path is not None:
        written_value = edit.tree(_written_node(score_texts, field_path, value_owner.file))
        for field, text in field_changes.items():
            if text is not None:
                score_texts = score_texts.put((*field_path, field), text, value_owner.file)
            elif isinstance(written_value, dict) and field in written_value:
                score_texts = score_texts.remove((*field_path, field), file=value_owner.file)
        return score_texts
    texts_by_field = {field: text for field, text in field_changes.items() if text is not None}
    if not value_owner.module:
        return score_texts.put(
            (*value_owner.base_path, value_owner.kind), edit.flow(texts_by_field), value_owner.file
        )
    path = (*value_owner.base_path, "modules", value_owner.module)
    return score_texts.put(path, edit.flow({value_owner.kind: texts_by_field}), value_owner.file)


def set_list(score_texts: Texts, target_path: str, value_changes: Mapping[int, str]) -> Texts:
    """Set values of the list `bell.f` of MODES by their index; the others stay as they are written.

    Raises EditError if the modes come from a file, or if `f` or `transpose` of the instrument
    moves them all.
    """
    list_owner, list_name = _value_owner(score_texts, target_path)
    if list_owner.resolved_values.written("modes"):
        raise EditError(
            f"{quote(target_path)}: the modes are read from a file and cannot be set here; change "
            "the file"
        )
    if moved_fields := list_owner.written_values.written("f", "transpose"):
        raise EditError(
            f"{quote(target_path)}: '{moved_fields[0]}' of the instrument transposes all its "
            "pitches; "
            f"remove '{moved_fields[0]}' before you set a single one"
        )
    node = list_owner.resolved_values.nodes.get(list_name)
    list_items = node.items if isinstance(node, document.Sequence) else [node]
    if max(value_changes) >= len(list_items):
        raise EditError(
            f"{quote(target_path)}: there are {len(list_items)} modes in the list; those after "
            "them are drawn in its band; change the band instead"
        )
    item_texts = [
        value_changes[item_index]
        if item_index in value_changes
        else item.text
        if isinstance(item, Scalar)
        else ""
        for item_index, item in enumerate(list_items)
    ]
    list_text = f"[{', '.join(item_texts)}]"
    if not list_owner.module:
        if list_owner.written_values.kind:
            return score_texts.put(
                (*list_owner.base_path, list_owner.kind, list_name), list_text, list_owner.file
            )
        return score_texts.put(
            (*list_owner.base_path, list_owner.kind),
            f"{{{list_name}: {list_text}}}",
            list_owner.file,
        )
    list_path = list_owner.written_path(list_name)
    if list_path is not None:
        return score_texts.put((*list_path, list_name), list_text, list_owner.file)
    path = (*list_owner.base_path, "modules", list_owner.module)
    return score_texts.put(
        path, f"{{{list_owner.kind}: {{{list_name}: {list_text}}}}}", list_owner.file
    )


def _set_pitch(score_texts: Texts, instrument: Instrument, pitch_text: str) -> Texts:
    """Set the named pitch of an instrument of several modules. Raises EditError."""
    names, _ = score_texts.names()
    named_entry = names.tables["instruments"].get(instrument.name)
    if named_entry is None or not isinstance(named_entry.values, Values):
        raise EditError(
            f"{instrument.name} is one note of an instrument, whose pitch cannot be set at once; "
            "write `over` and a length, or set its modules"
        )
    entry_values, file_name = named_entry.values, named_entry.values.node.document.file
    path = ("instruments", entry_values.context.name)
    assert instrument.pitch is not None
    target_pitch = (
        value_kinds.PITCH.parse(pitch_text)
        if not pitch_text.startswith("x")
        else instrument.pitch * quantities.factor(pitch_text)
    )
    if entry_values.written("like", "from"):
        score_texts = score_texts.put(
            (*path, "f"),
            f"{target_pitch!r}Hz" if pitch_text.startswith("x") else pitch_text,
            file_name,
        )
        transposed_fields = entry_values.written("transpose")
        return (
            score_texts.remove((*path, "transpose"), file=file_name)
            if transposed_fields
            else score_texts
        )
    written_pitch = named_pitch(entry_values)  # the written pitch, which `transpose` moves
    assert written_pitch is not None
    pitch_interval = interval_between(written_pitch, target_pitch)
    if pitch_interval.ratio == 1.0:
        transposed_fields = entry_values.written("transpose")
        return (
            score_texts.remove((*path, "transpose"), file=file_name)
            if transposed_fields
            else score_texts
        )
    change_text = (
        f"x{pitch_interval.ratio!r}"
        if pitch_interval.cents is None
        else f"{pitch_interval.cents:g}cents"
    )
    if pitch_interval.cents is not None and not pitch_interval.cents % 100.0:
        change_text = f"{pitch_interval.cents / 100.0:g}st"
    return score_texts.put((*path, "transpose"), change_text, file_name)


def _set_transposition(score_texts: Texts, part_name: str, value_text: str) -> Texts:
    """Set the interval by which an instrument is moved. Raises EditError."""
    names, uses = score_texts.names()
    instrument_table = names.tables["instruments"]
    family_name, _, note_name = part_name.rpartition(".")
    table_name = (
        family_name
        if part_name not in instrument_table and family_name in instrument_table
        else part_name
    )
    entry_values = instrument_table[table_name].values if table_name in instrument_table else None
    if not isinstance(entry_values, Values):
        raise EditError(f"{quote(part_name)} is not an instrument that can be transposed")
    path: tuple[str, ...] = ("instruments", entry_values.context.name)
    if table_name != part_name:  # one of its notes
        resolved_values, _ = uses.resolved("instruments", instrument_table[table_name])
        member = (
            _note_and_fields(resolved_values, entry_values, note_name)
            if resolved_values and resolved_values["notes"]
            else None
        )
        if member is None:
            raise EditError(
                f"{quote(family_name)} has no note {quote(note_name)} that can be transposed"
            )
        path = (*path, "members", member[0])
    return score_texts.put((*path, TRANSPOSE), value_text, entry_values.node.document.file)


def number_fields(part_module: Module) -> Iterator[tuple[str, float]]:
    """The fields of a module that are a single number, and its constants; without X0 and V0."""
    for field_name, field_value in part_module.fields.items():
        if isinstance(field_value, float) and field_name not in ("X0", "V0"):
            yield field_name, field_value
    followed_names = following.followings(part_module)
    for field_name, field_value in part_module.fields.get("constants", {}).items():
        if field_name not in followed_names:
            yield field_name, field_value


def quantity_text(value: float, name: str, *, is_ca: bool) -> str:
    """A value [SI] as a score writes it, without loss of precision."""
    is_unitless = is_ca and name in ("M", "K", "Z")
    return f"{value!r}{'' if is_unitless else _UNIT_BY_FIELD.get(name, '')}"


def set_gain(score_texts: Texts, instrument_name: str | None, level_text: str) -> Texts:
    """Set the gain of an instrument's routes, or of all channels (None). Raises EditError."""
    if instrument_name is None:
        if _written_node(score_texts, ("mix",), score_texts.path) is None:
            raise EditError("the score has no mix, so it has no master gain")
        return score_texts.put(("mix", "master", "gain"), level_text)
    is_routed = False
    for route_index, route in enumerate(section_entries(score_texts, "mix", "route")):
        source = route.get("from") if isinstance(route, document.Mapping) else None
        if isinstance(source, Scalar) and (
            source.text == instrument_name or source.text.startswith(f"{instrument_name}.")
        ):
            score_texts = score_texts.put(
                (*entry_path(score_texts, "mix", route_index, "route"), "gain"), level_text
            )
            is_routed = True
    if not is_routed:
        raise EditError(f"no route comes from {quote(instrument_name)}")
    return score_texts


def _value_owner(texts: Texts, target_path: str) -> tuple[_ValueOwner, str]:
    score_names, uses = texts.names()
    path_words = target_path.split(".")
    for n_words in range(
        len(path_words) - 1, 0, -1
    ):  # names that a file brings in have dots themselves
        part_name = ".".join(path_words[:n_words])
        for section_name in ("keys", "instruments"):
            named_entry = score_names.tables[section_name].get(part_name)
            if named_entry is None or not isinstance(named_entry.values, Values):
                continue
            values, _ = uses.resolved(section_name, named_entry)
            if values is None:
                raise EditError(f"the definition of {quote(part_name)} has mistakes")
            part_values = named_entry.values
            path: tuple[str, ...] = (section_name, part_values.context.name)
            if (values["notes"] or ()) if section_name == "instruments" else ():
                member = _note_and_fields(values, part_values, path_words[n_words])
                if member is not None:
                    note_name, values, part_values = member
                    part_name, path, n_words = (
                        f"{part_name}.{note_name}",
                        (*path, "members", note_name),
                        n_words + 1,
                    )
            module_name, field_name = ".".join(path_words[n_words:-1]), path_words[-1]
            fields_written, module_kind = _module_fields(values, module_name, target_path)
            is_ca = section_name == "instruments" and values["units"] == "ca"
            value_owner = _ValueOwner(
                part_name,
                section_name,
                part_values,
                path,
                module_name,
                module_kind,
                fields_written,
                is_ca,
            )
            is_space = section_name == "instruments" and values["space"] > 1
            field_table = (
                KINDS[module_kind].tables["space" if is_space else "si"]
                if module_kind
                else KEY_RECORD
            )
            if field_name not in field_table.by_name and field_name not in fields_written.free:
                field_list = ", ".join([*field_table.by_name, *fields_written.free])
                raise EditError(
                    f"{quote(target_path)}: the field {quote(field_name)} does not "
                    f"exist; the fields are {field_list}"
                )
            return value_owner, field_name
    raise EditError(f"{quote(target_path)} is not a field of a key or an instrument")


def _note_and_fields(
    instrument_values: Values, part_values: Values, note_word: str
) -> tuple[str, Values, Values] | None:
    """The note that a word names, the instrument at this note, and the fields that are written for
    it.
    """
    pitch = notes.pitch(note_word)
    for note_name in instrument_values["notes"]:
        if notes.pitch(note_name) == pitch:
            member_values = overlay.fields_of_note(part_values, pitch or 0.0)
            if member_values is None:
                member_values = Values(member_table("si"), part_values.node, part_values.context)
            else:
                note_name = next(
                    member_word
                    for member_word in part_values["members"]
                    if notes.pitch(member_word) == pitch
                )
            member_interval = part_values.by_name.get(TRANSPOSE)
            interval = overlay.interval_sum(member_interval, member_values.by_name.get(TRANSPOSE))
            if interval is not None:
                member_values = replace(
                    member_values, by_name={**member_values.by_name, TRANSPOSE: interval}
                )
            return (
                note_name,
                overlay.shifted_note(instrument_values, note_name, member_interval),
                member_values,
            )
    return None


def _module_fields(part_values: Values, module_name: str, target_path: str) -> tuple[Values, str]:
    """The fields of a module (or of the only module of a part), and its kind."""
    module_kind, module_fields = part_values.kind, part_values
    if module_name:
        module_body = (part_values["modules"] or {}).get(module_name)
        if not isinstance(module_body, Values):
            module_names = ", ".join(part_values["modules"] or {})
            raise EditError(
                f"{quote(target_path)}: the module {quote(module_name)} does not "
                f"exist; the modules are {module_names}"
            )
        module_kind, module_fields = module_body.kind, module_body
    elif part_values.written("modules"):
        module_names = ", ".join(part_values["modules"] or {})
        raise EditError(f"{quote(target_path)}: name one of its modules: {module_names}")
    kind_fields = module_fields.by_name.get(module_kind) if module_kind else module_fields
    assert isinstance(kind_fields, Values)
    return kind_fields, module_kind


def _field_changes(
    value_owner: _ValueOwner, piece: Piece, target_path: str, field_name: str, value_text: str
) -> Changes:
    """The fields to write for a value, and those to remove because they contradict it."""
    current_values = _current_values(value_owner, piece)
    field_changes: dict[str, str | None] = {}
    contradicting_names = (
        _CONTRADICTING_FIELDS.get(field_name, ()) if value_owner.kind in ("", "CEL") else ()
    )
    if value_owner.resolved_values.written(*contradicting_names):
        equivalent_fields = (
            _stiffness_and_viscosity(current_values)
            if contradicting_names == _TUNED_FIELDS
            else _frequency_and_decay(current_values, target_path)
        )
        field_changes = dict.fromkeys(contradicting_names)
        field_changes |= {
            field: _amount_text(field_number, field, value_owner)
            for field, field_number in equivalent_fields.items()
            if field_number
        }
        current_values = {**current_values, **equivalent_fields}
    if not value_text.startswith("x"):
        return {**field_changes, field_name: value_text}
    try:
        value_factor = quantities.factor(value_text)
    except TextError as error:
        raise EditError(error.message) from None
    field_node = value_owner.resolved_values.nodes.get(field_name)
    if "calib" in value_owner.resolved_values.nodes and not value_owner.written_values.written(
        field_name
    ):
        field_node = None  # the measured value is used, not the written one
    if isinstance(field_node, Scalar) and _is_as_written(value_owner, field_name, field_node.text):
        scaled_value = _scaled_text(field_node.text, value_factor)
        if scaled_value is not None:
            return {**field_changes, field_name: scaled_value}
    amount = current_values.get(field_name)
    if value_owner.resolved_values.written("modes"):
        raise EditError(
            f"{quote(target_path)}: the modes are read from a file and cannot be set at once; use "
            "`transpose`, or `set` with `over` and a length"
        )
    if isinstance(amount, tuple):
        amount_texts = [
            _amount_text(number * value_factor, field_name, value_owner) for number in amount
        ]
        is_list = isinstance(amount, Each)
        return {
            **field_changes,
            field_name: f"[{', '.join(amount_texts)}]" if is_list else "..".join(amount_texts),
        }
    if not isinstance(amount, float):
        raise EditError(
            f"{quote(target_path)} has no value that could be multiplied: set a value first"
        )
    return {
        **field_changes,
        field_name: _amount_text(amount * value_factor, field_name, value_owner),
    }


def _current_values(value_owner: _ValueOwner, piece: Piece) -> Mapping[str, object]:
    """The current values in SI units, including those of a measured key."""
    part = piece.keys.get(value_owner.part) or piece.instruments.get(value_owner.part)
    for module in part.modules if part is not None else ():
        if module.name == value_owner.module:
            return module.fields
    return value_owner.resolved_values.by_name


def _is_as_written(value_owner: _ValueOwner, field_name: str, field_text: str) -> bool:
    """Whether a field has the value of its text; a transposition makes it differ."""
    field = (KINDS[value_owner.kind].table if value_owner.kind else KEY_RECORD).by_name.get(
        field_name
    )
    if field is None or not isinstance(field.shape, Text):
        return True
    return bool(
        field.shape.parse(field_text) == value_owner.resolved_values.by_name.get(field_name)
    )


def _untransposed_changes(
    value_owner: _ValueOwner, field_path: tuple[str, ...] | None, field_changes: Changes
) -> Changes:
    """Changes in the values that must be written so that `transpose` turns them into those asked
    for.
    """
    interval = value_owner.written_values.by_name.get("transpose")
    if interval is None or (
        value_owner.kind and keeps_pitch(value_owner.kind, value_owner.resolved_values.by_name)
    ):
        return field_changes
    is_root = not value_owner.written_values.written("like", "from")
    field_table = KINDS[value_owner.kind].table
    written_changes = dict(field_changes)
    for field_name, value_text in field_changes.items():
        is_moved = is_root or (field_path == value_owner.base_path and field_name == "f")
        shape = field_table.by_name[field_name].shape if field_name in field_table.by_name else None
        if not is_moved or value_text is None or not isinstance(shape, Text):
            continue
        try:
            parsed_value = shape.parse(value_text)
        except TextError:
            continue  # reported where the score is read
        untransposed_value = transposed_value(field_name, parsed_value, interval.inverse())
        if untransposed_value != parsed_value and isinstance(untransposed_value, float):
            written_changes[field_name] = (
                f"{untransposed_value!r}{_UNIT_BY_FIELD.get(field_name, '')}"
            )
    return written_changes


def _stiffness_and_viscosity(current_values: Mapping[str, object]) -> dict[str, float]:
    """K and Z from a damped frequency and its decay."""
    mass, frequency, decay_time = (
        _current_number(current_values, name) for name in ("M", "f", "t60")
    )
    decay_rate = LN_1000 / decay_time if decay_time else 0.0
    angular_frequency = 2.0 * math.pi * frequency
    return {
        "K": mass * (angular_frequency * angular_frequency + decay_rate * decay_rate),
        "Z": 2.0 * mass * decay_rate,
    }


def _frequency_and_decay(
    current_values: Mapping[str, object], target_path: str
) -> dict[str, float]:
    """The damped frequency and decay from K and Z."""
    mass, stiffness, viscosity = (_current_number(current_values, name) for name in ("M", "K", "Z"))
    decay_rate = viscosity / (2.0 * mass)
    omega_squared = stiffness / mass - decay_rate * decay_rate
    if omega_squared <= 0.0:
        raise EditError(f"{quote(target_path)}: it is overdamped and has no frequency; set K and Z")
    return {
        "f": math.sqrt(omega_squared) / (2.0 * math.pi),
        "t60": LN_1000 / decay_rate if decay_rate else 0.0,
    }


def _current_number(current_values: Mapping[str, object], name: str) -> float:
    value = current_values.get(name)
    return value if isinstance(value, float) else 0.0


def _scaled_text(text: str, factor: float) -> str | None:
    """A number or a range times a factor, with the same unit; None for a note or a fraction."""
    scaled_texts = []
    for amount_text in text.split(".."):
        amount_match = _AMOUNT_PATTERN.fullmatch(amount_text.strip())
        if amount_match is None or amount_match[2].startswith("/"):
            return None
        scaled_texts.append(f"{float(amount_match[1]) * factor:.9g}{amount_match[2]}")
    return "..".join(scaled_texts)


def _amount_text(value: float, name: str, value_owner: _ValueOwner) -> str:
    is_unitless = value_owner.is_ca and name in ("M", "K", "Z")
    return f"{value:.9g}{'' if is_unitless else _UNIT_BY_FIELD.get(name, '')}"


def _written_node(texts: Texts, path: tuple[str, ...], file: str) -> document.Node | None:
    is_score_file = file == texts.path
    node = texts.section(path[0]) if is_score_file else texts.document(file).root
    for name in path[1:] if is_score_file else path:
        node = node.get(name) if isinstance(node, document.Mapping) else None
    return node
