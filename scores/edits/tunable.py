"""One part of a piece as a network by itself, with some values replaced."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from ergon.instruments import following
from ergon.instruments.assemble import Assembly
from ergon.instruments.modal import Each
from ergon.instruments.model import Instrument, Module
from ergon.instruments.module_kinds import LINK_KINDS, POINT_KINDS
from ergon.scores.edits.matter import number_fields, quantity_text, set_list, set_value
from ergon.scores.edits.texts import Texts
from ergon.scores.reading.piece import Piece
from ergon.scores.reading.playing import Key

if TYPE_CHECKING:
    from ergon import _core

# Fields that affect the modes of a part, as do constants of laws; only numbers above 0 are changed.
_TUNABLE_FIELDS = ("M", "K", "f", "inharmonicity", "stiffness", "bending", "sigma0", "stretching")

FieldKey = tuple[str, str, int | None]  # module, field, place in a list from 1


@dataclass(frozen=True, slots=True)
class TunableValue:
    """A number [SI] of a module that may be changed, and where it is.

    `list_index` is its index in a list, from 1, such as `f` of MODES; None if the field is one
    number.
    """

    module: str
    field: str
    number: float
    list_index: int | None = None

    @property
    def field_key(self) -> FieldKey:
        """Where the number is: module, field and place."""
        return self.module, self.field, self.list_index


@dataclass(frozen=True, slots=True)
class TunablePart:
    """An instrument or a key of a piece."""

    piece: Piece
    name: str

    @property
    def _definition(self) -> Key | Instrument:
        return self.piece.keys.get(self.name) or self.piece.instruments[self.name]

    def values(self) -> Iterator[TunableValue]:
        """Every number above 0 of the part's modules that may affect its modes."""
        for part_module in self._definition.modules:
            constants = part_module.fields.get("constants", {})
            for name, value in number_fields(part_module):
                if value > 0 and (name in _TUNABLE_FIELDS or name in constants):
                    yield TunableValue(part_module.name, name, value)
            if part_module.kind == "MODES":
                for list_index, value in enumerate(part_module.fields["f"], 1):
                    yield TunableValue(part_module.name, "f", value, list_index)

    def target(self, value: TunableValue) -> str:
        """The value's name in a line of a session and in a table of automation: `bell.m.K`.

        A number of a list has its place at the end: `bell.f.2`.
        """
        name = self.field_name(value)
        return name if value.list_index is None else f"{name}.{value.list_index}"

    def field_name(self, value: TunableValue) -> str:
        """The field of the value, or of the list that has it: `bell.f`."""
        return ".".join(filter(None, (self.name, value.module, value.field)))

    def value_text(self, value: TunableValue) -> str:
        """The value as a score writes it, without loss of precision."""
        part = self._definition
        is_ca = isinstance(part, Instrument) and part.ca_rate is not None
        return quantity_text(value.number, value.field, is_ca=is_ca)

    def with_values(self, texts: Texts, values: Sequence[TunableValue]) -> Texts:
        """A score's texts with the values set in them. Raises EditError."""
        lists_by_target: dict[str, dict[int, str]] = {}
        for tuned_value in values:
            if tuned_value.list_index is None:
                texts = set_value(
                    texts, self.piece, self.target(tuned_value), self.value_text(tuned_value)
                )
            else:
                lists_by_target.setdefault(self.field_name(tuned_value), {})[
                    tuned_value.list_index - 1
                ] = self.value_text(tuned_value)
        for target, list_changes in lists_by_target.items():
            texts = set_list(texts, target, list_changes)
        return texts

    def network(self, values: Mapping[FieldKey, float]) -> _core.Network:
        """The part as a network by itself, with some numbers replaced. Raises EngineError."""
        part_definition = self._definition
        lever_ratio = part_definition.reach if isinstance(part_definition, Key) else 1.0
        ca_rate = part_definition.ca_rate if isinstance(part_definition, Instrument) else None
        new_modules = [_module_with_values(module, values) for module in part_definition.modules]
        assembly = Assembly(seed=self.piece.seed)
        point_modules = [module for module in new_modules if module.kind in POINT_KINDS]
        space = part_definition.space if isinstance(part_definition, Instrument) else None
        assembly.add_part(self.name, point_modules, ca_rate=ca_rate, reach=lever_ratio, space=space)
        assembly.add_followers(self.name, point_modules, ca_rate=ca_rate)
        links = [module for module in new_modules if self._is_inside(module, assembly)]
        assembly.add_links(self.name, links, ca_rate=ca_rate, reach=lever_ratio)
        for other_part, other_module in self.piece.modules():
            if other_part != self.name and self._is_inside(other_module, assembly):
                rate = self.piece.instruments[other_part].ca_rate
                assembly.add_links(other_part, [other_module], ca_rate=rate)
        return assembly.network

    def _is_inside(self, module: Module, assembly: Assembly) -> bool:
        if module.kind not in LINK_KINDS:
            return False
        # Links to a PROXY between masses of another part, or that follow a MAT of another part, are
        # left out.
        end_targets = *module.ends, *following.targets(module)
        return all((end.part, end.module) in assembly.mats for end in end_targets)


def _module_with_values(part_module: Module, numbers_by_field: Mapping[FieldKey, float]) -> Module:
    field_numbers: dict[str, float] = {}
    module_fields = dict(part_module.fields)
    for (name, field_name, list_index), value in numbers_by_field.items():
        if name != part_module.name:
            continue
        if list_index is None:
            field_numbers[field_name] = value
        else:
            numbers = module_fields[field_name]
            module_fields[field_name] = Each(
                (*numbers[: list_index - 1], value, *numbers[list_index:])
            )
    module_fields |= {
        name: field_number
        for name, field_number in field_numbers.items()
        if name in part_module.fields
    }
    constants = part_module.fields.get("constants", {})
    if constants:
        module_fields["constants"] = {
            **constants,
            **{
                constant_name: field_number
                for constant_name, field_number in field_numbers.items()
                if constant_name in constants
            },
        }
    return replace(part_module, fields=module_fields)
