"""The numbers by which the engine changes a module, for given values of its parameters.

The numbers are K, Z and M of a CEL; factors of K and of Z for links and for the links of a
STRING or a PLATE; the square of the factor of all frequencies and the factor of all decay rates
of a BANK.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from ergon import _core
from ergon.common.decay import LN_1000
from ergon.instruments.model import Module
from ergon.instruments.module_kinds import KINDS, member_count
from ergon.scores.reading.automatable import pitched_module
from ergon.scores.reading.piece import Piece
from ergon.scores.staging.version_glides import BODY_KINDS, TWO_PI, cel_constants

if TYPE_CHECKING:
    from ergon.instruments.assemble import Assembly

ModuleKey = tuple[str, str]  # a part and one of its modules
Point = tuple[float, ...]  # an instant [s] and numbers
Points = Sequence[Point]

_INFINITE_T60_SECONDS = 1e9  # the t60 without decay [s]


class AutomatedModule:
    """A module with automated parameters; `scale` turns its values into those that the piece
    sees.
    """

    def __init__(self, module: Module, scale: float) -> None:
        """Take a module."""
        self.module = module
        self.scale = scale
        self.written_values = _written_values(module)
        self.written_engine_values = self.engine_values({})

    @classmethod
    def from_piece(cls, piece: Piece, module_key: ModuleKey) -> AutomatedModule | None:
        """A module of a piece; None if it does not exist."""
        name, module_name = module_key
        named_key = piece.keys.get(name)
        owning_part = named_key or piece.instruments.get(name)
        modules = () if owning_part is None else owning_part.modules
        part_module = next(
            (candidate for candidate in modules if candidate.name == module_name), None
        )
        if part_module is None and not module_name:
            part_module = pitched_module(owning_part)
        if part_module is None:
            return None
        return cls(
            part_module, 1.0 if named_key is None else 1.0 / (named_key.reach * named_key.reach)
        )

    def is_same(self, other_module: AutomatedModule) -> bool:
        """Whether another module has the same numbers for all values."""
        return self.scale == other_module.scale and self.module == other_module.module

    @property
    def cost(self) -> int:
        """How many entries a point takes in the engine."""
        kind = self.module.kind
        return member_count(kind, self.module.fields) if kind == "BANK" else 1

    def engine_values(self, values_by_name: Mapping[str, float]) -> tuple[float, ...]:
        """The module's numbers, if some parameters have the values `values_by_name`."""
        module_kind = self.module.kind
        if module_kind == "CEL":
            return _cel_constants(self.module, self.written_values, values_by_name, self.scale)
        if module_kind == "INSTRUMENT":
            return ()  # its modules have numbers
        if module_kind == "BANK":
            frequency, t60 = values_by_name.get("f", 1.0), values_by_name.get("t60", 1.0)
            return frequency * frequency, 1.0 / t60
        if module_kind in BODY_KINDS:
            stiffness, decay_rate = _square_and_decay_rate(self.written_values)
            new_k, new_rate = _square_and_decay_rate({**self.written_values, **values_by_name})
            return new_k / stiffness, new_rate / decay_rate if decay_rate else 1.0
        scaled_names = KINDS[module_kind].scaled_fields
        return tuple(
            values_by_name[name] / self.written_values[name] if name in values_by_name else 1.0
            for name in scaled_names
        )

    def transposed(self, engine_values: tuple[float, ...], ratio: float) -> tuple[float, ...]:
        """The numbers with all times divided by a ratio, as `transpose` does."""
        stiffness, viscosity, *other_values = engine_values
        return (stiffness * ratio * ratio, viscosity * ratio, *other_values)

    def put_points(
        self, timeline: _core.Timeline, assembly: Assembly, module_key: ModuleKey, points: Points
    ) -> None:
        """Put the points on the timeline, so that the engine moves the module. Raises
        EngineError.
        """
        module_kind = self.module.kind
        if module_kind == "CEL":
            timeline.path(assembly.mats[module_key], [(t, k, z, m) for t, k, z, m in points])
            return
        timed_pairs = [(t, a, b) for t, a, b in points]
        if module_kind == "BANK":
            timeline.retune(assembly.mats[module_key], timed_pairs, n=self.cost)
            return
        links = assembly.links_of(module_key)
        timeline.lead(links.start, timed_pairs, n=len(links))


def _written_values(part_module: Module) -> dict[str, float]:
    """The parameters of a module as written."""
    module_fields = part_module.fields
    if part_module.kind == "INSTRUMENT":
        return {"f": float(module_fields["f"])}
    if part_module.kind == "BANK":
        return {"f": 1.0, "t60": 1.0}  # each member has its own
    if part_module.kind in BODY_KINDS:
        t60 = module_fields.get("t60")
        return {
            "f": float(module_fields["f"]),
            "t60": t60 if isinstance(t60, float) else _INFINITE_T60_SECONDS,
        }
    if part_module.kind != "CEL":
        return {
            name: float(module_fields.get(name) or 0.0)
            for name in KINDS[part_module.kind].scaled_fields
        }
    k, z, m = cel_constants(module_fields)
    decay_rate = z / (2.0 * m)
    f, t60 = module_fields.get("f"), module_fields.get("t60")
    return {
        "K": k,
        "Z": z,
        "M": m,
        "f": float(f) if f else math.sqrt(max(0.0, k / m - decay_rate * decay_rate)) / TWO_PI,
        "t60": float(t60)
        if t60
        else (LN_1000 / decay_rate if decay_rate else _INFINITE_T60_SECONDS),
    }


def _cel_constants(
    part_module: Module,
    written_values: Mapping[str, float],
    values_by_name: Mapping[str, float],
    scale: float,
) -> tuple[float, float, float]:
    """K, Z and M of a CEL, if some parameters have the values `values_by_name`."""
    module_fields: dict[str, Any] = dict(part_module.fields)
    if values_by_name.keys() & {"f", "t60"} and not module_fields.get("f"):
        module_fields |= written_values
    module_fields |= values_by_name
    if float(module_fields.get("t60") or 0.0) >= _INFINITE_T60_SECONDS:
        module_fields["t60"] = None
    if values_by_name.keys() & {"K", "Z"} and module_fields.get("f"):
        k, z, _ = cel_constants(module_fields)
        module_fields |= {
            "f": None,
            "K": values_by_name.get("K", k),
            "Z": values_by_name.get("Z", z),
        }
    k, z, m = cel_constants(module_fields)
    return k * scale, z * scale, m * scale


def _square_and_decay_rate(values: Mapping[str, float]) -> tuple[float, float]:
    """The square of the lowest angular frequency without losses [1/s²] and the decay rate [1/s]."""
    angular_frequency, t60 = TWO_PI * values["f"], values["t60"]
    decay_rate = LN_1000 / t60 if t60 < _INFINITE_T60_SECONDS else 0.0
    return angular_frequency * angular_frequency + decay_rate * decay_rate, decay_rate
