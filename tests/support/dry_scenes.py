"""Scenes with dry friction, and their exact motion from turn to turn, without any part of ergon.

Between two turns every friction either slides one way or holds. An event ends each interval when
a slide stops or a hold breaks, so no step of the solver crosses a kink.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from scipy.integrate import DOP853

RATE = 44_100.0
_STILL = 1e-13  # [m/s] of a slide that has stopped


@dataclass(frozen=True)
class Dry:
    """Dry friction between masses a and b (-1: the ground), with the numbers of a DRY (SI)."""

    a: int
    b: int
    F: float
    static: float | None = None
    speed: float = 0.001

    def text(self, ends: str) -> str:
        """The friction as a score writes it."""
        fields = f"{ends}, F: {self.F}N"
        if self.static is not None:
            fields += f", static: {self.static}N, speed: {self.speed}m/s"
        return f"{{DRY: {{{fields}}}}}"

    def level(self, v: float) -> float:
        """Level [N] at a velocity."""
        static = self.F if self.static is None else self.static
        return self.F + (static - self.F) * float(np.exp(-((v / self.speed) ** 2)))


@dataclass(frozen=True)
class Scene:
    """A score, and the same scene as equations: masses (M, K, Z to the ground, X0, V0, constant
    force).

    `springs`: (a, b, K, Z); `strikes`: (mass, instant, impulse); `heard`: masses, in the order
    of the outputs.
    """

    name: str
    text: str
    masses: tuple[tuple[float, float, float, float, float, float], ...]
    dry: tuple[Dry, ...]
    taps: tuple[int, ...]
    springs: tuple[tuple[int, int, float, float], ...] = ()
    strikes: tuple[tuple[int, float, float], ...] = field(default=())

    def exact(self, n_frames: int) -> np.ndarray:
        """Positions of the heard masses (n_frames, n_heard) [m]."""
        return _Motion(self).path(n_frames)[:, list(self.taps)]


class _Motion:
    """The motion of a scene; on each mass at most one dry friction that holds can be solved."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.m, self.k, self.z, x0, v0, self.push = np.array(scene.masses).T
        self.n = len(self.m)
        self.state = np.concatenate([x0, v0])
        self.ways: list[int] = []

    def others(self, state: np.ndarray) -> np.ndarray:
        x, v = state[: self.n], state[self.n :]
        force = self.push - self.k * x - self.z * v
        for a, b, k, z in self.scene.springs:
            pull = k * (x[b] - x[a]) + z * (v[b] - v[a])
            force[a] += pull
            force[b] -= pull
        return force

    def rate(self, own: Dry, v: np.ndarray) -> float:
        return (v[own.b] if own.b >= 0 else 0.0) - (v[own.a] if own.a >= 0 else 0.0)

    def weight(self, own: Dry) -> float:
        return sum(1.0 / self.m[end] for end in (own.a, own.b) if end >= 0)

    def needed(self, own: Dry, force: np.ndarray) -> float:
        """The pull that keeps the two ends together [N]."""
        return self.rate(own, force / self.m) / self.weight(own)

    def slopes(self, _: float, state: np.ndarray) -> np.ndarray:
        force = self.others(state)
        for item, method in zip(self.scene.dry, self.ways, strict=True):
            v = self.rate(item, state[self.n :])
            pull = method * item.level(v) if method else self.needed(item, force)
            if item.a >= 0:
                force[item.a] += pull
            if item.b >= 0:
                force[item.b] -= pull
        return np.concatenate([state[self.n :], force / self.m])

    def begin(self) -> None:
        """Set the direction of each friction from here on: that in which it slides, or is
        pushed.
        """
        force = self.others(self.state)
        self.ways = []
        for item in self.scene.dry:
            v = self.rate(item, self.state[self.n :])
            need = self.needed(item, force)
            holds = abs(v) <= _STILL and abs(need) <= item.level(0.0)
            self.ways.append(0 if holds else int(np.sign(v if abs(v) > _STILL else need)))

    def margin(self, which: int, state: np.ndarray) -> float:
        """Positive as long as a friction does not change between sliding and holding."""
        single, method = self.scene.dry[which], self.ways[which]
        if method:
            return method * self.rate(single, state[self.n :])
        return single.level(0.0) - abs(self.needed(single, self.others(state)))

    def path(self, n_frames: int) -> np.ndarray:
        frames = np.arange(n_frames) / RATE
        result = np.empty((n_frames, self.n))
        instants = [0.0, *(at for _, at, _ in self.scene.strikes), frames[-1] + 1e-9]
        for i, (start, end) in enumerate(pairwise(instants)):
            if i:
                struck, _, impulse = self.scene.strikes[i - 1]
                self.state[self.n + struck] += impulse / self.m[struck]
            t = start
            while t < end:
                t = self.stretch(t, end, frames, result)
        return result

    def stretch(self, t: float, end: float, frames: np.ndarray, outcome: np.ndarray) -> float:
        """Continue to the next turn, or to the end; returns that instant."""
        self.begin()
        solver = DOP853(
            self.slopes, t, self.state, end, rtol=1e-12, atol=1e-16, max_step=0.5 / RATE
        )
        began = False
        while solver.status == "running":
            before = solver.t
            solver.step()
            dense = solver.dense_output()
            stop, turned = solver.t, None
            for which in range(len(self.ways)):
                late = self.margin(which, solver.y)
                if late >= 0.0 or (not began and self.margin(which, dense(before)) < -_STILL):
                    continue
                low, high = before, solver.t
                for _ in range(60):
                    middle = 0.5 * (low + high)
                    if self.margin(which, dense(middle)) < 0.0 and middle > t:
                        high = middle
                    else:
                        low = middle
                if high <= stop:
                    stop, turned = high, which
            began = True
            here = (frames >= before - 1e-13) & (frames < stop - 1e-13)
            if here.any():
                outcome[here] = dense(frames[here])[: self.n].T
            if turned is not None:
                self.state = dense(stop)
                single = self.scene.dry[turned]
                if self.ways[turned]:
                    self._stop(single)
                return stop
        self.state = solver.y
        return end

    def _stop(self, friction: Dry) -> None:
        """Remove the remaining rate of both ends after it has passed zero."""
        v = self.state[self.n :]
        impulse = self.rate(friction, v) / self.weight(friction)
        if friction.a >= 0:
            v[friction.a] += impulse / self.m[friction.a]
        if friction.b >= 0:
            v[friction.b] -= impulse / self.m[friction.b]


