"""Keys that the planner makes slow by itself: where that pays, and nowhere else."""

from typing import Any

import numpy as np
import pytest
from oracle.planned import error_db
from sweep import few

from ergon import _core

RATE = 44100.0
N = 11025
ASKED_DB = -60.0
FINER = 16
GESTURE = ([0.0, 0.1, 0.2, 0.33], [0.0, 5e-3, -2e-3, 4e-3], ["smooth"] * 4)


def scene(
    masses: int = 24,
    *,
    rate: float = RATE,
    every: int | None = None,
    ca: bool = False,
    gesture: bool = True,
    **how: Any,
) -> tuple[_core.Network, _core.Timeline]:
    """A key of masses in a row, with dampers of no proportion; its last one pulls a string."""
    single, m, r = (rate, rate**2, rate) if ca else (None, 1.0, 1.0)
    network = _core.Network()
    network.part("key", ca_rate=single, macrostep=every)
    mats = [network.cel("m0", M=0.05 * m, K=200.0, Z=0.4 * r)]
    mats += [network.mas(f"m{i}", M=0.05 * m) for i in range(1, masses)]
    for i in range(masses - 1):
        network.ref(f"r{i}", mats[i], mats[i + 1], K=300.0, Z=0.05 * (1 + i % 3) * r)
    network.part("string", ca_rate=single)
    string = network.string("s", masses=40, M=4e-3 * m, f=220.0, t60=2.0)
    network.part("between", ca_rate=single)
    network.ref("c", mats[-1], string + 7, K=5e3, Z=0.0)
    network.listen("string", positions=[(string + 30, 1, 1.0)])
    timeline = _core.Timeline(network, rate)
    key = timeline.key("key", mats[0])
    if gesture:
        timeline.gesture(key, *GESTURE, **how)
    return network, timeline


def rows(plan: _core.Plan) -> dict[str, _core.PlanRow]:
    return {row.parts[0]: row for row in plan.rows()}


def play(
    built: tuple[_core.Network, _core.Timeline], plan: _core.Plan | None, n: int
) -> np.ndarray:
    out = np.zeros((n, built[0].n_out))
    _core.Simulation(*built, plan=plan).process(out)
    return out


@pytest.mark.slow
def test_planner_slows_key_of_many_masses():
    built = scene()
    plan = _core.Plan(*built, error_db=ASKED_DB)
    key = rows(plan)["key"]
    assert (key.what, key.macrostep, key.offered) == ("e4", 10, True)
    assert key.preserved
    assert key.error_db is not None
    assert key.error_db <= -75.0
    assert key.radius is not None
    assert key.radius <= 1.0 + 1e-6
    out = play(built, plan, N)
    truth = play(scene(rate=FINER * RATE), None, FINER * N)[::FINER]
    assert error_db(out, truth) <= ASKED_DB
    # A limit that no force reaches keeps it at every frame: that costs more, and is why.
    on_every = _core.Plan(*scene(force_limit=1e6), error_db=ASKED_DB)
    costs = [sum(row.cost for row in one.rows()) for one in (plan, on_every)]
    assert costs[0] < 0.95 * costs[1]
    # What was decided is decided again, to the same bytes.
    again = _core.Plan(*built, error_db=ASKED_DB, pins=plan.choices())
    assert again.hash == plan.hash
    assert rows(again)["key"].offered
    assert play(built, again, 2000).tobytes() == out[:2000].tobytes()


FULL_RATE_CASES: dict[str, dict[str, Any]] = {
    "one mass": {"masses": 1},
    "four masses": {"masses": 4},
    "units: ca": {"ca": True},
    "tracked": {"touch": "tracked"},
    "force_limit": {"force_limit": 5.0},
}


@pytest.mark.parametrize("name", few(FULL_RATE_CASES, ["one mass", "four masses", "units: ca"]))
def test_planner_offers_no_slow_key_without_benefit(name: str):
    made = scene(**FULL_RATE_CASES[name])
    assert all(row.what != "e4" for row in _core.Plan(*made, error_db=ASKED_DB).rows())


def test_planner_slows_no_key_of_open_timeline():
    network, timeline = scene()
    assert rows(_core.Plan(network, timeline, method="ca"))["key"].what == "stepped"
    timeline.open()
    assert all(row.what != "e4" for row in _core.Plan(network, timeline).rows())


def test_slow_key_by_request_not_marked_offered():
    key = rows(_core.Plan(*scene(every=10), error_db=ASKED_DB))["key"]
    assert (key.what, key.offered) == ("e4", False)
