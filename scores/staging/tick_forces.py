"""Mean forces of ergons, tick by tick."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ergon import _core


@dataclass(frozen=True, slots=True)
class TickForces:
    """The mean force of ergons in each tick, `delay` [s] after it begins: `forces` (n_ticks,)."""

    period: float  # period of a tick [s]
    delay: float
    first_tick: int  # number of the first tick
    forces: NDArray[np.float64]

    @property
    def n_late_ticks(self) -> int:
        """How many ticks after the last one its ergons are over."""
        return int(np.ceil(self.delay / self.period)) + 1

    def add(self, simulation: _core.Simulation) -> None:
        """Add the ergons of a simulation since the last call; it was made with record=True."""
        ergons = simulation.ergons()
        ticks = np.floor((ergons["time"] - self.delay) / self.period + 1e-6).astype(int)
        ticks -= self.first_tick
        is_inside = (ticks >= 0) & (ticks < len(self.forces))
        np.add.at(self.forces, ticks[is_inside], ergons["impulse"][is_inside] / self.period)
