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
        for part_module in modules:
            if part_module.kind in HOLDERS and part_module.kind not in FOLLOWERS:
                seen_fields = _seen(part_module.fields, reach)
                n_links = self.network.n_lia
                with self._collecting_refusals():
                    if space is None:
                        add = KINDS[part_module.kind].add
                        first_mat = add(self.network, part_module.name, seen_fields, self.seed)
                    else:
                        module_label = ".".join((name, part_module.name))
                        labels = part_module.kind, part_module.name, seen_fields
                        first_mat = add_points(
                            self.network, *labels, self._chance(module_label), module_label
                        )
                        mat_count = member_count(part_module.kind, seen_fields)
                        firsts = along(first_mat, mat_count, space.axes)
                        self.points[name, part_module.name] = firsts
                        if space.gravity:  # against the last axis
                            self.network.weigh(firsts[-1], mat_count, -space.gravity)
                    self.mats[name, part_module.name] = first_mat
                    if part_module.kind in GENERATORS:
                        self.bodies[name, part_module.name] = range(n_links, self.network.n_lia)
                    if "X0" in seen_fields and part_module.kind in GENERATORS:
                        self._starts(first_mat, seen_fields)

    def add_followers(
        self, part_name: str, part_modules: Iterable[Module], *, ca_rate: float | None = None
    ) -> None:
        """Add a part's proxies and surfaces; the masses of all parts must exist.

        Raises EngineError unless refusals are collected.
        """
        self.network.part(part_name, ca_rate=ca_rate)
        for part_module in part_modules:
            if part_module.kind == "PROXY" and self._are_there(proxies.targets(part_module.fields)):
                with self._collecting_refusals():
                    labels = part_module.name, part_module.fields
                    self.mats[part_name, part_module.name] = proxies.add(
                        self.network, *labels, self.members
                    )
            if part_module.kind == "SURFACE" and self._are_there([part_module.fields["of"]]):
                with self._collecting_refusals():
                    fields = cast("SurfaceFields", part_module.fields)
                    masses = self.members(part_module.fields["of"])
                    firsts = add_surface(self.network, part_module.name, fields, masses)
                    self.points[part_name, part_module.name] = firsts
                    self.mats[part_name, part_module.name] = firsts[0]

    def _are_there(self, targets: Iterable[Target]) -> bool:
        return all(_home(target) in self.mats for target in targets)

    def joins(
        self,
        part_name: str,
        part_modules: Iterable[Module],
        *,
        ca_rate: float | None = None,
        reach: float = 1.0,
    ) -> None:
        """Add a part's links; the <M> points of all parts must exist.

        Raises EngineError unless refusals are collected; then links to modules that were left
        out are left out too.
        """
        self.network.part(part_name, ca_rate=ca_rate)
        for part_module in part_modules:
            if self.refused and not self._are_there(following.targets(part_module)):
                continue
            if part_module.kind == "MAS":
                for _, follow_values in following.values(part_module, self.mat):
                    with self._collecting_refusals():
                        mat = self.mats[part_name, part_module.name]
                        self.network.follow_mass(part_module.name, mat, follow_values)
            if part_module.kind not in LINKS:
                continue
            ends = part_module.ends
            if self.refused and any((end.part, end.module) not in self.mats for end in ends):
                continue
            first_link = self.network.n_lia
            with self._collecting_refusals():
                module_links = list(single_links(part_module))
                for link in module_links:
                    self.link(part_name, link, *link.ends, reach=reach)
                if part_module.fields.get("box") is not None:
                    self.walls[part_name, part_module.name] = [
                        self.links[part_name, link.name] for link in module_links
                    ]
            self.links[part_name, part_module.name] = range(first_link, self.network.n_lia)

    def link(self, part: str, module: Module, a: Target, b: Target, *, reach: float = 1.0) -> int:
        """Add one link between two <M> points, or two points in space; returns its index."""
        if a.points and b.points:
            link_index = self._link_in_space(module, a, b)
            self.links[part, module.name] = range(link_index, self.network.n_lia)
            return link_index
        ends = self._end(part, a), self._end(part, b)
        if follow_values := following.values(module, self.mat):
            law_fields = picked(module.fields, "law", "damping", "constants", "rest")
            law_fields = {"law": None, "damping": None} | law_fields
            link_index = self.network.following_lnl(
                module.name, *ends, follows=follow_values, **law_fields
            )
        else:
            add = KINDS[module.kind].add
            fields = _seen(module.fields, reach)
            link_index = add(self.network, module.name, *ends, fields, reach)
        self.links[part, module.name] = range(link_index, link_index + 1)
        return link_index

    def port(self, part: str, module: str, x: float) -> None:
        """Add a fixed point at `x` [m] to which other parts link in place of a module."""
        self.network.part(f"{part}, late")
        self.ports[part, module] = self.network.sol("port", X0=x)

    def _end(self, part: str, target: Target) -> int:
        """Index of the MAT to which a link of a part goes."""
        port = None if part == target.part else self.ports.get(_home(target))
        return self.mat(target) if port is None else port

    def _link_in_space(self, link_module: Module, first_end: Target, second_end: Target) -> int:
        link_fields = link_module.fields
        first_coordinates, second = self.coordinates(first_end), self.coordinates(second_end)
        if is_pairwise(link_module.kind, link_fields, (first_end, second_end)):
            link_groups = sorted(
                ((first_coordinates, first_end.count), (second, second_end.count)),
                key=lambda group: group[1],
            )
            contact_fields = picked(
                link_fields, "K", "Z", "gap", "exponent", "clamp", "friction", "core"
            )
            contact_fields |= picked(link_fields, "cohesion", "reach")
            contact_fields["inside"] = link_fields.get("side") == "inside"
            contact_fields["normal"] = unit(link_fields.get("normal"))
            if (surface := link_fields.get("mesh")) is not None:
                contact_fields["surface"] = surface.corners, surface.faces
            return self.network.pairwise(link_module.name, *link_groups, **contact_fields)
        if link_module.kind == "BUT":
            contact_fields = picked(
                link_fields, "K", "Z", "gap", "exponent", "clamp", "cohesion", "reach"
            )
            return self.network.space_but(
                link_module.name, first_coordinates, second, **contact_fields
            )
        rest_length = 0.0 if link_module.kind == "ATTRACTION" else link_fields.get("rest")
        if rest_length is None:
            rest_length = self.network.distance(first_coordinates, second)
        if link_module.kind == "LNL":
            return self.network.space_lnl(
                link_module.name,
                first_coordinates,
                second,
                law(cast("LawFields", link_fields)),
                rest_length,
            )
        contact_fields = picked(link_fields, "K", "Z", "yields", "breaks", "core")
        return self.network.space_ref(
            link_module.name, first_coordinates, second, rest=rest_length, **contact_fields
        )

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
        first_mat = self.mats[target.part, target.module]
        if target.first == "centre":
            centre = self.network.centre(first_mat)
            return range(centre, centre + 1)
        return range(first_mat + target.first, first_mat + target.first + target.count)

    def _starts(self, first: int, fields: _Fields) -> None:
        """X0 and V0 of a generator: one value for all its MATs, or values for some."""
        initial_positions, velocity = (
            _members(self, first, fields["X0"]),
            _members(self, first, fields["V0"]),
        )
        for index in sorted(initial_positions.keys() | velocity.keys()):
            self.network.start(index, initial_positions.get(index, 0.0), velocity.get(index, 0.0))


