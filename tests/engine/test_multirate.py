"""Keys with a rate (E4): held against every frame, against the motion itself, and by their map."""

from itertools import product
from typing import Any

import numpy as np
import pytest
from oracle.planned import error_db
from scipy.linalg import expm
from sweep import few

from ergon import _core

RATE = 44100.0
N = 22050
SHORT = 8000
COUNT = 9
MASSES = (0.08, *[0.05] * (COUNT - 1))
SPRINGS = (200.0, *[300.0] * (COUNT - 1))  # the first to the ground
DAMPERS = (
    0.4,
    0.05,
    0.3,
    0.02,
    0.05,
    0.3,
    0.02,
    0.05,
    0.3,
)  # of no proportion: modes feel each other
UNDAMPED = (0.0, 0.0, 1e-9, *[0.0] * (COUNT - 3))
FEW = ((0.08, 0.05, 0.05), (200.0, 300.0, 300.0))  # masses and springs of a small key
STRING, F, MASS = 40, 220.0, 4e-3
GESTURE = ([0.0, 0.1, 0.2, 0.33], [0.0, 5e-3, -2e-3, 4e-3], ["smooth"] * 4)
KEY, END, TAP = 0, COUNT - 1, 30
STRUCK = 44  # not a frame of any kick


def scene(
    every: int | None,
    *,
    kc: float = 5e3,
    z: tuple[float, ...] = DAMPERS,
    t60: float | None = 2.0,
    ca: bool = False,
    masses: int = STRING,
    gesture: dict[str, Any] | None = None,
    chain: tuple[tuple[float, ...], tuple[float, ...]] = (MASSES, SPRINGS),
) -> tuple[_core.Network, _core.Timeline]:
    """A key of masses in a row, and the string that its last one pulls."""
    single = RATE if ca else None
    m, r = (RATE**2, RATE) if ca else (1.0, 1.0)
    network = _core.Network()
    network.part("key", ca_rate=single, macrostep=every)
    mats = [network.cel("m0", M=chain[0][0] * m, K=chain[1][0], Z=z[0] * r)]
    mats += [network.mas(f"m{i}", M=mass * m) for i, mass in enumerate(chain[0][1:], 1)]
    for i in range(len(mats) - 1):
        network.ref(f"r{i}", mats[i], mats[i + 1], K=chain[1][i + 1], Z=z[i + 1] * r)
    network.part("string", ca_rate=single)
    string = network.string("s", masses=masses, M=MASS * m, f=F, t60=t60)
    network.part("between", ca_rate=single)
    network.ref("c", mats[-1], string + 7, K=kc, Z=0.0)
    for name, mat in (("key", mats[KEY]), ("end", mats[-1]), ("string", string + TAP)):
        network.listen(name, positions=[(mat, 1, 1.0)])
    timeline = _core.Timeline(network, RATE)
    key = timeline.key("key", mats[KEY])
    if gesture is None:
        timeline.strike(mats[KEY], STRUCK / RATE, impulse=0.05)
    else:
        timeline.gesture(key, *GESTURE, **gesture)
    return network, timeline


def play(
    built: tuple[_core.Network, _core.Timeline], n: int = N, plan: bool = True, **budget: Any
) -> np.ndarray:
    network, timeline = built
    planned = _core.Plan(network, timeline, **budget) if plan else None
    out = np.zeros((n, network.n_out))
    _core.Simulation(network, timeline, plan=planned).process(out)
    return out


def slow_row(plan: _core.Plan) -> _core.PlanRow:
    (row,) = [row for row in plan.rows() if row.what == "e4"]
    return row


# --- against every frame --------------------------------------------------------------------------


@pytest.mark.parametrize("gesture", [None, {}], ids=["strike", "gesture"])
def test_slow_key_at_every_frame_equals_plain_network(gesture: dict[str, Any] | None):
    plain = play(scene(None, ca=True, gesture=gesture), plan=False)
    once = play(scene(1, ca=True, gesture=gesture), error_db=-100.0)
    assert error_db(once, plain) < -200.0


@pytest.mark.parametrize(
    ("kc", "gesture", "damped"), few(product([5e2, 5e4], [None, {}], [True, False]), 2)
)
def test_rate_of_key_against_every_frame(kc: float, gesture: dict[str, Any] | None, damped: bool):
    """Down to 1002 Hz, beside the network that is stepped by its numbers."""
    how: dict[str, Any] = {"kc": kc, "ca": True, "gesture": gesture}
    # One damper more than none: else all of it is one bank of modes.
    how |= {} if damped else {"z": (0.0, 0.0, 1e-6, *[0.0] * (COUNT - 3)), "t60": None}
    plain = play(scene(None, **how), SHORT, plan=False)
    for every in (4, 44):
        slow = play(scene(every, **how), SHORT, error_db=-100.0)
        for output in range(3):
            assert error_db(slow[:, [output]], plain[:, [output]]) < -180.0


