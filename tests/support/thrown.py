"""A thrown ball, in two and in three axes, and its position by the parabola."""

import numpy as np
from numpy.typing import NDArray

_SCORE = """\
ergon: 1
instruments:
  throw:
    space: %d
    gravity: 9.81m/s2
    modules:
      nail: {SOL: {X0: %s}}
      ball: {MAS: {M: 20g, X0: %s, V0: %s}}
      thread: {RES: {between: [nail, ball], K: 0.001}}
    out: {SOX: ball.x}
  bell: {CEL: {M: 20g, f: 217.5Hz, t60: 1s}, out: {SOX: bell}}
strikes: {one: {to: bell, at: 0, impulse: 1mNs}}
render: {tail: 0.5s}
"""
THROWN = {
    2: _SCORE % (2, "[0, 0]", "[10cm, 1m]", "[0.2m/s, 1m/s]"),
    3: _SCORE % (3, "[0, 0, 0]", "[10cm, 0, 1m]", "[0.2m/s, 0.3m/s, 1m/s]"),
}


def places_of_ball(times: NDArray[np.float64], axes: int) -> NDArray[np.float64]:
    """x, y and z [m] of the ball at instants [s], z upwards, from the nail (n_instants, 3).

    With two axes the second is up. The thread pulls it by less than a thousandth of its weight.
    """
    y = 0.3 * times if axes == 3 else 0.0 * times
    return np.stack([0.1 + 0.2 * times, y, 1.0 + times - 0.5 * 9.81 * times**2], axis=1)
