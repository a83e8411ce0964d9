"""Builds a `Network` from modules: the MATs of every part, then its links, then what is heard."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Any, cast

from ergon import _core
from ergon.instruments import following, proxies
from ergon.instruments.kinds.kind import picked
from ergon.instruments.kinds.lnl import LawFields, law
from ergon.instruments.members import members
from ergon.instruments.model import Module, Target
from ergon.instruments.module_kinds import (
    FOLLOWERS,
    GENERATORS,
    HOLDERS,
    KINDS,
    LINKS,
    member_count,
)
from ergon.instruments.space import Space
from ergon.instruments.space import add as add_points
from ergon.instruments.space.points import SurfaceFields, add_surface, along, unit
from ergon.instruments.spread import is_pairwise, single_links
from ergon.instruments.starts import Start

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
    # (part, module) of a key whose motor is late -> the point in its place for links of other parts
    ports: dict[tuple[str, str], int] = field(default_factory=dict)
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
                        add = KINDS[module.kind].add
                        first = add(self.network, module.name, fields, self.seed)
                    else:
                        who = ".".join((name, module.name))
                        labels = module.kind, module.name, fields
                        first = add_points(self.network, *labels, self._chance(who), who)
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
                    labels = module.name, module.fields
                    self.mats[name, module.name] = proxies.add(self.network, *labels, self.members)
            if module.kind == "SURFACE" and self._are_there([module.fields["of"]]):
                with self._collecting_refusals():
                    fields = cast("SurfaceFields", module.fields)
                    masses = self.members(module.fields["of"])
                    firsts = add_surface(self.network, module.name, fields, masses)
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
            ends = module.ends
            if self.refused and any((end.part, end.module) not in self.mats for end in ends):
                continue
            first = self.network.n_lia
            with self._collecting_refusals():
                links = list(single_links(module))
                for link in links:
                    self.link(name, link, *link.ends, reach=reach)
                if module.fields.get("box") is not None:
                    self.walls[name, module.name] = [self.links[name, link.name] for link in links]
            self.links[name, module.name] = range(first, self.network.n_lia)

    def link(self, part: str, module: Module, a: Target, b: Target, *, reach: float = 1.0) -> int:
        """Add one link between two <M> points, or two points in space; returns its index."""
        if a.points and b.points:
            index = self._link_in_space(module, a, b)
            self.links[part, module.name] = range(index, self.network.n_lia)
            return index
        ends = self._end(part, a), self._end(part, b)
        if by := following.values(module, self.mat):
            law_fields = picked(module.fields, "law", "damping", "constants", "rest")
            law_fields = {"law": None, "damping": None} | law_fields
            index = self.network.following_lnl(module.name, *ends, follows=by, **law_fields)
        else:
            add = KINDS[module.kind].add
            fields = _seen(module.fields, reach)
            index = add(self.network, module.name, *ends, fields, reach)
        self.links[part, module.name] = range(index, index + 1)
        return index

    def port(self, part: str, module: str, x: float) -> None:
        """Add a fixed point at `x` [m] to which other parts link in place of a module."""
        self.network.part(f"{part}, late")
        self.ports[part, module] = self.network.sol("port", X0=x)

    def _end(self, part: str, target: Target) -> int:
        """Index of the MAT to which a link of a part goes."""
        port = None if part == target.part else self.ports.get(_home(target))
        return self.mat(target) if port is None else port

    def _link_in_space(self, module: Module, a: Target, b: Target) -> int:
        fields = module.fields
        first, second = self.coordinates(a), self.coordinates(b)
        if is_pairwise(module.kind, fields, (a, b)):
            groups = sorted(((first, a.count), (second, b.count)), key=lambda group: group[1])
            contact_fields = picked(
                fields, "K", "Z", "gap", "exponent", "clamp", "friction", "core"
            )
            contact_fields |= picked(fields, "cohesion", "reach")
            contact_fields["inside"] = fields.get("side") == "inside"
            contact_fields["normal"] = unit(fields.get("normal"))
            if (surface := fields.get("mesh")) is not None:
                contact_fields["surface"] = surface.corners, surface.faces
            return self.network.pairwise(module.name, *groups, **contact_fields)
        if module.kind == "BUT":
            contact_fields = picked(
                fields, "K", "Z", "gap", "exponent", "clamp", "cohesion", "reach"
            )
            return self.network.space_but(module.name, first, second, **contact_fields)
        rest = 0.0 if module.kind == "ATTRACTION" else fields.get("rest")
        if rest is None:
            rest = self.network.distance(first, second)
        if module.kind == "LNL":
            return self.network.space_lnl(
                module.name, first, second, law(cast("LawFields", fields)), rest
            )
        contact_fields = picked(fields, "K", "Z", "yields", "breaks", "core")
        return self.network.space_ref(module.name, first, second, rest=rest, **contact_fields)

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

# The power of the ratio that multiplies a field: what all kinds have, then what one kind has.
_POWERS = {"X0": 1, "V0": 1, "rest": 1, "gap": 1, "M": -2, "K": -2, "Z": -2}
_POWERS |= {name: power for kind in KINDS.values() for name, power in kind.lever.items()}


def _seen(fields: _Fields, reach: float) -> _Fields:
    """Fields of a module behind a lever, as the piece sees them."""
    if reach == 1.0:
        return fields
    seen = dict(fields)
    for name, power in _POWERS.items():
        if seen.get(name) is not None:
            seen[name] = _stretched(seen[name], reach, power)
    for name in ("hardening", "stretching"):
        if seen.get(name):
            seen[name] /= reach**4  # q·(x/s)³/s
    if seen.get("exponent", 1.0) != 1.0:
        # The force is K·(p/s)^α/s, so K gets the factor s^-(1+α); s^-2 is applied above.
        seen["K"] *= reach / _core.pow(reach, seen["exponent"])
    return seen


def _stretched(value: Any, reach: float, power: int) -> Any:
    """A value, or those of some members of a generator, times `reach` to the power 1, -1 or -2."""
    if isinstance(value, tuple):
        return tuple(_stretched(each, reach, power) for each in value)
    if isinstance(value, Start):
        return replace(value, value=_stretched(value.value, reach, power))
    return value * reach if power == 1 else value / (reach if power == -1 else reach * reach)
