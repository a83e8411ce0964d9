"""Builds a `Network` from modules: the MATs of every part, then its links, then what is heard."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Any

from ergon import _core
from ergon.instruments import following, proxies
from ergon.instruments.members import members
from ergon.instruments.modal import Each
from ergon.instruments.model import Module, Target
from ergon.instruments.module_kinds import (
    FOLLOWERS,
    GENERATORS,
    HOLDERS,
    LINKS,
    Start,
    member_count,
)
from ergon.instruments.space import Space
from ergon.instruments.space import add as add_points
from ergon.instruments.space.points import add_surface, along, unit
from ergon.instruments.spread import is_pairwise, single_links

_Fields = Mapping[str, Any]


@dataclass(slots=True)
class Assembly:
    """A network under construction, with the index of each named module in it."""

    network: _core.Network = field(default_factory=_core.Network)
    mats: dict[tuple[str, str], int] = field(default_factory=dict)  # (part, module) -> first MAT
    # (part, module) -> LIAs of a link or of a generator; a link over a range also has one entry for
    # each of its links.
    links: dict[tuple[str, str], range] = field(default_factory=dict)
    # (part, module) -> LIAs of a box, one range for each wall
    walls: dict[tuple[str, str], list[range]] = field(default_factory=dict)
    bodies: dict[tuple[str, str], range] = field(default_factory=dict)
    seed: int = 0
    # (part, module) in space -> the MATs of its first point, axis by axis
    points: dict[tuple[str, str], list[int]] = field(default_factory=dict)
    # Why modules are left out. If None, the first refusal of the engine is raised.
    refused: list[_core.EngineError] | None = None

    def part(
        self,
        name: str,
        modules: Iterable[Module],
        *,
        ca_rate: float | None = None,
        reach: float = 1.0,
        every: int = 1,
        space: Space | None = None,
    ) -> None:
        """Add a part's <M> points. Raises EngineError unless refusals are collected.

        The springs of the part act once in `every` frames if the plan allows it.

        With `reach` s the part lies behind a lever: the piece sees s times its movement, and
        power is conserved, so m, k and z are seen as m/s², k/s², z/s² and every length as s
        times itself.
        """
        self.network.part(name, ca_rate=ca_rate, macrostep=every if every > 1 else None)
        for module in modules:
            if module.kind in HOLDERS and module.kind not in FOLLOWERS:
                fields = _seen(module.fields, reach)
                n_links = self.network.n_lia
                with self._collecting_refusals():
                    if space is None:
                        first = _MATS[module.kind](self, module.name, fields)
                    else:
                        who = ".".join((name, module.name))
                        own = module.kind, module.name, fields
                        first = add_points(self.network, *own, self._chance(who), who)
                        count = member_count(module.kind, fields)
                        firsts = along(first, count, space.axes)
                        self.points[name, module.name] = firsts
                        if space.gravity:  # against the last axis
                            self.network.weigh(firsts[-1], count, -space.gravity)
                    self.mats[name, module.name] = first
                    if module.kind in GENERATORS:
                        self.bodies[name, module.name] = range(n_links, self.network.n_lia)
                    if "X0" in fields and module.kind in GENERATORS:
                        self._starts(first, fields)

    def add_followers(
        self, name: str, modules: Iterable[Module], *, ca_rate: float | None = None
    ) -> None:
        """Add a part's proxies and surfaces; the masses of all parts must exist.

        Raises EngineError unless refusals are collected.
        """
        self.network.part(name, ca_rate=ca_rate)
        for module in modules:
            if module.kind == "PROXY" and self._are_there(proxies.targets(module.fields)):
                with self._collecting_refusals():
                    own = module.name, module.fields
                    self.mats[name, module.name] = proxies.add(self.network, *own, self.members)
            if module.kind == "SURFACE" and self._are_there([module.fields["of"]]):
                with self._collecting_refusals():
                    masses = self.members(module.fields["of"])
                    firsts = add_surface(self.network, module.name, module.fields, masses)
                    self.points[name, module.name] = firsts
                    self.mats[name, module.name] = firsts[0]

    def _are_there(self, targets: Iterable[Target]) -> bool:
        return all(_home(target) in self.mats for target in targets)

    def joins(
        self,
        name: str,
        modules: Iterable[Module],
        *,
        ca_rate: float | None = None,
        reach: float = 1.0,
    ) -> None:
        """Add a part's links; the <M> points of all parts must exist.

        Raises EngineError unless refusals are collected; then links to modules that were left
        out are left out too.
        """
        self.network.part(name, ca_rate=ca_rate)
        for module in modules:
            if self.refused and not self._are_there(following.targets(module)):
                continue
            if module.kind == "MAS":
                for _, by in following.values(module, self.mat):
                    with self._collecting_refusals():
                        mat = self.mats[name, module.name]
                        self.network.follow_mass(module.name, mat, by)
            if module.kind not in LINKS:
                continue
            ends = module.fields["between"]
            if self.refused and any((end.part, end.module) not in self.mats for end in ends):
                continue
            first = self.network.n_lia
            with self._collecting_refusals():
                own = list(single_links(module))
                for one in own:
                    self.link(name, one, *one.fields["between"], reach=reach)
                if module.fields.get("box") is not None:
                    self.walls[name, module.name] = [self.links[name, one.name] for one in own]
            self.links[name, module.name] = range(first, self.network.n_lia)

    def link(self, part: str, module: Module, a: Target, b: Target, *, reach: float = 1.0) -> int:
        """Add one link between two <M> points, or two points in space; returns its index."""
        if a.points and b.points:
            index = self._link_in_space(module, a, b)
            self.links[part, module.name] = range(index, self.network.n_lia)
            return index
        ends = self.mat(a), self.mat(b)
        if by := following.values(module, self.mat):
            own = _pick(module.fields, "law", "damping", "constants", "rest")
            own = {"law": None, "damping": None} | own
            index = self.network.following_lnl(module.name, *ends, follows=by, **own)
        else:
            make = _LINKS[module.kind]
            index = make(self, module.name, *ends, _seen(module.fields, reach), reach)
        self.links[part, module.name] = range(index, index + 1)
        return index

    def _link_in_space(self, module: Module, a: Target, b: Target) -> int:
        fields = module.fields
        first, second = self.coordinates(a), self.coordinates(b)
        if is_pairwise(module.kind, fields, (a, b)):
            groups = sorted(((first, a.count), (second, b.count)), key=lambda group: group[1])
            own = _pick(fields, "K", "Z", "gap", "exponent", "clamp", "friction", "core")
            own |= _pick(fields, "cohesion", "reach")
            own["inside"] = fields.get("side") == "inside"
            own["normal"] = unit(fields.get("normal"))
            if (surface := fields.get("mesh")) is not None:
                own["surface"] = surface.corners, surface.faces
            return self.network.pairwise(module.name, *groups, **own)
        if module.kind == "BUT":
            own = _pick(fields, "K", "Z", "gap", "exponent", "clamp", "cohesion", "reach")
            return self.network.space_but(module.name, first, second, **own)
        rest = 0.0 if module.kind == "ATTRACTION" else fields.get("rest")
        if rest is None:
            rest = self.network.distance(first, second)
        if module.kind == "LNL":
            return self.network.space_lnl(module.name, first, second, _law(fields), rest)
        own = _pick(fields, "K", "Z", "yields", "breaks", "core")
        return self.network.space_ref(module.name, first, second, rest=rest, **own)

    def _chance(self, name: str) -> Callable[[int], _core.Chance]:
        """A function that gives each member of a module, by index, its own random numbers."""
        return lambda member: _core.Chance(self.seed, "place", name, member, 0)

    @contextmanager
    def _collecting_refusals(self) -> Iterator[None]:
        """Collect what the engine refuses in this context, or raise it if refusals are not
        collected.
        """
        try:
            yield
        except _core.EngineError as error:
            if self.refused is None:
                raise
            self.refused.append(error)

    def links_of(self, where: tuple[str, str]) -> range:
        """The LIAs of a link or of a generator; empty if a module has none."""
        return self.bodies.get(where, self.links.get(where, range(0)))

    def mat(self, target: Target) -> int:
        """Index of the single MAT that a target names."""
        return self.members(target)[0]

    def coordinates(self, target: Target) -> list[int]:
        """Indices of the MATs of the first point in space that a target names, axis by axis."""
        return [first + int(target.first) for first in self.points[target.part, target.module]]

    def members(self, target: Target) -> range:
        """Indices of the MATs that a target names."""
        first = self.mats[target.part, target.module]
        if target.first == "centre":
            centre = self.network.centre(first)
            return range(centre, centre + 1)
        return range(first + target.first, first + target.first + target.count)

    def _starts(self, first: int, fields: _Fields) -> None:
        """X0 and V0 of a generator: one value for all its MATs, or values for some."""
        position, velocity = (
            _members(self, first, fields["X0"]),
            _members(self, first, fields["V0"]),
        )
        for index in sorted(position.keys() | velocity.keys()):
            self.network.start(index, position.get(index, 0.0), velocity.get(index, 0.0))


def _home(target: Target) -> tuple[str, str]:
    return target.part, target.module


def _members(assembly: Assembly, first: int, value: Any) -> dict[int, float]:
    """The MATs that do not start at 0, with their values."""
    count = assembly.network.count(first)
    if isinstance(value, float):
        return dict.fromkeys(range(first, first + count), value) if value else {}
    by_mat: dict[int, float] = {}
    for start in value if isinstance(value, tuple) else (value,):
        by_mat.update(dict.fromkeys(_range(assembly, first, count, start), start.value))
    return by_mat


def _range(assembly: Assembly, first: int, count: int, start: Start) -> range:
    low, size = members(str(start.at), count, "")
    low = assembly.network.centre(first) if low == "centre" else first + low
    return range(low, low + size)


# --- a lever ------------------------------------------------------------------------------------

_LENGTHS = ("X0", "V0", "rest", "gap", "vs", "speed")
_PER_LENGTH = ("Fc", "Fs", "F", "static")
_PER_LENGTH_SQUARED = ("M", "K", "Z", "sigma0", "sigma1", "sigma2")


def _seen(fields: _Fields, reach: float) -> _Fields:
    """Fields of a module behind a lever, as the piece sees them."""
    if reach == 1.0:
        return fields
    seen = dict(fields)
    for name in _LENGTHS:
        if name in seen:
            seen[name] = _stretched(seen[name], reach)
    for name in _PER_LENGTH:
        if seen.get(name) is not None:
            seen[name] /= reach
    for name in _PER_LENGTH_SQUARED:
        if seen.get(name) is not None:
            seen[name] /= reach * reach
    for name in ("hardening", "stretching"):
        if seen.get(name):
            seen[name] /= reach**4  # q·(x/s)³/s
    if seen.get("exponent", 1.0) != 1.0:
        # The force is K·(p/s)^α/s, so K gets the factor s^-(1+α); s^-2 is applied above.
        seen["K"] *= reach / _core.pow(reach, seen["exponent"])
    return seen


def _stretched(value: Any, reach: float) -> Any:
    """A length, or those of some members of a generator, multiplied by `reach`."""
    if isinstance(value, tuple):
        return tuple(_stretched(one, reach) for one in value)
    if isinstance(value, Start):
        return replace(value, value=value.value * reach)
    return value * reach


# --- kinds --------------------------------------------------------------------------------------


def _pick(fields: _Fields, *names: str) -> dict[str, Any]:
    return {name: fields[name] for name in names if fields.get(name) is not None}


def _mas(assembly: Assembly, name: str, f: _Fields) -> int:
    return assembly.network.mas(name, **_pick(f, "M", "X0", "V0"))


def _sol(assembly: Assembly, name: str, f: _Fields) -> int:
    return assembly.network.sol(name, **_pick(f, "X0"))


def _cel(assembly: Assembly, name: str, f: _Fields) -> int:
    # K and Z have defaults; if f is written, f and t60 replace both.
    tie = ("K", "Z") if f.get("f") is None else ("f", "t60")
    return assembly.network.cel(name, **_pick(f, "M", *tie, "X0", "V0", "rest"))


def _string(assembly: Assembly, name: str, f: _Fields) -> int:
    options = ("masses", "M", "f", "t60", "K", "Z", "ends", "stiffness", "inharmonicity")
    return assembly.network.string(name, **_pick(f, *options, "hardening", "stretching"))


def _plate(assembly: Assembly, name: str, f: _Fields) -> int:
    form = ("sides",) if f["shape"] == "rectangle" else ("shape", "radius")
    options = (*form, "M", "f", "t60", "K", "Z", "rim", "bending", "hardening")
    return assembly.network.plate(name, **_pick(f, *options))


def _bank(assembly: Assembly, name: str, f: _Fields) -> int:
    if isinstance(f["f"], Each):
        masses = (f["M"] / gain for gain in f["gain"])
        cells = list(zip(f["f"], f["t60"], masses, strict=True))
        return assembly.network.cells(name, cells=cells, **_pick(f, "place", "hole"))
    return assembly.network.bank(
        name, **_pick(f, "count", "M", "f", "t60", "spread", "place", "hole"), seed=assembly.seed
    )


def _modes(assembly: Assembly, name: str, f: _Fields) -> int:
    modes = list(zip(f["f"], f["t60"], strict=True))
    levels = list(zip(*(levels for _, levels in f["places"]), strict=True))
    return assembly.network.modal(name, M=f["M"], modes=modes, levels=levels)


def _ref(assembly: Assembly, name: str, a: int, b: int, f: _Fields, reach: float) -> int:
    return assembly.network.ref(name, a, b, **_pick(f, "K", "Z", "rest"))


def _but(assembly: Assembly, name: str, a: int, b: int, f: _Fields, reach: float) -> int:
    options = ("K", "Z", "gap", "side", "contact", "restitution", "exponent", "clamp", "steps")
    return assembly.network.but(name, a, b, **_pick(f, *options))


def _lnl(assembly: Assembly, name: str, a: int, b: int, f: _Fields, reach: float) -> int:
    return assembly.network.lnl(name, a, b, _law(f, reach), rest=f["rest"])


def _law(f: _Fields, reach: float = 1.0) -> _core.Law:
    return _core.Law(f["law"], f["damping"], f["constants"], f["points"], reach)


def _bristle(assembly: Assembly, name: str, a: int, b: int, f: _Fields, reach: float) -> int:
    options = ("sigma0", "sigma1", "sigma2", "Fc", "Fs", "vs")
    return assembly.network.bristle(name, a, b, **_pick(f, *options))


def _dry(assembly: Assembly, name: str, a: int, b: int, f: _Fields, reach: float) -> int:
    static = f["static"] or f["F"]
    if f["K"] is None:
        return assembly.network.dry(name, a, b, F=f["F"], static_level=static, speed=f["speed"])
    # Dry friction with a stiffness K is a bristle without damping.
    return assembly.network.bristle(name, a, b, sigma0=f["K"], Fc=f["F"], Fs=static, vs=f["speed"])


_MATS: dict[str, Callable[[Assembly, str, _Fields], int]] = {
    "MAS": _mas,
    "SOL": _sol,
    "CEL": _cel,
    "STRING": _string,
    "PLATE": _plate,
    "BANK": _bank,
    "MODES": _modes,
}
_LINKS: dict[str, Callable[[Assembly, str, int, int, _Fields, float], int]] = {
    "RES": _ref,
    "FRO": _ref,
    "REF": _ref,
    "BUT": _but,
    "LNL": _lnl,
    "BRISTLE": _bristle,
    "DRY": _dry,
}
