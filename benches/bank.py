"""10,000 oscillators, all heard in one output: a scene that every program can compute."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from benches.measure import Row, interleaved
from benches.native import Loops
from benches.peers import Missing, csound, scsynth
from benches.planned import planned
from ergon import _core

RATE = 44100.0
ROUNDS = 5
COUNT = 10_000
_M, _F, _T60 = 1e-3, (20.0, 10_000.0), (0.5, 8.0)
_FRAMES = 11_025
_PROBED = 200
# The sums have another order, and its rounding errors grow over the compared frames.
_SAME = 1e-8
Floats = NDArray[np.float64]


def bank(loops: Loops | None) -> list[Row]:
    """The engine compared with C loops and with programs that have such a bank."""
    simulation, start = _scene()
    runs: dict[str, Callable[[], object]] = {}
    missing: dict[str, str] = {}
    sound = {"ergon": _FRAMES / RATE}
    block = np.empty((_FRAMES, 1))
    runs["ergon"] = lambda: simulation.process(block)
    ours = np.empty((_PROBED, 1))
    simulation.process(ours)
    for name, loop in (("C, AVX-512 by hand", "bank_avx512"), ("C, plain", "bank")):
        if loops is None:
            missing[name] = "no compiler (`cc`) here"
        elif not loops.has(loop):
            missing[name] = "this processor has no AVX-512"
        else:
            run = _loop(loops, loop, *start)
            theirs = run(_PROBED)
            differs = np.abs(theirs - ours).max() / np.abs(ours).max()
            assert differs < _SAME, f"{name} differs by {differs:.1e}"
            runs[name], sound[name] = partial(run, _FRAMES), _FRAMES / RATE
    pairs = list(zip(*_cells(), strict=True))
    peers: dict[str, tuple[Callable[[], Callable[[], float]], float]] = {
        f"SuperCollider Klank, f32, {each} a synth": (
            partial(scsynth.bank, pairs, each),
            scsynth.LONG - scsynth.SHORT,
        )
        for each in (100, 1_000)
    }
    peers["Csound `mode`, f64"] = (partial(csound.bank, pairs), csound.LONG - csound.SHORT)
    for name, (built, length) in peers.items():
        try:
            run_peer = built()
            run_peer()  # a peer may be here and still not work
            runs[name], sound[name] = run_peer, length
        except Missing as why:
            missing[name] = str(why)
    spent = interleaved(ROUNDS, runs)
    speed = {name: sound[name] / taken for name, taken in spent.items()}
    return _rows(speed, missing)


def _rows(speed: dict[str, float], missing: dict[str, str]) -> list[Row]:
    scene, sense = "bank of 10,000 oscillators", "speed over the reference's"
    text = f"{speed['ergon']:.4g} × real time"
    values = {"modules": COUNT} | {f"{name}, × real time": is_ for name, is_ in speed.items()}
    return [
        Row(scene, text, f"{name}: {is_:.4g} × real time", speed["ergon"] / is_, sense, values)
        for name, is_ in speed.items()
        if name != "ergon"
    ] + [Row(scene, text, f"{name}: {why}", None, sense, values) for name, why in missing.items()]


def _cells() -> tuple[list[float], list[float]]:
    """Pitches [Hz] and decays [s], evenly spaced on a logarithmic scale, as the engine's own BANK
    sets them.
    """
    share = np.arange(COUNT) / (COUNT - 1)
    f = _F[0] * (_F[1] / _F[0]) ** share
    t60 = _T60[1] * (_T60[0] / _T60[1]) ** share
    return f.tolist(), t60.tolist()


def _scene() -> tuple[_core.Simulation, tuple[Floats, Floats]]:
    network = _core.Network()
    network.part("sky")
    first = network.bank("", count=COUNT, M=_M, f=_F, t60=_T60)
    for i in range(COUNT):
        network.start(first + i, 1e-6 * (1 + i % 7), 0.0)
    network.listen("all", positions=[(first, COUNT, 1.0)])
    timeline = _core.Timeline(network, RATE)
    plain = _core.Simulation(network, timeline)
    return planned(network, timeline), (plain.positions(), plain.velocities() / RATE)


def _loop(loops: Loops, name: str, x: Floats, d: Floats) -> Callable[[int], Floats]:
    # Poles r·exp(±jθ): the discrete cell has exactly the frequency and decay of the continuous one.
    f, t60 = (np.array(column) for column in _cells())
    theta = 2 * math.pi * f / RATE
    r = np.exp(-math.log(1000.0) / t60 / RATE)
    kappa, zeta = 1.0 + r * r - 2.0 * r * np.cos(theta), 1.0 - r * r
    if name == "bank_avx512":  # full vectors, and what it keeps of d instead of what it loses
        columns = kappa, 1.0 - zeta, x, d
        rest = -COUNT % 64
        kappa, zeta, x, d = (np.concatenate([column, np.zeros(rest)]) for column in columns)
    else:
        x, d = x.copy(), d.copy()

    def run(n_frames: int) -> Floats:
        out = np.empty((n_frames, 1))
        loops.call(name, n_frames, len(x), kappa, zeta, x, d, out)
        return out

    return run