def _home(target: Target) -> tuple[str, str]:
    return target.part, target.module


def _members(assembly: Assembly, first_mat: int, start_value: Any) -> dict[int, float]:
    """The MATs that do not start at 0, with their values."""
    mat_count = assembly.network.count(first_mat)
    if isinstance(start_value, float):
        return (
            dict.fromkeys(range(first_mat, first_mat + mat_count), start_value)
            if start_value
            else {}
        )
    by_mat: dict[int, float] = {}
    for start in start_value if isinstance(start_value, tuple) else (start_value,):
        by_mat.update(dict.fromkeys(_range(assembly, first_mat, mat_count, start), start.value))
    return by_mat


def _range(assembly: Assembly, first: int, count: int, start: Start) -> range:
    low, size = members(str(start.at), count, "")
    low = assembly.network.centre(first) if low == "centre" else first + low
    return range(low, low + size)


# --- a lever ------------------------------------------------------------------------------------

# The power of the ratio that multiplies a field: what all kinds have, then what one kind has.
_POWERS = {"X0": 1, "V0": 1, "rest": 1, "gap": 1, "M": -2, "K": -2, "Z": -2}
_POWERS |= {name: power for kind in KINDS.values() for name, power in kind.lever.items()}


def _seen(module_fields: _Fields, lever_ratio: float) -> _Fields:
    """Fields of a module behind a lever, as the piece sees them."""
    if lever_ratio == 1.0:
        return module_fields
    seen_fields = dict(module_fields)
    for field_name, power in _POWERS.items():
        if seen_fields.get(field_name) is not None:
            seen_fields[field_name] = _stretched(seen_fields[field_name], lever_ratio, power)
    for field_name in ("hardening", "stretching"):
        if seen_fields.get(field_name):
            seen_fields[field_name] /= lever_ratio**4  # q·(x/s)³/s
    if seen_fields.get("exponent", 1.0) != 1.0:
        # The force is K·(p/s)^α/s, so K gets the factor s^-(1+α); s^-2 is applied above.
        seen_fields["K"] *= lever_ratio / _core.pow(lever_ratio, seen_fields["exponent"])
    return seen_fields


def _stretched(field_value: Any, lever_ratio: float, lever_power: int) -> Any:
    """A value, or those of a generator's members, times `lever_ratio` to the power 1, -1 or -2."""
    if isinstance(field_value, tuple):
        return tuple(_stretched(member, lever_ratio, lever_power) for member in field_value)
    if isinstance(field_value, Start):
        return replace(field_value, value=_stretched(field_value.value, lever_ratio, lever_power))
    return (
        field_value * lever_ratio
        if lever_power == 1
        else field_value / (lever_ratio if lever_power == -1 else lever_ratio * lever_ratio)
    )
