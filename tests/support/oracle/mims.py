"""Models of MIMS (v1) and mi-gen (v2) played step by step, from the laws of their libraries alone.

Plain Python, one list a mass: [position, last step, force]; for a macro rows of an array. The
libraries keep two positions instead; the result is the same except for rounding, which is
smaller with the last step. It reads correct models only.
"""

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

RATE = 44100
Mass = list[float] | np.ndarray
STRINGS = ("string", "stiffString", "chain")


@dataclass
class Played:
    """The parts of a model to play: the actions of each step, in order."""

    is_v1: bool
    laws: str
    inputs: Mapping[str, Sequence[float]]
    params: dict[str, float] = field(default_factory=dict)
    signals: dict[str, str] = field(default_factory=dict)  # parameters, and the input of each
    masses: dict[str, Mass] = field(default_factory=dict)
    macros: dict[str, tuple[str, int, int, list[Mass]]] = field(default_factory=dict)
    reads: list[Callable[[int], None]] = field(default_factory=list)  # inputs
    moves: list[Callable[[], None]] = field(default_factory=list)
    pulls: list[Callable[[], None]] = field(default_factory=list)  # proxies, then links
    pushes: list[Callable[[int], None]] = field(default_factory=list)
    spreads: list[Callable[[], None]] = field(default_factory=list)
    outs: dict[int, Callable[[], float]] = field(default_factory=dict)

    def value(self, text: str) -> float:
        return float(eval(text, {"sqrt": math.sqrt}, dict(self.params)))

    def values(self, texts: Sequence[str]) -> Callable[[], list[float]]:
        """Values at each step; computed once if there is no signal."""
        if not any(signal in text for signal in self.signals for text in texts):
            result = [self.value(text) for text in texts]
            return lambda: result
        return lambda: [self.value(text) for text in texts]

    def force(self, m1: Mass, m2: Mass, f: float) -> None:
        m1[2] -= f
        m2[2] += f

    def inertia(self, m: Mass, mass: float, k: float, z: float, gravity: float) -> None:
        m[1] += (m[2] - gravity - k * m[0] - z * m[1]) / mass
        m[0], m[2] = m[0] + m[1], 0.0

    def proxy(self, name: str, along: Sequence[str]) -> Mass:
        kind, length, width, data = self.macros[name]
        single = [0.0, 0.0, 0.0]
        places = self.weights(kind, length, width, [self.value(a) for a in along])

        def weights() -> list[tuple[int, float]]:
            if not self.signals:
                return places
            return self.weights(kind, length, width, [self.value(a) for a in along])

        def read() -> None:
            before, single[0] = single[0], sum(w * data[i][0] for i, w in weights())
            single[1] = single[0] - before

        def spread() -> None:
            for i, w in weights():
                data[i][2] += single[2] * w
            single[2] = 0.0

        self.moves.append(read)
        self.spreads.append(spread)
        return single

    def weights(
        self, kind: str, length: int, width: int, shares: Sequence[float]
    ) -> list[tuple[int, float]]:
        def neighbours(share: float, count: int) -> list[tuple[int, float]]:
            p = share * count if self.laws == "2019" else min(max(share, 0.0), 1.0) * (count - 1)
            low = math.floor(p)
            if self.laws == "2019" and low + 1 >= count:
                return [(count - 1, 1.0)]
            return [(low, 1 - (p - low)), (min(low + 1, count - 1), p - low)]

        if kind in STRINGS:
            return neighbours(shares[0], length)
        rows, columns = neighbours(shares[0], length), neighbours(shares[1], width)
        return [(i * width + j, a * b) for i, a in rows for j, b in columns]


def played(
    text: str,
    dialect: str,
    seconds: float,
    laws: str = "head",
    inputs: Mapping[str, Sequence[float]] | None = None,
    arguments: Mapping[str, float] | None = None,
) -> np.ndarray:
    """Outputs of a model (n_frames, n_out)."""
    single = Played(dialect == "v1", laws, inputs or {})
    rows = [_words(line, single.is_v1) for line in re.split(r"\r\n|\r|\n", text)]
    rows = [row for row in rows if row]
    for name, word, *rest in rows:
        if word == "param":
            single.params[name[1:]] = single.value(rest[0])
        if word == "audioParam":
            single.params[name[1:]], single.signals[name[1:]] = 0.0, rest[0].lstrip("@")
    single.params |= arguments or {}
    for row in rows:
        _matter(single, *row)
    n_reads = len(single.moves)
    for row in rows:
        _links_and_ports(single, *row)
    proxies, single.moves = single.moves[n_reads:], single.moves[:n_reads]
    frames = round(seconds * RATE)
    sound = np.zeros((frames, max(single.outs)))
    for n in range(frames):
        for name, source in single.signals.items():
            signal = single.inputs.get(source, ())
            single.params[name] = signal[n] if n < len(signal) else 0.0
        for read in single.reads:
            read(n)
        for step in (*single.moves, *proxies, *single.pulls):
            step()
        for push in single.pushes:
            push(n)
        for spread in single.spreads:
            spread()
        for channel, out in single.outs.items():
            sound[n, channel - 1] = out()
    return sound


