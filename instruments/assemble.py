"""Builds a `Network` from modules: the MATs of every part, then its links, then what is heard."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Any, cast

from ergon import _core
from ergon.instruments import following, proxies
from ergon.instruments.kinds.kind import present_fields
from ergon.instruments.kinds.lnl import LawFields, compiled_law
from ergon.instruments.members import parse_members
from ergon.instruments.model import Module, Target
from ergon.instruments.module_kinds import (
    FOLLOWER_KINDS,
    GENERATOR_KINDS,
    KINDS,
    LINK_KINDS,
    POINT_KINDS,
    member_count,
)
from ergon.instruments.space import Space
from ergon.instruments.space import add as add_points
from ergon.instruments.space.points import SurfaceFields, add_surface, mats_by_axis, unit_vector
from ergon.instruments.spread import is_pairwise, single_links
from ergon.instruments.starts import Start

_ModuleFields = Mapping[str, Any]


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
    generator_links: dict[tuple[str, str], range] = field(default_factory=dict)
    seed: int = 0
    # (part, module) in space -> the MATs of its first point, axis by axis
    points: dict[tuple[str, str], list[int]] = field(default_factory=dict)
    # (part, module) of a key whose motor is late -> the point in its place for links of other parts
    ports: dict[tuple[str, str], int] = field(default_factory=dict)
    # Why modules are left out. If None, the first refusal of the engine is raised.
    refusals: list[_core.EngineError] | None = None

    def add_part(
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
            if module.kind in POINT_KINDS and module.kind not in FOLLOWER_KINDS:
                fields = _fields_behind_lever(module.fields, reach)
                n_links = self.network.n_lia
                with self._collecting_refusals():
                    if space is None:
                        add_module = KINDS[module.kind].add
                        first_mat = add_module(self.network, module.name, fields, self.seed)
                    else:
                        module_label = ".".join((name, module.name))
                        module_arguments = module.kind, module.name, fields
                        first_mat = add_points(
                            self.network,
                            *module_arguments,
                            self._chance_of_member(module_label),
                            module_label,
                        )
                        n_points = member_count(module.kind, fields)
                        first_mat_by_axis = mats_by_axis(first_mat, n_points, space.axes)
                        self.points[name, module.name] = first_mat_by_axis
                        if space.gravity:  # against the last axis
                            self.network.weigh(first_mat_by_axis[-1], n_points, -space.gravity)
                    self.mats[name, module.name] = first_mat
                    if module.kind in GENERATOR_KINDS:
                        self.generator_links[name, module.name] = range(n_links, self.network.n_lia)
                    if "X0" in fields and module.kind in GENERATOR_KINDS:
                        self._set_start_values(first_mat, fields)

    def add_followers(
        self, part_name: str, part_modules: Iterable[Module], *, ca_rate: float | None = None
    ) -> None:
        """Add a part's proxies and surfaces; the masses of all parts must exist.

        Raises EngineError unless refusals are collected.
        """
        self.network.part(part_name, ca_rate=ca_rate)
        for module in part_modules:
            if module.kind == "PROXY" and self._all_exist(proxies.targets(module.fields)):
                with self._collecting_refusals():
                    proxy_arguments = module.name, module.fields
                    self.mats[part_name, module.name] = proxies.add(
                        self.network, *proxy_arguments, self.members
                    )
            if module.kind == "SURFACE" and self._all_exist([module.fields["of"]]):
                with self._collecting_refusals():
                    fields = cast("SurfaceFields", module.fields)
                    masses = self.members(module.fields["of"])
                    first_mats = add_surface(self.network, module.name, fields, masses)
                    self.points[part_name, module.name] = first_mats
                    self.mats[part_name, module.name] = first_mats[0]

    def _all_exist(self, targets: Iterable[Target]) -> bool:
        return all(_module_key(target) in self.mats for target in targets)

    def add_links(
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
        for module in part_modules:
            if self.refusals and not self._all_exist(following.targets(module)):
                continue
            if module.kind == "MAS":
                for _, follow_values in following.engine_values(module, self.mat):
                    with self._collecting_refusals():
                        mat = self.mats[part_name, module.name]
                        self.network.follow_mass(module.name, mat, follow_values)
            if module.kind not in LINK_KINDS:
                continue
            ends = module.ends
            if self.refusals and any((end.part, end.module) not in self.mats for end in ends):
                continue
            first_link = self.network.n_lia
            with self._collecting_refusals():
                module_links = list(single_links(module))
                for link in module_links:
                    self.add_link(part_name, link, *link.ends, reach=reach)
                if module.fields.get("box") is not None:
                    self.walls[part_name, module.name] = [
                        self.links[part_name, link.name] for link in module_links
                    ]
            self.links[part_name, module.name] = range(first_link, self.network.n_lia)

    def add_link(
        self, part: str, module: Module, a: Target, b: Target, *, reach: float = 1.0
    ) -> int:
        """Add one link between two <M> points, or two points in space; returns its index."""
        if a.points and b.points:
            link_index = self._link_in_space(module, a, b)
            self.links[part, module.name] = range(link_index, self.network.n_lia)
            return link_index
        ends = self._end_mat(part, a), self._end_mat(part, b)
        if follow_values := following.engine_values(module, self.mat):
            law_fields = present_fields(module.fields, "law", "damping", "constants", "rest")
            law_fields = {"law": None, "damping": None} | law_fields
            link_index = self.network.following_lnl(
                module.name, *ends, follows=follow_values, **law_fields
            )
        else:
            add_module = KINDS[module.kind].add
            fields = _fields_behind_lever(module.fields, reach)
            link_index = add_module(self.network, module.name, *ends, fields, reach)
        self.links[part, module.name] = range(link_index, link_index + 1)
        return link_index

    def add_port(self, part: str, module: str, x: float) -> None:
        """Add a fixed point at `x` [m] to which other parts link in place of a module."""
        self.network.part(f"{part}, late")
        self.ports[part, module] = self.network.sol("port", X0=x)

    def _end_mat(self, part: str, target: Target) -> int:
        """Index of the MAT to which a link of a part goes."""
        port = None if part == target.part else self.ports.get(_module_key(target))
        return self.mat(target) if port is None else port

    def _link_in_space(self, link: Module, first_end: Target, second_end: Target) -> int:
        fields = link.fields
        mats_a, mats_b = (
            self.coordinates(first_end),
            self.coordinates(second_end),
        )
        if is_pairwise(link.kind, fields, (first_end, second_end)):
            groups = sorted(
                ((mats_a, first_end.count), (mats_b, second_end.count)),
                key=lambda group: group[1],
            )
            contact_fields = present_fields(
                fields, "K", "Z", "gap", "exponent", "clamp", "friction", "core"
            )
            contact_fields |= present_fields(fields, "cohesion", "reach")
            contact_fields["inside"] = fields.get("side") == "inside"
            contact_fields["normal"] = unit_vector(fields.get("normal"))
            if (surface := fields.get("mesh")) is not None:
                contact_fields["surface"] = surface.corners, surface.faces
            return self.network.pairwise(link.name, *groups, **contact_fields)
        if link.kind == "BUT":
            contact_fields = present_fields(
                fields, "K", "Z", "gap", "exponent", "clamp", "cohesion", "reach"
            )
            return self.network.space_but(link.name, mats_a, mats_b, **contact_fields)
        rest_length = 0.0 if link.kind == "ATTRACTION" else fields.get("rest")
        if rest_length is None:
            rest_length = self.network.distance(mats_a, mats_b)
        if link.kind == "LNL":
            return self.network.space_lnl(
                link.name,
                mats_a,
                mats_b,
                compiled_law(cast("LawFields", fields)),
                rest_length,
            )
        spring_fields = present_fields(fields, "K", "Z", "yields", "breaks", "core")
        return self.network.space_ref(
            link.name,
            mats_a,
            mats_b,
            rest=rest_length,
            **spring_fields,
        )

    def _chance_of_member(self, name: str) -> Callable[[int], _core.Chance]:
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
            if self.refusals is None:
                raise
            self.refusals.append(error)

    def links_of(self, module_key: tuple[str, str]) -> range:
        """The LIAs of a link or of a generator; empty if a module has none."""
        return self.generator_links.get(module_key, self.links.get(module_key, range(0)))

    def mat(self, target: Target) -> int:
        """Index of the single MAT that a target names."""
        return self.members(target)[0]

    def coordinates(self, target: Target) -> list[int]:
        """Indices of the MATs of the first point in space that a target names, axis by axis."""
        return [
            first_mat + int(target.first) for first_mat in self.points[target.part, target.module]
        ]

    def members(self, target: Target) -> range:
        """Indices of the MATs that a target names."""
        first_mat = self.mats[target.part, target.module]
        if target.first == "centre":
            centre = self.network.centre(first_mat)
            return range(centre, centre + 1)
        return range(first_mat + target.first, first_mat + target.first + target.count)

    def _set_start_values(self, first: int, fields: _ModuleFields) -> None:
        """X0 and V0 of a generator: one value for all its MATs, or values for some."""
        initial_positions, initial_velocities = (
            _start_values_by_mat(self, first, fields["X0"]),
            _start_values_by_mat(self, first, fields["V0"]),
        )
        for index in sorted(initial_positions.keys() | initial_velocities.keys()):
            self.network.start(
                index, initial_positions.get(index, 0.0), initial_velocities.get(index, 0.0)
            )


def _module_key(target: Target) -> tuple[str, str]:
    return target.part, target.module


def _start_values_by_mat(assembly: Assembly, first_mat: int, start_value: Any) -> dict[int, float]:
    """The MATs that do not start at 0, with their values."""
    n_mats = assembly.network.count(first_mat)
    if isinstance(start_value, float):
        return (
            dict.fromkeys(range(first_mat, first_mat + n_mats), start_value) if start_value else {}
        )
    by_mat: dict[int, float] = {}
    for start in start_value if isinstance(start_value, tuple) else (start_value,):
        by_mat.update(dict.fromkeys(_member_mats(assembly, first_mat, n_mats, start), start.value))
    return by_mat


def _member_mats(assembly: Assembly, first: int, count: int, start: Start) -> range:
    low, size = parse_members(str(start.at), count, "")
    low = assembly.network.centre(first) if low == "centre" else first + low
    return range(low, low + size)


# --- a lever ------------------------------------------------------------------------------------

# The power of the ratio that multiplies a field: what all kinds have, then what one kind has.
_LEVER_POWERS = {"X0": 1, "V0": 1, "rest": 1, "gap": 1, "M": -2, "K": -2, "Z": -2}
_LEVER_POWERS |= {
    name: power for kind in KINDS.values() for name, power in kind.lever_powers.items()
}


def _fields_behind_lever(fields: _ModuleFields, ratio: float) -> _ModuleFields:
    """Fields of a module behind a lever, as the piece sees them."""
    if ratio == 1.0:
        return fields
    seen_fields = dict(fields)
    for field_name, power in _LEVER_POWERS.items():
        if seen_fields.get(field_name) is not None:
            seen_fields[field_name] = _times_power(seen_fields[field_name], ratio, power)
    for field_name in ("hardening", "stretching"):
        if seen_fields.get(field_name):
            seen_fields[field_name] /= ratio**4  # q·(x/s)³/s
    if seen_fields.get("exponent", 1.0) != 1.0:
        # The force is K·(p/s)^α/s, so K gets the factor s^-(1+α); s^-2 is applied above.
        seen_fields["K"] *= ratio / _core.pow(ratio, seen_fields["exponent"])
    return seen_fields


def _times_power(value: Any, ratio: float, power: int) -> Any:
    """A value, or those of a generator's members, times `ratio` to the power 1, -1 or -2."""
    if isinstance(value, tuple):
        return tuple(_times_power(member, ratio, power) for member in value)
    if isinstance(value, Start):
        return replace(value, value=_times_power(value.value, ratio, power))
    return value * ratio if power == 1 else value / (ratio if power == -1 else ratio * ratio)
