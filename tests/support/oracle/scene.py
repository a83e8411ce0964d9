"""A scene written once, both as rows for the oracle's loop and as calls on the core."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from oracle.laws import Law


class Mat(int):
    """Index of a MAT in the oracle; the core may number differently."""


class Lia(int):
    """Index of a LIA in the oracle."""


@dataclass
class Point:
    """MAS (K = Z = 0), CEL, or SOL (M = inf). `tuned` is (f, t60) of a pole-exact CEL."""

    M: float
    K: float = 0.0
    Z: float = 0.0
    X0: float = 0.0
    V0: float = 0.0
    rest: float = 0.0
    tuned: tuple[float, float | None] | None = None
    cel: bool = False
    ca: bool = False
    part: str = ""


@dataclass
class Link:
    """A link of kind `ref`, `but`, `exact`, `magic`, `lnl` or `dry`; offset is rest or gap.

    The K of a `dry` is its level.
    """

    kind: str
    a: int
    b: int
    K: float = 0.0
    Z: float = 0.0
    offset: float = 0.0
    side: str = "below"
    exponent: float = 1.0
    clamp: bool = False
    restitution: float = 1.0
    steps: int = 2
    static: float | None = None
    speed: float = 1e-3
    law: Law | None = None
    ca: bool = False


@dataclass
class Gesture:
    """A written gesture of a key: dense, or one throw for each point whose curve says so."""

    key: int
    t: Sequence[float]
    x: Sequence[float]
    curve: Sequence[str]
    touch: str = "open"


@dataclass
class Scene:
    """Builder with the core's own names. Every adding method also records the core's call."""

    mats: list[Point] = field(default_factory=list)
    lias: list[Link] = field(default_factory=list)
    outs: list[list[tuple[int, int, float]]] = field(default_factory=list)
    orders: list[int] = field(default_factory=list)  # how often each is differentiated
    keys: list[int] = field(default_factory=list)
    gestures: list[Gesture] = field(default_factory=list)
    strikes: list[tuple[int, float, float, float, float]] = field(default_factory=list)
    drives: list[tuple[int, str, Callable[[np.ndarray], np.ndarray]]] = field(default_factory=list)
    calls: list[tuple[str, str, tuple[Any, ...], dict[str, Any], list[int], str]] = field(
        default_factory=list
    )
    ca: bool = False
    part_index: str = ""

    def _call(
        self,
        on: str,
        method: str,
        *args: Any,
        built: Sequence[int] = (),
        kind: str = "mat",
        **kw: Any,
    ) -> None:
        self.calls.append((on, method, args, kw, list(built), kind))

    def _point(self, method: str, name: str, point: Point, **kw: Any) -> Mat:
        point.ca, point.part = self.ca, self.part_index
        self.mats.append(point)
        i = Mat(len(self.mats) - 1)
        self._call("net", method, name, built=[i], **kw)
        return i

    def _link(self, method: str, name: str, link: Link, *args: Any, **kw: Any) -> Lia:
        link.ca = self.ca
        self.lias.append(link)
        j = Lia(len(self.lias) - 1)
        self._call(
            "net", method, name, Mat(link.a), Mat(link.b), *args, built=[j], kind="lia", **kw
        )
        return j

    def part(self, name: str, *, ca_rate: float | None = None) -> None:
        self.ca, self.part_index = ca_rate is not None, name
        self._call("net", "part", name, ca_rate=ca_rate)

    def mas(self, name: str, *, M: float, X0: float = 0.0, V0: float = 0.0) -> Mat:
        return self._point("mas", name, Point(M=M, X0=X0, V0=V0), M=M, X0=X0, V0=V0)

    def sol(self, name: str, *, X0: float = 0.0) -> Mat:
        return self._point("sol", name, Point(M=np.inf, X0=X0), X0=X0)

    def cel(
        self,
        name: str,
        *,
        M: float,
        K: float | None = None,
        Z: float | None = None,
        f: float | None = None,
        t60: float | None = None,
        X0: float = 0.0,
        V0: float = 0.0,
        rest: float = 0.0,
    ) -> Mat:
        point = Point(M=M, K=K or 0.0, Z=Z or 0.0, X0=X0, V0=V0, rest=rest, cel=True)
        if f is not None:
            sigma = 3.0 * np.log(10.0) / t60 if t60 is not None else 0.0
            point.K = M * ((2.0 * np.pi * f) ** 2 + sigma**2)
            point.Z = 2.0 * M * sigma
            point.tuned = (f, t60)
            kw: dict[str, Any] = {"f": f, "t60": t60}
        else:
            kw = {"K": K, "Z": Z or 0.0}
        return self._point("cel", name, point, M=M, X0=X0, V0=V0, rest=rest, **kw)

    def mesh(
        self,
        method: str,
        name: str,
        edges: Sequence[tuple[int, int, float]],
        count: int,
        m: float,
        k: float,
        z: float,
        q: float,
        **kw: Any,
    ) -> list[Mat]:
        """A generator of the core, expanded: edges (i, j, factor of k); i = -1 is the ground."""
        first = len(self.mats)
        self.mats += [Point(M=m, ca=self.ca, part=self.part_index) for _ in range(count)]
        if any(i < 0 for i, _, _ in edges):
            self.mats.append(Point(M=np.inf, ca=self.ca, part=self.part_index))
        built = [Mat(first + i) for i in range(count)]
        for i, j, s in edges:
            a = first + (i if i >= 0 else count)
            law = Law("cubic", (("k", s * k), ("q", q), ("z", z * s))) if q else None
            self.lias.append(
                Link("lnl" if q else "ref", a, first + j, K=s * k, Z=s * z, law=law, ca=self.ca)
            )
        # The core may number a plate's masses differently: only its centre is the same there.
        kind = "centre" if method == "plate" else "mat"
        self._call(
            "net", method, name, built=built[:1] if kind == "centre" else built, kind=kind, **kw
        )
        return built

    def ref(
        self, name: str, a: Mat, b: Mat, *, K: float = 0.0, Z: float = 0.0, rest: float = 0.0
    ) -> Lia:
        return self._link("ref", name, Link("ref", a, b, K, Z, rest), K=K, Z=Z, rest=rest)

    def but(self, name: str, a: Mat, b: Mat, *, K: float, contact: str = "plain", **kw: Any) -> Lia:
        arguments = dict(kw)
        link = Link(
            {"plain": "but"}.get(contact, contact),
            a,
            b,
            K,
            offset=arguments.pop("gap", 0.0),
            **arguments,
        )
        return self._link("but", name, link, K=K, contact=contact, **kw)

    def lnl(self, name: str, a: Mat, b: Mat, law: Law, *, rest: float = 0.0) -> Lia:
        return self._link("lnl", name, Link("lnl", a, b, offset=rest, law=law), law, rest=rest)

    def dry(
        self, name: str, a: Mat, b: Mat, *, F: float, static: float | None = None, speed: float
    ) -> Lia:
        link = Link("dry", a, b, K=F, static=static, speed=speed)
        return self._link("dry", name, link, F=F, static_level=static, speed=speed)

    def start(self, i: Mat, X0: float, V0: float) -> None:
        self.mats[i].X0, self.mats[i].V0 = X0, V0
        self._call("net", "start", i, X0, V0)

    def listen(
        self,
        name: str,
        *,
        positions: Sequence[tuple[Mat, float]] = (),
        forces: Sequence[tuple[Lia, float]] = (),
        ground_forces: Sequence[tuple[Mat, float]] = (),
        order: int = 0,
    ) -> int:
        """An output: sums of (index, weight), differentiated `order` times by time."""
        taps = [(0, int(i), w) for i, w in positions] + [(1, int(j), w) for j, w in forces]
        self.outs.append(taps + [(2, int(i), w) for i, w in ground_forces])
        self.orders.append(order)
        self._call(
            "net",
            "listen",
            name,
            positions=[(i, 1, w) for i, w in positions],
            forces=[(j, 1, w) for j, w in forces],
            ground_forces=[(i, 1, w) for i, w in ground_forces],
            order=order,
        )
        return len(self.outs) - 1

    # --- what will happen ---

    def key(self, name: str, struck: Mat, **kw: Any) -> int:
        self.keys.append(int(struck))
        self._call("time", "key", name, struck, **kw)
        return len(self.keys) - 1

    def gesture(
        self,
        key: int,
        t: Sequence[float],
        x: Sequence[float],
        curve: Sequence[str],
        *,
        touch: str = "open",
        **kw: Any,
    ) -> None:
        self.gestures.append(Gesture(key, t, x, curve, touch))
        self._call("time", "gesture", key, list(t), list(x), list(curve), touch=touch, **kw)

    def strike(
        self,
        mat: Mat,
        time: float,
        *,
        impulse: float | None = None,
        mass: float | None = None,
        speed: float | None = None,
    ) -> None:
        arguments = {"impulse": impulse, "mass": mass, "speed": speed}
        self.strikes.append(
            (int(mat), time, *(np.nan if v is None else v for v in arguments.values()))
        )
        self._call("time", "strike", mat, time, **arguments)

    def drive(
        self,
        mat: Mat,
        kind: str,
        *,
        constant: float | None = None,
        curve: Callable[[np.ndarray], np.ndarray] | None = None,
        **kw: Any,
    ) -> None:
        """A constant, or `curve(t)` in the oracle and the same movement as `take=` (with at, scale)
        in the core.
        """
        if kind == "position":
            self._call("net", "impose", mat)
        value = constant
        self.drives.append((int(mat), kind, curve or (lambda t: np.full(len(t), value))))
        arguments = {"constant": constant} if constant is not None else kw
        self._call("time", "drive", mat, kind, **arguments)

    # --- the same in the core ---

    def build(self, core: Any, rate: float) -> tuple[Any, Any]:
        """(Network, Timeline) of the core with every call replayed."""
        network = core.Network()
        timeline: Any = None
        index: dict[tuple[str, int], int] = {}

        def resolved(value: Any) -> Any:
            if isinstance(value, Mat):
                return index["mat", int(value)]
            if isinstance(value, Lia):
                return index["lia", int(value)]
            if isinstance(value, Law):
                return value.on(core)
            if isinstance(value, list | tuple):
                return type(value)(resolved(v) for v in value)
            return value

        for on in ("net", "time"):
            if on == "time":
                timeline = core.Timeline(network, rate)
            for where, method, args, kw, built, kind in self.calls:
                if where != on:
                    continue
                target = network if on == "net" else timeline
                first = getattr(target, method)(
                    *(resolved(v) for v in args), **{k: resolved(v) for k, v in kw.items()}
                )
                if kind == "centre":
                    index["mat", built[0]] = network.centre(first)
                    continue
                for i, handle in enumerate(built):
                    index[kind, handle] = first + i
        self.core_index = {i: c for (kind, i), c in index.items() if kind == "mat"}
        return network, timeline
