"""Grains that came to rest: ten minutes later they lie where they lay."""

import numpy as np
import pytest
from checked import check

from ergon.scores.staging.stage import stage

HEAP = """\
ergon: 1
seed: 2
rates: {audio: 11025Hz}
accuracy: {method: ca}
instruments:
  sand:
    space: 2
    gravity: 9.81m/s2
    modules:
      middle: {SOL: {X0: [0, 5cm]}}
      grains: {GRAINS: {count: 12, M: 12g, from: [-1cm, 4mm], to: [1cm, 5cm], scatter: 20%%}}
      rub: {BUT: {between: [grains.all, grains.all], K: 2kN/m, Z: 0.3Ns/m, gap: 8mm%s}}
      walls: {BUT: {between: [middle, grains.all], K: 2kN/m, Z: 0.3Ns/m, gap: 4mm,
        box: [3cm, 10cm], friction: 0.6}}
    out: {%s}
render: {tail: 1s}
"""
OUT = ", ".join(f"{axis}{i}: {{SOX: grains.{i}.{axis}}}" for i in range(12) for axis in "xy")
RUBBING, STICKING = ", friction: 0.6", ", friction: 0.6, cohesion: 5mN, reach: 0.5mm"


def places(text: str, seconds: list[int]) -> np.ndarray:
    """Where the grains are at some instants [m], (n_instants, n_coordinates)."""
    simulation = stage(check(text).piece, planned=True).simulation
    result = []
    room = np.empty((11_025, simulation.n_out))
    for second in range(max(seconds) + 1):
        simulation.process(room)
        if second in seconds:
            result.append(room[-1].copy())
    return np.array(result)


@pytest.mark.parametrize("more", [RUBBING, STICKING])
def test_grains_come_to_rest(more: str):
    """Four seconds after they fell, and four more: nothing moves beyond rounding."""
    before, after = places(HEAP % (more, OUT), [5, 9])
    np.testing.assert_allclose(after, before, 0, 1e-14)
    assert np.ptp(before[::2]) > 0.01  # they lie beside each other


@pytest.mark.slow
def test_grains_at_rest_stay_at_rest_for_ten_minutes():
    before, after = places(HEAP % (RUBBING, OUT), [9, 609])
    np.testing.assert_allclose(after, before, 0, 1e-13)
