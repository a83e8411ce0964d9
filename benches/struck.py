"""The exact motion of a hammer on a linear body.

Between contacts every mode follows its own exponential; through a contact DOP853 solves all
modes with the hammer, to 1e-12. The engine's rate plays no part.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from benches.modes import Body, Floats, ring

_CHUNK = 256
_CLOSE = 8  # times a sample that a gap is looked at


@dataclass(frozen=True, slots=True)
class Hammer:
    """A free mass below point 0 of a body; it pushes with k·p while it is p above that point."""

    m: float
    k: float
    x: float
    v: float


def struck(body: Body, hammer: Hammer, rate: float, n_frames: int) -> Floats:
    """The motion of a body at rest that the hammer hits: all its points at every sample (n_frames,
    points).
    """
    period, shapes = 1.0 / rate, body.shapes
    out = np.zeros((n_frames, len(shapes)))
    n, position, touches = len(body.w2), 0.0, False
    state = np.concatenate([np.zeros(2 * n), [hammer.x, hammer.v]])
    end = n_frames * period
    while position < end:
        # Samples from `position` on, and where they lie from there.
        first = math.ceil(position / period - 1e-9)
        if touches:
            until, after, solved = _through(body, hammer, state, end - position)
            last = min(n_frames, math.ceil((position + until) / period - 1e-9))
            if last > first:
                out[first:last] = (
                    solved(np.arange(first, last) * period - position)[:n].T @ shapes.T
                )
        else:
            until, after = _until_touch(body, state, end - position, period)
            last = min(n_frames, math.ceil((position + until) / period - 1e-9))
            if last > first:
                c = body.phasor(state[:n], state[n:-2])
                begun = c * np.exp(body.pole * (first * period - position))
                out[first:last] = ring(body, begun, np.arange(last - first) * period, shapes)
        position, state, touches = position + until, after, not touches
    return out


def _through(
    body: Body, hammer: Hammer, state: Floats, limit: float
) -> tuple[float, Floats, Callable[[Floats], Floats]]:
    n, push = len(body.w2), body.shapes[0]

    def rate(_: float, y: Floats) -> Floats:
        f = hammer.k * (y[-2] - push @ y[:n])
        accelerated = push * f - body.w2 * y[:n] - 2.0 * body.sigma * y[n:-2]
        return np.concatenate([y[n:-2], accelerated, [y[-1], -f / hammer.m]])

    def apart(_: float, y: Floats) -> float:
        return float(y[-2] - push @ y[:n])

    apart.terminal, apart.direction = True, -1.0  # type: ignore[attr-defined]
    # The absolute tolerance is below the rounding (1e-16) of the largest magnitude.
    done = solve_ivp(
        rate, (0.0, limit), state, "DOP853", events=apart, dense_output=True, rtol=1e-12, atol=1e-17
    )
    return done.t[-1], done.y[:, -1], done.sol


def _until_touch(body: Body, state: Floats, limit: float, period: float) -> tuple[float, Floats]:
    n, push = len(body.w2), body.shapes[0]
    c = body.phasor(state[:n], state[n:-2])
    fine = period / _CLOSE

    def above(t: float) -> float:
        return float(state[-2] + state[-1] * t - (push @ (c * np.exp(body.pole * t)).real))

    touch, begun = limit, 0.0
    times = np.arange(_CHUNK + 1) * fine
    turn = np.exp(np.outer(times, body.pole)) * push
    while begun < limit:
        now = c * np.exp(body.pole * begun)
        # The hammer is lower than the body can ever reach, and moves down: it never returns.
        if state[-2] + state[-1] * begun < -np.abs(now * push).sum() and state[-1] <= 0.0:
            break
        p = state[-2] + state[-1] * (begun + times) - (turn @ now).real
        # A hammer that has just left still counts as touching; only a crossing from below begins a
        # contact.
        enters = np.flatnonzero((p[:-1] <= 0.0) & (p[1:] > 0.0))
        if len(enters):
            low = begun + times[enters[0]]
            touch = min(limit, brentq(above, low, low + fine, xtol=1e-16) + 1e-15)
            break
        begun += _CHUNK * fine
    now = c * np.exp(body.pole * touch)
    moved = [state[-2] + state[-1] * touch, state[-1]]
    return touch, np.concatenate([now.real, (now * body.pole).real, moved])
