"""What a key meets: the force of the scene, tick by tick, against a hand that is moved once."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ergon import _core

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from ergon.scores.staging.live import LiveHand
    from ergon.scores.staging.stage import Stage

# Long enough that a loop which grows shows it, short enough to wait for [ticks].
_TICKS = 400
# The scene is linear here: any step will do that rounding does not reach [m].
_STEP = 1e-3
_ENDLESS = 1e12  # [N/m]


def response(stage: Stage, hand: LiveHand) -> NDArray[np.float64]:
    """Force against the key [N/m] in each tick after it was away for one, (400,).

    All contacts are closed.
    """
    import numpy as np

    network = stage.network.pressed()
    timeline = _core.Timeline(network, stage.rate)
    ticks = np.zeros(_TICKS)
    ticks[0] = _STEP * hand.reach
    # A hand comes from where it begins: it begins at rest.
    path = np.concatenate([[0.0], ticks, [0.0]])
    index = timeline.hand(hand.mat, hand.every, positions=path)
    simulation = _core.Simulation(network, timeline, unchecked=True, on_fault="mute")
    felt = np.zeros(_TICKS)
    frames = np.zeros((hand.every, simulation.n_out))
    simulation.process(frames)
    for tick in range(_TICKS):
        simulation.process(frames)
        felt[tick] = simulation.felt(index)
    if simulation.muted():
        # Closed, the scene runs away by itself: no key bears that.
        return np.full(_TICKS, _ENDLESS)
    return -felt * hand.reach / _STEP
