"""Frames without events, and frames with open contacts: the same bytes as ordinary frames."""

import numpy as np
import pytest

from ergon import _core

RATE = 44100.0
N = 16000
MASSES = 9
TOUCHES = (0.01, 0.2)  # the beginnings of two gestures [s]


def scene(link: str, every: int | None, forced: bool) -> tuple[_core.Network, _core.Timeline]:
    """A key that pulls or strikes a string; a force of 0 N makes all of its frames ordinary."""
    network = _core.Network()
    network.part("key", macrostep=every)
    mats = [network.cel("m0", M=0.05, K=60.0, Z=0.4)]
    mats += [network.mas(f"m{i}", M=0.03 + 0.001 * (7 * i % 11)) for i in range(1, MASSES)]
    for i in range(MASSES - 1):
        network.ref(f"r{i}", mats[i], mats[i + 1], K=2000.0 + 100 * (i % 7), Z=0.1 + 0.2 * (i % 5))
    network.part("string")
    string = network.string("s", masses=20, M=6e-3, f=220.0, t60=2.0)
    network.part("between")
    if link == "but":
        network.but("hit", mats[-1], string + 5, K=3e3, gap=1e-3)
    else:
        network.ref("hit", mats[-1], string + 5, K=3e3, Z=0.05)
    for name, mat in (("key", mats[5]), ("string", string + 14)):
        network.listen(name, positions=[(mat, 1, 1.0)])
    timeline = _core.Timeline(network, RATE)
    key = timeline.key("key", mats[0])
    for start in TOUCHES:
        times = [start, start + 0.06, start + 0.14]
        timeline.gesture(key, times, [0.0, 6e-3, 0.0], ["smooth"] * 3)
    if forced:
        timeline.drive(mats[0], "force", constant=0.0)
    return network, timeline


def played(
    link: str, every: int | None, forced: bool, block_sizes: tuple[tuple[int, ...], ...]
) -> tuple[list[str], set[bytes]]:
    """The methods of the rows of the plan, and the different outputs of playing in such blocks."""
    network, timeline = scene(link, every, forced)
    plan = _core.Plan(network, timeline, error_db=-20.0, share=0.1) if every else None
    outputs = set()
    for sizes in block_sizes:
        simulation = _core.Simulation(network, timeline, plan=plan)
        out, done = np.zeros((N, network.n_out)), 0
        while done < N:
            for size in sizes:
                simulation.process(out[done : done + size])
                done += size
        assert np.ptp(out[:, 1]) > 1e-6
        outputs.add(out.tobytes())
    return [row.what for row in plan.rows()] if plan else [], outputs


@pytest.mark.parametrize("link", ["ref", "but"])
@pytest.mark.parametrize("every", [None, 20])
def test_frames_without_events_are_ordinary_frames(link: str, every: int | None):
    how, plain = played(link, every, True, ((N,),))
    assert ("e4" in how) == (every is not None)
    assert played(link, every, False, ((N,), (1, 2, 700, 5))) == (how, plain)
