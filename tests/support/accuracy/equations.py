"""The text of a scene as a system of differential equations, read without any part of ergon.

It knows the modules that audited scenes use, in SI units, and refuses all others.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import yaml
from oracle.bodies import eigenvalues, string_edges
from scipy.interpolate import PPoly, make_interp_spline
from scipy.signal.windows import blackman

from accuracy.changing import (
    CELL_PITCH,
    FOLLOWING_LINK,
    FOLLOWING_MASS,
    GROUND,
    LINK,
    LINK_PITCH,
    MASS,
    SHAPES,
    Glide,
    Proxies,
    coupling_rows,
    following_row,
)

_UNITS = {"k": 1e3, "m": 1e-3, "u": 1e-6, "": 1.0}
_NUMBER = re.compile(r"^([-+]?[0-9.]+(?:e[-+]?[0-9]+)?)\s*(.*)$", re.IGNORECASE)
ELASTIC = {
    **{"linear": 1, "cubic": 2, "rope": 3, "detent": 4, "contact": 5},
    **{"bristle": 6, "dry": 7, "power": 8},
}
DAMPING = {"linear": 1, "cubic": 1, "rope": 2, "bow": 3, "coulomb": 4, "bow-hyperbolic": 5}
# Constants of each law, in the order of a link's numbers: elastic ones from 0, damping from 3.
_ELASTIC_FIELDS = {
    **{"cubic": ("k", "q"), "rope": ("k",), "detent": ("F", "w")},
    "power": ("c", "p"),
}
_DAMPING_FIELDS = {
    "cubic": ("z",),
    "rope": ("z",),
    "bow": ("F", "a", "u"),
    "coulomb": ("F", "s"),
    "bow-hyperbolic": ("F", "r", "v1", "v2", "u"),
}
N_NUMBERS = 8
_CONTACT = "0.19ms"  # for which a strike lasts that does not say so
_PARTS_PER_SECOND = 44_100.0
REST = 2  # where a link's rest or gap stands among its numbers


def number(value: Any) -> float:
    """A number in SI units: 2mm, 1g, 4e3, -5N, 2mNs, 48kHz, 20mm/s."""
    if isinstance(value, int | float):
        return float(value)
    result = _NUMBER.match(value)
    assert result, f"{value} is no number"
    size, unit = float(result[1]), result[2]
    if unit in ("g", "mg", "kg"):
        return size * {"g": 1e-3, "mg": 1e-6, "kg": 1.0}[unit]
    if unit.startswith("m/") or unit in ("m", "s", "N", "") or len(unit) == 1:
        return size
    return size * (_UNITS[unit[0]] if unit[0] in "kmu" else 1.0)


@dataclass
class Path:
    """A gesture: the mass that it moves, the image of that mass in the free copy of the key, and
    its spline.
    """

    mass: int
    image: int
    tracked: bool
    spline: PPoly  # t [s] of the piece, x [m]


@dataclass
class TunedBody:
    """A cell or a body that `f` [Hz] and a decay [1/s] tune: for each of its masses or links, which
    `what` names, its index and the weight of its K and Z.
    """

    f: float
    sigma: float
    what: int
    weights: list[tuple[int, float]]


@dataclass
class Equations:
    """Masses, links, outputs and events of a scene (SI).

    `mass` (n,), infinite where fixed; `ground` (n, 2): K and Z; `push` (n,): constant forces;
    `ends` (n_links, 2); `kinds` (n_links, 2): laws of ELASTIC and DAMPING; `numbers`
    (n_links, N_NUMBERS); `stretched`: (first link, end, q) of each string whose links share one
    tension; `outputs`: ("SOX" or "SOF", index); `strikes`: (mass, instant, impulse).
    """

    rate: float
    mass: list[float] = field(default_factory=list)
    ground: list[tuple[float, float]] = field(default_factory=list)
    push: list[float] = field(default_factory=list)
    x0: list[float] = field(default_factory=list)
    v0: list[float] = field(default_factory=list)
    ends: list[tuple[int, int]] = field(default_factory=list)
    kinds: list[tuple[int, int]] = field(default_factory=list)
    numbers: list[list[float]] = field(default_factory=list)
    stretched: list[tuple[int, int, float]] = field(default_factory=list)
    outputs: list[tuple[str, int]] = field(default_factory=list)
    strikes: list[tuple[int, float, float]] = field(default_factory=list)
    paths: list[Path] = field(default_factory=list)
    names: dict[str, int] = field(default_factory=dict)
    links: dict[str, int] = field(default_factory=dict)
    keys: dict[str, list[int]] = field(default_factory=dict)
    bodies: dict[str, TunedBody] = field(default_factory=dict)
    body_masses: dict[str, list[int]] = field(default_factory=dict)
    changes: list[list[float]] = field(default_factory=list)
    proxies: Proxies = field(default_factory=Proxies)

    @property
    def is_linear(self) -> bool:
        """Whether a matrix exponential solves it: no contact, no law, no friction, no gesture, no
        shared tension, nothing that changes in time, no proxy.
        """
        is_plain = not (self.paths or self.stretched or self.changes or self.proxies.rows)
        return is_plain and all(a <= 1 and b <= 1 for a, b in self.kinds)

    def point(
        self, name: str, m: float, k: float, z: float, rest: float, x: float, v: float
    ) -> int:
        self.names[name] = len(self.mass)
        self.mass.append(m)
        self.ground.append((k, z))
        self.push.append(k * rest)
        self.x0.append(x)
        self.v0.append(v)
        return len(self.mass) - 1

    def link(self, a: int, b: int, elastic: int, damping: int, *numbers: float) -> int:
        self.ends.append((a, b))
        self.kinds.append((elastic, damping))
        self.numbers.append([*numbers, *[0.0] * (N_NUMBERS - len(numbers))])
        return len(self.ends) - 1

    def find(self, name: str, part: str) -> int:
        """A mass by its name, as seen from a part."""
        inside = f"{part}.{name}"
        return self.names[inside if inside in self.names else name]

    def pairs(self, ends: list[str], part: str) -> list[tuple[int, int]]:
        """The pairs of masses that a link joins: one pair, or one for each member of
        `string.1..12`.
        """
        rows = []
        for end in ends:
            head, _, low, high = re.fullmatch(r"(.*?)(\.([0-9]+)\.\.([0-9]+))?", end).groups()
            members = range(int(low), int(high) + 1) if low else ()
            rows.append([self.find(f"{head}.{i}", part) for i in members] or [self.find(end, part)])
        n = max(map(len, rows))
        a, b = (row * n if len(row) == 1 else row for row in rows)
        return list(zip(a, b, strict=True))


def read(text: str) -> Equations:
    """The equations of a scene."""
    score = yaml.safe_load(text)
    rates = score.get("rates", {})
    result = Equations(number(rates.get("audio", "44100Hz")))
    for name, key in score.get("keys", {}).items():
        first = len(result.mass)
        if "modules" in key:
            _part(result, name, key["modules"])
            result.names[name] = result.names[f"{name}.{key['struck']}"]
        else:
            _module(result, "", name, "CEL", key)
        result.keys[name] = list(range(first, len(result.mass)))
    for name, instrument in score.get("instruments", {}).items():
        _part(result, name, instrument["modules"])
        outs = instrument["out"]
        for out in [outs] if set(outs) & {"SOX", "SOF"} else outs.values():
            if "SOX" in out:
                result.outputs.append(("SOX", result.find(out["SOX"], name)))
            else:
                ((_, link),) = out["SOF"].items()
                result.outputs.append(("SOF", result.links[f"{name}.{link}"]))
    for couple in score.get("duet", []):
        a, b = (result.names[key] for key in couple["couple"])
        K, Z = (number(couple["REF"].get(name, 0.0)) for name in ("K", "Z"))
        link = result.link(a, b, 1, 1, K, 0.0, 0.0, Z)
        begin, end = number(couple.get("at", 0.0)), number(couple.get("until", np.inf))
        result.changes += coupling_rows(link, (K, Z), begin, end, result.rate)
    for strike in score.get("strikes", {}).values():
        struck, begin = result.names[strike["to"]], number(strike["at"])
        for after, impulse in _impulses(strike):
            result.strikes.append((struck, begin + after, impulse))
    _gestures(result, score)
    for line in score.get("automation", []):
        _glide(result, line)
    return result


def _glide(outcome: Equations, line: dict[str, Any]) -> None:
    """Add the changes of a line of automation: one parameter to one value, in its own unit."""
    label, _, parameter = line["set"].rpartition(".")
    begin = number(line["at"])
    glide = Glide(begin, begin + number(line["over"]), SHAPES[line.get("curve", "line")])
    last = number(str(line["to"]).removesuffix("Hz"))
    if parameter in ("f", "t60"):
        body = outcome.bodies[label]
        pitches, sigmas = (body.f, body.f), (body.sigma, body.sigma)
        if parameter == "f":
            pitches = (body.f, last)
        else:
            sigmas = (body.sigma, _decay_rate(last))
        for index, weight in body.weights:
            outcome.changes.append(glide.row(body.what, index, weight, pitches, sigmas))
    elif label in outcome.links:
        link = outcome.links[label]
        columns = _GLIDING_COLUMNS[outcome.kinds[link][0]][parameter]
        first = outcome.numbers[link][columns[0]]
        for column in columns:  # static friction keeps its ratio to the level that glides
            start = outcome.numbers[link][column]
            values = (start, last * start / first)
            outcome.changes.append(glide.row(LINK, link, float(column), values))
    else:
        mass = outcome.names[label]
        if parameter == "M":
            outcome.changes.append(glide.row(MASS, mass, 0.0, (outcome.mass[mass], last)))
        else:
            column = ("K", "Z").index(parameter)
            values = (outcome.ground[mass][column], last)
            outcome.changes.append(glide.row(GROUND, mass, float(column), values))


# By the kind of a link: where the numbers of a parameter that may glide stand.
_GLIDING_COLUMNS = {
    ELASTIC["linear"]: {"K": (0,), "Z": (3,)},
    ELASTIC["contact"]: {"K": (0,), "Z": (3,)},
    ELASTIC["bristle"]: {"sigma0": (0,), "Fc": (3, 4)},
    ELASTIC["dry"]: {"F": (0, 1)},
}


def _decay_rate(t60: float) -> float:
    return 3.0 * float(np.log(10.0)) / t60


def _impulses(strike: dict[str, Any]) -> Iterator[tuple[float, float]]:
    """The impulses of which a strike consists, and how long after its beginning they act [s]:
    samples of Blackman's window, 1/44,100 s apart.
    """
    impulse, lasts = number(strike["impulse"]), number(strike.get("lasts", _CONTACT))
    n = round(lasts * _PARTS_PER_SECOND)
    if n < 3:
        yield 0.0, impulse
        return
    window = blackman(n, sym=False)
    for k in range(1, n):
        yield k / _PARTS_PER_SECOND, impulse * window[k] / window.sum()


def _part(outcome: Equations, part: str, modules: dict[str, Any]) -> None:
    for name, module in modules.items():
        ((kind, arguments),) = module.items()
        _module(outcome, f"{part}.", name, kind, arguments or {})


def _module(outcome: Equations, part: str, name: str, kind: str, arguments: dict[str, Any]) -> None:
    def field_value(field: str, default: float = 0.0) -> float:
        return number(arguments[field]) if field in arguments else default

    label, single = f"{part}{name}", part.removesuffix(".")
    if kind == "SOL":
        outcome.point(label, np.inf, 0.0, 0.0, 0.0, field_value("X0"), 0.0)
    elif kind in ("MAS", "CEL"):
        k, z = field_value("K"), field_value("Z")
        if "f" in arguments:
            sigma = _decay_rate(field_value("t60")) if "t60" in arguments else 0.0
            f = number(str(arguments["f"]).removesuffix("Hz"))
            k, z = (
                field_value("M") * ((2.0 * np.pi * f) ** 2 + sigma**2),
                2.0 * field_value("M") * sigma,
            )
            weights = [(len(outcome.mass), field_value("M"))]
            outcome.bodies[label] = TunedBody(f, sigma, CELL_PITCH, weights)
        following = arguments.get("follows", {}).get("M")
        m = number(following["from"]) if following else field_value("M")
        point = outcome.point(
            label, m, k, z, field_value("rest"), field_value("X0"), field_value("V0")
        )
        if following:
            _follow(outcome, FOLLOWING_MASS, point, 0, following, single)
    elif kind == "PROXY":
        _proxy(outcome, label, single, arguments)
    elif kind in ("STRING", "PLATE"):
        _body(outcome, label, kind, arguments)
    elif kind == "ENF":
        outcome.push[outcome.find(arguments["to"], single)] += number(arguments["from"])
    else:
        if kind == "DRY" and "to" in arguments:
            floor = outcome.point(f"{label}.floor", np.inf, 0.0, 0.0, 0.0, 0.0, 0.0)
            pairs = [(floor, outcome.find(arguments["to"], single))]
        else:
            pairs = outcome.pairs(arguments["between"], single)
        a, b = pairs[0]
        assert len(pairs) == 1 or kind == "BUT", f"a {kind} over a range is not known here"
        if kind in ("RES", "FRO", "REF"):
            link = outcome.link(
                a, b, 1, 1, field_value("K"), 0.0, field_value("rest"), field_value("Z")
            )
        elif kind == "BUT":
            sign = -1.0 if arguments.get("side") == "above" else 1.0
            clamp = float(arguments.get("clamp", False))
            for (a, b), gap in zip(pairs, gaps(arguments.get("gap", 0.0), len(pairs)), strict=True):
                shape = (
                    field_value("K"),
                    field_value("exponent", 1.0),
                    gap,
                    field_value("Z"),
                    sign,
                    clamp,
                )
                link = outcome.link(a, b, ELASTIC["contact"], 0, *shape)
        elif kind == "LNL" and arguments.get("law") == "k*d":
            # A spring whose constants may follow masses; its damping is z*v or none.
            assert arguments.get("damping", "z*v") == "z*v", "of laws k*d and z*v are known here"
            link = outcome.link(a, b, 1, 1, field_value("k"), 0.0, 0.0, field_value("z"))
            for constant, following in arguments.get("follows", {}).items():
                column = {"k": 0, "z": 3}[constant]
                outcome.numbers[link][column] = number(following["from"])
                _follow(outcome, FOLLOWING_LINK, link, column, following, single)
        elif kind == "LNL":
            law, damping = arguments.get("law"), arguments.get("damping")
            row = [0.0] * N_NUMBERS
            for i, constant in enumerate(_ELASTIC_FIELDS.get(law, ())):
                row[i] = field_value(constant)
            row[REST] = field_value("rest")
            for i, constant in enumerate(_DAMPING_FIELDS.get(damping, ())):
                row[3 + i] = field_value(constant)
            laws = (ELASTIC[law] if law else 0), (DAMPING[damping] if damping else 0)
            link = outcome.link(a, b, *laws, *row)
        elif kind == "BRISTLE" or "K" in arguments:
            level, stiffness = ("Fc", "sigma0") if kind == "BRISTLE" else ("F", "K")
            static = field_value("Fs" if kind == "BRISTLE" else "static", field_value(level))
            speed = field_value("vs" if kind == "BRISTLE" else "speed", 0.001)
            shape = (
                field_value(stiffness),
                field_value("sigma1"),
                field_value("sigma2"),
                field_value(level),
                static,
                speed,
            )
            link = outcome.link(a, b, ELASTIC["bristle"], 0, *shape)
        elif kind == "DRY":
            shape = (
                field_value("F"),
                field_value("static", field_value("F")),
                0.0,
                field_value("speed", 0.001),
            )
            link = outcome.link(a, b, ELASTIC["dry"], 0, *shape)
        else:
            raise ValueError(f"{kind} is not known here")
        outcome.links[label] = link


def _follow(
    outcome: Equations, what: int, index: int, column: int, following: dict[str, Any], part: str
) -> None:
    first, last = number(following["from"]), number(following["to"])
    offset, span = number(following.get("offset", 0.0)), number(following.get("span", 1.0))
    guide = outcome.find(following["of"], part)
    outcome.changes.append(following_row(what, index, column, guide, offset, span, first, last))


def _proxy(outcome: Equations, label: str, part: str, arguments: dict[str, Any]) -> None:
    """A proxy between the masses of a row: at a fixed place, or where a mass leads it."""
    members = []
    listed = arguments["of"]
    for name in listed if isinstance(listed, list) else [listed]:
        inside = f"{part}.{name}"
        if inside in outcome.body_masses:
            members += outcome.body_masses[inside]
        else:
            members.append(outcome.find(name, part))
    point = outcome.point(label, np.inf, 0.0, 0.0, 0.0, 0.0, 0.0)
    guide = outcome.find(arguments["follows"], part) if "follows" in arguments else -1
    offset, span = number(arguments.get("offset", 0.0)), number(arguments.get("span", 1.0))
    outcome.proxies.add(point, members, guide, offset, span, number(arguments.get("at", 0.0)))


def gaps(arguments: Any, n: int) -> list[float]:
    """The gap at each of n points [m]: one value for all, a list, or least +
    depth·(i/length)^power.
    """
    if isinstance(arguments, list):
        return [number(one) for one in arguments]
    if not isinstance(arguments, dict):
        return [number(arguments)] * n
    assert "top" not in arguments, "a top is not known here"
    i = np.arange(n) / number(arguments.get("length", max(n - 1, 1)))
    shape = number(arguments["depth"]) * i ** number(arguments.get("power", 2.0))
    return list(number(arguments.get("least", 0.0)) + shape)


def plate_edges(shape: str, radius: int, *, fixed: bool) -> tuple[list[tuple[int, int]], int]:
    """Edges of a mesh, -1 for the held rim, and how many masses it has.

    Masses are numbered row by row, from the lowest row, each from its left.
    """
    outer = radius + fixed
    steps = [(1, 0), (0, 1), (-1, 1)] if shape == "hex" else [(1, 0), (0, 1)]

    def ring(x: int, y: int) -> int:
        return max(abs(x), abs(y), abs(x + y) if shape == "hex" else 0)

    around = range(-outer, outer + 1)
    rows = [(x, y) for y in around for x in around]
    inner = {site: i for i, site in enumerate(s for s in rows if ring(*s) <= radius)}
    edges = []
    for x, y in rows:
        for right, up in steps:
            first, other = (x, y), (x + right, y + up)
            if max(ring(*first), ring(*other)) <= outer and (first in inner or other in inner):
                edges.append((inner.get(first, -1), inner.get(other, -1)))
    return edges, len(inner)


def _body(outcome: Equations, label: str, kind: str, arguments: dict[str, Any]) -> None:
    if kind == "STRING":
        n = arguments["masses"]
        edges = string_edges(n, arguments.get("ends", "fixed"), arguments.get("stiffness", 0.0))
    else:
        fixed = arguments.get("rim", "free") == "fixed"
        pairs, n = plate_edges(arguments.get("shape", "hex"), arguments["radius"], fixed=fixed)
        edges = [(min(pair), max(pair), 1.0) for pair in pairs]
    m = number(arguments["M"]) / n
    sigma = _decay_rate(number(arguments["t60"])) if "t60" in arguments else 0.0
    f = number(str(arguments["f"]).removesuffix("Hz"))
    omega2 = (2.0 * np.pi * f) ** 2 + sigma**2
    lowest = eigenvalues(edges, n)[0]
    k = m * omega2 / lowest
    z = 2.0 * sigma * k / omega2
    first = len(outcome.mass)
    outcome.body_masses[label] = list(range(first, first + n))
    weights = [(len(outcome.ends) + i, edge[2] * m / lowest) for i, edge in enumerate(edges)]
    outcome.bodies[label] = TunedBody(f, sigma, LINK_PITCH, weights)
    for i in range(n):
        outcome.point(f"{label}.{i}", m, 0.0, 0.0, 0.0, 0.0, 0.0)
    ground = outcome.point(f"{label}.ground", np.inf, 0.0, 0.0, 0.0, 0.0, 0.0)
    for field_, values in (("X0", outcome.x0), ("V0", outcome.v0)):
        if field_ in arguments:
            starts = arguments[field_]
            for start in starts if isinstance(starts, list) else [starts]:
                values[first + start["at"]] = number(start["x" if field_ == "X0" else "v"])
    q = number(arguments.get("hardening", 0.0))
    law = ELASTIC["cubic"] if q else ELASTIC["linear"]
    if "stretching" in arguments:
        # The links between neighbours come first; the others bend, and share no tension.
        n_links = len(string_edges(n, arguments.get("ends", "fixed"), 0.0))
        line = len(outcome.ends)
        outcome.stretched.append((line, line + n_links, number(arguments["stretching"])))
    for i, j, factor in edges:
        a = first + i if i >= 0 else ground
        outcome.link(a, first + j, law, 1, factor * k, q, 0.0, factor * z)


def _gestures(outcome: Equations, score: dict[str, Any]) -> None:
    key_of = {player: told["key"] for player, told in score.get("players", {}).items()}
    images: dict[str, dict[int, int]] = {}
    for player, events in score.get("parts", {}).items():
        key = key_of[player]
        if key not in images:
            images[key] = _free_copy(outcome, outcome.keys[key])
        for event in events:
            gesture = score["gestures"][event["play"]]
            complete = gesture if isinstance(gesture, dict) else {"notation": gesture}
            words = [word for word in complete["notation"].split() if word != "smooth"]
            points = [word.split("@") for word in words]
            x = [number(point[0]) for point in points]
            t = np.array([number(point[1]) for point in points]) + number(event["at"])
            on_rest = ([(1, 0.0), (2, 0.0)], [(1, 0.0), (2, 0.0)])
            spline = PPoly.from_spline(make_interp_spline(t, x, k=5, bc_type=on_rest))
            mass = outcome.names[key]
            tracked = complete.get("touch", "open") == "tracked"
            outcome.paths.append(Path(mass, images[key][mass], tracked, spline))


def _free_copy(outcome: Equations, members: list[int]) -> dict[int, int]:
    """Copy the masses of a key and the links between them; returns the index of each mass's
    image.
    """
    image = {}
    for i in members:
        k, z = outcome.ground[i]
        rest = outcome.push[i] / k if k else 0.0
        image[i] = outcome.point(f"free copy {i}", outcome.mass[i], k, z, rest, outcome.x0[i], 0.0)
    for (a, b), kind, row in list(zip(outcome.ends, outcome.kinds, outcome.numbers, strict=True)):
        if a in image and b in image:
            outcome.link(image[a], image[b], *kind, *row)
    return image
