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
from ergon.instruments.transpose import between, is_mechanics, moved, named_pitch
from ergon.notation.tables import notes, tuning
from ergon.notation.tables import quantities as q
from ergon.notation.tables import value_kinds as k
from ergon.notation.tables.fields import Values
from ergon.notation.tables.shapes import Text
from ergon.notation.text import document, edit
from ergon.notation.text.document import Scalar
from ergon.notation.text.edit import EditError
from ergon.notation.text.errors import TextError, quote
from ergon.scores.edits.lists import items, place
from ergon.scores.edits.texts import Texts
from ergon.scores.reading import automatable, overlay
from ergon.scores.reading.key_tables import KEY
from ergon.scores.reading.piece import Piece

# Two equivalent pairs of fields: a CEL or a key has one of them.
_TUNED, _PLAIN = ("f", "t60"), ("K", "Z")
_OTHERS = {"K": _TUNED, "Z": _TUNED, "f": _PLAIN, "t60": _PLAIN}
TRANSPOSE = "transpose"  # the interval by which an instrument is moved
_RETUNED = ("f", "t60", "M")  # of a single generator, beside `like` or `from`
_UNITS = {
    **{"M": "kg", "K": "N/m", "Z": "Ns/m", "f": "Hz", "t60": "s", "gap": "m", "rest": "m"},
    **{"X0": "m", "V0": "m/s", "hardening": "N/m3", "stretching": "N/m3"},
}
_AMOUNT = re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*([^\d\s.+-]*[^\s.+-]*)")

Changes = Mapping[str, str | None]  # fields and their new texts; None removes one


@dataclass(frozen=True, slots=True)
class _Owner:
    """The fields of a module or a key: their values, and where each is written."""

    part: str  # the key or instrument, as the score calls it
    section: str
    written: Values  # the key or instrument as its own file has it, or a note of it
    base: tuple[str, ...]  # the path of `written`
    module: str  # "" if it has the name of its part
    kind: str  # "" for a key of M, K, Z
    followed: Values  # the fields with `like` and `from` followed
    is_ca: bool

    @property
    def file(self) -> str:
        """The file in which the key or instrument is written."""
        return self.written.node.document.file

    def home(self, name: str) -> tuple[str, ...] | None:
        """The path of the mapping in which a field is written; None if `like` or `from` brought it
        in.
        """
        if self.module:
            modules = self.written["modules"]
            if isinstance(modules, dict) and self.module in modules:
                return (*self.base, "modules", self.module, self.kind)
            return None
        if not self.kind:
            return self.base
        if name in _RETUNED and (self.written.written(name) or not self.written.kind):
            return self.base
        return (*self.base, self.kind) if self.written.kind else None


def set_value(texts: Texts, piece: Piece, target: str, value: str) -> Texts:
    """Set `bell.m.K`, `k1.M` or `gong.f` to a value, or multiply it (`x1.5`).

    A value that comes by `like` or `from` is written for this part alone. Setting K or Z
    replaces f and t60 by the equivalent K and Z, and vice versa, so the other one keeps its
    value. Raises EditError.
    """
    with tuning.used(piece.tuning_of(target)):
        return _set_value(texts, piece, target, value)


