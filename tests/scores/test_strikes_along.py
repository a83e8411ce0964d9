"""Strikes on points in space along a direction."""

import numpy as np
import pytest
from checked import check, check_reports

from ergon.scores.staging.stage import stage

SCENE = """\
ergon: 1
seed: 3
accuracy: {{method: ca}}
instruments:
  a:
    space: 3
    modules:
      bob: {{MAS: {{M: 10g, X0: [1cm, 0, 0]}}}}
      net: {{GRAINS: {{count: 4, M: 40g, from: [0, 0, 1m], to: [3cm, 0, 1m]}}}}
      skin: {{SURFACE: {{of: drum.body, at: [0, 0], across: 1m}}}}
    out: {{x: {{SOX: {0}.x}}, y: {{SOX: {0}.y}}, z: {{SOX: {0}.z}}}}
  drum: {{modules: {{body: {{STRING: {{masses: 5, M: 1g, f: 90Hz}}}}}}}}
strikes:
  hit: {{{1}}}
render: {{bits: float, tail: 0.2s}}
"""


def paths(point: str, strikes: str) -> np.ndarray:
    """Where a point goes (n_frames, 3)."""
    built = stage(check(SCENE.format(point, strikes)).piece, planned=True)
    sound = np.empty((built.n_frames, built.simulation.n_out))
    built.simulation.process(sound)
    return sound


@pytest.mark.parametrize("along", [(1, 2, 2), (-3, 0, 4), (0, 0, -0.5)])
def test_strike_along_direction_sets_velocity(along):
    path = paths("bob", f"to: a.bob, at: 0, impulse: 6mNs, along: [{', '.join(map(str, along))}]")
    speed = (path[-1] - path[-2]) * 44_100
    wanted = 0.6 * np.array(along) / np.linalg.norm(along)
    assert speed == pytest.approx(wanted, abs=1e-9)


@pytest.mark.parametrize(
    "when",
    [
        "at: 0, every: 1/64, times: 9",
        "at: 0, for: 1/8, rate: 90Hz",
        "at: 0, euclid: 3 8, every: 1/64",
    ],
)
def test_chance_impulse_along_keeps_direction(when):
    """Impulses by chance, some of them backwards: the path stays on one line."""
    path = paths("net.2", f"{when}, to: a.net.all, impulse: -1mNs..3mNs, along: [2, -1, 2]")
    moved = path - path[0]
    direction = np.array([2.0, -1.0, 2.0]) / 3.0
    along = moved @ direction
    assert np.ptp(along) > 1e-4
    assert moved - np.outer(along, direction) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize(
    ("strikes", "code", "said"),
    [
        ("to: a.bob, impulse: 1mNs, along: [1, 0]", "E106", "'a.bob' has 3 axes, not 2"),
        ("to: a.bob, impulse: 1mNs, along: [0, 0, 0]", "E105", "it has no direction"),
        ("to: a.bob, mass: 1g, speed: 1m/s, along: [1, 0, 0]", "E111", "have an `impulse` alone"),
        ("to: a.bob.x, impulse: 1mNs, along: [1, 0, 0]", "E304", "write the point: a.bob"),
        (
            "to: drum.body.2, impulse: 1mNs, along: [1, 0, 0]",
            "E304",
            "moves along one axis, not in space",
        ),
        ("to: a.skin.2, impulse: 1mNs, along: [1, 0, 0]", "E304", "moves along one axis"),
        ("to: a.net, impulse: 1mNs, along: [1, 0, 0]", "E304", "write some of them"),
    ],
)
def test_strike_along_mistakes_codes(strikes, code, said):
    reports = check_reports(SCENE.format("bob", f"at: 0, {strikes}"))
    assert any(code == own and said in message for own, _, message in reports), reports