@pytest.mark.parametrize("seed", few(range(40), [1, 2]))
def test_rate_of_random_key_against_every_frame(seed: int):
    """Keys of 9 to 24 masses at 2205 and 1050 Hz, beside the network stepped by its numbers."""
    chance = np.random.default_rng(seed)
    masses, every = int(chance.integers(9, 25)), int(chance.choice([20, 42]))
    chain = (
        tuple(10.0 ** chance.uniform(-2.0, -1.0, masses)),
        tuple(10.0 ** chance.uniform(1.5, 3.7, masses)),
    )
    how: dict[str, Any] = {"ca": True, "chain": chain, "z": tuple(chance.uniform(0, 1, masses))}
    how |= {"kc": float(10.0 ** chance.uniform(2.0, 4.7)), "gesture": [None, {}][seed % 2]}
    built = scene(every, **how)
    assert slow_row(_core.Plan(*built, error_db=-100.0)).macrostep == every
    slow = play(built, SHORT // 2, error_db=-100.0)
    assert error_db(slow, play(scene(None, **how), SHORT // 2, plan=False)) < -180.0


# --- against the motion itself --------------------------------------------------------------------


def matrices(kc: float, k: float, z: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Masses, K and Z of key and string together, written from the network's drawing."""
    n = COUNT + STRING
    masses = np.r_[MASSES, np.full(STRING, MASS / STRING)]
    K, Z = np.zeros((n, n)), np.zeros((n, n))

    def link(a: int, b: int | None, stiff: float, damp: float) -> None:
        for matrix, value in ((K, stiff), (Z, damp)):
            matrix[a, a] += value
            if b is not None:
                matrix[b, b] += value
                matrix[a, b] -= value
                matrix[b, a] -= value

    link(0, None, SPRINGS[0], DAMPERS[0])
    for i in range(COUNT - 1):
        link(i, i + 1, SPRINGS[i + 1], DAMPERS[i + 1])
    for end in (COUNT, n - 1):
        link(end, None, k, z)
    for i in range(COUNT, n - 1):
        link(i, i + 1, k, z)
    link(END, COUNT + 7, kc, 0.0)
    return masses, K, Z


def string_of(t60: float) -> tuple[float, float]:
    """Stiffness and viscosity of the string's links: its lowest mode sounds at F."""
    sigma = 3.0 * np.log(10.0) / t60
    squared = (2.0 * np.pi * F) ** 2 + sigma**2
    k = MASS / STRING * squared / (4.0 * np.sin(np.pi / 2 / (STRING + 1)) ** 2)
    return k, 2.0 * sigma * k / squared


@pytest.mark.slow
@pytest.mark.parametrize(
    ("every", "limit"), few([(4, -85.0), (10, -85.0), (44, -85.0)], [(44, -85.0)])
)
def test_slow_key_error_against_matrix_exponential(every: int, limit: float):
    masses, K, Z = matrices(5e3, *string_of(2.0))
    n = len(masses)
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-K / masses[:, None], -Z / masses[:, None]]])
    flow, state = expm(A / RATE), np.r_[np.zeros(n), np.eye(n)[0] * 0.05 / masses[0]]
    truth = np.zeros((N, 3))
    for i in range(STRUCK, N):
        truth[i] = state[[KEY, END, COUNT + TAP]]
        state = flow @ state
    out = play(scene(every), error_db=-120.0)
    assert error_db(out, truth) < limit


# --- whether it grows -----------------------------------------------------------------------------


def radius(
    kc: float, chain: tuple[tuple[float, ...], tuple[float, ...]], z: tuple[float, ...]
) -> float:
    """Largest eigenvalue of the map of a frame, by the formulas (undamped string by CA)."""
    m = np.array(chain[0])
    size = len(m)
    K, Z = np.zeros((size, size)), np.zeros((size, size))
    for i in range(size):
        for matrix, value in ((K, chain[1][i]), (Z, z[i])):
            matrix[i, i] += value
            if i:
                matrix[i - 1, i - 1] += value
                matrix[i - 1, i] -= value
                matrix[i, i - 1] -= value
    h, first = 1.0 / RATE, np.eye(size)
    K, Z = h * h * K / m[:, None], h * Z / m[:, None]
    k = MASS / STRING * (2.0 * np.sin(np.pi * F / RATE)) ** 2  # CA sounds it at F
    k /= 4.0 * np.sin(np.pi / 2 / (STRING + 1)) ** 2 * h * h
    laplace = 2.0 * np.eye(STRING) - np.eye(STRING, k=1) - np.eye(STRING, k=-1)
    w, w_end = h * h * STRING / MASS, h * h / m[-1]
    n = 2 * (size + STRING)
    fast = np.zeros((n, n))
    for column in range(n):
        X, V, x, v = np.split(np.eye(n)[column], [size, 2 * size, 2 * size + STRING])
        f = kc * (x[7] - X[-1])
        V = (first - Z) @ V - K @ X
        V[-1] += w_end * f
        force = -k * (laplace @ x)
        force[7] -= f
        v = v + w * force
        fast[:, column] = np.r_[X + V, V, x + v, v]
    return float(abs(np.linalg.eigvals(fast)).max())


def soft(seed: int, every: int, turn: float) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """A random key whose quickest mode turns so far in `every` frames."""
    chance = np.random.default_rng(seed)
    m, k = 10.0 ** chance.uniform(-3.0, -1.0, COUNT), 10.0 ** chance.uniform(0.0, 3.0, COUNT)
    K = np.diag(k + np.r_[k[1:], 0.0]) - np.diag(k[1:], 1) - np.diag(k[1:], -1)
    top = np.linalg.eigvals(K / m[:, None]).real.max()
    k *= (turn * RATE / every) ** 2 / top
    return tuple(m), tuple(k)


@pytest.mark.parametrize("seed", few(range(12), range(2)))
def test_stable_slow_key_has_spectral_radius_of_at_most_one(seed: int):
    chance = np.random.default_rng(1000 + seed)
    every = int(chance.integers(2, 60))
    chain = soft(seed, every, chance.uniform(0.05, 1.0))
    z = tuple(chance.uniform(0.0, 0.05, COUNT)) if seed % 2 else UNDAMPED
    kc = float(10.0 ** chance.uniform(1.0, 3.0))
    by_hand = radius(kc, chain, z)
    plan = _core.Plan(*scene(every, kc=kc, chain=chain, z=z, t60=None, ca=True))
    assert plan.stay() == []
    assert by_hand < 1.0 + 1e-9
    assert slow_row(plan).radius == pytest.approx(by_hand, abs=1e-8)


def test_key_of_quick_modes_keeps_its_rate():
    """Its quickest mode turns by 2.6 rad from tick to tick."""
    how: dict[str, Any] = {"kc": 5e3, "chain": soft(8, 44, 2.6), "z": UNDAMPED, "t60": None}
    how["ca"] = True
    plan = _core.Plan(*scene(44, **how))
    assert plan.stay() == []
    assert slow_row(plan).macrostep == 44
    slow = play(scene(44, **how), SHORT, error_db=-100.0)
    assert error_db(slow, play(scene(None, **how), SHORT, plan=False)) < -180.0


def test_slow_key_stability_tried_on_large_island():
    soft_one = {"z": UNDAMPED, "t60": None, "masses": 150}
    plan = _core.Plan(*scene(10, **soft_one), error_db=-20.0)
    row = slow_row(plan)
    assert row.guarantee == "tried"
    assert row.radius is not None
    assert abs(row.radius - 1.0) < 3e-5


# --- hands ----------------------------------------------------------------------------------------


def lone_key(every: int | None, **more: Any) -> tuple[_core.Network, _core.Timeline, int, int]:
    network = _core.Network()
    network.part("key", macrostep=every)
    struck = network.cel("m", M=0.08, K=200.0, Z=0.4, X0=1e-3, rest=5e-4, **more)
    other = network.mas("n", M=0.03)
    network.ref("r", struck, other, K=150.0, Z=0.2)
    network.listen("key", positions=[(struck, 1, 1.0), (other, 1, 1.0)])
    timeline = _core.Timeline(network, RATE)
    return network, timeline, timeline.key("key", struck), struck


@pytest.mark.parametrize(
    "gesture",
    few(
        [
            {},
            {"grain": 5e-3},
            {"ergons": "particle"},
            {"join": 0.0},
        ],
        2,
    ),
    ids=["dense", "grains", "particles", "no joining curve"],
)
@pytest.mark.parametrize("every", few([10, 44], [44]))
def test_slow_key_meets_written_points(every: int, gesture: dict[str, Any]):
    network, timeline, key, struck = lone_key(every)
    t, x, curves = [0.05, 0.1, 0.2, 0.3037], [2e-3, 5e-3, -2e-3, 1e-3], ["smooth"] * 4
    timeline.gesture(key, t, x, curves, **gesture)
    # Another begins as it falls back, and throws it.
    timeline.gesture(key, [0.4, 0.45, 0.47], [1e-3, 3e-3, 1e-3], ["smooth", "smooth", "throw"])
    plan = _core.Plan(network, timeline)
    assert slow_row(plan).macrostep == every
    simulation = _core.Simulation(network, timeline, plan=plan)
    worst, asked_for = 0.0, 0
    for _ in range(int(0.5 * RATE)):
        asked = simulation.asked()[0]
        if not np.isnan(asked):
            worst = max(worst, abs(simulation.positions()[struck] - asked))
            asked_for += 1
        simulation.process(np.zeros((1, 1)))
    # Particles carry their impulse to 1e-6: over the gesture that is some nanometres.
    assert worst < (1e-6 if "ergons" in gesture else 1e-9)
    assert asked_for > 50
    assert all(report.missed == 0 for report in simulation.reports())


def test_slow_key_layers_add_up():
    network, timeline, key, _ = lone_key(44)
    timeline.gesture(key, [0.05, 0.1, 0.25], [2e-3, 5e-3, 1e-3], ["smooth"] * 3)
    for start in (0.08, 0.1):
        t = [start, start + 0.03, start + 0.0612]
        timeline.gesture(key, t, [0.0, 2e-3, 1e-3], ["smooth"] * 3, layer=True)
    simulation = _core.Simulation(network, timeline, plan=_core.Plan(network, timeline))
    simulation.process(np.zeros((int(0.3 * RATE), 1)))
    report = simulation.reports()[0]
    assert report.compared > 8000
    assert report.worst < 1e-9


def test_slow_key_joins_gesture_without_force_peak():
    def force_peak(every: int | None) -> float:
        network, timeline, key, struck = lone_key(every)
        timeline.strike(struck, 0.01, impulse=0.02)
        timeline.gesture(key, [0.1, 0.2], [2e-3, 3e-3], ["smooth"] * 2, join=0.05)
        plan = _core.Plan(network, timeline)
        out = np.zeros((int(0.2 * RATE), 1))
        simulation = _core.Simulation(network, timeline, plan=plan)
        simulation.process(out)
        assert simulation.reports()[0].first_point_missed is False
        # From pull to pull, for a free key has a corner at each: none more where the hand takes it.
        return float(np.abs(np.diff(out[int(0.03 * RATE) :: 20, 0], 2)).max())

    assert force_peak(20) == pytest.approx(force_peak(None), rel=0.05)


def stays_of(every: int, **gesture: Any) -> str:
    network, timeline = scene(every, gesture=gesture)
    ((part, why),) = _core.Plan(network, timeline).stay()
    assert part == "key"
    return why


def test_slow_key_stays_fast_for_tracked_hand():
    assert "tracked" in stays_of(10, touch="tracked")
    assert "limit" in stays_of(10, force_limit=5.0)
    network, timeline = scene(10)
    assert "method" in _core.Plan(network, timeline, method="ca").stay()[0][1]


def test_slow_part_without_linear_springs_stays_fast():
    network = _core.Network()
    network.part("key", macrostep=10)
    struck = network.mas("m", M=0.1)
    network.part("bell")
    bell = network.cel("b", M=2e-3, f=220.0)
    network.but("hit", struck, bell, K=900.0, gap=1e-3)
    network.listen("bell", positions=[(bell, 1, 1.0)])
    timeline = _core.Timeline(network, RATE)
    timeline.gesture(timeline.key("key", struck), [0.0, 0.1], [0.0, 3e-3], ["smooth"] * 2)
    why = "no mass in it is held by linear springs or by links in space"
    assert _core.Plan(network, timeline).stay() == [("key", why)]


# --- contracts ------------------------------------------------------------------------------------


def test_slow_key_bytes_for_blocks_threads_and_snapshot():
    network, timeline = scene(10, gesture={})
    plan = _core.Plan(network, timeline, cents=3.0)
    pinned = _core.Plan(network, timeline, cents=3.0, pins=plan.choices())
    assert pinned.hash == plan.hash
    assert slow_row(pinned).macrostep == 10
    complete = np.zeros((6000, 3))
    _core.Simulation(network, timeline, plan=plan).process(complete)
    assert complete[:, 2].any()
    for threads, block in ((1, 7), (3, 1000), (2, 4999)):
        simulation = _core.Simulation(network, timeline, plan=pinned, threads=threads)
        out, snapshot = np.zeros_like(complete), None
        for first in range(0, 6000, block):
            simulation.process(out[first : first + block])
            if snapshot is None and first > 2000:
                snapshot, then = simulation.snapshot(), min(6000, first + block)
        assert out.tobytes() == complete.tobytes()
        if snapshot is not None:
            simulation.restore(snapshot)
            again = np.zeros_like(complete[then:])
            simulation.process(again)
            assert again.tobytes() == complete[then:].tobytes()


@pytest.mark.slow
def test_plan_row_of_a_slow_key_states_its_error():
    rows = {R: slow_row(_core.Plan(*scene(R, kc=5e2, gesture={}))) for R in (10, 20, 44)}
    errors = [row.error_db for row in rows.values()]
    assert all(error is not None and error < -200.0 for error in errors)
    assert rows[10].preserved
    assert rows[20].preserved
    assert all(row.n_mat == COUNT and row.radius is not None for row in rows.values())
