"""A cloth, a chain and grains in a drum compared with miPhysics, on one thread each: CPU time."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from statistics import median
from typing import Protocol

import numpy as np

from benches import grains, matter, sides
from benches.measure import Row
from benches.peers import Missing
from benches.peers.mi_physics import Program
from benches.planned import planned
from benches.sides import Floats
from ergon import _core

ROUNDS = 3
RATE = 44_100.0
_PROBED = 150  # frames after which both are in the same places
_LINKS, _CHAIN_M, _CHAIN_K, _SPACING, _G = 1_000, 1e-3, 2_000.0, 5e-3, 9.81
# Allowed difference, as a share of the way of a mass: its dampers use the change of distance in a
# step, ours the velocity along the line.
_SAME = 0.02

# Name, network, the lines that a peer plays, and number of modules.
_Scene = tuple[str, _core.Network, list[str], int]


def mi_physics(_: object) -> list[Row]:
    """The same masses, springs and contacts at the same steps; both must reach the same places.

    Java compiles hot code in a background thread, for a second or more; the frames before the
    measurement last that long.
    """
    scenes = (
        (cloth(matter.SIDE), 2_000, 500),
        (chain(), 40_000, 10_000),
        (_grains(), 300, 100),
    )
    return beside("miPhysics", Program, scenes, (_PROBED, _SAME))


class _Peer(Protocol):
    """A program that plays scenes, as `peers.mi_physics.Program` does."""

    def scene(
        self, lines: Iterable[str], warm: int, n_frames: int
    ) -> Callable[[], tuple[float, Floats]]: ...


def beside(
    peer: str,
    program: Callable[[], _Peer],
    scenes: Iterable[tuple[_Scene, int, int]],
    probed: tuple[int, float],
) -> list[Row]:
    """Rows of scenes that a peer also plays: the CPU time of frames, after warm-up frames.

    `scenes`: each with the warm-up frames, and the frames. `probed`: the number of frames after
    which places are compared, and the allowed difference as a share of the way of a mass.
    """
    rows = []
    for (name, network, lines, modules), warm, n_frames in scenes:
        timeline = _core.Timeline(network, RATE)
        ours = planned(network, timeline, method="ca")
        begun = ours.snapshot()

        def go_on(
            ours: _core.Simulation = ours,
            begun: _core.Snapshot = begun,
            warm: int = warm,
            n_frames: int = n_frames,
        ) -> float:
            ours.restore(begun)
            sides.forward(ours, warm)
            start = time.thread_time()
            sides.forward(ours, n_frames)
            return time.thread_time() - start

        sound = n_frames / RATE
        try:
            playing = program()
            _agree((network, timeline), (peer, playing, lines), probed)
            theirs = playing.scene(lines, warm, n_frames)
            pairs = [(go_on(), theirs()[0]) for _ in range(ROUNDS)]
            taken = {
                "ergon": median(own for own, _ in pairs),
                peer: median(other for _, other in pairs),
            }
            rows += sides.rows(name, "one thread", taken, {}, {}, sound, modules)
        except Missing as missing:
            taken = {"ergon": median(go_on() for _ in range(ROUNDS))}
            missed = {peer: str(missing)}
            rows += sides.rows(name, "one thread", taken, {}, missed, sound, modules)
    return rows


def _agree(
    ours: tuple[_core.Network, _core.Timeline],
    theirs: tuple[str, _Peer, list[str]],
    probed: tuple[int, float],
) -> None:
    """Fails if a peer's masses are elsewhere after some frames; the difference is a share of their
    way.
    """
    (peer, program, lines), (n_frames, limit) = theirs, probed
    plain = _core.Simulation(*ours)
    begun = _points(plain.positions())
    sides.forward(plain, n_frames)
    ended = _points(plain.positions())
    method = np.abs(ended - begun).max()
    _, output = program.scene(lines, 0, n_frames)()
    is_told = np.isfinite(output).all(axis=1)
    assert is_told.any(), "no place is told"
    differs = float(np.abs(ended - output)[is_told].max() / method)
    assert differs < limit, f"{peer} differs by {differs:.1e} of the way"


def _points(coordinates: Floats) -> Floats:
    """(n, 3). Coordinates are stored axis by axis; those of the middle of a drum come first."""
    x = coordinates
    head = x[:3].reshape(-1, 3) if len(x) == 3 * (grains.N + 1) else np.empty((0, 3))
    return np.concatenate([head, x[3 * len(head) :].reshape(3, -1).T])


def _masses(mass: Floats, places: Floats, steps: Floats) -> Iterator[str]:
    for m, position, step in zip(mass, places, steps, strict=True):
        numbers = " ".join(repr(float(x)) for x in (m, *position, *step))
        yield f"mass {numbers}"


def _spring(a: int, b: int, stiff: float, damp: float, rest: float) -> str:
    return f"spring {a} {b} {stiff / RATE**2!r} {damp / RATE!r} {rest!r}"


def _begun(network: _core.Network) -> tuple[Floats, Floats]:
    """Places and last steps at the beginning, (n, 3) each [m]."""
    plain = _core.Simulation(network, _core.Timeline(network, RATE))
    return _points(plain.positions()), _points(plain.velocities()) / RATE


def cloth(side: int) -> _Scene:
    """A net of `side` points along each side, held at two corners."""
    runs, n = matter.runs_of_cloth(side), side**2
    network, _ = matter.cloth(side, runs)
    mass = np.where(np.isin(np.arange(n), (0, side - 1)), 0.0, matter.M)
    lines = [f"gravity {_G / RATE**2!r}", *_masses(mass, *_begun(network))]
    for a, b, count, stiff, rest in runs:
        lines += [_spring(a + i, b + i, stiff, 0.01, rest) for i in range(count)]
    modules = n + sum(run[2] for run in runs)
    return f"cloth in space of {modules:,} modules", network, lines, modules


def chain() -> _Scene:
    """A thousand points in a row, held at both ends."""
    n = _LINKS
    network = _core.Network()
    network.part("chain")
    x = np.concatenate([_SPACING * np.arange(n), np.zeros(2 * n)])
    mass = np.full(n, _CHAIN_M)
    mass[[0, -1]] = 0.0
    first = network.points("m", axes=3, M=list(mass), X0=list(x), V0=[0.0] * (3 * n))
    ends = (range(first + end, first + end + 3 * n, n) for end in (0, 1))
    network.space_ref("link", *ends, count=n - 1, rest=_SPACING, K=_CHAIN_K, Z=0.01)
    network.weigh(first + 2 * n, n, -_G)
    network.listen("tap", positions=[(first + 2 * n + n // 2, 1, 1.0)])
    lines = [f"gravity {_G / RATE**2!r}", *_masses(mass, *_begun(network))]
    lines += [_spring(i, i + 1, _CHAIN_K, 0.01, _SPACING) for i in range(n - 1)]
    modules = 2 * n - 1
    return f"chain in space of {modules:,} modules", network, lines, modules


def _grains() -> _Scene:
    network = grains.settled()
    n = grains.N
    places, steps = _begun(network)
    lines = [f"gravity {_G / RATE**2!r}", f"radius {0.5 * grains.GAP!r}"]
    lines += _masses(np.array([0.0, *[grains.M] * n]), places, steps)
    wall = f"{grains.WALL / RATE**2!r} 0.0 {grains.RADIUS!r}"
    lines += [f"bubble 0 {i + 1} {wall}" for i in range(n)]
    cells = int(2 * (grains.RADIUS + grains.GAP) / grains.GAP) + 6
    lines.append(f"meet {0.5 * grains.GAP!r} {grains.K / RATE**2!r} {grains.Z / RATE!r} {cells}")
    return f"{n:,} grains in a drum", network, lines, n
