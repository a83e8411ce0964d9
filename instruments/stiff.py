"""How stiff a string is: its inharmonicity, as a number or from what it is made of."""

from __future__ import annotations

import math
from typing import Any

from ergon.notation.tables import kinds as k
from ergon.notation.tables.fields import Field, Record, Values
from ergon.notation.tables.shapes import MISSING, Either

INHARMONICITY_MAX = 0.1


def _coefficient(values: Values) -> Any:
    """B = π³·E·r⁴/(4·T·L²) of a round wire: bending stiffness E·π·r⁴/4 over tension."""
    young, radius, tension, length = (
        float(values[name]) for name in ("young", "radius", "tension", "length")
    )
    b = math.pi**3 * young * radius**4 / (4.0 * tension * length**2)
    if b <= INHARMONICITY_MAX:
        return b
    message = (
        f"{values.context.of('inharmonicity')} would be {b:.3g}, above the maximum of "
        f"{INHARMONICITY_MAX:g}; take a thinner or longer wire, or more tension"
    )
    values.error("E202", message, "radius")
    return MISSING


_WIRE = Record(
    "wire",
    "a round wire: B = π³·E·r⁴/(4·T·L²)",
    (
        Field("young", k.PRESSURE, "Young's modulus E", required=True),
        Field("radius", k.SIZE, "radius r of its cross-section", required=True),
        Field("tension", k.FORCE, "tension T", required=True),
        Field("length", k.SIZE, "length L between its ends", required=True),
    ),
    _coefficient,
)
INHARMONICITY = Either(k.INHARMONICITY, _WIRE)
