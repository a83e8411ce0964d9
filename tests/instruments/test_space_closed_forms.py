"""Matter in space beside closed forms, with the order of its convergence."""

from collections.abc import Callable

import numpy as np
import pytest
from checked import check
from scipy.special import ellipj, ellipk

from ergon.scores.staging.stage import stage

G = 9.81
RATES = (22_050, 44_100)


def rendered(text: str, rate: int) -> np.ndarray:
    """Outputs of a score, stepped by CA (n_frames, n_out)."""
    lines = f"rates: {{audio: {rate}Hz}}\naccuracy: {{method: ca}}\n"
    built = stage(check(lines + text).piece, planned=True)
    sound = np.empty((built.n_frames, built.simulation.n_out))
    built.simulation.process(sound)
    return sound


def converges(text: str, exact: Callable[[np.ndarray], np.ndarray], limit: float):
    """Outputs go where `exact` of the seconds says; the error at half the step is a quarter.

    At the finer rate it is below `limit`, as a share of the largest value.
    """
    errors = []
    for rate in RATES:
        ours = rendered(text, rate)
        right = exact(np.arange(len(ours)) / rate)
        errors.append(float(np.abs(ours - right).max() / np.abs(right).max()))
    assert errors[1] < limit
    assert 3.6 < errors[0] / errors[1] < 4.4


def test_conical_pendulum_closed_form():
    """Its rod is as much longer as it pulls: T cos(angle) = m g, and it turns by w² = T/(m l)."""
    mass, stiff, rest, angle = 0.02, 400.0, 0.5, 0.6
    pull = float(mass * G / np.cos(angle))
    length = rest + pull / stiff
    turn = float(np.sqrt(pull / (mass * length)))
    out, down = float(length * np.sin(angle)), float(length * np.cos(angle))
    text = f"""\
ergon: 1
instruments:
  p:
    space: 3
    gravity: {G}
    modules:
      nail: {{SOL: {{X0: [0, 0, 0]}}}}
      bob: {{MAS: {{M: {mass}kg, X0: [{out!r}, 0, {-down!r}], V0: [0, {out * turn!r}, 0]}}}}
      rod: {{REF: {{between: [nail, bob], K: {stiff}, rest: {rest}}}}}
    out: {{x: {{SOX: bob.x}}, y: {{SOX: bob.y}}, z: {{SOX: bob.z}}}}
render: {{bits: float, tail: 2s}}
"""

    def exact(t: np.ndarray) -> np.ndarray:
        phase = turn * t
        return np.stack([out * np.cos(phase), out * np.sin(phase), np.full_like(t, -down)], 1)

    converges(text, exact, 1e-6)


def test_pendulum_elliptic_integral():
    """From 120 degrees; the rod is so stiff that it stretches by 3e-6 of its length."""
    mass, length, top = 0.05, 0.3, np.radians(120)
    out, height = float(length * np.sin(top)), float(-length * np.cos(top))
    modulus = float(np.sin(top / 2) ** 2)
    text = f"""\
ergon: 1
instruments:
  p:
    space: 2
    gravity: {G}
    modules:
      nail: {{SOL: {{X0: [0, 0]}}}}
      bob: {{MAS: {{M: {mass}kg, X0: [{out!r}, {height!r}]}}}}
      rod: {{REF: {{between: [nail, bob], K: 2000kN/m}}}}
    out: {{x: {{SOX: bob.x}}, y: {{SOX: bob.y}}}}
render: {{bits: float, tail: 3s}}
"""
    ours = rendered(text, 44_100)
    quarter = ellipk(modulus)
    slow = np.sqrt(G / length)
    t = np.arange(len(ours)) / 44_100
    half = np.arcsin(np.sqrt(modulus) * ellipj(quarter - slow * t, modulus)[0])
    exact = length * np.stack([np.sin(2 * half), -np.cos(2 * half)], 1)
    assert slow * t[-1] > 4 * quarter  # more than one period
    np.testing.assert_allclose(ours, exact, rtol=0, atol=1e-4 * length)


def test_kepler_orbit_of_attraction_law():
    """An orbit of eccentricity 0.6 by a law of 1/d², its places by Kepler's equation."""
    mass, pull, far, eccentric = 5e-3, 2e-4, 0.2, 0.6
    mu = pull / mass
    axis = far / (1 + eccentric)
    speed = float(np.sqrt(mu * (1 - eccentric) / far))
    text = f"""\
ergon: 1
instruments:
  sky:
    space: 2
    modules:
      sun: {{SOL: {{X0: [0, 0]}}}}
      comet: {{MAS: {{M: {mass}kg, X0: [{far}, 0], V0: [0, {speed!r}]}}}}
      pull: {{LNL: {{between: [sun, comet], law: mu/d**2, mu: {pull}, rest: 0}}}}
    out: {{x: {{SOX: comet.x}}, y: {{SOX: comet.y}}}}
render: {{bits: float, tail: 3s}}
"""
    mean_motion = np.sqrt(mu / axis**3)
    assert 3 * mean_motion > 2 * np.pi  # it goes round more than once

    def exact(t: np.ndarray) -> np.ndarray:
        mean = np.pi + mean_motion * t
        anomaly = mean.copy()
        for _ in range(60):
            anomaly -= (anomaly - eccentric * np.sin(anomaly) - mean) / (
                1 - eccentric * np.cos(anomaly)
            )
        # Perihelion lies on the other side of the sun.
        x = -axis * (np.cos(anomaly) - eccentric)
        y = -axis * np.sqrt(1 - eccentric**2) * np.sin(anomaly)
        return np.stack([x, y], 1)

    converges(text, exact, 1e-5)


