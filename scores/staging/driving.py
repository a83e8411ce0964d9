"""The forces that drive a real key along a written part: the part's ergons on the measured key."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ergon import _core
from ergon.notation.text.errors import Collector
from ergon.scores.staging.live import solo_hands
from ergon.scores.staging.tick_forces import TickForces

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ergon.scores.reading.piece import Piece
    from ergon.scores.reading.playing import Key, Player

# Ticks that are computed between two readings of the ergons.
_BLOCK_TICKS = 1024


def written_forces(
    piece: Piece, player: Player, tick_frames: int, standin: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Forces that move the measured key of a player along `standin` (n_ticks,) [m]; (n_ticks,) [N].

    The last one holds the key where the part ends.
    """
    player_key = piece.keys[player.key]
    network, hands = solo_hands(piece, player, Collector())
    simulation = _core.Simulation(network, hands.timeline, record=True)
    period = tick_frames / piece.rate
    tick_forces = TickForces(period, delay_of(player_key), 0, np.zeros(len(standin)))
    frames = np.zeros((_BLOCK_TICKS * tick_frames, 1))
    for _ in range(0, len(standin) + tick_forces.n_late_ticks, _BLOCK_TICKS):
        simulation.process(frames)
        tick_forces.add(simulation)
    tick_forces.forces[max(0, len(standin) - tick_forces.n_late_ticks) :] = holding_force(
        player_key, float(standin[-1])
    )
    return tick_forces.forces


def delay_of(key: Key) -> float:
    """The measured delay of a key's motor [s]; 0 if it is not known."""
    return 0.0 if key.measured_constants is None else key.measured_constants[2] or 0.0


def holding_force(player_key: Key, x: float) -> float:
    """The force [N] that holds a measured key at `x` [m]; 0 where its dry friction does."""
    fields_by_module = {module.name: module.fields for module in player_key.modules}
    cel_fields = fields_by_module[player_key.struck]
    spring_force = (cel_fields["K"] or 0.0) * (x - (cel_fields["rest"] or 0.0))
    spring_force -= fields_by_module["weight"]["from"] if "weight" in fields_by_module else 0.0
    friction = fields_by_module["dry"]["F"] if "dry" in fields_by_module else 0.0
    return 0.0 if abs(spring_force) <= friction else spring_force


def moving_mass(key: Key) -> float:
    """The mass of a measured key with the modes that swing on it [kg]."""
    return float(sum(module.fields["M"] for module in key.modules if "M" in module.fields))