def _words(line: str, is_v1: bool) -> list[str]:
    if is_v1:
        return line.split("#")[0].split()
    if not line.strip().startswith("@"):
        return []
    return re.findall(r"\[[^\]]*\]|[^\s\[]+", line)


def _height(text: str) -> str:
    return text.strip("[]").split()[-1]


def _matter(played: Played, name: str, word: str, *rest: str) -> None:
    name, words = name[1:], [one.strip("[]") for one in rest]
    if played.is_v1 and word in ("ground", "mass", "massG", "osc", "posInput"):
        size = {"ground": 1, "mass": 3, "massG": 4, "osc": 5, "posInput": 1}[word]
        words = words[:size]
    if word in ("ground", "posInput"):
        x0 = played.value(_height(words[0]))
        played.masses[name] = m = [x0, 0.0, 0.0]

        def hold(n: int) -> None:
            m[2] = 0.0
            if word == "posInput":
                signal = played.inputs.get(name, ())
                before, m[0] = m[0], signal[n] if n < len(signal) else 0.0
                m[1] = m[0] - before

        played.reads.append(hold)
    elif word in ("mass", "massG", "osc"):
        *matter, x0, x1 = words
        x0, x1 = played.value(_height(x0)), played.value(_height(x1))
        played.masses[name] = m = [x0, x0 - x1 if played.is_v1 else x1 / RATE, 0.0]
        n = 3 if word == "osc" else 1
        weight = "0"
        if len(matter) > n:
            weight = matter[n] if played.is_v1 else f"{matter[n]} / 44100"
        numbers = played.values([*matter[:n], *("0" for _ in range(3 - n)), weight])
        played.moves.append(lambda: played.inertia(m, *numbers()))
    elif word in STRINGS or word in ("mesh", "closedMesh", "cornerMesh"):
        _macro(played, name, word, words)


def _macro(played: Played, name: str, word: str, words: list[str]) -> None:
    n = 1 if word in STRINGS else 2
    size = [int(w) for w in words[:n]]
    length, width = (size[0], 1) if n == 1 else size
    tail = 1 if played.is_v1 else 2
    texts = [*words[n : len(words) - tail]]
    k2 = played.value(texts.pop(2)) if word == "stiffString" else 0.0
    numbers = played.values([*texts, "0"][:4])
    x0 = played.value(_height(words[-tail]))
    step = 0.0 if played.is_v1 else played.value(_height(words[-1])) / RATE
    data = np.tile([x0, step, 0.0], (length * width, 1))
    played.macros[name] = word, length, width, list(data)
    x, v, f = data.T
    pairs = []
    stiff: list[tuple[int, int]] = []
    if n == 1:
        pairs = [(i, i + 1) for i in range(length - 1)]
    else:
        position = lambda i, j: i * width + j  # noqa: E731
        for i in range(length):
            pairs += [(position(i, j), position(i, j + 1)) for j in range(width - 1)]
        for i in range(length - 1):
            pairs += [(position(i, j), position(i + 1, j)) for j in range(width)]
    if word == "stiffString":
        low = 0 if played.laws == "2019" else -1
        clip = lambda i: min(max(i, 0), length - 1)  # noqa: E731
        stiff = [(clip(i), clip(i + 2)) for i in range(low, length - 1)]

    def is_fixed(index: int) -> bool:
        i, j = divmod(index, width)
        if word in ("string", "stiffString"):
            return index in (0, length - 1)
        ends = [i in (0, length - 1), j in (0, width - 1)]
        return {"closedMesh": any(ends), "cornerMesh": all(ends)}.get(word, False)

    fixed = np.array([is_fixed(i) for i in range(length * width)])
    free = ~fixed
    first, second = np.array(pairs, int).reshape(-1, 2).T
    near, far = np.array(stiff, int).reshape(-1, 2).T

    def pull(a: np.ndarray, b: np.ndarray, force: np.ndarray) -> None:
        """Link by link, in their order."""
        np.add.at(f, np.stack([a, b], 1).ravel(), np.stack([-force, force], 1).ravel())

    def move() -> None:
        m, k, z, zo = numbers()
        v[free] += (f[free] - zo * v[free]) / m
        x[free] += v[free]
        f[:] = 0.0
        if n == 2:
            v[fixed] = 0.0
        pull(first, second, k * (x[first] - x[second]) + z * (v[first] - v[second]))
        if stiff:
            pull(near, far, k2 * (x[near] - x[far]))

    played.moves.append(move)


