"""Points that meet in all pairs, and walls: beside DOP853 and closed forms; mistakes."""

import numpy as np
import pytest
from checked import check, check_reports
from oracle import matter
from sweep import few

from ergon.scores.staging.stage import stage

G = 9.81
M = 2e-3  # of one grain


def rendered(text: str, rate: int = 44_100) -> np.ndarray:
    """Outputs of a score, stepped by CA (n_frames, n_out)."""
    lines = f"rates: {{audio: {rate}Hz}}\naccuracy: {{method: ca}}\n"
    built = stage(check(lines + text).piece, planned=True)
    sound = np.empty((built.n_frames, built.simulation.n_out))
    built.simulation.process(sound)
    return sound


def outputs(n: int, axes: int, module: str = "g") -> str:
    points = [f"{module}.{i}.{c}" for i in range(n) for c in "xyz"[:axes]]
    return ", ".join(f"o{i}: {{SOX: {point}}}" for i, point in enumerate(points))


def box(n: int, axes: int, extra: str, out: str, *, tail: str, gravity: float = G) -> str:
    """Grains of 8 mm over a floor, and what else."""
    low, high = ["-15mm", "-15mm", "4mm"][-axes:], ["15mm", "15mm", "4cm"][-axes:]
    corners = f"from: [{', '.join(low)}], to: [{', '.join(high)}]"
    rest = ", ".join("0" * (axes - 1))
    zeros = ", ".join("0" * axes)
    return f"""\
ergon: 1
instruments:
  sand:
    space: {axes}
    gravity: {gravity}m/s2
    modules:
      floor: {{SOL: {{X0: [{zeros}]}}}}
      g: {{GRAINS: {{count: {n}, M: {n * M}kg, {corners}, scatter: 40%}}}}
      ground: {{BUT: {{between: [floor, g.all], K: 300, Z: 0.05, gap: 4mm, normal: [{rest}, 2]}}}}
{extra}
    out: {{{out}}}
render: {{bits: float, tail: {tail}}}
"""


