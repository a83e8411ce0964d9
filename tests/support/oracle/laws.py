"""Non-linear laws, each written twice: as the text a composer writes and as plain arithmetic."""

import math
from dataclasses import dataclass
from typing import Any

from oracle.compiled import compiled

CUBIC, ROPE, BOW, COULOMB = range(4)

# name: (number, text of the elastic law, text of the damping, constants in the order of the kernel)
TABLE: dict[str, tuple[int, str | None, str | None, tuple[str, ...]]] = {
    "cubic": (CUBIC, "k*d + q*d**3", "z*v", ("k", "q", "z")),
    "rope": (ROPE, "where(d > 0, k*d, 0)", "where(d > 0, z*v, 0)", ("k", "z")),
    "bow": (BOW, None, "F*sqrt(2*a)*(v + u)*exp(0.5 - a*(v + u)**2)", ("F", "a", "u")),
    "coulomb": (COULOMB, "k*d", "F*tanh(v/s)", ("k", "F", "s")),
}


@compiled
def law(number, c, d, v):
    """Force [N] of law `number` with constants c at elongation d [m] and its rate v [m/s]."""
    if number == CUBIC:
        return c[0] * d + c[1] * d * d * d + c[2] * v
    if number == ROPE:
        return c[0] * d + c[1] * v if d > 0.0 else 0.0
    if number == BOW:
        w = v + c[2]
        return c[0] * math.sqrt(2.0 * c[1]) * w * math.exp(0.5 - c[1] * w * w)
    return c[0] * d + c[1] * math.tanh(v / c[2])


@dataclass(frozen=True, slots=True)
class Law:
    """One law of TABLE with its constants (SI)."""

    name: str
    constants: tuple[tuple[str, float], ...]

    @property
    def number(self) -> int:
        return TABLE[self.name][0]

    def values(self) -> list[float]:
        """Constants in the order of the kernel, padded to three."""
        arguments = dict(self.constants)
        return [arguments[name] for name in TABLE[self.name][3]] + [0.0] * (
            3 - len(TABLE[self.name][3])
        )

    def slope(self) -> float:
        """Elastic slope at rest [N/m]."""
        return dict(self.constants).get("k", 0.0)

    def viscosity(self) -> float:
        """Slope of the damping at rest [N·s/m], for laws with constant damping."""
        return dict(self.constants).get("z", 0.0)

    def on(self, core: Any) -> Any:
        """The same law in the core."""
        _, expression, damping, _ = TABLE[self.name]
        return core.Law(expression, damping, dict(self.constants))


def make(name: str, **constants: float) -> Law:
    """A law of the table: `make("cubic", k=1e3, q=1e8, z=0.1)`."""
    if set(constants) != set(TABLE[name][3]):
        raise ValueError(f"{name} needs {TABLE[name][3]}")
    return Law(name, tuple(constants.items()))
