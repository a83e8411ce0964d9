"""How long a strike lasts: its force against closed forms, on every way that it is computed."""

import math

import numpy as np
import pytest

from ergon import _core

RATE = 44_100.0
POINT = 7
HARMONICS = ((0.42, 0), (-0.25, 1), (-0.25, -1), (0.04, 2), (0.04, -2))  # of Blackman's window


def response(t, lasts, impulse, m, k, z):
    """Positions of a mass on a spring and a damper [m], t [s] after a force in the shape of
    Blackman's window begins; by integration of exponentials.
    """
    sigma = 0.5 * z / m
    omega = math.sqrt(k / m - sigma * sigma)
    pole = -sigma + 1j * omega
    until = np.clip(t, 0.0, lasts)
    total = np.zeros(len(t), dtype=complex)
    for share, number in HARMONICS:
        rate = 2j * math.pi * number / lasts - pole
        total += share * (np.exp(rate * until) - 1.0) / rate
    total *= impulse / (0.42 * lasts) / (m * omega)
    return np.where(t > 0.0, np.imag(np.exp(pole * np.maximum(t, 0.0)) * total), 0.0)


def played(network, timeline, n_frames, *, is_planned=True):
    plan = _core.Plan(network, timeline) if is_planned else None
    simulation = _core.Simulation(network, timeline, plan=plan)
    out = np.zeros((n_frames, simulation.n_out))
    simulation.process(out)
    return out[:, 0]


def off(x, wanted):
    """Greatest difference over greatest value [dB]."""
    return 20.0 * math.log10(np.abs(x - wanted).max() / np.abs(wanted).max())


@pytest.mark.parametrize("is_planned", [True, False])
@pytest.mark.parametrize(("f", "begin"), [(300.0, 0.01), (2_000.0, 0.0101234), (6_000.0, 0.02002)])
def test_strike_pulse_on_cell_closed_form(f, begin, is_planned):
    m, z = 2e-3, 0.1
    k = m * (2.0 * math.pi * f) ** 2
    network = _core.Network()
    network.part("p")
    cell = network.cel("a", M=m, K=k, Z=z)
    network.listen("o", positions=[(cell, 1, 1.0)])
    timeline = _core.Timeline(network, RATE)
    timeline.strike(cell, begin, impulse=1e-3, lasts=2e-3)
    lasts = round(2e-3 * RATE) / RATE  # whole frames
    t = np.arange(4_000) / RATE - begin
    sound = played(network, timeline, 4_000, is_planned=is_planned)
    after = t > lasts
    wanted = response(t, lasts, 1e-3, m, k, z)
    size = np.abs(wanted).max()
    assert 20.0 * math.log10(np.abs(sound - wanted)[after].max() / size) < -90.0
    # Within the pulse it is a row of impulses a frame apart, by the trapezoidal rule.
    assert off(sound, wanted) < 20.0 * math.log10((2.0 * math.pi * f / RATE) ** 2 / 12.0) + 3.0


def test_strike_pulse_on_coupled_body_closed_form():
    network = _core.Network()
    network.part("p")
    m, k, z = 2e-3, 2e4, 0.02
    a, b = (network.cel(name, M=m, K=k, Z=z) for name in "ab")
    network.ref("r", a, b, K=k, Z=0.0)
    network.listen("o", positions=[(b, 1, 1.0)])
    timeline = _core.Timeline(network, RATE)
    timeline.strike(a, 0.0103, impulse=1e-3, lasts=None)
    t, lasts = np.arange(4_000) / RATE - 0.0103, 8 / RATE
    slow, fast = (response(t, lasts, 0.5e-3, m, stiffness, z) for stiffness in (k, 3.0 * k))
    sound, wanted = played(network, timeline, 4_000), slow - fast
    after = t > lasts
    assert off(sound[after], wanted[after]) < -70.0


@pytest.mark.parametrize("lasts", [None, 0.0, 1e-3])
def test_strike_pulse_on_free_mass_total_impulse(lasts):
    network = _core.Network()
    network.part("p")
    mass = network.mas("m", M=1e-3)
    network.listen("o", positions=[(mass, 1, 1.0)])
    timeline = _core.Timeline(network, RATE)
    timeline.strike(mass, 0.01, impulse=2e-6, lasts=lasts)
    speed = np.diff(played(network, timeline, 1_000)) * RATE
    assert speed[-1] == pytest.approx(2e-3, rel=1e-10)
    assert np.all(np.diff(speed) > -1e-12)
    n_steps = np.count_nonzero((speed > 1e-9) & (speed < 2e-3 * (1.0 - 1e-9)))
    assert n_steps == {None: 6, 0.0: 0, 1e-3: 42}[lasts]


@pytest.mark.parametrize("ca", [True, False])
def test_live_strike_against_a_written_one(ca):
    network = _core.Network()
    network.part("p", ca_rate=RATE if ca else None)
    m, k, z = (2.0, 0.02, 1e-4) if ca else (2e-3, 4e3, 2e-3)
    a, b = (network.cel(name, M=m, K=k, Z=z) for name in "ab")
    network.ref("r", a, b, K=0.2 * k, Z=z)
    network.listen("o", positions=[(b, 1, 1.0)])
    written, live = _core.Timeline(network, RATE), _core.Timeline(network, RATE)
    for frame, impulse in ((100, 2e-3), (130, -1e-3)):  # the second while the first acts
        written.strike(a, frame / RATE, impulse=impulse, lasts=1e-3)
    live.strike_point(a, POINT, lasts=1e-3)
    simulation = _core.Simulation(network, live)
    blocks = []
    for n_frames, impulse in ((100, 2e-3), (30, -1e-3), (870, 0.0)):
        block = np.zeros((n_frames, 1))
        simulation.process(block)
        blocks.append(block)
        assert simulation.strike(POINT, impulse)
    sound = np.concatenate(blocks)[:, 0]
    wanted = played(network, written, 1_000, is_planned=False)
    assert np.abs(sound).max() > 1e-6
    assert np.allclose(sound, wanted, rtol=0.0, atol=1e-13 * np.abs(wanted).max())


def test_strike_pulse_longer_than_50_ms_is_refused():
    network = _core.Network()
    network.part("p")
    mass = network.mas("m", M=1e-3)
    timeline = _core.Timeline(network, RATE)
    with pytest.raises(_core.EngineError, match="0 to 50 ms, not 80 ms"):
        timeline.strike(mass, 0.0, impulse=1.0, lasts=0.08)
