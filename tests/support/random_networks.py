"""Random networks of one to five masses with contacts and laws, and their energy from positions.

The equations stand here a second time: no part of the engine computes an energy of these tests.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

Floats = NDArray[np.float64]
RATE = 44_100.0
SPAN = 1e-3  # [m] that masses start from where their springs hold them, at most
LOWEST, HIGHEST = 100.0, 6_000.0  # [Hz] of the modes of the springs
WINDOW = 1_024  # frames over which an energy is the median: a closed contact may be shorter
# Weights of a derivative at the middle of nine samples (Fornberg, 1988): an error of 4e-4 at 6 kHz.
_SLOPE = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 0.0, 4 / 5, -1 / 5, 4 / 105, -1 / 280])


@dataclass(frozen=True)
class Link:
    """A link between two masses, or a mass and the ground (-1): what is written, its potential [J]
    over the elongation x_b - x_a [m], and its loss [W] over the elongation and its rate [m/s].
    """

    a: int
    b: int
    written: dict[str, Any]
    potential: Callable[[Floats], Floats]
    loss: Callable[[Floats, Floats], Floats] | None = None


@dataclass
class RandomNetwork:
    """Masses, links and where they start (SI)."""

    mass: list[float] = field(default_factory=list)
    ground: list[tuple[float, float]] = field(default_factory=list)
    x0: list[float] = field(default_factory=list)
    v0: list[float] = field(default_factory=list)
    links: list[Link] = field(default_factory=list)

    def text(self, seconds: float) -> str:
        """The score."""
        modules: dict[str, Any] = {"e": {"SOL": {}}}
        starts = zip(self.mass, self.ground, self.x0, self.v0, strict=True)
        for i, (m, (k, z), x, v) in enumerate(starts):
            tie = {"K": k, "Z": z} if k or z else {}
            kind = "CEL" if tie else "MAS"
            modules[f"m{i}"] = {kind: {"M": f"{m!r}kg", **tie, "X0": f"{x!r}m", "V0": f"{v!r}m/s"}}
        for i, link in enumerate(self.links):
            ((kind, fields),) = link.written.items()
            ends = [f"m{end}" if end >= 0 else "e" for end in (link.a, link.b)]
            modules[f"l{i}"] = {kind: {"between": ends, **fields}}
        n = len(self.mass)
        score = {
            "ergon": 1,
            "rates": {"audio": f"{RATE:g}Hz"},
            "instruments": {
                "s": {"modules": modules, "out": {f"o{i}": {"SOX": f"m{i}"} for i in range(n)}}
            },
            "mix": {
                "channels": n,
                "route": [{"from": f"s.o{i}", "to": [i + 1]} for i in range(n)],
            },
            "render": {"bits": "float", "tail": f"{seconds!r}s"},
        }
        return str(yaml.safe_dump(score, sort_keys=False, width=1_000))

    def stretches(self, x: Floats) -> list[Floats]:
        """The elongation of each link, or its rate, from positions or velocities (n_frames, n)."""
        still = np.zeros(len(x))
        source = [*x.T, still]
        return [source[link.b] - source[link.a] for link in self.links]

    def energy(self, x: Floats, v: Floats) -> Floats:
        """Kinetic and stored energy [J] (n_frames,)."""
        k = np.array([tie[0] for tie in self.ground])
        total = 0.5 * (v**2 @ np.array(self.mass) + x**2 @ k)
        for link, d in zip(self.links, self.stretches(x), strict=True):
            total += link.potential(d)
        return np.asarray(total)

    def power(self, x: Floats, v: Floats) -> Floats:
        """What dampers take [W], where that is a function of the motion (n_frames,)."""
        total = v**2 @ np.array([tie[1] for tie in self.ground])
        both = zip(self.links, self.stretches(x), self.stretches(v), strict=True)
        for link, d, w in both:
            if link.loss is not None:
                total += link.loss(d, w)
        return np.asarray(total)

    @property
    def initial_energy(self) -> float:
        """The energy at the start [J]."""
        return float(self.energy(np.array([self.x0]), np.array([self.v0]))[0])

    def gain(self, x: Floats, rate: float = RATE) -> float:
        """The most energy that is stored or lost, over what was there at the start, from positions
        (n_frames, n): 1 is exact, more is made.
        """
        n_windows = (len(x) - len(_SLOPE) + 1) // WINDOW
        middle = slice(4, 4 + n_windows * WINDOW)
        v = np.stack([np.convolve(one, _SLOPE[::-1], "valid") for one in x.T], axis=1) * rate
        x, v = x[middle], v[: n_windows * WINDOW]
        stored = self.energy(x, v)
        lost = np.cumsum(self.power(x, v)) / rate
        single = (stored + lost).reshape(n_windows, WINDOW)
        return float(np.median(single, axis=1).max() / self.initial_energy)

    def kappa(self, x: Floats, rate: float = RATE) -> float:
        """The highest squared frequency of springs and laws in radians a step, at the steepest
        slopes of laws that the positions (n_frames, n) come to; contacts do not count.
        """
        springs = []
        for link, d in zip(self.links, self.stretches(x), strict=True):
            if "BUT" in link.written:
                continue
            spread = np.linspace(d.min(), d.max(), 401)
            spacing = max(spread[1] - spread[0], 1e-12)
            slopes = np.diff(link.potential(spread), 2) / spacing**2
            springs.append((link.a, link.b, float(max(slopes.max(), 0.0))))
        return _highest(self.mass, [tie[0] for tie in self.ground], springs) / rate**2


def network(seed: int) -> RandomNetwork:
    """The network of a seed."""
    rng = np.random.default_rng([57, seed])
    result = RandomNetwork()
    n = int(rng.integers(1, 6))
    is_damped = bool(rng.integers(0, 2))

    def by_ratio(low: float, high: float) -> float:
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))

    def viscosity(m: float, omega: float) -> float:
        return m * omega * by_ratio(1e-4, 3e-2) if is_damped and rng.integers(0, 2) else 0.0

    for _ in range(n):
        m, omega = by_ratio(3e-5, 1e-2), 2.0 * np.pi * by_ratio(LOWEST, 4_000.0)
        result.mass.append(m)
        is_tied = rng.integers(0, 3) == 0
        result.ground.append((m * omega**2, viscosity(m, omega)) if is_tied else (0.0, 0.0))
        result.x0.append(SPAN * float(rng.uniform(-1.0, 1.0)))
        result.v0.append(float(rng.uniform(-1.0, 1.0)) if rng.integers(0, 2) else 0.0)
    springs = []
    for b in range(n):
        a = int(rng.integers(-1, b)) if b else -1
        if result.ground[b][0] and rng.integers(0, 2):
            continue
        m = result.mass[b] if a < 0 else min(result.mass[a], result.mass[b])
        omega = 2.0 * np.pi * by_ratio(LOWEST, 4_000.0)
        springs.append((a, b, m * omega**2, viscosity(m, omega)))
    least = _soften(result, springs)
    for a, b, k, z in springs:
        result.links.append(_spring(a, b, k * least, z * float(np.sqrt(least))))
    result.ground = [(k * least, z * float(np.sqrt(least))) for k, z in result.ground]
    for _ in range(int(rng.integers(1, 4))):
        a, b = rng.choice(np.arange(-1, n), 2, replace=False)
        if b < 0:
            a, b = b, a
        pair = [result.mass[end] for end in (a, b) if end >= 0]
        m = pair[0] if len(pair) == 1 else pair[0] * pair[1] / sum(pair)
        kind = _KINDS[int(rng.integers(0, len(_KINDS)))]
        result.links.append(kind(int(a), int(b), m, is_damped, rng, by_ratio))
    return result


def _soften(outcome: RandomNetwork, springs: list[tuple[int, int, float, float]]) -> float:
    """The factor on all springs that keeps their modes below HIGHEST."""
    between = [(a, b, k) for a, b, k, _ in springs]
    highest = _highest(outcome.mass, [tie[0] for tie in outcome.ground], between)
    return float(min(1.0, (2.0 * np.pi * HIGHEST) ** 2 / max(highest, 1e-300)))


def _highest(
    mass: list[float], ground: list[float], springs: list[tuple[int, int, float]]
) -> float:
    """The highest squared frequency [rad²/s²] of masses on springs (end, end, N/m)."""
    stiffness = np.diag(ground).astype(float)
    for a, b, k in springs:
        e = np.zeros(len(mass))
        e[b] = 1.0
        if a >= 0:
            e[a] = -1.0
        stiffness += k * np.outer(e, e)
    root = 1.0 / np.sqrt(mass)
    return float(np.linalg.eigvalsh(root[:, None] * stiffness * root).max())


def _spring(a: int, b: int, k: float, z: float) -> Link:
    return Link(a, b, {"REF": {"K": k, "Z": z}}, lambda d: 0.5 * k * d**2, lambda d, w: z * w**2)


Draw = Callable[[float, float], float]


def _contact(a: int, b: int, m: float, is_damped: bool, rng: Any, by_ratio: Draw) -> Link:
    exponent = float(rng.choice([1.0, 1.0, 1.5, 2.3]))
    omega = 2.0 * np.pi * by_ratio(200.0, 15_000.0)
    depth = min(SPAN, 1.0 / omega)
    k = m * omega**2 * depth ** (1.0 - exponent)
    z = m * omega * by_ratio(1e-3, 0.3) if is_damped and rng.integers(0, 2) else 0.0
    gap = SPAN * float(rng.uniform(-0.2, 0.8))
    side = str(rng.choice(["below", "above"]))
    sign = 1.0 if side == "below" else -1.0
    fields = {
        "K": k,
        "Z": z,
        "gap": f"{gap!r}m",
        "exponent": exponent,
        "side": side,
        "clamp": bool(rng.integers(0, 2)),
        "contact": "plain" if z else str(rng.choice(["plain", "exact"])),
    }

    def potential(d: Floats) -> Floats:
        return np.asarray(k * np.maximum(-sign * d - gap, 0.0) ** (exponent + 1.0) / (exponent + 1))

    return Link(a, b, {"BUT": fields}, potential)


def _cubic(a: int, b: int, m: float, is_damped: bool, rng: Any, by_ratio: Draw) -> Link:
    k = m * (2.0 * np.pi * by_ratio(LOWEST, 2_000.0)) ** 2
    q = k / SPAN**2 * by_ratio(0.1, 3.0)
    z = m * 30.0 if is_damped else 0.0
    fields = {"law": "cubic", "damping": "cubic", "k": k, "q": q, "z": z}
    return Link(
        a, b, {"LNL": fields}, lambda d: 0.5 * k * d**2 + 0.25 * q * d**4, lambda d, w: z * w**2
    )


def _power(a: int, b: int, m: float, is_damped: bool, rng: Any, by_ratio: Draw) -> Link:
    p = float(rng.choice([1.5, 2.0, 3.0]))
    c = m * (2.0 * np.pi * by_ratio(LOWEST, 2_000.0)) ** 2 * SPAN ** (1.0 - p)
    fields = {"law": "power", "c": c, "p": p}
    return Link(a, b, {"LNL": fields}, lambda d: c * np.abs(d) ** (p + 1.0) / (p + 1.0))


def _rope(a: int, b: int, m: float, is_damped: bool, rng: Any, by_ratio: Draw) -> Link:
    k = m * (2.0 * np.pi * by_ratio(LOWEST, 4_000.0)) ** 2
    rest = SPAN * float(rng.uniform(0.0, 0.6))
    fields = {"law": "rope", "k": k, "rest": f"{rest!r}m"}
    return Link(a, b, {"LNL": fields}, lambda d: 0.5 * k * np.maximum(d - rest, 0.0) ** 2)


def _notch(a: int, b: int, m: float, is_damped: bool, rng: Any, by_ratio: Draw) -> Link:
    w = SPAN * by_ratio(0.1, 1.0)
    F = m * (2.0 * np.pi * by_ratio(LOWEST, 2_000.0)) ** 2 * w
    fields = {"law": "detent", "F": F, "w": w}
    top = F * w * np.exp(0.5)
    return Link(a, b, {"LNL": fields}, lambda d: top * (1.0 - np.exp(-0.5 * (d / w) ** 2)))


def _soft(a: int, b: int, m: float, is_damped: bool, rng: Any, by_ratio: Draw) -> Link:
    w = SPAN * by_ratio(0.05, 1.0)
    F = m * (2.0 * np.pi * by_ratio(LOWEST, 2_000.0)) ** 2 * w
    fields = {"law": "F*tanh(d/w)", "F": F, "w": w}

    def potential(d: Floats) -> Floats:
        u = np.abs(d / w)
        return np.asarray(F * w * (u + np.log1p(np.exp(-2.0 * u)) - np.log(2.0)))

    return Link(a, b, {"LNL": fields}, potential)


def _points(a: int, b: int, m: float, is_damped: bool, rng: Any, by_ratio: Draw) -> Link:
    """Straight lines: soft inside, stiffer on both sides."""
    k = m * (2.0 * np.pi * by_ratio(LOWEST, 1_000.0)) ** 2
    inner, far, times = SPAN * by_ratio(0.1, 1.0), 0.1, by_ratio(2.0, 8.0)
    outer = k * inner + times * k * (far - inner)
    points = [[-far, -outer], [-inner, -k * inner], [inner, k * inner], [far, outer]]
    fields = {"points": [[f"{d!r}m", f"{f!r}N"] for d, f in points]}

    def potential(d: Floats) -> Floats:
        e = np.abs(d)
        over = np.maximum(e - inner, 0.0)
        within = np.minimum(e, inner)
        return np.asarray(0.5 * k * within**2 + k * inner * over + 0.5 * times * k * over**2)

    return Link(a, b, {"LNL": fields}, potential)


def _coulomb(a: int, b: int, m: float, is_damped: bool, rng: Any, by_ratio: Draw) -> Link:
    F, s = m * by_ratio(3.0, 300.0), by_ratio(0.02, 0.5)
    fields = {"damping": "coulomb", "F": F, "s": f"{s!r}m/s"}
    return Link(a, b, {"LNL": fields}, lambda d: 0.0 * d, lambda d, w: F * w * np.tanh(w / s))


def _dry(a: int, b: int, m: float, is_damped: bool, rng: Any, by_ratio: Draw) -> Link:
    F = m * by_ratio(3.0, 300.0)
    fields = {"F": F, "static": F * float(rng.uniform(1.0, 2.0)), "speed": by_ratio(0.01, 0.1)}
    return Link(a, b, {"DRY": fields}, lambda d: 0.0 * d)


def _bristle(a: int, b: int, m: float, is_damped: bool, rng: Any, by_ratio: Draw) -> Link:
    F = m * by_ratio(3.0, 300.0)
    sigma0 = m * (2.0 * np.pi * by_ratio(200.0, 3_000.0)) ** 2
    damping = float(np.sqrt(sigma0 * m)) * by_ratio(0.02, 0.3)
    fields = {"sigma0": sigma0, "Fc": F, "Fs": 1.5 * F, "vs": 0.05, "sigma1": damping,
              "sigma2": damping}  # fmt: skip
    return Link(a, b, {"BRISTLE": fields}, lambda d: 0.0 * d)


_KINDS = (
    _contact, _contact, _contact, _contact,
    _cubic, _power, _rope, _notch, _soft, _points, _coulomb, _dry, _bristle,
)  # fmt: skip
