"""Distances of points in space as outputs: beside the points' coordinates, and mistakes."""

import numpy as np
import pytest
from checked import check, check_reports

from ergon.scores.staging.stage import stage

PAIR = """\
ergon: 1
accuracy: {method: ca}
instruments:
  one:
    space: 3
    modules:
      a: {MAS: {M: 20g, X0: [0, 0, 0], V0: [0, 0.4m/s, 0]}}
    out: {x: {SOX: a.x}, y: {SOX: a.y}, z: {SOX: a.z}}
  two:
    space: 3
    modules:
      b: {MAS: {M: 30g, X0: [10cm, 0, 2cm], V0: [0.1m/s, -0.3m/s, 0.2m/s]}}
      nail: {SOL: {X0: [1cm, 2cm, 3cm]}}
      pin: {SOL: {X0: [1cm, 5cm, 7cm]}}
      s: {RES: {between: [one.a, b], K: 200N/m}}
    out: {x: {SOX: b.x}, y: {SOX: b.y}, z: {SOX: b.z}}
  ears:
    space: 3
    modules: {far: {SOL: {X0: [0, 0, 0]}}}
    out: {far: {SOX: {between: [one.a, two.b]}}, rate: {SOV: {between: [one.a, two.b]}},
      held: {SOX: {between: [two.nail, two.b]}}, still: {SOX: {between: [two.nail, two.pin]}}}
render: {bits: float, tail: 0.2s}
"""


def rendered(text: str, **options) -> np.ndarray:
    """Outputs (n_frames, n_out)."""
    built = stage(check(text).piece, **options)
    sound = np.empty((built.n_frames, built.simulation.n_out))
    built.simulation.process(sound)
    return sound


@pytest.mark.parametrize("planned", [False, True])
def test_distance_output_equals_coordinates(planned: bool):
    sound = rendered(PAIR, planned=planned)
    a, b, (far, rate, held, still) = sound[:, :3], sound[:, 3:6], sound[:, 6:].T
    np.testing.assert_array_max_ulp(far, np.linalg.norm(b - a, axis=1), 2)
    np.testing.assert_array_max_ulp(held, np.linalg.norm(b - (0.01, 0.02, 0.03), axis=1), 2)
    np.testing.assert_allclose(still, 0.05, 1e-15)
    # The rate is that of the distance, 7.5 frames late: by central differences at half a frame.
    exact = np.diff(far) * 44_100
    np.testing.assert_allclose(rate[8 + 20 : -1], exact[20 : len(exact) - 8], 0, 1e-5)
    assert np.ptp(far) > 1e-3


def test_distance_output_changes_no_other_output():
    """A link that does nothing joins what is told of; all else is what it is without it."""
    complete = rendered(PAIR)[:, :6]
    alone = rendered(PAIR[: PAIR.index("  ears:")] + PAIR[PAIR.index("render:") :])
    assert complete.tobytes() == alone.tobytes()


def test_distance_output_of_plate_point():
    """The mass of a body that goes by its modes is where it is heard to be."""
    text = """\
ergon: 1
instruments:
  drum:
    modules: {head: {PLATE: {shape: disc, radius: 3, M: 60g, f: 110Hz, t60: 0.8s, rim: fixed}}}
    out: {SOX: head.12}
  ball:
    space: 3
    modules:
      nail: {SOL: {X0: [0, 0, 5cm]}}
      skin: {SURFACE: {of: drum.head, at: [0, 0], across: 30cm}}
    out: {x: {SOX: skin.12.x}, y: {SOX: skin.12.y}, far: {SOX: {between: [nail, skin.12]}}}
strikes: {hit: {to: drum.head.12, at: 1|1, impulse: 20mNs}}
render: {bits: float, tail: 0.1s}
"""
    for planned in (False, True):
        z, x, y, far = rendered(text, planned=planned).T
        np.testing.assert_allclose(far, np.sqrt(x**2 + y**2 + (0.05 - z) ** 2), 1e-14)
        assert np.ptp(z) > 1e-4


HEAD = "ergon: 1\ninstruments:\n  b:\n    space: 3\n    modules:\n"
HEAD += "      bob: {MAS: {M: 1g, X0: [0, 0, 1m]}}\n      nail: {SOL: {X0: [0, 0, 0]}}\n"
FLAT = "  c:\n    space: 2\n    modules: {m: {MAS: {M: 1g, X0: [0, 0]}}}\n"
CELL = "  d:\n    modules: {m: {CEL: {M: 1g, f: A3}}}\n"


@pytest.mark.parametrize(
    ("out", "code", "said"),
    [
        ("SOX: {between: [bob, bob]}", "E304", "both points are bob"),
        ("SOX: {between: [bob, c.m]}", "E304", "'bob' has 3 axes and 'c.m' 2"),
        ("SOX: {between: [bob, d.m]}", "E304", "'d.m' moves along one axis, not in space"),
        ("SOX: {between: [bob.x, nail]}", "E304", "write the point: bob"),
        ("SOX: {between: [bob]}", "E106", "between"),
        ("SOX: {}", "E103", "between"),
        ("SOF: {between: [bob, nail]}", "E101", "between"),
        ("SOX: {between: [bob, nai]}", "E301", "nothing is called 'nai'"),
    ],
)
def test_distance_output_mistakes(out: str, code: str, said: str):
    reports = check_reports(f"{HEAD}    out: {{{out}}}\n{FLAT}{CELL}")
    assert any(own == code and said in sentence for own, _, sentence in reports), reports


def test_distance_output_routed_to_nearest_is_refused(tmp_path):
    mix = "mix: {channels: 2, route: [{from: b, to: nearest}]}\n"
    reports = check_reports(f"{HEAD}    out: {{SOX: {{between: [bob, nail]}}}}\n{mix}")
    assert any("and b gives a distance" in sentence for _, _, sentence in reports), reports
