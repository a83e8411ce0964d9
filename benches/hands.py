"""A hand on a key: one ergon for every sample."""

from __future__ import annotations

import numpy as np

from benches.measure import Row, interleaved
from ergon import _core

RATE = 44100.0
ROUNDS = 9


def gesture() -> list[Row]:
    """A dense gesture on a key with a bell, open and tracked, over the length of the sound."""
    runs = {touch: _scene(touch) for touch in ("open", "tracked")}
    n_frames = int(2.0 * RATE)
    block = np.empty((n_frames, 1))
    seconds = interleaved(
        ROUNDS, {touch: (lambda sim=sim: sim.process(block)) for touch, sim in runs.items()}
    )
    rows = []
    for touch, taken in seconds.items():
        assert runs[touch].reports()[0].n_ergons > 0.9 * runs[touch].frame
        speed = n_frames / RATE / taken
        rows.append(
            Row(
                f"dense gesture on a key with a bell, {touch}",
                f"{1e9 * taken / n_frames:.0f} ns a frame",
                "real time: 22,676 ns",
                speed,
                "× real time",
                {"x_real_time": speed, "rate_hz": RATE},
            )
        )
    return rows


def _scene(touch: str) -> _core.Simulation:
    network = _core.Network()
    network.part("k1")
    key = network.cel("", M=0.4, K=60.0, Z=1.2)
    network.part("bell")
    bell = network.cel("m", M=2e-3, f=220.0, t60=2.5)
    network.but("b", key, bell, K=900.0, Z=0.1, gap=1e-3)
    network.listen("m", positions=[(bell, 1, 1.0)])
    timeline = _core.Timeline(network, RATE)
    hand = timeline.key("k1", key)
    # Long enough for all rounds: a point every 60 ms, so that the bell is struck repeatedly.
    t = [0.05 + 0.06 * i for i in range(int(2.0 * (ROUNDS + 2) / 0.06))]
    x = [6e-3 * (i % 2) for i in range(len(t))]
    timeline.gesture(hand, t, x, ["smooth"] * len(t), touch=touch)  # type: ignore[arg-type]
    return _core.Simulation(network, timeline)
