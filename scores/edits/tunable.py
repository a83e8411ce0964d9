"""One part of a piece as a network by itself, with some of its values replaced."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from ergon.instruments.assemble import Assembly
from ergon.instruments.model import Instrument, Module
from ergon.instruments.module_kinds import HOLDERS, LINKS
from ergon.scores.edits.matter import quantities, said, set_value
from ergon.scores.edits.texts import Texts
from ergon.scores.reading.piece import Key, Piece

if TYPE_CHECKING:
    from ergon import _core

# What moves the modes of a part, but for constants of laws; only numbers above 0 are moved.
_FIELDS = ("M", "K", "f", "inharmonicity", "stiffness", "bending", "sigma0", "stretching")


@dataclass(frozen=True, slots=True)
class Value:
    """A number of a module that may be moved: where it stands, and what it is [SI]."""

    module: str
    field: str
    number: float


@dataclass(frozen=True, slots=True)
class TunablePart:
    """An instrument or a key of a piece."""

    piece: Piece
    name: str

    @property
    def _own(self) -> Key | Instrument:
        return self.piece.keys.get(self.name) or self.piece.instruments[self.name]

    @property
    def is_listed(self) -> bool:
        """Whether modes of it are written one by one (MODES), so that nothing else moves them."""
        return any(module.kind == "MODES" for module in self._own.modules)

    def values(self) -> Iterator[Value]:
        """Every number above 0 of its modules that may move its modes."""
        for module in self._own.modules:
            constants = module.fields.get("constants", {})
            for name, number in quantities(module):
                if number > 0 and (name in _FIELDS or name in constants):
                    yield Value(module.name, name, number)

    def target(self, value: Value) -> str:
        """The value as a line of a session and a table of automation name it: `bell.m.K`."""
        return ".".join(filter(None, (self.name, value.module, value.field)))

    def text(self, value: Value) -> str:
        """The value as a score says it, to the last bit."""
        own = self._own
        is_ca = isinstance(own, Instrument) and own.ca_rate is not None
        return said(value.number, value.field, is_ca=is_ca)

    def edit(self, texts: Texts, value: Value) -> Texts:
        """A score's texts with the value in them. Raises EditError."""
        return set_value(texts, self.piece, self.target(value), self.text(value))

    def network(self, values: Mapping[tuple[str, str], float]) -> _core.Network:
        """It by itself, with numbers in place of those of (module, field). Raises EngineError."""
        own = self._own
        reach = own.reach if isinstance(own, Key) else 1.0
        ca_rate = own.ca_rate if isinstance(own, Instrument) else None
        modules = [_with(module, values) for module in own.modules]
        assembly = Assembly(seed=self.piece.seed)
        points = [module for module in modules if module.kind in HOLDERS]
        space = own.space if isinstance(own, Instrument) else None
        assembly.part(self.name, points, ca_rate=ca_rate, reach=reach, space=space)
        links = [module for module in modules if self._is_inside(module)]
        assembly.joins(self.name, links, ca_rate=ca_rate, reach=reach)
        for other, module in self.piece.modules():
            if other != self.name and self._is_inside(module):
                rate = self.piece.instruments[other].ca_rate
                assembly.joins(other, [module], ca_rate=rate)
        return assembly.network

    def _is_inside(self, module: Module) -> bool:
        if module.kind not in LINKS:
            return False
        return all(end.part == self.name for end in module.fields["between"])


def _with(module: Module, values: Mapping[tuple[str, str], float]) -> Module:
    own = {field: number for (name, field), number in values.items() if name == module.name}
    if not own:
        return module
    fields = {**module.fields, **{name: x for name, x in own.items() if name in module.fields}}
    constants = module.fields.get("constants", {})
    if constants:
        fields["constants"] = {**constants, **{n: x for n, x in own.items() if n in constants}}
    return replace(module, fields=fields)