def _links_and_ports(played: Played, name: str, word: str, *rest: str) -> None:
    if word in ("posOutput", "frcOutput", "frcInput"):
        m, _ = _ends(played, rest, 1)
        if word == "frcInput":
            signal = played.inputs.get(name[1:], ())

            def push(n: int) -> None:
                m[0][2] += signal[n] if n < len(signal) else 0.0

            played.pushes.append(push)
        else:
            position = 0 if word == "posOutput" else 2
            played.outs[int(name[4:])] = lambda: m[0][position]
    elif word in LAWS:
        (m1, m2), words = _ends(played, rest, 2)
        values = played.values([one.strip("[]") for one in words])
        if played.is_v1 and word == "spring" and len(words) == 2:
            word = "springDamper"
        law = LAWS[word]
        if played.laws == "2019":
            law = LAWS_2019.get(word, law)

        def pull() -> None:
            played.force(m1, m2, law(m1[0] - m2[0], m1[1] - m2[1], *values()))

        played.pulls += [pull] * (2 if played.is_v1 and word == "nlSpring3" else 1)


def _ends(played: Played, rest: Sequence[str], count: int) -> tuple[list[Mass], list[str]]:
    ends, words = list(rest[:count]), list(rest[count:])
    points = [end.strip("[]").lstrip("@").split() for end in ends]
    if played.is_v1:
        on = [point for point in points if point[0] in played.macros]
        for point, place in zip(on, words[len(words) - len(on) :], strict=True):
            point += place.split(":")
        words = words[: len(words) - len(on)]
    result = []
    for position, *along in points:
        result.append(
            played.proxy(position, along) if position in played.macros else played.masses[position]
        )
    return result, words


# --- laws: force over d = x1 - x2 and v, subtracted from m1 --------------------------------------


def _contact(d: float, v: float, k: float, z: float, thresh: float = 0.0) -> float:
    return k * (d + thresh) + z * v if d > -thresh else 0.0


def _nl_contact(
    d: float, v: float, s: float, c: float, k: float, z: float, thresh: float = 0.0
) -> float:
    if k < s:
        k, c = s, 0.0
    if not d > -thresh:
        return 0.0
    d += thresh
    if c == 0:
        f = s * d
    elif s >= k:
        f = k * d
    else:
        f = d * (s + c * d * d) if abs(d) <= math.sqrt((k - s) / c) else k * d
    return f + z * v


def _clipped(d: float, v: float, s: float, c: float, k: float, z: float) -> float:
    if c == 0:
        return s * d + z * v
    if s >= k:
        return k * d + z * v
    if abs(d) <= math.sqrt((k - s) / c):
        return d * (s + c * d * d) + z * v
    return k * d + (z + 0.3 * k) * v


def _pluck(d: float, v: float, k: float, scale: float, z: float = 0.0) -> float:
    tip, end = scale / 10, k / 10
    if abs(d) < tip:
        return -(k - end) * d
    if abs(d) < scale:
        return math.copysign(tip * k, -d) + end * d + z * v
    return 0.0


def _bow(d: float, v: float, z: float, scale: float, smooth: float = 0.0) -> float:
    if smooth >= 1:
        return 0.63 * z * v * math.exp(-4 * (v / scale) ** 2 + 0.5)
    tip, end = scale / 3, z / 3
    if abs(v) < tip:
        return (z - end) * v
    return math.copysign(tip * z, v) - end * v if abs(v) < scale else 0.0


def _square(d: float, v: float, k: float, q: float, z: float) -> float:
    return k * d + q * math.copysign(d * d, d) + z * v


LAWS: dict[str, Callable[..., float]] = {
    "spring": lambda d, v, k: k * d,
    "damper": lambda d, v, z: z * v,
    "springDamper": lambda d, v, k, z: k * d + z * v,
    "contact": _contact,
    "detent": _contact,
    "nlContact": _nl_contact,
    "nlSpring": _square,
    "nlSpring2": _square,
    "nlSpring3": lambda d, v, k, q, z: k * d + q * d**3 + z * v,
    "nlSpringDamper": _clipped,
    "nlPluck": _pluck,
    "nlBow": _bow,
}


def _pluck_2019(d: float, v: float, k: float, scale: float, z: float = 0.0) -> float:
    tip, inner = scale / 10, 10 * k
    if abs(d) < tip:
        return -(inner - k) * d
    return math.copysign(tip * inner, -d) + k * d if abs(d) < scale else 0.0


def _bow_2019(d: float, v: float, z: float, scale: float, smooth: float = 0.0) -> float:
    tip = scale / 3
    if abs(v) < tip:
        return z * v
    return math.copysign(tip * z, v) - 0.25 * z * v if abs(v) < scale else 0.0


def _contact_2019(d: float, v: float, k: float, z: float, thresh: float = 0.0) -> float:
    return k * d + z * v if d > thresh else 0.0


LAWS_2019: dict[str, Callable[..., float]] = {
    "nlPluck": _pluck_2019,
    "nlBow": _bow_2019,
    "contact": _contact_2019,
    "detent": _contact_2019,
}
