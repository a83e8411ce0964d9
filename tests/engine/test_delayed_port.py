"""A key whose motor is late: against its delay equation, its ledger, plans and snapshots."""

import numpy as np
import pytest
from planned_sound import off_db, played, ready

from ergon import _core

RATE, N = 44_100, 8_820
M, K, Z = 0.1, 60.0, 1.2  # the key
STIFFNESS, DAMPING = 200.0, 0.1  # the link between key and bell
BELL, PITCH, T60 = 0.002, 220.0, 2.5
SPEED = 0.3  # of the key at the beginning [m/s]
TEXT = """\
ergon: 1
rates: {{audio: 44100Hz}}
keys: {{k: {{M: 100g, K: 60N/m, Z: 1.2Ns/m, V0: 0.3m/s, delay: {delay}ms}}}}
instruments:
  bell:
    modules:
      m: {{CEL: {{M: 2g, f: 220Hz, t60: 2.5s}}}}
      b: {link}
    out: {{SOX: m}}
render: {{tail: 0.2s, bits: float}}
"""
SPRING = "{REF: {between: [k, m], K: 200N/m, Z: 0.1Ns/m}}"
CONTACT = "{BUT: {between: [k, m], K: 2kN/m, Z: 0.2Ns/m, gap: 0.1mm}}"


def motion(delay: float) -> np.ndarray:
    """Positions of key and bell (N, 2) by Runge and Kutta's method in quarters of a frame.

    A force between two known instants is a line.
    """
    h, parts = 1.0 / (4 * RATE), 4
    sigma = 3.0 * np.log(10.0) / T60
    spring = BELL * ((2 * np.pi * PITCH) ** 2 + sigma**2)
    state, forces, path = np.array([0.0, SPEED, 0.0, 0.0]), [], np.zeros((N, 2))

    def pull(y):
        return STIFFNESS * (y[2] - y[0]) + DAMPING * (y[3] - y[1])

    def late(t):
        step = (t - delay) / h
        if step < 0.0:
            return 0.0
        first = int(step)
        following = forces[min(first + 1, len(forces) - 1)]
        return forces[first] + (step - first) * (following - forces[first])

    def rate(t, y):
        push = pull(y) if delay == 0.0 else late(t)
        key = (push - K * y[0] - Z * y[1]) / M
        bell = (-pull(y) - spring * y[2]) / BELL - 2.0 * sigma * y[3]
        return np.array([y[1], key, y[3], bell])

    for i in range(parts * N):
        if i % parts == 0:
            path[i // parts] = state[0], state[2]
        forces.append(pull(state))
        t = i * h
        a = rate(t, state)
        b = rate(t + h / 2, state + h / 2 * a)
        c = rate(t + h / 2, state + h / 2 * b)
        d = rate(t + h, state + h * c)
        state = state + h / 6 * (a + 2 * b + 2 * c + d)
    return path


def staged(delay: float, link: str = SPRING):
    return ready(TEXT.format(delay=1e3 * delay, link=link))


@pytest.mark.parametrize("delay", [0.002, 0.0033])
def test_key_and_bell_by_the_delay_equation(delay: float):
    done = staged(delay)
    simulation = _core.Simulation(done.built_network.network, done.timeline)
    path, out = np.zeros((N, 2)), np.zeros((1, simulation.n_out))
    mats = done.built_network.assembly.mats
    for i in range(N):
        path[i] = simulation.positions()[[mats["k", ""], mats["bell", "m"]]]
        simulation.process(out)
    exact, undelayed = motion(delay), motion(0.0)
    for point in (0, 1):
        size = np.std(exact[:, point])
        error = np.std(path[:, point] - exact[:, point]) / size
        apart = np.std(undelayed[:, point] - exact[:, point]) / size
        assert error < 2e-3 < 0.05 < apart, (point, error, apart)


@pytest.mark.parametrize("link", [SPRING, CONTACT])
def test_ledger_of_a_delayed_key(link: str):
    done = staged(0.002, link)
    simulation = _core.Simulation(done.built_network.network, done.timeline, ledger=True)
    simulation.process(np.zeros((N, simulation.n_out)))
    energy = simulation.energy()
    balance = energy.start + energy.injected - energy.stored - energy.lost + energy.produced
    assert energy.start > 4e-3
    assert abs(balance) < 1e-9 * energy.start


@pytest.mark.parametrize("link", [SPRING, CONTACT])
def test_plan_of_a_delayed_key(link: str):
    text = TEXT.format(delay=2, link=link)
    finer = text.replace("44100Hz", "176400Hz")
    exact = played(finer, method="ca")[::4][:N]
    assert off_db(played(text, error_db=-60.0)[:N], exact) < -50.0


def test_snapshot_of_a_delayed_key():
    done = staged(0.0033)
    simulation = _core.Simulation(done.built_network.network, done.timeline)
    simulation.process(np.zeros((400, simulation.n_out)))
    snapshot = simulation.snapshot()
    first, again = (np.zeros((800, simulation.n_out)) for _ in range(2))
    simulation.process(first)
    simulation.restore(snapshot)
    simulation.process(again)
    assert np.array_equal(first, again)
    assert np.ptp(first) > 0.0


def test_delay_outside_zero_to_one_is_refused():
    done = staged(0.0)
    network = done.built_network.network
    port = network.sol("port")
    timeline = _core.Timeline(network, RATE)
    with pytest.raises(_core.EngineError, match="a delay must be a finite number from 0 to 1 s"):
        timeline.delay_forces(port, done.built_network.assembly.mats["k", ""], 1.5)


@pytest.mark.parametrize(("stiffness", "is_named"), [(540, False), (660, True)])
def test_swinging_of_delayed_key_warns_w336(stiffness: int, is_named: bool):
    """The delay takes K·delay of the damping: with 2 ms and 1.2 Ns/m, all of it from 600 N/m on."""
    wall = f"{{REF: {{between: [k, m], K: {stiffness}N/m, Z: 0Ns/m}}}}"
    text = TEXT.format(delay=2, link=wall).replace(
        "{CEL: {M: 2g, f: 220Hz, t60: 2.5s}}", "{SOL: {}}"
    )
    done = ready(text)
    named = [own.code for own in done.hands.collector.finish()]
    assert ("W336" in named) is is_named
    simulation = _core.Simulation(done.built_network.network, done.timeline)
    out, path = np.zeros((1, simulation.n_out)), np.zeros(2 * RATE)
    for i in range(len(path)):
        path[i] = simulation.positions()[done.built_network.assembly.mats["k", ""]]
        simulation.process(out)
    early, late = np.ptp(path[: RATE // 2]), np.ptp(path[-RATE // 2 :])
    assert bool(late > early) is is_named