def _set_value(texts: Texts, piece: Piece, target: str, value: str) -> Texts:
    part, _, name = target.rpartition(".")
    if name == TRANSPOSE:
        return _set_transposition(texts, part, value)
    instrument = piece.instruments.get(part)
    if (
        name == "f"
        and instrument is not None
        and automatable.pitched_module(instrument) is not None
    ):
        return _set_pitch(texts, instrument, value)
    if name == "f" and part in piece.families:
        raise EditError(
            f"the notes of {quote(part)} have pitches of their own; move them all by an interval: "
            f"set {part}.{TRANSPOSE} 2st"
        )
    owner, name = _owner(texts, target)
    changes = _changes(owner, piece, target, name, value)
    home = owner.home(name)
    changes = _as_written(owner, home, changes)
    if home is not None:
        written_tree = edit.tree(_written_node(texts, home, owner.file))
        for field, text in changes.items():
            if text is not None:
                texts = texts.put((*home, field), text, owner.file)
            elif isinstance(written_tree, dict) and field in written_tree:
                texts = texts.remove((*home, field), file=owner.file)
        return texts
    texts_by_field = {field: text for field, text in changes.items() if text is not None}
    if not owner.module:
        return texts.put((*owner.base, owner.kind), edit.flow(texts_by_field), owner.file)
    path = (*owner.base, "modules", owner.module)
    return texts.put(path, edit.flow({owner.kind: texts_by_field}), owner.file)


def set_list(texts: Texts, target: str, changes: Mapping[int, str]) -> Texts:
    """Set values of the list `bell.f` of MODES by their index; the others stay as they are written.

    Raises EditError if the modes come from a file, or if `f` or `transpose` of the instrument
    moves them all.
    """
    owner, name = _owner(texts, target)
    if owner.followed.written("modes"):
        raise EditError(
            f"{quote(target)}: the modes are read from a file and cannot be set here; change the "
            "file"
        )
    if moving := owner.written.written("f", "transpose"):
        raise EditError(
            f"{quote(target)}: '{moving[0]}' of the instrument transposes all its pitches; remove "
            f"'{moving[0]}' before you set a single one"
        )
    node = owner.followed.nodes.get(name)
    items = node.items if isinstance(node, document.Sequence) else [node]
    if max(changes) >= len(items):
        raise EditError(
            f"{quote(target)}: there are {len(items)} modes in the list; those after them are "
            "drawn in its band; change the band instead"
        )
    words_written = [
        changes[i] if i in changes else item.text if isinstance(item, Scalar) else ""
        for i, item in enumerate(items)
    ]
    text = f"[{', '.join(words_written)}]"
    if not owner.module:
        if owner.written.kind:
            return texts.put((*owner.base, owner.kind, name), text, owner.file)
        return texts.put((*owner.base, owner.kind), f"{{{name}: {text}}}", owner.file)
    home = owner.home(name)
    if home is not None:
        return texts.put((*home, name), text, owner.file)
    path = (*owner.base, "modules", owner.module)
    return texts.put(path, f"{{{owner.kind}: {{{name}: {text}}}}}", owner.file)


def _set_pitch(texts: Texts, instrument: Instrument, value: str) -> Texts:
    """Set the named pitch of an instrument of several modules. Raises EditError."""
    names, _ = texts.names()
    entry = names.tables["instruments"].get(instrument.name)
    if entry is None or not isinstance(entry.values, Values):
        raise EditError(
            f"{instrument.name} is one note of an instrument, whose pitch cannot be set at once; "
            "write "
            "`over` and a length, or set its modules"
        )
    values, file = entry.values, entry.values.node.document.file
    path = ("instruments", values.context.name)
    assert instrument.pitch is not None
    pitch_asked = (
        k.PITCH.parse(value) if not value.startswith("x") else instrument.pitch * q.factor(value)
    )
    if values.written("like", "from"):
        texts = texts.put(
            (*path, "f"), f"{pitch_asked!r}Hz" if value.startswith("x") else value, file
        )
        is_moved = values.written("transpose")
        return texts.remove((*path, "transpose"), file=file) if is_moved else texts
    written_pitch = named_pitch(values)  # the written pitch, which `transpose` moves
    assert written_pitch is not None
    step = between(written_pitch, pitch_asked)
    if step.ratio == 1.0:
        is_moved = values.written("transpose")
        return texts.remove((*path, "transpose"), file=file) if is_moved else texts
    change_text = f"x{step.ratio!r}" if step.cents is None else f"{step.cents:g}cents"
    if step.cents is not None and not step.cents % 100.0:
        change_text = f"{step.cents / 100.0:g}st"
    return texts.put((*path, "transpose"), change_text, file)


