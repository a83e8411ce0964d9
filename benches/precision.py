"""Meshes in single precision, which the engine does not have: the possible gain, and the cost in
accuracy.

It also compares a mesh with the limit set by memory: bytes and operations of a link, and a
bandwidth measured beside it.
"""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import DTypeLike, NDArray

from benches import sides
from benches.measure import Row
from benches.native import Loops, RustMesh
from benches.planned import planned
from benches.wiring import RATE, Floats, Ints, bent, neighbours, runs, spring
from ergon import _core

_M, _Q = 0.3, 4e8
# Rings of a hex gong, hardening [N/m³]: sizes of instruments, of the largest scenes, and larger.
_SIZES = ((9, _Q), (28, _Q), (58, _Q), (58, 0.0), (183, _Q))
_ROUNDS = 11
_LINK_FRAMES = 2e7  # a round of one side
_PROBED = 50
_SAME = 1e-8
_LONGEST = 58  # rings up to which a second is played for the error
_STREAMED = 10_000  # masses from which the arrays are larger than the nearest cache
# Bytes per mass that a frame moves to and from memory if the state exceeds the cache: forces
# cleared; x, d and force (read, written) by each of two passes over the links; force, w, κ, ζ,
# rest, and x and d (read, written) by the masses.
_BYTES = 8 + 2 * 32 + 72
_FLOPS_LINK, _FLOPS_HARDENING, _FLOPS_MASS = 8, 4, 8

Go = Callable[[int], tuple[float, Floats]]


@dataclass(frozen=True, slots=True)
class Mesh:
    """A wired gong, and the initial state of all sides."""

    wiring: tuple[Ints, Ints, Ints]
    law: tuple[float, float, float]  # k [N/m], q [N/m³], z [N a step]
    w: Floats
    x: Floats
    d: Floats
    taps: Ints

    @property
    def n_links(self) -> int:
        """How many links."""
        return int(self.wiring[2].sum())


def precision(loops: Loops | None) -> list[Row]:
    """A row for each size, and one for each size with the limit set by memory."""
    scene = "a mesh in single precision"
    if loops is None or shutil.which("rustc") is None:
        sense = "speed over the reference's"
        return [Row(scene, "–", "no compiler (`cc`, `rustc`) here", None, sense)]
    rust = {"f64": RustMesh(is_single=False), "f32": RustMesh(is_single=True)}
    return [row for size in _SIZES for row in _size(loops, rust, *size)]