def test_collision_of_two_balls_half_period():
    """While they touch they are one oscillator of K and the reduced mass; then both fly on."""
    item, other, stiff, gap, speed, begin = 0.03, 0.05, 5e3, 0.02, 0.8, 0.03
    reduced = item * other / (item + other)
    omega = np.sqrt(stiff / reduced)
    text = f"""\
ergon: 1
instruments:
  b:
    space: 2
    modules:
      a: {{MAS: {{M: {item}kg, X0: [0, 0], V0: [{0.6 * speed}, {0.8 * speed}]}}}}
      b: {{MAS: {{M: {other}kg, X0: [{0.6 * begin}, {0.8 * begin}]}}}}
      hit: {{BUT: {{between: [a, b], K: {stiff}, gap: {gap}}}}}
    out: {{ax: {{SOX: a.x}}, ay: {{SOX: a.y}}, bx: {{SOX: b.x}}, by: {{SOX: b.y}}}}
render: {{bits: float, tail: 60ms}}
"""
    meet, last = (begin - gap) / speed, np.pi / omega
    for rate, limit in ((44_100, 2e-4), (176_400, 5e-5)):
        ours = rendered(text, rate)
        t = np.arange(len(ours)) / rate
        since = np.clip(t - meet, 0, last)
        deep = speed / omega * np.sin(omega * since)
        after = np.maximum(t - meet - last, 0.0)
        apart = np.where(t < meet, begin - speed * t, gap - deep + speed * after)
        middle = (item * speed * t + other * begin) / (item + other)
        a = middle - other / (item + other) * apart
        b = middle + item / (item + other) * apart
        exact = np.stack([0.6 * a, 0.8 * a, 0.6 * b, 0.8 * b], 1)
        assert t[-1] > meet + last
        # The step in which they meet may begin anywhere: the error is a part of a step.
        assert np.abs(ours - exact).max() < limit * begin


@pytest.mark.parametrize("mode", [(1, 1), (2, 1), (3, 2)])
def test_cloth_under_tension_square_lattice_modes(mode: tuple[int, int]):
    """Under tension P w² = 4 P/(m a) (sin²(..) + sin²(..)) across it, in each of its modes."""
    wide, high, spacing, stiff, stretch, total = 6, 5, 0.02, 800.0, 0.25, 0.024
    inner = (wide - 2) * (high - 2)
    mass = total / inner
    rest = spacing / (1 + stretch)
    tension = stiff * (spacing - rest)
    half = [np.pi * number / (2 * (n - 1)) for number, n in zip(mode, (wide, high), strict=True)]
    omega = 2 * np.sqrt(tension / (mass * spacing) * (np.sin(half[0]) ** 2 + np.sin(half[1]) ** 2))

    def shape(i: int, j: int) -> float:
        return float(np.sin(2 * half[0] * i) * np.sin(2 * half[1] * j))

    push = 1e-7  # so weak that the tension stays
    inside = [(i, j) for j in range(1, high - 1) for i in range(1, wide - 1)]
    strikes = "\n".join(
        f"  s{i}{j}: {{to: net.{wide * j + i}.z, at: 0, lasts: 0s, "
        f"impulse: {push * shape(i, j)!r}Ns}}"
        for i, j in inside
        if abs(shape(i, j)) > 1e-9
    )
    outputs = ", ".join(f"o{i}{j}: {{SOX: net.{wide * j + i}.z}}" for i, j in inside)
    text = f"""\
ergon: 1
instruments:
  n:
    space: 3
    modules:
      net: {{CLOTH: {{sides: [{wide}, {high}], M: {total}kg, at: [0, 0, 0],
        across: [{spacing * (wide - 1)}, 0, 0], up: [0, {spacing * (high - 1)}, 0], K: {stiff},
        stretch: {stretch:.0%}, held: rim}}}}
    out: {{{outputs}}}
strikes:
{strikes.replace("to: net", "to: n.net")}
render: {{bits: float, tail: 50ms}}
"""
    shapes = np.array([shape(i, j) for i, j in inside])

    def exact(t: np.ndarray) -> np.ndarray:
        return push / (mass * omega) * np.sin(omega * t)[:, None] * shapes

    converges(text, exact, 1e-3)