@pytest.mark.parametrize("axes", few([2, 3], [3]))
def test_grains_motion_against_dop853(axes: int):
    """The path of a crowd that meets a floor and a drum; the less, the shorter the steps."""
    n = 7
    extra = """\
      rub: {BUT: {between: [g.all, g.all], K: 2kN/m, gap: 12mm, exponent: 1.5}}
      drum: {BUT: {between: [floor, g.all], K: 5kN/m, gap: 4cm, side: inside, exponent: 1.5}}"""
    text = box(n, axes, extra, outputs(n, axes), tail="60ms").replace("Z: 0.05", "Z: 0")
    errors = []
    for rate in (88_200, 176_400):
        ours = rendered(text, rate).reshape(-1, n, axes)
        when = np.arange(0, len(ours), rate // 4410) / rate
        x0 = np.concatenate([np.zeros((1, axes)), ours[0]])
        # At rest in the beginning, so that the first frame is where the points are.
        mass = np.array([0.0] + [M] * n)
        up = (0.0,) * (axes - 1) + (1.0,)
        links = [matter.Link(0, i, 300.0, 0.0, 4e-3, True, normal=up) for i in range(1, n + 1)] + [
            matter.Link(0, i, 5e3, 0.0, 4e-2, True, 1.5, inside=True) for i in range(1, n + 1)
        ]
        links += [
            matter.Link(a, b, 2e3, 0.0, 12e-3, True, 1.5)
            for b in range(1, n + 1)
            for a in range(1, b)
        ]
        exact = matter.solve(x0, np.zeros_like(x0), mass, links, when, gravity=G)[:, 1:]
        errors.append(np.abs(ours[:: rate // 4410] - exact).max())
        moved = np.abs(exact - exact[0]).max()
    assert moved > 5e-3
    assert errors[1] < 1e-6 * moved
    assert errors[0] > 1.5 * errors[1]  # contacts begin between steps, with a kink


WALLS = """\
      rub: {BUT: {between: [g.all, g.all], K: 1kN/m, Z: 0.2, gap: 8mm}}
      left: {BUT: {between: [floor, g.all], K: 1kN/m, Z: 0.2, gap: -16mm, normal: [1, 0]}}
      right: {BUT: {between: [floor, g.all], K: 1kN/m, Z: 0.2, gap: -16mm, normal: [-1, 0]}}"""


def test_grains_at_rest_total_weight_on_ground():
    """On the floor lies the weight of all, whoever lies on whom, and it stays."""
    n = 14
    extra = WALLS
    text = box(n, 2, extra, "force: {SOF: ground}, g0: {SOX: g.0.y}", tail="12s")
    sound = rendered(text.replace("scatter: 40%", "scatter: 40%, drag: 5mNs/m"))
    still = sound[-44_100:]
    assert np.abs(np.diff(still[:, 1])).max() < 1e-12
    assert np.ptp(still[:, 0]) < 1e-6 * n * M * G
    np.testing.assert_allclose(still[0, 0], n * M * G, rtol=1e-6)


def test_grains_in_one_layer_weight_on_ground():
    n = 6
    extra = "      rub: {BUT: {between: [g.all, g.all], K: 1kN/m, Z: 0.2, gap: 4mm}}"
    text = box(n, 2, extra, "force: {SOF: ground}, one: {SOF: ground.3}", tail="6s")
    sound = rendered(text.replace("15mm, 4cm", "15mm, 4mm").replace("40%", "0%"))
    np.testing.assert_allclose(sound[-1], [n * M * G, M * G], rtol=1e-6)


@pytest.mark.slow
def test_grains_at_rest_stay_at_rest_for_ten_minutes():
    extra = WALLS
    text = box(14, 2, extra, outputs(14, 2), tail="600s")
    text = text.replace("scatter: 40%", "scatter: 40%, drag: 5mNs/m")
    built = stage(check("accuracy: {method: ca}\n" + text).piece, planned=True)
    block = np.empty((44_100, built.simulation.n_out))
    for second in range(600):
        built.simulation.process(block)
        if second == 20:
            position = block[-1].copy()
    assert np.abs(block[-1] - position).max() < 1e-12


@pytest.mark.slow
def test_thousand_grains_stay_in_sphere():
    """In a closed sphere, thrown for ten seconds: all are there, with the energy of their fall."""
    text = """\
ergon: 1
instruments:
  sand:
    space: 3
    modules:
      c: {SOL: {X0: [0, 0, 0]}}
      g: {GRAINS: {count: 1000, M: 1kg, from: [-5cm, -5cm, -5cm], to: [5cm, 5cm, 5cm],
        scatter: 30%, V0: [1m/s, 0.3m/s, -0.5m/s]}}
      rub: {BUT: {between: [g.all, g.all], K: 3kN/m, gap: 9mm, exponent: 1.5}}
      drum: {BUT: {between: [c, g.all], K: 30kN/m, gap: 10cm, side: inside}}
    out: {x: {SOX: g.0.x}}
render: {tail: 10s}
"""
    built = stage(check(text).piece, ledger=True)
    block = np.empty((44_100, 1))
    for _ in range(10):
        built.simulation.process(block)
        x = built.simulation.positions()[3:].reshape(3, 1000)
        assert np.sqrt((x**2).sum(0)).max() < 0.104
    energy = built.simulation.energy()
    assert energy.stored == pytest.approx(energy.start, rel=0.02)


def test_grains_places_by_seed():
    def places(seed: int, scatter: str) -> np.ndarray:
        text = f"seed: {seed}\n" + box(5, 3, "", outputs(5, 3), tail="1ms")
        return rendered(text.replace("40%", scatter))[0]

    assert np.array_equal(places(1, "40%"), places(1, "40%"))
    assert not np.array_equal(places(1, "40%"), places(2, "40%"))
    # Apart by the widest spacing at which five have room: half a side of the box.
    apart = np.diff(np.unique(places(1, "0%")[0::3]))
    np.testing.assert_allclose(apart, apart[0], rtol=1e-12)
    assert np.abs(places(1, "40%") - places(1, "0%")).max() <= 0.2 * apart[0]


HEAD = """\
ergon: 1
instruments:
  s:
    space: 3
    modules:
      a: {GRAINS: {count: 9, M: 1g, from: [0, 0, 0], to: [1cm, 1cm, 1cm]}}
      o: {SOL: {X0: [0, 0, 0]}}
      c: {BUT: {between: [%s], K: 1, gap: 1mm%s}}
"""


@pytest.mark.parametrize(
    ("ends", "more", "code", "said"),
    [
        ("a.all, o", ", side: inside", "E304", "'a.all' has 9 points; the first end is the wall"),
        ("a.all, a.all", ", side: inside", "E304", "both ends are a.all"),
        ("a.0..5, a.3..8", "", "E304", "'a.0..5' and 'a.3..8' have points in common"),
        ("a.3, a.3", "", "E304", "both ends are a.3"),
        ("o, a.all", ", normal: [0, 0, 0]", "E105", "a normal of length 0 has no direction"),
        ("o, a.all", ", normal: [0, 1]", "E106", "must be 3: x, y and z"),
        ("o, a.all", ", normal: [0, 0, 1], side: inside", "E111", "turn its normal round"),
        ("a.all, a.all", ", side: above", "E206", "not one of outside, inside"),
    ],
)
def test_pairwise_contact_mistakes(ends: str, more: str, code: str, said: str):
    reports = check_reports(HEAD % (ends, more))
    assert any(own.startswith(code) and said in sentence for own, _, sentence in reports), reports


def test_pairwise_gap_below_zero_only_for_planes():
    beside = HEAD.replace("gap: 1mm", "gap: -1mm")
    reports = check_reports(beside % ("o, a.all", ""))
    assert any("it must not be negative" in sentence for *_, sentence in reports)
    text = beside % ("o, a.all", ", normal: [0, 0, 1]") + "render: {tail: 1s}\n"
    module = check(text).piece.instruments["s"].modules[2]
    assert module.fields["gap"] == -1e-3


SLOPE = """\
ergon: 1
instruments:
  hill:
    space: 2
    gravity: 9.81m/s2
    modules:
      slope: {SOL: {X0: [0, 0]}}
      stone: {MAS: {M: 5g, X0: [-1.477mm, 3.692mm]}}
      lies:
        BUT:
          {between: [slope, stone], K: 2kN/m, Z: 6, gap: 4mm, normal: [-0.4, 1], friction: %s}
    out: {x: {SOX: stone.x}}
render: {bits: float, tail: 1s}
"""


def test_friction_on_slope_holds_or_slides():
    """Up to the slope's tangent the stone slides, as Coulomb has it; beyond it stays."""
    held = rendered(SLOPE % 0.5)[:, 0]
    # The weight along the slope on the spring of friction.
    yielded = 5e-3 * G * 0.4 / np.hypot(1.0, 0.4) / 2e3
    assert held[-1] - held[0] == pytest.approx(-yielded / np.hypot(1.0, 0.4), rel=0.1)
    assert np.ptp(held[22_050:]) < 1e-12
    sliding = rendered(SLOPE % 0.3)[:, 0]
    # g·(tan − μ)·cos along the slope, of which cos lies along the first axis.
    downhill = G * (0.4 - 0.3) / (1.0 + 0.4**2)
    seconds = len(sliding) / 44_100
    assert sliding[0] - sliding[-1] == pytest.approx(0.5 * downhill * seconds**2, rel=0.01)


def test_sand_heap_with_and_without_friction():
    """With friction a heap stays; without it the grains run apart on the floor."""
    text = """\
ergon: 1
seed: 2
instruments:
  sand:
    space: 2
    gravity: 9.81m/s2
    modules:
      table: {{SOL: {{X0: [0, 0]}}}}
      g: {{GRAINS: {{count: 12, M: 12g, from: [-12mm, 4mm], to: [12mm, 6cm], scatter: 20%}}}}
      rub: {{BUT: {{between: [g.all, g.all], K: 2kN/m, Z: 0.3, gap: 8mm, friction: {0}}}}}
      ground:
        BUT: {{between: [table, g.all], K: 2kN/m, Z: 0.3, gap: 4mm, normal: [0, 1], friction: {0}}}
    out: {{{1}}}
render: {{bits: float, tail: 1s}}
"""
    ends = []
    for friction in (0.0, 0.6):
        paths = rendered(text.format(friction, outputs(12, 2))).reshape(-1, 12, 2)
        assert np.ptp(paths[-2_205:], axis=0).max() < (1e-6 if friction else np.inf)
        ends.append(np.ptp(paths[-1, :, 0]))
    assert ends[1] < 0.5 * ends[0]
