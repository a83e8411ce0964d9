"""Contacts that stick, and boxes: beside DOP853 and closed forms; mistakes."""

import numpy as np
import pytest
from checked import check, check_reports
from oracle import matter

from ergon.scores.staging.refusals import StageError
from ergon.scores.staging.stage import stage

RATE = 44_100


def staged(text: str, rate: int = RATE):
    lines = f"rates: {{audio: {rate}Hz}}\naccuracy: {{method: ca}}\n"
    return stage(check(lines + text).piece, planned=True)


def rendered(text: str, rate: int = RATE) -> np.ndarray:
    """Outputs of a score, stepped by CA (n_frames, n_out)."""
    built = staged(text, rate)
    sound = np.empty((built.n_frames, built.simulation.n_out))
    built.simulation.process(sound)
    return sound


STIFF, PULL, GAP, REACH = 500.0, 0.3, 0.01, 0.002


def sticking(e: float, viscous: float = 0.0, step: float = 0.0) -> float:
    """Force that pulls together: PULL where they touch, evenly less up to REACH, and the push."""
    if e >= REACH:
        return 0.0
    if e >= 0.0:
        return PULL * (1.0 - e / REACH)
    return PULL + STIFF * e + viscous * step


TWO = """\
ergon: 1
instruments:
  t:
    space: 2
    modules:
      a: {MAS: {M: 4g, X0: [0, 0], V0: [0, 0]}}
      b: {MAS: {M: 6g, X0: [13mm, 2mm], V0: [%s, 0]}}
      c: {BUT: {between: [%s], K: 500N/m, Z: %s, gap: 1cm, cohesion: 300mN, reach: 2mm%s}}
    out: {ax: {SOX: a.x}, ay: {SOX: a.y}, bx: {SOX: b.x}, by: {SOX: b.y}, f: {SOF: c}}
render: {bits: float, tail: 0.1s}
"""


