"""Scenes with friction by bristles, and their exact motion by DOP853, without any part of ergon."""

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from scipy.integrate import DOP853, solve_ivp

RATE = 44_100.0


@dataclass(frozen=True)
class Bristles:
    """Friction between masses a and b (-1: the ground), with the numbers of a BRISTLE (SI)."""

    a: int
    b: int
    sigma0: float
    Fc: float
    sigma1: float = 0.0
    sigma2: float = 0.0
    Fs: float | None = None
    vs: float = 0.001

    def text(self, ends: str) -> str:
        """The friction as a score writes it."""
        fields = f"sigma0: {self.sigma0}N/m, sigma1: {self.sigma1}Ns/m, sigma2: {self.sigma2}Ns/m"
        fields += f", Fc: {self.Fc}N, Fs: {self.Fs or self.Fc}N, vs: {self.vs}m/s"
        return f"{{BRISTLE: {{between: [{ends}], {fields}}}}}"

    def pull(self, z: float, v: float) -> tuple[float, float]:
        """Force [N] at a bend z [m] and a rate of the ends [m/s], and the rate of the bend."""
        static = self.Fc if self.Fs is None else self.Fs
        level = self.Fc + (static - self.Fc) * np.exp(-((v / self.vs) ** 2))
        rate = v - self.sigma0 * abs(v) * z / level
        return self.sigma0 * z + self.sigma1 * rate + self.sigma2 * v, rate


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
    bristles: tuple[Bristles, ...]
    taps: tuple[int, ...]
    springs: tuple[tuple[int, int, float, float], ...] = ()
    strikes: tuple[tuple[int, float, float], ...] = field(default=())

    def exact(self, n_frames: int, tolerance: float = 1e-11) -> np.ndarray:
        """Positions of the heard masses (n_frames, n_heard) [m]."""
        m, k, z, x0, v0, push = np.array(self.masses).T
        n = len(m)

        def slopes(_: float, state: np.ndarray) -> np.ndarray:
            x, v, bends = state[:n], state[n : 2 * n], state[2 * n :]
            force = push - k * x - z * v
            bending = np.empty(len(bends))
            for a, b, stiffness, damping in self.springs:
                pull = stiffness * (x[b] - x[a]) + damping * (v[b] - v[a])
                force[a] += pull
                force[b] -= pull
            for i, item in enumerate(self.bristles):
                va, vb = (v[end] if end >= 0 else 0.0 for end in (item.a, item.b))
                pull, bending[i] = item.pull(bends[i], vb - va)
                if item.a >= 0:
                    force[item.a] += pull
                if item.b >= 0:
                    force[item.b] -= pull
            return np.concatenate([v, force / m, bending])

        frames = np.arange(n_frames) / RATE
        state = np.concatenate([x0, v0, np.zeros(len(self.bristles))])
        instants = [0.0, *(at for _, at, _ in self.strikes), frames[-1] + 1e-9]
        result = np.empty((n_frames, n))
        scale = np.concatenate(
            [np.full(n, 1e-14), np.full(n, 1e-11), np.full(len(self.bristles), 1e-15)]
        )
        for i, (start, end) in enumerate(pairwise(instants)):
            if i:
                struck, _, impulse = self.strikes[i - 1]
                state[n + struck] += impulse / m[struck]
            here = (frames >= start - 1e-12) & (frames < end - 1e-12)
            solved = solve_ivp(
                slopes,
                (start, end),
                state,
                DOP853,
                np.append(frames[here], end),
                rtol=tolerance,
                atol=scale,
                max_step=2.0 / RATE,
            )
            result[here] = solved.y[:n, :-1].T
            state = solved.y[:, -1]
        return result[:, list(self.taps)]


def _score(modules: dict[str, str], out: dict[str, str], more: str = "") -> str:
    lines = "".join(f"      {name}: {module}\n" for name, module in modules.items())
    outs = ", ".join(f"{name}: {{SOX: {to}}}" for name, to in out.items())
    route = ", ".join(f"{{from: s.{name}, to: [{i + 1}]}}" for i, name in enumerate(out))
    return (
        "ergon: 1\nrates: {audio: 44100Hz}\ninstruments:\n  s:\n    modules:\n"
        f"{lines}    out: {{{outs}}}\n{more}mix: {{channels: {len(out)}, route: [{route}]}}\n"
        "render: {tail: 0.25s, bits: float}\n"
    )


def _presliding() -> Scene:
    """A push below the level: the block swings on its bristles and creeps."""
    single = Bristles(-1, 0, 1e5, 1.0, 2.0, 1.0, 1.5, 0.01)
    text = _score(
        {
            "floor": "{SOL: {}}",
            "m": "{MAS: {M: 0.1kg}}",
            "f": "{ENF: {to: m, from: 0.7N}}",
            "rub": single.text("floor, m"),
        },
        {"o": "m"},
    )
    return Scene("presliding", text, ((0.1, 0, 0, 0, 0, 0.7),), (single,), (0,))


