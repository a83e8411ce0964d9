"""The kinds of outputs: everything that is asked of a kind, said once.

A kind is a row of `OUTPUTS`. From it follow what may be named, taps, levels, reports, exporters and
what messages advise.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True, slots=True)
class OutputKind:
    """A kind of output: it hears a quantity of masses or of links.

    `reference` [`unit`] is heard at the reference level, -20 dBFS. `order` is how often positions
    are differentiated with respect to time. With `radiates` it is what the pressure of a small
    source follows. An energy is that of the masses' motion, ½·m·v² of each.
    """

    name: str
    quantity: str
    unit: str
    reference_amount: float
    sources: Literal["mats", "links"] = "mats"
    order: int = 0
    radiates: bool = False
    is_energy: bool = False

    @property
    def is_movement(self) -> bool:
        """Whether it is linear in the positions of masses."""
        return self.sources == "mats" and not self.is_energy


# SOX, SOV and SOA are at the reference level by one movement at 1.6 kHz (10,000 rad/s).
_ALL_OUTPUTS = (
    OutputKind("SOX", "position", "m", 1e-4),
    OutputKind("SOV", "speed", "m/s", 1.0, order=1),
    OutputKind("SOA", "acceleration", "m/s²", 1e4, order=2, radiates=True),
    OutputKind("SOE", "energy", "J", 1e-3, order=1, is_energy=True),
    OutputKind("SOF", "force", "N", 1e-2, sources="links"),
)
OUTPUTS = {kind.name: kind for kind in _ALL_OUTPUTS}
_movement_names = [kind.name for kind in _ALL_OUTPUTS if kind.is_movement]
MOVEMENT_NAMES = f"{', '.join(_movement_names[:-1])} or {_movement_names[-1]}"  # for messages
