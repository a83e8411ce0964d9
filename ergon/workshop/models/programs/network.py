"""Modules of a score as stepped points and links, the form that can be written for other
programs.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from ergon import _core
from ergon.instruments import following
from ergon.instruments.assemble import Assembly
from ergon.instruments.model import Module, Output, Target
from ergon.instruments.module_kinds import GENERATOR_KINDS, LINK_KINDS
from ergon.instruments.proxies import add as add_proxy
from ergon.instruments.proxies import targets
from ergon.instruments.spread import single_links
from ergon.notation.text.values import Place
from ergon.workshop.models.errors import ModelError
from ergon.workshop.models.programs.elements import (
    Body,
    Input,
    Law,
    Link,
    MixedOutput,
    Part,
    Point,
    SteppedNetwork,
)
from ergon.workshop.models.programs.masses import POINT_MAKERS

NETWORK_MAX = 200  # points: Faust takes 7 s for 150 that are joined, more than 100 s for 990

_EXPORTED_LINKS = ("RES", "FRO", "REF", "BUT", "LNL")


def stepped_network(
    parts: Sequence[Part],
    struck: Iterable[Target],
    rate: float,
    *,
    points_max: int = NETWORK_MAX,
) -> SteppedNetwork:
    """Parts as the engine steps them at `rate` [Hz], with the links between them.

    The points `struck` have an input for a force. Links to other parts are left out. There may
    be at most `points_max` points. Raises ModelError with the places of all that cannot be written.
    """
    return _Builder(SteppedNetwork(rate), points_max).build(parts, struck)


class _Builder:
    def __init__(self, network: SteppedNetwork, points_max: int) -> None:
        self.network, self.points_max = network, points_max
        self.points_by_module: dict[tuple[str, str], list[int]] = {}  # points of a module
        self.centre_by_module: dict[tuple[str, str], int] = {}
        self.links_by_module: dict[tuple[str, str], list[int]] = {}
        self.input_by_points: dict[tuple[int, ...], int] = {}  # points -> input
        self.refusals: list[tuple[Place, str]] = []

    def build(self, parts: Sequence[Part], struck: Iterable[Target]) -> SteppedNetwork:
        for part in parts:
            if part.ca_rate not in (None, self.network.rate):
                refusal_reason = f"its numbers are for {part.ca_rate:,g} Hz, and the score has"
                self._refuse(
                    part.modules[0].place,
                    f"{part.name}: {refusal_reason} {self.network.rate:,g} Hz; write the same",
                )
            for module in part.modules:
                self._add_points(part, module)
        for part in parts:
            for module in part.modules:
                if module.kind == "PROXY":
                    self._add_proxy(part, module)
        for part in parts:
            for module in part.modules:
                self._add_link_or_input(part, module)
        for part in parts:
            if part.struck_module is not None:
                self._add_force_on(self.points_by_module[part.name, part.struck_module], part.name)
        for target in struck:
            self._add_force_input(target)
        for part in parts:
            for output in part.outputs:
                self._add_output(part, output)
        if len(self.network.points) > self.points_max:
            self._refuse(
                parts[0].modules[0].place,
                f"there are {len(self.network.points):,} masses, and at most {self.points_max:,} "
                "are written",
            )
        if not any(part.outputs for part in parts):
            names = ", ".join(part.name for part in parts)
            self._refuse(parts[0].modules[0].place, f"{names} has no output; add an `out`")
        if self.refusals:
            raise refusal(self.refusals)
        self._set_first_steps()
        return self.network

    def _refuse(self, place: Place, reason: str) -> None:
        self.refusals.append((place, reason))

    # --- points ---

    def _add_points(self, part: Part, module: Module) -> None:
        key = (part.name, module.name)
        name = f"{part.name}.{module.name}" if module.name else part.name
        if module.kind in POINT_MAKERS:
            point = POINT_MAKERS[module.kind](module.fields, name, part.ca_rate, self.network.rate)
            point.is_ca, point.place = (
                part.ca_rate is not None,
                module.place,
            )
            self.points_by_module[key] = [len(self.network.points)]
            self.network.points.append(point)
        elif module.kind in GENERATOR_KINDS:
            self._add_generator(part, module, name)

    def _add_proxy(self, part: Part, module: Module) -> None:
        name, fields = f"{part.name}.{module.name}", module.fields
        self.points_by_module[part.name, module.name] = [len(self.network.points)]
        shares: list[tuple[int, float]] = []
        if fields["follows"]:
            self._refuse(module.place, f"{name}: a PROXY that follows a MAT is not written yet")
        elif any(
            (target.part, target.module) not in self.points_by_module for target in targets(fields)
        ):
            self._refuse(module.place, f"{name}: a PROXY between masses of another part")
        else:
            network = _core.Network()
            mat_by_point: dict[int, int] = {}

            def members(target: Target) -> list[int]:
                for point in self._members(target):
                    mat_by_point.setdefault(point, network.sol(f"{point}"))
                return [mat_by_point[point] for point in self._members(target)]

            proxy = add_proxy(network, name, fields, members)
            point_by_mat = {mat: point for point, mat in mat_by_point.items()}
            shares = [(point_by_mat[mat], share) for mat, share in network.shares(proxy)]
        x0 = sum(share * self.network.points[target].x0 for target, share in shares)
        v0 = sum(share * self.network.points[target].v0 for target, share in shares)
        point = Point(
            name,
            x0,
            f"PROXY between {len(shares)} masses",
            v0=v0,
            shares=tuple(shares),
        )
        point.place = module.place
        self.network.points.append(point)

    def _add_generator(self, part: Part, module: Module, name: str) -> None:
        fields, key = (module.fields, (part.name, module.name))
        self.points_by_module[key] = []
        if module.kind == "MODES":
            reason = f"{name}: MODES is a bank of resonators, and no network of masses"
            self._refuse(module.place, f"{reason}; name {part.name} for a Faust program of its own")
            return
        starts = {field_name: fields.get(field_name) or 0.0 for field_name in ("X0", "V0")}
        if not all(isinstance(value, float) for value in starts.values()):
            self._refuse(module.place, f"{name}: members that start elsewhere than the others")
            return
        assembly = Assembly()
        assembly.add_part(part.name, [module], ca_rate=part.ca_rate)
        network = assembly.network
        n_masses, table = network.count(0), network.elements([part.name])
        if not {*table.kinds} <= {"CEL", "RES", "FRO", "REF"} or (table.stiffness < 0).any():
            self._refuse(module.place, f"{name}: a {module.kind} that hardens, stretches or bends")
            return
        if n_masses > self.points_max:
            self._refuse(
                module.place,
                f"{name}: {n_masses:,} masses, and at most {self.points_max:,} are written",
            )
            return
        first_point = len(self.network.points)
        self.points_by_module[key] = list(range(first_point, first_point + n_masses))
        self.centre_by_module[key] = first_point + network.centre(0)
        row_by_mat = {mat: row for row, mat in enumerate(table.mats)}
        ground_by_row = {
            int(a): (float(k), float(z))
            for kind, a, k, z in zip(
                table.kinds, table.a, table.stiffness, table.damping, strict=True
            )
            if kind == "CEL"
        }
        rate = self.network.rate
        for member in range(n_masses):
            member_name, mat_row = f"{name}.{member}", row_by_mat.get(member)
            if mat_row is None:
                point = Point(member_name, 0.0, f"SOL of {module.kind}")
            else:
                m = float(table.masses[mat_row])
                constants = dict(
                    zip(("K", "Z"), ground_by_row.get(mat_row, (None, 0.0)), strict=True)
                )
                make_point = POINT_MAKERS["MAS" if mat_row not in ground_by_row else "CEL"]
                point = make_point({"M": m, **constants, **starts}, member_name, part.ca_rate, rate)
            point.is_ca, point.place = (part.ca_rate is not None, module.place)
            self.network.points.append(point)
        first_link = len(self.network.links)
        ground = None
        point_by_row = [first_point + mat_number for mat_number in table.mats]
        link_rows = zip(table.kinds, table.a, table.b, table.stiffness, table.damping, strict=True)
        for link_number, (link_kind, a, b, k, z) in enumerate(link_rows):
            if link_kind == "CEL":
                continue
            if ground is None and min(a, b) < 0:
                ground = len(self.network.points)
                self.network.points.append(Point(f"{name}.ground", 0.0, f"SOL of {module.kind}"))
            end_points = [ground if end < 0 else point_by_row[end] for end in (int(a), int(b))]
            constants = {"K": float(k), "Z": float(z)}
            self._add_link(
                part, f"{name}.link.{link_number}", end_points, link_kind, constants, module.place
            )
        ranges = (
            range(first_point, len(self.network.points)),
            range(first_link, len(self.network.links)),
        )
        self._add_body(module, name, n_masses, *ranges)

    def _add_body(
        self, module: Module, name: str, n_masses: int, points: range, links: range
    ) -> None:
        """Add a generator as a whole, if it is one row or one rectangle of equal masses."""
        fields = module.fields
        mass_counts = (n_masses, 1)
        if module.kind == "PLATE" and fields["shape"] == "rectangle":
            mass_counts = fields["sides"]
        elif module.kind != "STRING" or fields["ends"] == "left" or fields.get("stiffness"):
            return
        is_held = fields.get("ends") == "fixed" or fields.get("rim") == "fixed"
        body_links = [self.network.links[link] for link in links]
        distinct_masses = {self.network.points[point].mass for point in points[:n_masses]}
        link_constants = {(link.K, link.z) for link in body_links}
        n_columns, n_rows = mass_counts
        n_links = n_columns * (n_rows - 1) + n_rows * (n_columns - 1)
        if is_held:
            n_links += 2 if module.kind == "STRING" else 2 * (n_columns + n_rows)
        is_tied = any(self.network.points[point].kappa for point in points)
        if (
            len(distinct_masses) == len(link_constants) == 1
            and len(body_links) == n_links
            and not is_tied
        ):
            (K, z), *_ = link_constants
            self.network.bodies.append(
                Body(name, module.kind, is_held, mass_counts, points, links, K, z)
            )

    # --- links and inputs ---

    def _add_link_or_input(self, part: Part, module: Module) -> None:
        name = f"{part.name}.{module.name}"
        if following.followings(module):
            self._refuse(module.place, f"{name}: what follows a MAT is not written yet")
            return
        if module.kind in ("ENX", "ENF"):
            self._add_input(module, name)
        elif module.kind in LINK_KINDS:
            if module.kind not in _EXPORTED_LINKS:
                self._refuse(module.place, f"{name}: {module.kind} is not written yet")
                return
            if any("noise(" in (module.fields.get(field) or "") for field in ("law", "damping")):
                self._refuse(module.place, f"{name}: a law with `noise` is not written yet")
                return
            if module.fields.get("contact", "plain") != "plain":
                contact_kind = module.fields["contact"]
                self._refuse(
                    module.place,
                    f"{name}: a contact that is {contact_kind}; only plain is written",
                )
                return
            targets = module.ends
            missing_ends = [
                end.text for end in targets if (end.part, end.module) not in self.points_by_module
            ]
            if missing_ends:
                self.network.omissions.append(f"{name}, which joins {' and '.join(missing_ends)}")
                for end in targets:
                    self._add_force_input(end)
                return
            first_link = len(self.network.links)
            for single_link in single_links(module):
                a, b = (self._members(end)[:1] for end in single_link.ends)
                if a and b:
                    link_name = f"{part.name}.{single_link.name}"
                    self._add_link(
                        part, link_name, [*a, *b], module.kind, single_link.fields, module.place
                    )
            if (module.fields.get("K") or 0.0) < 0 and part.ca_rate is None:
                self._refuse(module.place, f"{name}: a stiffness below 0")
            self.links_by_module[part.name, module.name] = list(
                range(first_link, len(self.network.links))
            )

    def _add_link(
        self,
        part: Part,
        name: str,
        end_points: Sequence[int | None],
        kind: str,
        fields: Any,
        place: Place,
    ) -> None:
        K, Z = float(fields.get("K") or 0.0), float(fields.get("Z") or 0.0)
        z = Z * (self.network.rate if part.ca_rate is None else self.network.rate / part.ca_rate)
        a, b = (end for end in end_points if end is not None)
        units = ("", "") if part.ca_rate is not None else (" N/m", " N·s/m")
        description = f"{kind}: K = {K!r}{units[0]}, Z = {Z!r}{units[1]}"
        if kind == "LNL":
            law_fields = (
                fields[field_name] for field_name in ("law", "damping", "constants", "points")
            )
            law = Law(fields, _core.Law(*law_fields), 1.0 if part.ca_rate else self.network.rate)
            offset = float(fields["rest"])
            law_texts = (
                f"{field_name} = {fields[field_name]}"
                for field_name in ("law", "damping")
                if fields[field_name]
            )
            description = f"LNL: {', '.join([*law_texts, f'rest = {offset!r} m'])}"
            self.network.links.append(
                Link(
                    name,
                    a,
                    b,
                    0.0,
                    0.0,
                    offset,
                    description,
                    law=law,
                    place=place,
                )
            )
            return
        if kind != "BUT":
            offset = float(fields.get("rest") or 0.0)
            description += f", rest = {offset!r} m"
            self.network.links.append(Link(name, a, b, K, z, offset, description, place=place))
            return
        gap, exponent, side = float(fields["gap"]), fields["exponent"], fields["side"]
        description += f", gap = {gap!r} m, {side}, exponent = {exponent!r}"
        contact_side, is_clamped = 1 if side == "below" else -1, fields["clamp"]
        self.network.links.append(
            Link(
                name,
                a,
                b,
                K,
                z,
                gap,
                description,
                exponent,
                contact_side,
                is_clamped,
                place=place,
            )
        )

    def _members(self, target: Target) -> list[int]:
        key = (target.part, target.module)
        points = self.points_by_module.get(key, [])
        if target.first == "centre":
            return [self.centre_by_module[key]] if key in self.centre_by_module else []
        return points[target.first : target.first + target.count]

    def _add_input(self, module: Module, name: str) -> None:
        target = module.driven_mat
        if (target.part, target.module) not in self.points_by_module:
            self.network.omissions.append(f"{name}, which feeds {target.text}")
            return
        source = module.fields["from"]
        take = source if isinstance(source, str) else ""
        if module.kind == "ENF":
            if take or module.fields["at"] is not None:
                self._add_force_input(target, take)
            else:
                for member in self._members(target):
                    for mass, share in self.network.points[member].shares or [(member, 1.0)]:
                        self.network.points[mass].weight += share * float(source)
            return
        for member in self._members(target):
            point = self.network.points[member]
            if point.position_input is None:
                point.position_input = len(self.network.inputs)
                self.network.inputs.append(Input(f"position of {point.name} [m]", take))

    def _add_force_input(self, target: Target, take: str = "") -> None:
        self._add_force_on(self._members(target), target.text, take)

    def _add_force_on(self, points: Sequence[int], target_text: str, take: str = "") -> None:
        key = tuple(points)
        mobile_points = [
            point_index
            for point_index in key
            if self.network.points[point_index].mass or self.network.points[point_index].shares
        ]
        if not mobile_points or key in self.input_by_points:
            return
        input_index = self.input_by_points[key] = len(self.network.inputs)
        point_name = self.network.points[key[0]].name
        name = f"force on {point_name if len(key) == 1 else target_text} [N]"
        self.network.inputs.append(Input(name, take))
        for point_number in mobile_points:
            self.network.points[point_number].force_inputs.append(input_index)

    def _add_output(self, part: Part, output: Output) -> None:
        name = f"{part.name}.{output.name}" if output.name else part.name
        if output.nearest:
            reason = f"{name}: an output of which each member goes to its own loudspeaker"
            self._refuse(output.place, reason)
            return
        output_kind, points, links = output.kind_facts, list[int](), list[int]()
        for target in output.targets:
            if output.is_movement:
                if (target.part, target.module) not in self.points_by_module:
                    self.network.omissions.append(f"{target.text}, which {name} hears")
                points += self._members(target)
                continue
            links_of_target = self.links_by_module.get((target.part, target.module), [])
            if not links_of_target or target.first == "centre":
                quantity = "distance" if output.is_distance else output_kind.quantity
                reason = f"{name}: the {quantity} of {target.text} is not written yet"
                self._refuse(output.place, reason)
                continue
            links += links_of_target[target.first : target.first + target.count]
        output_name = f"{name} [{output_kind.unit.replace('²', '^2')}]"
        self.network.outputs.append(
            MixedOutput(output_name, points, links, output_kind.order, output.place)
        )

    # --- the first step ---

    def _set_first_steps(self) -> None:
        """Set d0 of every point: the step of its own motion, less half a step of the forces at the
        start.
        """
        points, period = self.network.points, 1.0 / self.network.rate
        forces = [0.0] * len(points)
        for link in self.network.links:
            a, b = points[link.a], points[link.b]
            separation = b.x0 - a.x0
            force = _link_force(link, separation, period * (b.v0 - a.v0))
            forces[link.a] += force
            forces[link.b] -= force
        for point, force in zip(points, tuple(forces), strict=True):
            for mass_index, share in point.shares:
                forces[mass_index] += share * force
        for point, force in zip(points, forces, strict=True):
            if point.position_input is not None or not point.mass:
                point.d0 = 0.0
            elif not point.is_ca:
                point.d0 -= 0.5 * point.gain * (force + point.weight)


def _link_force(link: Link, elongation: float, elongation_step: float) -> float:
    """Force on the first point, for x_b - x_a = e with a last step d."""
    if link.law is not None:
        return link.law.compiled.force(
            elongation - link.offset, elongation_step * link.law.per_step
        )
    if link.exponent is None:
        return link.K * (elongation - link.offset) + link.z * elongation_step
    penetration = -link.side * elongation - link.offset
    if penetration <= 0.0:
        return 0.0
    push_force = (
        link.K * _core.pow(penetration, link.exponent) - link.z * link.side * elongation_step
    )
    return -link.side * (max(push_force, 0.0) if link.is_clamped else push_force)


def refusal(refusals: Sequence[tuple[Place, str]]) -> ModelError:
    """An error that lists all that cannot be written, each with its place."""
    (first_place, first_reason), *other_refusals = refusals
    further_reasons = "".join(
        f"; {place.file}:{place.line}: {text}" for place, text in other_refusals
    )
    error = ModelError(f"{first_reason}{further_reasons}", first_place.line)
    error.file = first_place.file
    return error