def _set_transposition(texts: Texts, part: str, value: str) -> Texts:
    """Set the interval by which an instrument is moved. Raises EditError."""
    names, uses = texts.names()
    table = names.tables["instruments"]
    head, _, note = part.rpartition(".")
    name = head if part not in table and head in table else part
    values = table[name].values if name in table else None
    if not isinstance(values, Values):
        raise EditError(f"{quote(part)} is not an instrument that can be transposed")
    path: tuple[str, ...] = ("instruments", values.context.name)
    if name != part:  # one of its notes
        resolved, _ = uses.resolved("instruments", table[name])
        member = _member(resolved, values, note) if resolved and resolved["notes"] else None
        if member is None:
            raise EditError(f"{quote(head)} has no note {quote(note)} that can be transposed")
        path = (*path, "members", member[0])
    return texts.put((*path, TRANSPOSE), value, values.node.document.file)


def quantities(module: Module) -> Iterator[tuple[str, float]]:
    """The fields of a module that are a single number, and its constants; without X0 and V0."""
    for name, value in module.fields.items():
        if isinstance(value, float) and name not in ("X0", "V0"):
            yield name, value
    follows = following.followings(module)
    for name, value in module.fields.get("constants", {}).items():
        if name not in follows:
            yield name, value


def written_quantity(value: float, name: str, *, is_ca: bool) -> str:
    """A value [SI] as a score writes it, without loss of precision."""
    is_plain = is_ca and name in ("M", "K", "Z")
    return f"{value!r}{'' if is_plain else _UNITS.get(name, '')}"


def gain(texts: Texts, name: str | None, level: str) -> Texts:
    """Set the gain of an instrument's routes, or of all channels (None). Raises EditError."""
    if name is None:
        if _written_node(texts, ("mix",), texts.path) is None:
            raise EditError("the score has no mix, so it has no master gain")
        return texts.put(("mix", "master", "gain"), level)
    is_routed = False
    for number, route in enumerate(items(texts, "mix", "route")):
        source = route.get("from") if isinstance(route, document.Mapping) else None
        if isinstance(source, Scalar) and (
            source.text == name or source.text.startswith(f"{name}.")
        ):
            texts = texts.put((*place(texts, "mix", number, "route"), "gain"), level)
            is_routed = True
    if not is_routed:
        raise EditError(f"no route comes from {quote(name)}")
    return texts


def _owner(texts: Texts, target: str) -> tuple[_Owner, str]:
    names, uses = texts.names()
    words = target.split(".")
    for count in range(len(words) - 1, 0, -1):  # names that a file brings in have dots themselves
        part = ".".join(words[:count])
        for section in ("keys", "instruments"):
            entry = names.tables[section].get(part)
            if entry is None or not isinstance(entry.values, Values):
                continue
            values, _ = uses.resolved(section, entry)
            if values is None:
                raise EditError(f"the definition of {quote(part)} has mistakes")
            part_values = entry.values
            path: tuple[str, ...] = (section, part_values.context.name)
            if (values["notes"] or ()) if section == "instruments" else ():
                member_found = _member(values, part_values, words[count])
                if member_found is not None:
                    note, values, part_values = member_found
                    part, path, count = f"{part}.{note}", (*path, "members", note), count + 1
            module, name = ".".join(words[count:-1]), words[-1]
            fields_written, kind = _fields(values, module, target)
            is_ca = section == "instruments" and values["units"] == "ca"
            owner = _Owner(part, section, part_values, path, module, kind, fields_written, is_ca)
            is_space = section == "instruments" and values["space"] > 1
            field_table = KINDS[kind].tables["space" if is_space else "si"] if kind else KEY
            if name not in field_table.by_name and name not in fields_written.free:
                fields = ", ".join([*field_table.by_name, *fields_written.free])
                raise EditError(
                    f"{quote(target)}: the field {quote(name)} does not "
                    f"exist; the fields are {fields}"
                )
            return owner, name
    raise EditError(f"{quote(target)} is not a field of a key or an instrument")


