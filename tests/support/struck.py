"""Synthetic strokes, and the theoretical bounds on the accuracy of their modes."""

from dataclasses import dataclass

import numpy as np

RATE = 44100.0
LN_1000 = 3.0 * np.log(10.0)


@dataclass(frozen=True)
class Struck:
    """Modes: f [Hz], d [1/s], amplitude, phase, each (n,)."""

    f: np.ndarray
    d: np.ndarray
    a: np.ndarray
    phase: np.ndarray

    def sound(self, duration: float, rate: float = RATE) -> np.ndarray:
        """The sum of the modes."""
        t = np.arange(round(duration * rate)) / rate
        modes = zip(self.f, self.d, self.a, self.phase, strict=True)
        return sum(a * np.exp(-d * t) * np.cos(2 * np.pi * f * t + p) for f, d, a, p in modes)

    def bound(self, n: int, deviation: float, rate: float = RATE) -> np.ndarray:
        """Standard deviations of f and d by the Cramér-Rao bound, in white noise (n_modes, 2)."""
        t = np.arange(n) / rate
        columns = []
        for f, d, a, p in zip(self.f, self.d, self.a, self.phase, strict=True):
            turn = a * np.exp(-d * t + 1j * (2 * np.pi * f * t + p))
            columns += [-2 * np.pi * t * turn.imag, -t * turn.real, turn.real, -turn.imag]
        tangents = np.stack(columns, 1)
        size = np.linalg.norm(tangents, axis=0)
        tangents /= size
        bound = np.sqrt(np.linalg.inv(tangents.T @ tangents).diagonal()) * deviation / size
        return bound.reshape(-1, 4)[:, :2]


def bell(rng, ratios, t60, levels, *, pitch, pairs, beat=(0.25, 2.0)) -> Struck:
    """A bell whose partials in `pairs` are doublets that beat, 0.25 to 2 times a second."""
    rows = []
    for i, (ratio, long, level) in enumerate(zip(ratios, t60, levels, strict=True)):
        f = pitch * ratio * (1.0 + 0.002 * rng.standard_normal())
        if i in pairs:
            gap = rng.uniform(*beat)
            rows.append((f - gap / 2, LN_1000 / long, 0.6 * level, rng.uniform(-3, 3)))
            other = LN_1000 / (long * rng.uniform(0.8, 1.2))
            rows.append((f + gap / 2, other, 0.4 * level, rng.uniform(-3, 3)))
        else:
            rows.append((f, LN_1000 / long, level, rng.uniform(-3, 3)))
    return Struck(*(np.array(column) for column in zip(*rows, strict=True)))


def church() -> Struck:
    """A minor-third bell of 21 modes, six pairs of which beat."""
    rng = np.random.default_rng(7)
    ratios = (0.5, 1, 1.2, 1.5, 2, 2.5, 2.67, 3, 3.36, 4.1, 5.4, 6.8, 8.3, 9.9, 11.6)
    t60 = (12, 6, 7, 3, 4, 2, 1.8, 1.6, 1.4, 1.1, 0.8, 0.6, 0.45, 0.35, 0.28)
    levels = (1, 0.8, 0.9, 0.35, 1, 0.3, 0.25, 0.5, 0.2, 0.4, 0.3, 0.22, 0.15, 0.1, 0.07)
    return bell(rng, ratios, t60, levels, pitch=440.0, pairs=(0, 1, 2, 4, 7, 9))


def others() -> dict[str, Struck]:
    """Five other objects: a bar, a bowl, a cowbell, a tubular bell and a glass."""
    rng = np.random.default_rng(16)
    bar = (1, 2.756, 5.404, 8.933, 13.34)
    bowl = (1, 2.71, 5.0, 7.8, 11.1, 14.9)
    tube = (0.7, 1.25, 2, 2.93, 4.0, 5.25, 6.6)
    glass = (1, 2.32, 4.25, 6.63, 9.38)
    return {
        "bar": bell(rng, bar, (4, 2, 1, 0.6, 0.4), (1, 0.6, 0.4, 0.2, 0.1), pitch=392, pairs=(1,)),
        "bowl": bell(
            rng, bowl, (20, 14, 9, 5, 3, 2), (1, 0.8, 0.5, 0.3, 0.2, 0.1), pitch=180, pairs=range(6)
        ),
        "cowbell": bell(
            rng,
            (1, 1.48, 2.9, 4.4),
            (0.6, 0.5, 0.3, 0.25),
            (1, 0.9, 0.5, 0.3),
            pitch=562,
            pairs=(2,),
            beat=(3.0, 5.0),
        ),
        "tube": bell(
            rng,
            tube,
            (9, 8, 6, 5, 3, 2, 1.4),
            (0.5, 1, 0.9, 0.7, 0.5, 0.3, 0.2),
            pitch=523,
            pairs=(1, 3),
        ),
        "glass": bell(
            rng, glass, (2.5, 1.5, 1, 0.6, 0.4), (1, 0.5, 0.3, 0.2, 0.1), pitch=812, pairs=(0, 2)
        ),
    }


def matched(outcome: np.ndarray, f: np.ndarray, cents: float = 10.0) -> list[tuple[int, int]]:
    """Pairs of found and true modes: each is matched with the nearest within some cents, once."""
    used: set[int] = set()
    pairs = []
    for true, item in enumerate(f):
        away = np.abs(1200.0 * np.log2(outcome / item))
        away[list(used)] = np.inf
        near = int(np.argmin(away)) if away.size else -1
        if near >= 0 and away[near] < cents:
            used.add(near)
            pairs.append((true, near))
    return pairs