def _score(modules: dict[str, str], out: dict[str, str], more: str = "") -> str:
    lines = "".join(f"      {name}: {module}\n" for name, module in modules.items())
    outs = ", ".join(f"{name}: {{SOX: {to}}}" for name, to in out.items())
    route = ", ".join(f"{{from: s.{name}, to: [{i + 1}]}}" for i, name in enumerate(out))
    return (
        "ergon: 1\nrates: {audio: 44100Hz}\ninstruments:\n  s:\n    modules:\n"
        f"{lines}    out: {{{outs}}}\n{more}mix: {{channels: {len(out)}, route: [{route}]}}\n"
        "render: {tail: 0.25s, bits: float}\n"
    )


def _block() -> Scene:
    """A displaced mass on a spring that turns several times and comes to rest beside its middle."""
    single = Dry(-1, 0, 0.05)
    text = _score(
        {"m": "{CEL: {M: 0.01kg, K: 300N/m, Z: 0.01Ns/m, X0: 1mm}}", "rub": single.text("to: m")},
        {"o": "m"},
    )
    return Scene("block", text, ((0.01, 300.0, 0.01, 1e-3, 0, 0),), (single,), (0,))


def _stribeck() -> Scene:
    """The same with a level that falls with the speed."""
    single = Dry(-1, 0, 0.05, 0.08, 0.01)
    text = _score(
        {"m": "{CEL: {M: 0.01kg, K: 300N/m, X0: 1mm}}", "rub": single.text("to: m")}, {"o": "m"}
    )
    return Scene("stribeck", text, ((0.01, 300.0, 0, 1e-3, 0, 0),), (single,), (0,))


def _stick_slip() -> Scene:
    """A block on a spring, dragged along by a belt: it holds, breaks loose, and holds again."""
    single = Dry(0, 1, 0.5, 1.0, 0.05)
    text = _score(
        {
            "belt": "{MAS: {M: 1000kg, V0: 0.05m/s}}",
            "m": "{CEL: {M: 0.02kg, K: 2000N/m, Z: 0.05Ns/m}}",
            "rub": single.text("between: [belt, m]"),
        },
        {"o": "m"},
    )
    masses = ((1000.0, 0, 0, 0, 0.05, 0), (0.02, 2000.0, 0.05, 0, 0, 0))
    return Scene("stick-slip", text, masses, (single,), (1,))


def _pair() -> Scene:
    """Two cells that rub on each other, struck."""
    single = Dry(0, 1, 0.3)
    text = _score(
        {
            "m": "{CEL: {M: 0.005kg, K: 500N/m, Z: 0.01Ns/m}}",
            "n": "{CEL: {M: 0.008kg, K: 200N/m, Z: 0.01Ns/m}}",
            "rub": single.text("between: [m, n]"),
        },
        {"o": "m", "p": "n"},
        "strikes: {a: {to: s.m, at: 0.01s, impulse: 0.01Ns}}\n",
    )
    masses = ((0.005, 500.0, 0.01, 0, 0, 0), (0.008, 200.0, 0.01, 0, 0, 0))
    return Scene("pair", text, masses, (single,), (0, 1), (), ((0, 0.01, 0.01),))


def _key() -> Scene:
    """A struck key that rubs on the ground and carries a swinging part."""
    single = Dry(-1, 0, 0.3)
    text = _score(
        {
            "swing": "{MAS: {M: 0.02kg}}",
            "arm": "{REF: {between: [k1, swing], K: 5000N/m, Z: 0.2Ns/m}}",
            "felt": single.text("to: k1"),
        },
        {"o": "k1", "p": "swing"},
        "keys: {k1: {M: 0.2kg, K: 500N/m, Z: 1Ns/m}}\n"
        "strikes: {a: {to: k1, at: 0.01s, impulse: 0.06Ns}}\n",
    )
    masses = ((0.2, 500.0, 1.0, 0, 0, 0), (0.02, 0, 0, 0, 0, 0))
    springs = ((0, 1, 5000.0, 0.2),)
    return Scene("key", text, masses, (single,), (0, 1), springs, ((0, 0.01, 0.06),))


def _held() -> Scene:
    """A constant force below the level: nothing moves at all."""
    single = Dry(-1, 0, 0.5)
    text = _score(
        {
            "m": "{CEL: {M: 0.1kg, K: 100N/m, X0: 1mm}}",
            "f": "{ENF: {to: m, from: 0.3N}}",
            "rub": single.text("to: m"),
        },
        {"o": "m"},
    )
    return Scene("held", text, ((0.1, 100.0, 0, 1e-3, 0, 0.3),), (single,), (0,))


SCENES = {
    scene.name: scene for scene in (_block(), _stribeck(), _stick_slip(), _pair(), _key(), _held())
}