def _member(values: Values, part_values: Values, word: str) -> tuple[str, Values, Values] | None:
    """The note that a word names, the instrument at this note, and the fields that are written for
    it.
    """
    pitch_asked = notes.pitch(word)
    for note in values["notes"]:
        if notes.pitch(note) == pitch_asked:
            member_values = overlay.member(part_values, pitch_asked or 0.0)
            if member_values is None:
                member_values = Values(member_table("si"), part_values.node, part_values.context)
            else:
                note = next(w for w in part_values["members"] if notes.pitch(w) == pitch_asked)
            member_interval = part_values.by_name.get(TRANSPOSE)
            interval = overlay.both(member_interval, member_values.by_name.get(TRANSPOSE))
            if interval is not None:
                member_values = replace(
                    member_values, by_name={**member_values.by_name, TRANSPOSE: interval}
                )
            return note, overlay.shifted_note(values, note, member_interval), member_values
    return None


def _fields(values: Values, module: str, target: str) -> tuple[Values, str]:
    """The fields of a module (or of the only module of a part), and its kind."""
    kind, fields = values.kind, values
    if module:
        body = (values["modules"] or {}).get(module)
        if not isinstance(body, Values):
            module_names = ", ".join(values["modules"] or {})
            raise EditError(
                f"{quote(target)}: the module {quote(module)} does not "
                f"exist; the modules are {module_names}"
            )
        kind, fields = body.kind, body
    elif values.written("modules"):
        module_names = ", ".join(values["modules"] or {})
        raise EditError(f"{quote(target)}: name one of its modules: {module_names}")
    inner = fields.by_name.get(kind) if kind else fields
    assert isinstance(inner, Values)
    return inner, kind


def _changes(owner: _Owner, piece: Piece, target: str, name: str, value: str) -> Changes:
    """The fields to write for a value, and those to remove because they contradict it."""
    current_values = _current_values(owner, piece)
    changes: dict[str, str | None] = {}
    contrary_names = _OTHERS.get(name, ()) if owner.kind in ("", "CEL") else ()
    if owner.followed.written(*contrary_names):
        twin = (
            _stiffness_and_viscosity(current_values)
            if contrary_names == _TUNED
            else _frequency_and_decay(current_values, target)
        )
        changes = dict.fromkeys(contrary_names)
        changes |= {field: _amount_text(x, field, owner) for field, x in twin.items() if x}
        current_values = {**current_values, **twin}
    if not value.startswith("x"):
        return {**changes, name: value}
    try:
        factor = q.factor(value)
    except TextError as error:
        raise EditError(error.message) from None
    node = owner.followed.nodes.get(name)
    if "calib" in owner.followed.nodes and not owner.written.written(name):
        node = None  # the measured value is used, not the written one
    if isinstance(node, Scalar) and _is_as_written(owner, name, node.text):
        scaled = _scaled_text(node.text, factor)
        if scaled is not None:
            return {**changes, name: scaled}
    amount = current_values.get(name)
    if owner.followed.written("modes"):
        raise EditError(
            f"{quote(target)}: the modes are read from a file and cannot be set at once; use "
            "`transpose`, or `set` with `over` and a length"
        )
    if isinstance(amount, tuple):
        amount_texts = [_amount_text(number * factor, name, owner) for number in amount]
        is_list = isinstance(amount, Each)
        return {
            **changes,
            name: f"[{', '.join(amount_texts)}]" if is_list else "..".join(amount_texts),
        }
    if not isinstance(amount, float):
        raise EditError(f"{quote(target)} has no value that could be multiplied: set a value first")
    return {**changes, name: _amount_text(amount * factor, name, owner)}


