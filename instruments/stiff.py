"""The stiffness of a string in bending and stretching: a number, or computed from its wire."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from ergon.notation.tables import value_kinds
from ergon.notation.tables.compound import Either
from ergon.notation.tables.fields import Field, Record, Values
from ergon.notation.tables.shapes import MISSING

INHARMONICITY_MAX = 0.1


def _inharmonicity(string_values: Values) -> Any:
    """B = π³·E·r⁴/(4·T·L²) of a round wire, with bending stiffness E·π·r⁴/4 and tension T."""
    young, radius, tension, wire_length = (
        float(string_values[name]) for name in ("young", "radius", "tension", "length")
    )
    inharmonicity = math.pi**3 * young * radius**4 / (4.0 * tension * wire_length**2)
    if inharmonicity <= INHARMONICITY_MAX:
        return inharmonicity
    message = (
        f"{string_values.context.label('inharmonicity')} would be {inharmonicity:.3g}, above the "
        f"maximum of {INHARMONICITY_MAX:g}; take a thinner or longer wire, or more tension"
    )
    string_values.error("E202", message, "radius")
    return MISSING


_WIRE = Record(
    "wire",
    "a round wire: B = π³·E·r⁴/(4·T·L²)",
    (
        Field("young", value_kinds.PRESSURE, "Young's modulus E", required=True),
        Field("radius", value_kinds.SIZE, "radius r of its cross-section", required=True),
        Field("tension", value_kinds.FORCE, "tension T", required=True),
        Field("length", value_kinds.SIZE, "length L between its ends", required=True),
    ),
    _inharmonicity,
)
INHARMONICITY_SHAPE = Either(value_kinds.INHARMONICITY, _WIRE)


@dataclass(frozen=True, slots=True)
class Stretched:
    """A wire whose tension rises with its length: E·A/(2·L³) [N/m³], for a single gap."""

    per_gap: float

    def stretching(self, masses: int, ends: str) -> float:
        """q of the force q·S·d on every link of a row of masses."""
        gaps = masses - 1 + {"fixed": 2, "left": 1, "free": 0}[ends]
        return self.per_gap * gaps * gaps


def _stretched_wire(values: Values) -> Stretched:
    section_area = math.pi * float(values["radius"]) ** 2
    return Stretched(float(values["young"]) * section_area / (2.0 * float(values["length"]) ** 3))


_STRETCHED_WIRE = Record(
    "wire",
    "a round wire that is stretched: q = E·A·n²/(2·L³), n gaps between masses",
    _WIRE.fields[:2] + _WIRE.fields[3:],
    _stretched_wire,
)
STRETCHING_SHAPE = Either(value_kinds.HARDENING, _STRETCHED_WIRE)
