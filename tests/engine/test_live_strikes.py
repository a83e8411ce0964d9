"""Strikes that nobody knew of beforehand: an impulse now, on a MAT that the timeline names."""

import numpy as np
import pytest

from ergon import _core

RATE = 44_100.0
POINT = 7


def _bell(*, ca: bool = False) -> tuple[_core.Network, int]:
    network = _core.Network()
    network.part("bell", ca_rate=RATE if ca else None)
    m, k, z = (2.0, 0.02, 1e-4) if ca else (2e-3, 4e3, 2e-3)
    a = network.cel("a", M=m, K=k, Z=z)
    b = network.cel("b", M=m, K=2.0 * k, Z=z)
    network.ref("r", a, b, K=0.2 * k, Z=z)
    network.listen("o", positions=[(b, 1, 1.0)])
    return network, a


def _simulation(network, timeline, **options):
    return _core.Simulation(network, timeline, **options)


def _played(simulation, n_frames, strikes=()):
    """Frames, with (frame, impulse) of live strikes."""
    out = []
    position = 0
    for frame, impulse in (*strikes, (n_frames, None)):
        block = np.zeros((frame - position, simulation.n_out))
        simulation.process(block)
        out.append(block)
        position = frame
        if impulse is not None:
            assert simulation.strike(POINT, impulse)
    return np.concatenate(out)


def test_live_strike_equals_written_strike_in_ca_units():
    network, a = _bell(ca=True)
    written = _core.Timeline(network, RATE)
    written.strike(a, 100 / RATE, impulse=2e-3)
    written.strike(a, 300 / RATE, impulse=-1e-3)
    live = _core.Timeline(network, RATE)
    live.strike_point(a, POINT)
    listened = _played(_simulation(network, live), 1000, [(100, 2e-3), (300, -1e-3)])
    assert np.array_equal(listened, _played(_simulation(network, written), 1000))
    assert np.abs(listened).max() > 1e-6


@pytest.mark.parametrize("frame", [49_920, 50_001])
def test_live_strike_on_resting_bell_at_later_frame(frame):
    network, a = _bell()
    timeline = _core.Timeline(network, RATE)
    timeline.strike_point(a, POINT)
    late, early = (_simulation(network, timeline) for _ in range(2))
    listened = _played(late, frame + 900, [(frame, 2e-3)])
    assert np.array_equal(listened[frame:], _played(early, 910, [(10, 2e-3)])[10:])
    assert np.abs(listened[:frame]).max() == 0.0 < np.abs(listened).max()
    # All but a few frames of what it stood still; none of what it sounds.
    assert frame - 500 < late.steps_at_rest() < frame
    assert early.steps_at_rest() == 0


def test_live_strikes_in_one_frame_add_up():
    network, a = _bell()
    timeline = _core.Timeline(network, RATE)
    timeline.strike_point(a, POINT)
    once = _played(_simulation(network, timeline), 600, [(64, 3e-3)])
    twice = _played(_simulation(network, timeline), 600, [(10, 0.0), (64, 1e-3), (64, 2e-3)])
    assert np.allclose(once, twice, rtol=1e-12, atol=0.0)


def test_live_strike_on_unknown_or_fixed_point():
    network, a = _bell()
    timeline = _core.Timeline(network, RATE)
    timeline.strike_point(a, POINT)
    simulation = _simulation(network, timeline)
    assert not simulation.strike(POINT + 1, 1.0)
    with pytest.raises(_core.EngineError, match="finite"):
        simulation.strike(POINT, float("nan"))
    fixed = network.sol("wall")
    with pytest.raises(_core.EngineError, match="fixed"):
        _core.Timeline(network, RATE).strike_point(fixed, POINT)


def test_live_strikes_of_fork_independent():
    network, a = _bell()
    timeline = _core.Timeline(network, RATE)
    timeline.strike_point(a, POINT)
    first = _simulation(network, timeline)
    assert first.strike(POINT, 1e-3)
    fork = first.fork()
    assert np.array_equal(_played(first, 200), _played(fork, 200))
    assert first.strike(POINT, 1e-3)
    assert not np.array_equal(_played(first, 200), _played(fork, 200))


@pytest.mark.parametrize("kind", ["alone", "linked", "string"])
def test_live_strikes_under_session_plan_near_written(kind):
    network = _core.Network()
    network.part("p")
    if kind == "string":
        struck = network.cel("m0", M=1e-3, K=2e3, Z=1e-3)
        last = struck
        for i in range(1, 12):
            new = network.cel(f"m{i}", M=1e-3, K=2e3, Z=1e-3)
            network.ref(f"r{i}", last, new, K=9e3, Z=1e-3)
            last = new
    else:
        last = struck = network.cel("a", M=2e-3, K=4e3, Z=2e-3)
        if kind == "linked":
            last = network.cel("b", M=3e-3, K=9e3, Z=2e-3)
            network.ref("r", struck, last, K=700.0, Z=1e-3)
    network.listen("o", positions=[(last, 1, 1.0)])
    written, live = _core.Timeline(network, RATE), _core.Timeline(network, RATE)
    live.strike_point(struck, POINT)
    strikes = [(100, 2e-3), (1000, -1e-3), (1001, 5e-4)]
    for frame, impulse in strikes:
        written.strike(struck, frame / RATE, impulse=impulse)
    sounds = []
    for timeline, played in ((written, ()), (live, strikes)):
        timeline.open()
        plan = _core.Plan(network, timeline)
        sounds.append(_played(_simulation(network, timeline, plan=plan), 4410, played))
    # A written strike is exact between samples, a live one acts over one frame.
    assert np.abs(sounds[1] - sounds[0]).max() < 0.02 * np.abs(sounds[0]).max()