def _current_values(owner: _Owner, piece: Piece) -> Mapping[str, object]:
    """The current values in SI units, including those of a measured key."""
    part = piece.keys.get(owner.part) or piece.instruments.get(owner.part)
    for module in part.modules if part is not None else ():
        if module.name == owner.module:
            return module.fields
    return owner.followed.by_name


def _is_as_written(owner: _Owner, name: str, text: str) -> bool:
    """Whether a field has the value of its text; a transposition makes it differ."""
    field = (KINDS[owner.kind].table if owner.kind else KEY).by_name.get(name)
    if field is None or not isinstance(field.shape, Text):
        return True
    return bool(field.shape.parse(text) == owner.followed.by_name.get(name))


def _as_written(owner: _Owner, home: tuple[str, ...] | None, changes: Changes) -> Changes:
    """Changes in the values that must be written so that `transpose` turns them into those asked
    for.
    """
    interval = owner.written.by_name.get("transpose")
    if interval is None or (owner.kind and is_mechanics(owner.kind, owner.followed)):
        return changes
    is_root = not owner.written.written("like", "from")
    table = KINDS[owner.kind].table
    changes_written = dict(changes)
    for name, text in changes.items():
        is_moved = is_root or (home == owner.base and name == "f")
        shape = table.by_name[name].shape if name in table.by_name else None
        if not is_moved or text is None or not isinstance(shape, Text):
            continue
        try:
            value = shape.parse(text)
        except TextError:
            continue  # reported where the score is read
        untransposed = moved(name, value, interval.back())
        if untransposed != value and isinstance(untransposed, float):
            changes_written[name] = f"{untransposed!r}{_UNITS.get(name, '')}"
    return changes_written


def _stiffness_and_viscosity(current_values: Mapping[str, object]) -> dict[str, float]:
    """K and Z from a damped frequency and its decay."""
    mass, f, t60 = (_current_number(current_values, name) for name in ("M", "f", "t60"))
    sigma = LN_1000 / t60 if t60 else 0.0
    omega = 2.0 * math.pi * f
    return {"K": mass * (omega * omega + sigma * sigma), "Z": 2.0 * mass * sigma}


def _frequency_and_decay(current_values: Mapping[str, object], target: str) -> dict[str, float]:
    """The damped frequency and decay from K and Z."""
    mass, k, z = (_current_number(current_values, name) for name in ("M", "K", "Z"))
    sigma = z / (2.0 * mass)
    square = k / mass - sigma * sigma
    if square <= 0.0:
        raise EditError(f"{quote(target)}: it is overdamped and has no frequency; set K and Z")
    return {"f": math.sqrt(square) / (2.0 * math.pi), "t60": LN_1000 / sigma if sigma else 0.0}


def _current_number(current_values: Mapping[str, object], name: str) -> float:
    value = current_values.get(name)
    return value if isinstance(value, float) else 0.0


def _scaled_text(text: str, factor: float) -> str | None:
    """A number or a range times a factor, with the same unit; None for a note or a fraction."""
    scaled_texts = []
    for amount_text in text.split(".."):
        match = _AMOUNT.fullmatch(amount_text.strip())
        if match is None or match[2].startswith("/"):
            return None
        scaled_texts.append(f"{float(match[1]) * factor:.9g}{match[2]}")
    return "..".join(scaled_texts)


def _amount_text(value: float, name: str, owner: _Owner) -> str:
    is_plain = owner.is_ca and name in ("M", "K", "Z")
    return f"{value:.9g}{'' if is_plain else _UNITS.get(name, '')}"


def _written_node(texts: Texts, path: tuple[str, ...], file: str) -> document.Node | None:
    is_own = file == texts.path
    node = texts.section(path[0]) if is_own else texts.document(file).root
    for name in path[1:] if is_own else path:
        node = node.get(name) if isinstance(node, document.Mapping) else None
    return node