@pytest.mark.parametrize(("viscous", "more"), [(0.0, ""), (0.4, ""), (0.0, ", friction: 0")])
def test_sticking_contact_against_dop853(viscous: float, more: str):
    link = matter.Link(0, 1, 0, 0, GAP, law=lambda e, v: sticking(e, viscous, v))
    x0, v0 = np.array([(0, 0), (0.013, 0.002)]), np.array([(0.0, 0), (-0.2, 0)])
    errors = []
    for rate in (RATE, 4 * RATE):
        ours = rendered(TWO % ("-0.2m/s", "a, b", f"{viscous}Ns/m", more), rate)
        when = np.arange(0, len(ours), rate // 4410) / rate
        exact = matter.solve(x0, v0, np.array([4e-3, 6e-3]), [link], when)
        apart = ours[:: rate // 4410, :4] - exact.reshape(len(when), -1)
        errors.append(np.abs(apart).max())
    far = np.linalg.norm(exact[:, 1] - exact[:, 0], axis=1)
    assert far.min() < GAP < far.max()
    assert far[-1] < GAP + REACH or viscous == 0.0
    assert errors[1] < 1e-4
    assert errors[1] < 0.5 * errors[0]


def test_sticking_contact_parts_above_the_work_of_adhesion():
    """Parting takes PULL·REACH/2 from touching: at that speed and above a ball flies on."""
    reduced = 1.0 / (1 / 4e-3 + 1 / 6e-3)
    # It begins where it rests, PULL/STIFF deep.
    needed = 0.5 * PULL * REACH + 0.5 * PULL**2 / STIFF
    border = float(np.sqrt(2 * needed / reduced))
    position = TWO.replace("[13mm, 2mm]", f"[{1e3 * (GAP - PULL / STIFF)}mm, 0]")
    for share, parts in ((0.99, False), (1.01, True)):
        sound = rendered(position % (f"{share * border}m/s", "a, b", "0Ns/m", ""))
        assert bool(np.any(sound[:, 2] - sound[:, 0] > GAP + REACH)) is parts


HEAP = """\
ergon: 1
seed: 4
instruments:
  sand:
    space: 3
    %s
    modules:
      middle: {SOL: {X0: [0, 0, 2cm]}}
      grains: {GRAINS: {count: 30, M: 15g, from: [-1cm, -1cm, 0], to: [1cm, 1cm, 3cm],
        scatter: 30%%, V0: [0.1m/s, 0, 0]}}
      meet: {BUT: {between: [grains.all, grains.all], K: 1kN/m, gap: 8mm, exponent: %s,
        friction: %s, cohesion: 30mN, reach: 1mm}}
    out: {meet: {SOF: meet}, x: {SOX: grains.all.x}}
render: {bits: float, tail: 0.2s}
"""


@pytest.mark.parametrize(("exponent", "friction"), [(1, 0), (1.5, 0), (1, 0.4)])
def test_sticking_contact_momentum_and_ledger(exponent: float, friction: float):
    built = stage(check(HEAP % ("", exponent, friction)).piece, planned=False, ledger=True)
    sound = np.empty((built.n_frames, built.simulation.n_out))
    built.simulation.process(sound)
    speed = np.diff(sound[:, 1]) * built.rate / 30
    np.testing.assert_allclose(speed, 0.1, 1e-8)
    assert np.abs(sound[:, 0]).max() > 0.01
    energy = built.simulation.energy()
    complete = energy.start + energy.injected + energy.produced - energy.stored - energy.lost
    assert abs(complete) < 1e-9 * max(abs(energy.start), abs(energy.lost), abs(energy.stored))


def test_ball_held_under_a_plane_by_sticking():
    """A ball hangs from a plane that holds it by more than its weight, sunk in by what is left."""
    text = """\
ergon: 1
instruments:
  t:
    space: 3
    gravity: 9.81m/s2
    modules:
      roof: {SOL: {X0: [0, 0, 0]}}
      ball: {MAS: {M: 10g, X0: [0, 0, -5mm]}}
      c: {BUT: {between: [roof, ball], K: 500N/m, Z: 2Ns/m, gap: 5mm, normal: [0, 0, -1],
        cohesion: %s, reach: 1mm, friction: 0.5}}
    out: {z: {SOX: ball.z}, f: {SOF: c}}
render: {bits: float, tail: 1s}
"""
    z, push = rendered(text % "0.2N")[-1]
    weight = 0.01 * 9.81
    assert z == pytest.approx(-0.005 + (0.2 - weight) / 500.0, abs=1e-9)
    assert push == pytest.approx(-weight, rel=1e-6)  # it pulls
    assert rendered(text % "0.09N")[-1, 0] < -1.0


BOX = """\
ergon: 1
seed: 4
instruments:
  b:
    space: %d
    gravity: 9.81m/s2
    modules:
      middle: {MAS: {M: 200g, X0: %s}}
      nail: {SOL: {X0: %s}}
      tie: {REF: {between: [nail, middle], K: 200N/m, Z: 2Ns/m, rest: 0}}
      grains: {GRAINS: {count: 20, M: 20g, from: %s, to: %s, scatter: 30%%}}
      %s
    out: {all: {SOF: %s}, one: {SOF: %s}}
render: {bits: float, tail: 0.5s}
"""
WALL = "{BUT: {between: [middle, grains.all], K: 2kN/m, Z: 0.1Ns/m, gap: 4mm, friction: 0.3, %s}}"


@pytest.mark.parametrize("axes", [2, 3])
def test_box_wall_equals_six_planes(axes: int):
    """One line, and a plane for each wall: the same bytes."""
    zero, low, high = [0] * axes, ["-15mm"] * axes, ["15mm"] * axes
    places = [str(place).replace("'", "") for place in (zero, zero, low, high)]
    widths = ["5cm", "5cm", "6cm"][-axes:]
    box = f"walls: {WALL % ('box: ' + str(widths))}".replace("'", "")
    walls, sides = [], []
    for axis, width in enumerate(widths):
        for sign in (1, -1):
            normal = [sign if other == axis else 0 for other in range(axes)]
            name = f"w{len(walls)}"
            gap = 4 - 5 * int(width[0])
            single = WALL.replace("gap: 4mm", f"gap: {gap}mm")
            walls.append(f"{name}: {single % f'normal: {normal}'}")
            sides.append(name)
    apart = "\n      ".join(walls)
    names = f"[{', '.join(sides)}]", f"[{', '.join(side + '.3' for side in sides)}]"
    first = rendered(BOX % (axes, *places, box, "walls", "walls.3"))
    many = rendered(BOX % (axes, *places, apart, *names))
    assert first.tobytes() == many.tobytes()
    assert np.abs(first[:, 0]).max() > 0.1
    assert np.abs(first[:, 1]).max() > 0.0


HEAD = "ergon: 1\ninstruments:\n  b:\n    space: 3\n    modules:\n"
HEAD += "      bob: {MAS: {M: 1g, X0: [0, 0, 1m]}}\n      nail: {SOL: {X0: [0, 0, 0]}}\n"
HEAD += "      c: {BUT: {between: [nail, bob], K: 1, gap: 1cm, %s}}\n"


@pytest.mark.parametrize(
    ("fields", "code", "said"),
    [
        ("cohesion: 1mN", "E103", "`reach` is missing"),
        ("reach: 1mm", "E103", "`cohesion` is missing"),
        ("cohesion: 1m, reach: 1mm", "E203", "cohesion"),
        ("box: [1m, 1m]", "E106", "must be 3: x, y and z"),
        ("box: [1m, 1m, 2cm]", "E105", "wider than twice the gap"),
        ("box: [1m, 1m, 1m], normal: [0, 0, 1]", "E111", "`box` is written too"),
        ("box: [1m, 1m, 1m], side: inside", "E111", "`box` is written too"),
        ("box: [1m, 1m, 0]", "E202", "box"),
    ],
)
def test_sticking_contact_mistakes(fields: str, code: str, said: str):
    reports = check_reports(HEAD % fields)
    assert any(own == code and said in sentence for own, _, sentence in reports), reports


def test_sticking_too_strong_is_refused_with_module():
    with pytest.raises(StageError, match=r"b\.c: its attraction is stronger than K times the gap"):
        stage(check(HEAD % "cohesion: 11mN, reach: 1mm").piece)
