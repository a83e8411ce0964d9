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
    Fed,
    Law,
    Link,
    MixedOutput,
    Part,
    Point,
    Stepped,
)
from ergon.workshop.models.programs.masses import POINTS

NETWORK_MAX = 200  # points: Faust takes 7 s for 150 that are joined, more than 100 s for 990

_WRITTEN = ("RES", "FRO", "REF", "BUT", "LNL")


def stepped(
    program_parts: Sequence[Part],
    struck_targets: Iterable[Target],
    rate: float,
    *,
    points_max: int = NETWORK_MAX,
) -> Stepped:
    """Parts as the engine steps them at `rate` [Hz], with the links between them.

    `struck_targets` points have an input for a force. Links to other parts are left out. There may
    be at most `points_max` points. Raises ModelError with the places of all that cannot be written.
    """
    return _Builder(Stepped(rate), points_max).build(program_parts, struck_targets)


class _Builder:
    def __init__(self, target: Stepped, points_max: int) -> None:
        self.to, self.points_max = target, points_max
        self.points_by_module: dict[tuple[str, str], list[int]] = {}  # points of a module
        self.centres: dict[tuple[str, str], int] = {}
        self.links: dict[tuple[str, str], list[int]] = {}
        self.pushes: dict[tuple[int, ...], int] = {}  # points -> input
        self.refused: list[tuple[Place, str]] = []

    def build(self, parts: Sequence[Part], struck: Iterable[Target]) -> Stepped:
        for piece_part in parts:
            if piece_part.ca_rate not in (None, self.to.rate):
                refusal_reason = (
                    f"its numbers are for {piece_part.ca_rate:,g} Hz, and the score has"
                )
                self._refuse(
                    piece_part.modules[0].place,
                    f"{piece_part.name}: {refusal_reason} {self.to.rate:,g} Hz; write the same",
                )
            for part_module in piece_part.modules:
                self._holder(piece_part, part_module)
        for piece_part in parts:
            for part_module in piece_part.modules:
                if part_module.kind == "PROXY":
                    self._proxy(piece_part, part_module)
        for piece_part in parts:
            for part_module in piece_part.modules:
                self._rest(piece_part, part_module)
        for piece_part in parts:
            if piece_part.struck is not None:
                self._push_all(
                    self.points_by_module[piece_part.name, piece_part.struck], piece_part.name
                )
        for target in struck:
            self._push(target)
        for piece_part in parts:
            for output in piece_part.outputs:
                self._output(piece_part, output)
        if len(self.to.points) > self.points_max:
            self._refuse(
                parts[0].modules[0].place,
                f"there are {len(self.to.points):,} masses, and at most {self.points_max:,} are "
                "written",
            )
        if not any(part.outputs for part in parts):
            names = ", ".join(part.name for part in parts)
            self._refuse(parts[0].modules[0].place, f"{names} has no output; add an `out`")
        if self.refused:
            raise refusal(self.refused)
        self._start()
        return self.to

    def _refuse(self, place: Place, reason: str) -> None:
        self.refused.append((place, reason))

    # --- points ---

    def _holder(self, piece_part: Part, part_module: Module) -> None:
        module_key = (piece_part.name, part_module.name)
        holder_name = (
            f"{piece_part.name}.{part_module.name}" if part_module.name else piece_part.name
        )
        if part_module.kind in POINTS:
            holder_point = POINTS[part_module.kind](
                part_module.fields, holder_name, piece_part.ca_rate, self.to.rate
            )
            holder_point.is_ca, holder_point.place = (
                piece_part.ca_rate is not None,
                part_module.place,
            )
            self.points_by_module[module_key] = [len(self.to.points)]
            self.to.points.append(holder_point)
        elif part_module.kind in GENERATOR_KINDS:
            self._generator(piece_part, part_module, holder_name)

    def _proxy(self, part: Part, proxy_module: Module) -> None:
        proxy_name, module_fields = f"{part.name}.{proxy_module.name}", proxy_module.fields
        self.points_by_module[part.name, proxy_module.name] = [len(self.to.points)]
        mass_shares: list[tuple[int, float]] = []
        if module_fields["follows"]:
            self._refuse(
                proxy_module.place, f"{proxy_name}: a PROXY that follows a MAT is not written yet"
            )
        elif any(
            (point_index.part, point_index.module) not in self.points_by_module
            for point_index in targets(module_fields)
        ):
            self._refuse(
                proxy_module.place, f"{proxy_name}: a PROXY between masses of another part"
            )
        else:
            network = _core.Network()
            mats: dict[int, int] = {}

            def members(target: Target) -> list[int]:
                for point in self._members(target):
                    mats.setdefault(point, network.sol(f"{point}"))
                return [mats[point] for point in self._members(target)]

            proxy = add_proxy(network, proxy_name, module_fields, members)
            points = {mat: point for point, mat in mats.items()}
            mass_shares = [(points[mat], share) for mat, share in network.shares(proxy)]
        x0 = sum(share * self.to.points[point_index].x0 for point_index, share in mass_shares)
        v0 = sum(share * self.to.points[point_index].v0 for point_index, share in mass_shares)
        proxy_point = Point(
            proxy_name,
            x0,
            f"PROXY between {len(mass_shares)} masses",
            v0=v0,
            shares=tuple(mass_shares),
        )
        proxy_point.place = proxy_module.place
        self.to.points.append(proxy_point)

    def _generator(self, part: Part, module: Module, name: str) -> None:
        fields, module_key = (module.fields, (part.name, module.name))
        self.points_by_module[module_key] = []
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
        count, table = network.count(0), network.elements([part.name])
        if not {*table.kinds} <= {"CEL", "RES", "FRO", "REF"} or (table.stiffness < 0).any():
            self._refuse(module.place, f"{name}: a {module.kind} that hardens, stretches or bends")
            return
        if count > self.points_max:
            self._refuse(
                module.place,
                f"{name}: {count:,} masses, and at most {self.points_max:,} are written",
            )
            return
        first_point = len(self.to.points)
        self.points_by_module[module_key] = list(range(first_point, first_point + count))
        self.centres[module_key] = first_point + network.centre(0)
        slots = {mat: slot for slot, mat in enumerate(table.mats)}
        ties = {
            int(a): (float(k), float(z))
            for kind, a, k, z in zip(
                table.kinds, table.a, table.stiffness, table.damping, strict=True
            )
            if kind == "CEL"
        }
        rate = self.to.rate
        for member in range(count):
            member_name, slot_index = f"{name}.{member}", slots.get(member)
            if slot_index is None:
                point = Point(member_name, 0.0, f"SOL of {module.kind}")
            else:
                m = float(table.masses[slot_index])
                tie = dict(zip(("K", "Z"), ties.get(slot_index, (None, 0.0)), strict=True))
                make = POINTS["MAS" if slot_index not in ties else "CEL"]
                point = make({"M": m, **tie, **starts}, member_name, part.ca_rate, rate)
            point.is_ca, point.place = (part.ca_rate is not None, module.place)
            self.to.points.append(point)
        first_link = len(self.to.links)
        ground = None
        point_indices = [first_point + mat for mat in table.mats]
        link_rows = zip(table.kinds, table.a, table.b, table.stiffness, table.damping, strict=True)
        for link_number, (link_kind, a, b, k, z) in enumerate(link_rows):
            if link_kind == "CEL":
                continue
            if ground is None and min(a, b) < 0:
                ground = len(self.to.points)
                self.to.points.append(Point(f"{name}.ground", 0.0, f"SOL of {module.kind}"))
            end_points = [ground if end < 0 else point_indices[end] for end in (int(a), int(b))]
            tie = {"K": float(k), "Z": float(z)}
            self._join(part, f"{name}.link.{link_number}", end_points, link_kind, tie, module.place)
        point_range = range(first_point, len(self.to.points)), range(first_link, len(self.to.links))
        self._body(module, name, count, *point_range)

    def _body(self, module: Module, name: str, count: int, points: range, links: range) -> None:
        """Add a generator as a whole, if it is one row or one rectangle of equal masses."""
        module_fields = module.fields
        mesh_sides = (count, 1)
        if module.kind == "PLATE" and module_fields["shape"] == "rectangle":
            mesh_sides = module_fields["sides"]
        elif (
            module.kind != "STRING"
            or module_fields["ends"] == "left"
            or module_fields.get("stiffness")
        ):
            return
        is_held = module_fields.get("ends") == "fixed" or module_fields.get("rim") == "fixed"
        body_links = [self.to.links[link] for link in links]
        masses = {self.to.points[point].mass for point in points[:count]}
        ties = {(link.K, link.z) for link in body_links}
        column_count, row_count = mesh_sides
        expected = column_count * (row_count - 1) + row_count * (column_count - 1)
        if is_held:
            expected += 2 if module.kind == "STRING" else 2 * (column_count + row_count)
        is_tied = any(self.to.points[point].kappa for point in points)
        if len(masses) == len(ties) == 1 and len(body_links) == expected and not is_tied:
            (K, z), *_ = ties
            self.to.bodies.append(Body(name, module.kind, is_held, mesh_sides, points, links, K, z))

    # --- links and inputs ---

    def _rest(self, part: Part, module: Module) -> None:
        ground_name = f"{part.name}.{module.name}"
        if following.followings(module):
            self._refuse(module.place, f"{ground_name}: what follows a MAT is not written yet")
            return
        if module.kind in ("ENX", "ENF"):
            self._input(module, ground_name)
        elif module.kind in LINK_KINDS:
            if module.kind not in _WRITTEN:
                self._refuse(module.place, f"{ground_name}: {module.kind} is not written yet")
                return
            if any("noise(" in (module.fields.get(field) or "") for field in ("law", "damping")):
                self._refuse(module.place, f"{ground_name}: a law with `noise` is not written yet")
                return
            if module.fields.get("contact", "plain") != "plain":
                contact_kind = module.fields["contact"]
                self._refuse(
                    module.place,
                    f"{ground_name}: a contact that is {contact_kind}; only plain is written",
                )
                return
            end_targets = module.ends
            other_fields = [
                end.text
                for end in end_targets
                if (end.part, end.module) not in self.points_by_module
            ]
            if other_fields:
                self.to.left_out.append(f"{ground_name}, which joins {' and '.join(other_fields)}")
                for end in end_targets:
                    self._push(end)
                return
            first_link = len(self.to.links)
            for single_link in single_links(module):
                a, b = (self._members(end)[:1] for end in single_link.ends)
                if a and b:
                    link_name = f"{part.name}.{single_link.name}"
                    self._join(
                        part, link_name, [*a, *b], module.kind, single_link.fields, module.place
                    )
            if (module.fields.get("K") or 0.0) < 0 and part.ca_rate is None:
                self._refuse(module.place, f"{ground_name}: a stiffness below 0")
            self.links[part.name, module.name] = list(range(first_link, len(self.to.links)))

    def _join(
        self,
        part: Part,
        name: str,
        end_points: Sequence[int | None],
        kind: str,
        fields: Any,
        place: Place,
    ) -> None:
        K, Z = float(fields.get("K") or 0.0), float(fields.get("Z") or 0.0)
        z = Z * (self.to.rate if part.ca_rate is None else self.to.rate / part.ca_rate)
        first_end, second_end = (end for end in end_points if end is not None)
        units = ("", "") if part.ca_rate is not None else (" N/m", " N·s/m")
        description = f"{kind}: K = {K!r}{units[0]}, Z = {Z!r}{units[1]}"
        if kind == "LNL":
            terms = (fields[field_name] for field_name in ("law", "damping", "constants", "points"))
            law = Law(fields, _core.Law(*terms), 1.0 if part.ca_rate else self.to.rate)
            rest_length = float(fields["rest"])
            contact_words = (
                f"{field_name} = {fields[field_name]}"
                for field_name in ("law", "damping")
                if fields[field_name]
            )
            description = f"LNL: {', '.join([*contact_words, f'rest = {rest_length!r} m'])}"
            self.to.links.append(
                Link(
                    name,
                    first_end,
                    second_end,
                    0.0,
                    0.0,
                    rest_length,
                    description,
                    law=law,
                    place=place,
                )
            )
            return
        if kind != "BUT":
            rest_length = float(fields.get("rest") or 0.0)
            description += f", rest = {rest_length!r} m"
            self.to.links.append(
                Link(name, first_end, second_end, K, z, rest_length, description, place=place)
            )
            return
        gap, exponent, side = float(fields["gap"]), fields["exponent"], fields["side"]
        description += f", gap = {gap!r} m, {side}, exponent = {exponent!r}"
        side_sign, clamped = 1 if side == "below" else -1, fields["clamp"]
        self.to.links.append(
            Link(
                name,
                first_end,
                second_end,
                K,
                z,
                gap,
                description,
                exponent,
                side_sign,
                clamped,
                place=place,
            )
        )

    def _members(self, target: Target) -> list[int]:
        module_key = (target.part, target.module)
        members = self.points_by_module.get(module_key, [])
        if target.first == "centre":
            return [self.centres[module_key]] if module_key in self.centres else []
        return members[target.first : target.first + target.count]

    def _input(self, module: Module, name: str) -> None:
        driven_target = module.driven_mat
        if (driven_target.part, driven_target.module) not in self.points_by_module:
            self.to.left_out.append(f"{name}, which feeds {driven_target.text}")
            return
        drive_source = module.fields["from"]
        take = drive_source if isinstance(drive_source, str) else ""
        if module.kind == "ENF":
            if take or module.fields["at"] is not None:
                self._push(driven_target, take)
            else:
                for member in self._members(driven_target):
                    for mass, share in self.to.points[member].shares or [(member, 1.0)]:
                        self.to.points[mass].weight += share * float(drive_source)
            return
        for member in self._members(driven_target):
            pushed_point = self.to.points[member]
            if pushed_point.fed is None:
                pushed_point.fed = len(self.to.inputs)
                self.to.inputs.append(Fed(f"position of {pushed_point.name} [m]", take))

    def _push(self, target: Target, take: str = "") -> None:
        self._push_all(self._members(target), target.text, take)

    def _push_all(self, points: Sequence[int], push_text: str, take: str = "") -> None:
        pushed_points = tuple(points)
        moved = [
            point_index
            for point_index in pushed_points
            if self.to.points[point_index].mass or self.to.points[point_index].shares
        ]
        if not moved or pushed_points in self.pushes:
            return
        input_number = self.pushes[pushed_points] = len(self.to.inputs)
        point_index = self.to.points[pushed_points[0]].name
        name = f"force on {point_index if len(pushed_points) == 1 else push_text} [N]"
        self.to.inputs.append(Fed(name, take))
        for member in moved:
            self.to.points[member].forces.append(input_number)

    def _output(self, part: Part, output: Output) -> None:
        name = f"{part.name}.{output.name}" if output.name else part.name
        if output.nearest:
            refusal_reason = f"{name}: an output of which each member goes to its own loudspeaker"
            self._refuse(output.place, refusal_reason)
            return
        traits, output_points, output_links = output.kind_facts, list[int](), list[int]()
        for output_target in output.targets:
            if output.is_movement:
                if (output_target.part, output_target.module) not in self.points_by_module:
                    self.to.left_out.append(f"{output_target.text}, which {name} hears")
                output_points += self._members(output_target)
                continue
            link_members = self.links.get((output_target.part, output_target.module), [])
            if not link_members or output_target.first == "centre":
                quantity = "distance" if output.is_distance else traits.quantity
                refusal_reason = (
                    f"{name}: the {quantity} of {output_target.text} is not written yet"
                )
                self._refuse(output.place, refusal_reason)
                continue
            output_links += link_members[
                output_target.first : output_target.first + output_target.count
            ]
        output_name = f"{name} [{traits.unit.replace('²', '^2')}]"
        self.to.outputs.append(
            MixedOutput(output_name, output_points, output_links, traits.order, output.place)
        )

    # --- the first step ---

    def _start(self) -> None:
        """Set d0 of every point: the step of its own motion, less half a step of the forces at the
        start.
        """
        stepped_points, T = self.to.points, 1.0 / self.to.rate
        point_forces = [0.0] * len(stepped_points)
        for stepped_link in self.to.links:
            a, b = stepped_points[stepped_link.a], stepped_points[stepped_link.b]
            e = b.x0 - a.x0
            f = _pull(stepped_link, e, T * (b.v0 - a.v0))
            point_forces[stepped_link.a] += f
            point_forces[stepped_link.b] -= f
        for stepped_point, f in zip(stepped_points, tuple(point_forces), strict=True):
            for base, share in stepped_point.shares:
                point_forces[base] += share * f
        for stepped_point, f in zip(stepped_points, point_forces, strict=True):
            if stepped_point.fed is not None or not stepped_point.mass:
                stepped_point.d0 = 0.0
            elif not stepped_point.is_ca:
                stepped_point.d0 -= 0.5 * stepped_point.gain * (f + stepped_point.weight)


def _pull(stepped_link: Link, e: float, d: float) -> float:
    """Force on the first point, for x_b - x_a = e with a last step d."""
    if stepped_link.law is not None:
        return stepped_link.law.compiled.force(
            e - stepped_link.offset, d * stepped_link.law.per_step
        )
    if stepped_link.exponent is None:
        return stepped_link.K * (e - stepped_link.offset) + stepped_link.z * d
    p = -stepped_link.side * e - stepped_link.offset
    if p <= 0.0:
        return 0.0
    size = (
        stepped_link.K * _core.pow(p, stepped_link.exponent)
        - stepped_link.z * stepped_link.side * d
    )
    return -stepped_link.side * (max(size, 0.0) if stepped_link.is_clamped else size)


def refusal(refused: Sequence[tuple[Place, str]]) -> ModelError:
    """An error that lists all that cannot be written, each with its place."""
    (first_place, first_reason), *other_refusals = refused
    further_reasons = "".join(
        f"; {place.file}:{place.line}: {text}" for place, text in other_refusals
    )
    error = ModelError(f"{first_reason}{further_reasons}", first_place.line)
    error.file = first_place.file
    return error
