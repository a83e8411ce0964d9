"""Contacts of order 2, which a plan by ear may choose where nobody hears the difference."""

import json
from functools import cache

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from ergon import _core
from ergon.exchange import plan_file
from ergon.scores.reading.load import load
from ergon.scores.staging.preparing import PreparedPiece, prepare

RATE = 44_100.0
N_FRAMES = round(0.5 * RATE)
WEIGHT, MASS = 29.4e-3, 3e-3  # [N], [kg]
STIFFNESS, LOSS = 2e6, 0.16  # [N/m^1.5], [Ns/m]
TAPPED_AT, IMPULSE = 0.25, 1e-6  # [s], [Ns]
# A ball of 3 g rests on a floor by Hertz's law, and is tapped.
SCORE = f"""
ergon: 1
instruments:
  ball:
    modules:
      drop: {{MAS: {{M: {MASS}kg, X0: 0m}}}}
      floor: {{SOL: {{}}}}
      weight: {{ENF: {{to: drop, from: -{WEIGHT}N}}}}
      rest: {{BUT: {{between: [floor, drop], K: {STIFFNESS}, exponent: 1.5, Z: {LOSS}Ns/m}}}}
    out: {{SOX: drop}}
strikes: {{tap: {{to: ball.drop, at: {TAPPED_AT}s, impulse: {IMPULSE}Ns, lasts: 0s}}}}
mix: {{channels: 1, route: [{{from: ball, to: 1}}]}}
render: {{tail: 0.3s}}
"""
# By ear plain CA does not do for this stroke.
PAN = """
ergon: 1
instruments: {pan: {from: found/pan, transpose: 9st}}
strikes: {stroke: {to: pan.hammer, at: 0.1s, impulse: 30mNs}}
mix: {channels: 1, route: [{from: pan, to: 1}]}
render: {tail: 1s}
"""


def _pins(order: int) -> list[_core.IslandChoice]:
    ready = _built()
    plan = _core.Plan(ready.network, ready.timeline, error_db=-80.0)
    return [own._replace(contact_order=order, counted_cost=None) for own in plan.choices()]


def _built(text: str = SCORE) -> PreparedPiece:
    piece = load("scene.yaml", text=text).piece
    assert piece is not None
    return prepare(piece)


def _played(order: int) -> tuple[np.ndarray, float]:
    """Positions [m], and the work of contacts [s]."""
    ready = _built()
    plan = _core.Plan(ready.network, ready.timeline, cents=3.0, pins=_pins(order))
    simulation = _core.Simulation(ready.network, ready.timeline, plan=plan)
    sound = np.empty((N_FRAMES, 1))
    simulation.process(sound)
    return sound[:, 0], simulation.counted_work()


@cache
def _exact() -> np.ndarray:
    """M·a = -W + K·g^1.5 + Z·g' at a depth g > 0, by DOP853."""

    def slope(_: float, state: np.ndarray) -> list[float]:
        x, v = state
        push = STIFFNESS * (-x) ** 1.5 - LOSS * v if x < 0.0 else 0.0
        return [v, (push - WEIGHT) / MASS]

    frames = np.arange(N_FRAMES) / RATE
    options = {"method": "DOP853", "rtol": 1e-11, "atol": 1e-18, "max_step": 1e-4}
    before = np.append(frames[frames < TAPPED_AT], TAPPED_AT)
    first = solve_ivp(slope, (0.0, TAPPED_AT), [0.0, 0.0], t_eval=before, **options)
    middle = first.y[:, -1].copy()
    middle[1] += IMPULSE / MASS
    after = frames[frames >= TAPPED_AT]
    second = solve_ivp(slope, (TAPPED_AT, frames[-1]), middle, t_eval=after, **options)
    return np.concatenate([first.y[0, :-1], second.y[0]])


@pytest.mark.parametrize(("order", "error_max"), [(2, -45.0), (4, -90.0)])
def test_contact_at_rest_by_order_beside_dop853(order: int, error_max: float):
    sound, _ = _played(order)
    exact = _exact()
    error = np.linalg.norm(sound - exact) / np.linalg.norm(exact - exact.mean())
    assert 20.0 * np.log10(error) < error_max


def test_contact_of_order_2_takes_a_fifth_of_the_work():
    work = {order: _played(order)[1] for order in (2, 4)}
    assert 0.0 < work[2] < 0.2 * work[4]


def test_plan_by_ear_takes_order_2_for_slow_contacts():
    ready = _built(PAN)
    (choice,) = _core.Plan(ready.network, ready.timeline, cents=3.0).choices()
    (exact_choice,) = _core.Plan(ready.network, ready.timeline, error_db=-60.0).choices()
    assert (choice.contact_substeps, choice.contact_order) == (2, 2)
    assert exact_choice.contact_order == 4


@pytest.mark.parametrize(("order", "again"), [("", 4), (", 2", 2), (", 4", 4)])
def test_plan_file_with_order_of_contacts(order: str, again: int):
    text = f'{{"ergon_plan": 2, "choices": [[5, 1, 2, [], null{order}]]}}'
    (choice,) = plan_file.parse_choices(json.loads(text))
    assert choice.contact_order == again


def test_plan_with_order_3_is_refused():
    ready = _built()
    pins = [own._replace(contact_order=3) for own in _pins(4)]
    with pytest.raises(_core.EngineError, match="another score"):
        _core.Plan(ready.network, ready.timeline, cents=3.0, pins=pins)