def _stick_slip() -> Scene:
    """A block on a spring, dragged along by a belt."""
    single = Bristles(0, 1, 2e4, 0.5, 0.2, 0.2, 1.0, 0.02)
    text = _score(
        {
            "belt": "{MAS: {M: 1000kg, V0: 0.02m/s}}",
            "m": "{CEL: {M: 0.02kg, K: 2000N/m, Z: 0.05Ns/m}}",
            "rub": single.text("belt, m"),
        },
        {"o": "m"},
    )
    masses = ((1000.0, 0, 0, 0, 0.02, 0), (0.02, 2000.0, 0.05, 0, 0, 0))
    return Scene("stick-slip", text, masses, (single,), (1,))


def _bowed() -> Scene:
    """A bow on a string of 12 masses."""
    n, m, k, z = 12, 2.5e-4, 8e3, 2e-3
    single = Bristles(0, 3, 2e4, 0.3, 0.2, 0.5, 0.9, 0.05)
    modules = {"bow": "{MAS: {M: 1000kg, V0: 0.1m/s}}", "a": "{SOL: {}}", "b": "{SOL: {}}"}
    modules |= {f"m{i}": f"{{MAS: {{M: {m}kg}}}}" for i in range(1, n + 1)}
    ends = ["a", *(f"m{i}" for i in range(1, n + 1)), "b"]
    for i, (item, other) in enumerate(pairwise(ends)):
        modules[f"r{i}"] = f"{{REF: {{between: [{item}, {other}], K: {k}N/m, Z: {z}Ns/m}}}}"
    modules["hair"] = single.text("bow, m3")
    masses = [(1000.0, 0.0, 0.0, 0.0, 0.1, 0.0)]
    masses += [
        (m, k if i in (1, n) else 0.0, z if i in (1, n) else 0.0, 0.0, 0.0, 0.0)
        for i in range(1, n + 1)
    ]
    springs = tuple((i, i + 1, k, z) for i in range(1, n))
    text = _score(modules, {"o": "m3", "p": "m9"})
    return Scene("bow", text, tuple(masses), (single,), (3, 9), springs)


def _key() -> Scene:
    """A struck key that rubs on a bell of one mass, and on the ground (Dahl)."""
    rub, forces = Bristles(0, 1, 5e4, 0.8, 1.0, 1.0, 1.2, 0.02), Bristles(-1, 0, 1e4, 0.1)
    text = _score(
        {
            "bell": "{CEL: {M: 0.01kg, K: 4000N/m, Z: 0.05Ns/m}}",
            "g": "{SOL: {}}",
            "rub": rub.text("k1, bell"),
            "felt": forces.text("g, k1"),
        },
        {"o": "bell", "p": "k1"},
        "keys: {k1: {M: 0.2kg, K: 500N/m, Z: 1Ns/m}}\n"
        "strikes: {a: {to: k1, at: 0.01s, impulse: 0.06Ns}}\n",
    )
    masses = ((0.2, 500.0, 1.0, 0, 0, 0), (0.01, 4000.0, 0.05, 0, 0, 0))
    return Scene("key", text, masses, (rub, forces), (1, 0), (), ((0, 0.01, 0.06),))


def _dahl() -> Scene:
    """One mass on a spring with Dahl's friction."""
    single = Bristles(-1, 0, 2e4, 0.2)
    text = _score(
        {
            "floor": "{SOL: {}}",
            "m": "{CEL: {M: 0.01kg, K: 3000N/m, X0: 1mm}}",
            "rub": single.text("floor, m"),
        },
        {"o": "m"},
    )
    return Scene("dahl", text, ((0.01, 3000.0, 0, 1e-3, 0, 0),), (single,), (0,))


def _pair() -> Scene:
    """Two cells that rub on each other, struck, with Stribeck's fall and viscosity."""
    single = Bristles(0, 1, 3e4, 0.3, 0.5, 0.5, 0.5, 0.05)
    text = _score(
        {
            "m": "{CEL: {M: 0.005kg, K: 5000N/m, Z: 0.01Ns/m}}",
            "n": "{CEL: {M: 0.008kg, K: 2000N/m, Z: 0.01Ns/m}}",
            "rub": single.text("m, n"),
        },
        {"o": "m", "p": "n"},
        "strikes: {a: {to: s.m, at: 0.01s, impulse: 0.01Ns}}\n",
    )
    masses = ((0.005, 5000.0, 0.01, 0, 0, 0), (0.008, 2000.0, 0.01, 0, 0, 0))
    return Scene("pair", text, masses, (single,), (0, 1), (), ((0, 0.01, 0.01),))


SCENES = {
    scene.name: scene
    for scene in (_presliding(), _stick_slip(), _bowed(), _key(), _dahl(), _pair())
}