def _size(loops: Loops, rust: Mapping[str, RustMesh], rings: int, q: float) -> list[Row]:
    mesh, engine = _mesh(rings, q)
    everyone: dict[str, Go] = {"ergon": engine}
    for name, dtype in (("f64", np.float64), ("f32", np.float32)):
        everyone[f"Rust {name}"] = _rust(rust[name], mesh, dtype)
        everyone[f"C {name}"] = _c(loops, "runs_f32" if name == "f32" else "runs", mesh, dtype)
    listened = everyone["ergon"](_PROBED)[1]
    for name in ("Rust f64", "C f64"):
        differs = np.abs(everyone[name](_PROBED)[1] - listened).max() / np.abs(listened).max()
        assert differs < _SAME, f"{name} differs by {differs:.1e}"
    n_frames = max(20, int(_LINK_FRAMES / mesh.n_links))
    n = len(mesh.x)
    copied = np.ones((3, 7 * n // 3))  # as large as what the engine goes over
    best = dict.fromkeys([*everyone, "copy"], np.inf)
    for _ in range(_ROUNDS):
        for name, go in everyone.items():
            best[name] = min(best[name], go(n_frames)[0] / (n_frames * mesh.n_links))
        best["copy"] = min(best["copy"], _copy(copied, n_frames))
    ns = {name: 1e9 * taken for name, taken in best.items() if name != "copy"}
    error = ""
    if rings <= _LONGEST:
        second = int(RATE)
        truth, single = (everyone[name](second)[1] for name in ("Rust f64", "Rust f32"))
        error = f", {sides.error(single, truth):.0f} dB after 1 s"
    kind = "hardening" if q else "linear"
    scene = f"mesh of {n:,} masses, {kind}"
    text = f"the engine's loops in f32: {ns['Rust f32']:.2f} ns a link and frame{error}"
    beside = ", ".join(f"{name} {ns[name]:.2f}" for name in ("ergon", "C f64", "C f32"))
    gain = ns["Rust f64"] / ns["Rust f32"]
    values: dict[str, float | int | str] = {"masses": n} | {f"{a}, ns": b for a, b in ns.items()}
    said64 = f"in f64: {ns['Rust f64']:.2f} ({beside})"
    row = Row(scene, text, said64, gain, "speed over f64's", values)
    return [row] if n < _STREAMED else [row, _roofline(scene, mesh, ns["ergon"], best["copy"])]


def _roofline(scene: str, mesh: Mesh, ours: float, speed: float) -> Row:
    """The engine's time [ns] compared with the limit at a memory bandwidth of `speed` [byte/s]."""
    masses = len(mesh.x) / mesh.n_links
    moved, flops = _BYTES * masses, _FLOPS_LINK + _FLOPS_MASS * masses
    flops += _FLOPS_HARDENING * (mesh.law[1] != 0.0)
    least, rate = 1e9 * moved / speed, speed * 1e-9
    return Row(
        scene,
        f"{ours:.2f} ns a link and frame: {flops / ours:.1f} GFLOP/s",
        f"{moved:.0f} bytes and {flops:.0f} flops a link, at {rate:.0f} GB/s: {least:.2f} ns",
        least / ours,
        "of the speed that memory allows",
        {"bytes": moved, "flops": flops, "GB/s": rate},
    )


def _copy(room: Floats, n_frames: int) -> float:
    """Bytes a second of a sum of two arrays into a third, done once per frame."""
    first, second, into = room
    start = time.thread_time()
    for _ in range(n_frames):
        np.add(first, second, out=into)
    return n_frames * room.nbytes / (time.thread_time() - start)


def _mesh(rings: int, q: float) -> tuple[Mesh, Go]:
    """A larger gong is lower and decays more slowly, so that at every size the links are of the
    same kind.
    """
    harden = {"hardening": q} if q else {}

    def plate(network: _core.Network) -> int:
        f, t60 = 3_800.0 / rings, 4e-3 * rings**2
        return network.plate("", shape="hex", radius=rings, M=_M, f=f, t60=t60, **harden)

    network, n_free = bent(plate, 1e-5, 1e-2)
    n = network.n_mat
    links = neighbours(np.array([network.position_of(i) for i in range(n)]), n_free)
    k, z = spring(plate, links, q)
    taps = np.array([n_free // 4, n_free // 2], dtype=np.int32)
    for tap in taps:
        network.listen(f"tap{tap}", positions=[(int(tap), 1, 1.0)])
    timeline = _core.Timeline(network, RATE)
    plain = _core.Simulation(network, timeline)
    w = np.where(np.arange(n) < n_free, 1.0 / (RATE * RATE * _M / n_free), 0.0)
    x, d = plain.positions(), plain.velocities() / RATE
    simulation = planned(network, timeline, method="ca")
    begun = simulation.snapshot()

    def engine(n_frames: int) -> tuple[float, Floats]:
        simulation.restore(begun)
        out = np.empty((n_frames, len(taps)))
        start = time.thread_time()
        simulation.process(out)
        return time.thread_time() - start, out

    return Mesh(runs(links), (k, q, z), w, x, d, taps), engine


def _rust(loops: RustMesh, mesh: Mesh, dtype: DTypeLike) -> Go:
    k, q, z = mesh.law
    law = np.array([k, q, z, 0.0], dtype)
    numbers = np.concatenate([mesh.w, np.zeros(3 * len(mesh.w))]).astype(dtype)
    return _timed(
        mesh,
        dtype,
        lambda n_frames, x, d, force, room, out: loops.call(
            n_frames, len(x), len(mesh.wiring[0]), *mesh.wiring, law, numbers, x, d, force, room,
            len(mesh.taps), mesh.taps, out,
        ),
    )  # fmt: skip


def _c(loops: Loops, how: str, mesh: Mesh, dtype: DTypeLike) -> Go:
    is_single = np.dtype(dtype) == np.float32
    law = [np.float32(value) if is_single else value for value in mesh.law]
    w = mesh.w.astype(dtype)
    return _timed(
        mesh,
        dtype,
        lambda n_frames, x, d, force, room, out: loops.call(
            how, n_frames, len(x), len(mesh.wiring[0]), *mesh.wiring, *law, w, x, d, force, room,
            len(mesh.taps), mesh.taps, out,
        ),
    )  # fmt: skip


def _timed(mesh: Mesh, dtype: DTypeLike, call: Callable[..., None]) -> Go:
    """A run from the start each time: CPU seconds, and the outputs (n_frames, n_taps)."""

    def go(n_frames: int) -> tuple[float, Floats]:
        arrays: list[NDArray[np.floating]] = [mesh.x.astype(dtype), mesh.d.astype(dtype)]
        arrays += [np.empty(len(mesh.x), dtype), np.empty(int(mesh.wiring[2].max()), dtype)]
        arrays.append(np.empty((n_frames, len(mesh.taps)), dtype))
        start = time.thread_time()
        call(n_frames, *arrays)
        return time.thread_time() - start, arrays[-1].astype(np.float64)

    return go
