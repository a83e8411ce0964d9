"""A piece whose outputs are points to measure: single masses, ends of contacts, members that are
heard.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

from ergon.instruments.model import Instrument, Module, Output, Target
from ergon.instruments.module_kinds import POINT_KINDS, member_count
from ergon.instruments.spread import single_links
from ergon.notation.tables.value_kinds import AXES
from ergon.scores.reading.outputs import Route
from ergon.scores.reading.piece import Piece

MAX_POINTS = 256  # measured at once; a piece of 10,000 masses is not read line by line
_PROBE_NAME = "measured points"  # no instrument of a score has a name with a space


@dataclass(frozen=True, slots=True)
class Point:
    """A MAT that is measured, by the number of its output; `name` is its full name."""

    name: str
    output_number: int
    is_fixed: bool


@dataclass(frozen=True, slots=True)
class ProbedLink:
    """A BUT whose `a` strikes `b`, or an LNL with friction, in SI units; or one point of such a
    link over a range.

    `full_name` is the name of the link as it is written. Its elongation is x_b - x_a.
    """

    name: str
    full_name: str
    module: Module
    a: Point
    b: Point


@dataclass(frozen=True, slots=True)
class ProbedPiece:
    """The piece with outputs at its points; `n_left_out` counts contacts and points without an
    output.
    """

    piece: Piece
    points: tuple[Point, ...]
    contacts: tuple[ProbedLink, ...]
    n_left_out: int
    friction_links: tuple[ProbedLink, ...] = ()


def probe_piece(piece: Piece) -> ProbedPiece:
    """The piece with an output for each end of a contact, each single mass and each member that is
    heard.
    """
    contacts, friction_links = list(_contacts(piece)), list(_friction_links(piece))
    end_targets = (end for _, _, module in (*contacts, *friction_links) for end in module.ends)
    probed_targets = {
        _point_key(target): target for target in (*end_targets, *_single_mass_targets(piece))
    }
    first_targets = list(probed_targets.items())[:MAX_POINTS]
    modules_by_key = {(part, module.name): module for part, module in piece.modules()}
    points_by_target = {
        point_key: _point(target, number, modules_by_key[target.part, target.module])
        for number, (point_key, target) in enumerate(first_targets)
    }
    measured_contacts = []
    for module_name, contact_name, part_module in contacts:
        first_point, second_point = (
            points_by_target.get(_point_key(end)) for end in part_module.ends
        )
        if first_point is not None and second_point is not None:
            measured_contacts.append(
                ProbedLink(module_name, contact_name, part_module, first_point, second_point)
            )
    measured_frictions = []
    for module_name, contact_name, part_module in friction_links:
        first_point, second_point = (
            points_by_target.get(_point_key(end)) for end in part_module.ends
        )
        if first_point is not None and second_point is not None:
            measured_frictions.append(
                ProbedLink(module_name, contact_name, part_module, first_point, second_point)
            )
    probed_outputs = tuple(
        Output(str(number), "SOX", (target,), None, piece.place)
        for number, (_, target) in enumerate(first_targets)
    )
    probe_instrument = Instrument(_PROBE_NAME, (), probed_outputs, None, piece.place)
    mix = replace(piece.mix, routes=(Route(_PROBE_NAME, None, (1,), 1.0, None, piece.place),))
    probed_piece = replace(
        piece, instruments={**piece.instruments, _PROBE_NAME: probe_instrument}, mix=mix
    )
    n_left_out = len(probed_targets) - len(first_targets) + len(contacts) - len(measured_contacts)
    return ProbedPiece(
        probed_piece,
        tuple(points_by_target.values()),
        tuple(measured_contacts),
        n_left_out,
        tuple(measured_frictions),
    )


def _point_key(target: Target) -> tuple[str, str, int | str]:
    return target.part, target.module, target.first


def _point(end_target: Target, output_number: int, part_module: Module) -> Point:
    n_members, member_index, axis = (
        member_count(part_module.kind, part_module.fields),
        end_target.first,
        "",
    )
    if "axes" in part_module.fields and isinstance(member_index, int):
        member_index, axis = member_index % n_members, AXES[member_index // n_members]
    member = "" if n_members == 1 else str(member_index)
    name = ".".join(filter(None, (end_target.part, end_target.module, member, axis)))
    return Point(name, output_number, part_module.kind == "SOL")


def _contacts(piece: Piece) -> Iterator[tuple[str, str, Module]]:
    for part, module in piece.modules():
        if module.kind == "BUT" and not module.ends[0].points:
            yield from _single_links(part, module)


def _friction_links(piece: Piece) -> Iterator[tuple[str, str, Module]]:
    for instrument in piece.instruments.values():
        for part_module in instrument.modules if instrument.ca_rate is None else ():
            is_damped = part_module.kind == "LNL" and part_module.fields.get("damping")
            if is_damped and not part_module.ends[0].points:
                yield from _single_links(instrument.name, part_module)


def _single_links(part_name: str, part_module: Module) -> Iterator[tuple[str, str, Module]]:
    """The single links of a link, each with its name and that of the whole."""
    contact_name = ".".join(filter(None, (part_name, part_module.name)))
    for link in single_links(part_module):
        yield ".".join(filter(None, (part_name, link.name))), contact_name, link


def _single_mass_targets(piece: Piece) -> Iterable[Target]:
    """Modules of one mass, and single members that outputs of the piece listen to."""
    for part_name, part_module in piece.modules():
        is_single = (
            part_module.kind in POINT_KINDS
            and member_count(part_module.kind, part_module.fields) == 1
        )
        if is_single and part_module.kind != "SOL" and "axes" not in part_module.fields:
            yield Target(part_name, part_module.name, 0, 1, "", part_module.place)
    for instrument in piece.instruments.values():
        for output in instrument.outputs:
            for target in output.targets if output.is_movement else ():
                if target.count == 1:
                    yield target
