"""The first bang of pmpd, in which links do not act yet."""

from __future__ import annotations

from ergon.workshop.models.pmpd.network import Link, Network
from ergon.workshop.models.pmpd.tables import find_table


def first_bang(network: Network) -> dict[int, float]:
    """Move the masses by one bang; returns the forces that links then have in addition to those of
    a score's links.

    In its first bang pmpd moves masses by the forces sent to it, then reads the links for the
    first time. Their dampers feel all movement since they were made.
    """
    for mass in network.masses:
        if mass.is_mobile:
            mass.v += mass.f / mass.M
            mass.x += mass.v
        else:
            mass.v = 0.0
    corrections: dict[int, float] = {}
    for link in network.links:
        a, b = network.masses[link.a], network.masses[link.b]
        length = a.x - b.x
        length_change, speed_difference = length - link.last_length, a.v - b.v
        # A score's damper feels the step of a mass too, so only the rest counts, above rounding.
        if abs(length_change - speed_difference) <= 1e-12 * max(abs(length), abs(link.last_length)):
            continue
        if not (link.Lmin <= length < link.Lmax) or length == 0.0:
            continue
        correction = _damping(network, link, length_change) - _damping(
            network, link, speed_difference
        )
        corrections[link.a] = corrections.get(link.a, 0.0) - correction
        corrections[link.b] = corrections.get(link.b, 0.0) + correction
    return {
        mass_index: force
        for mass_index, force in corrections.items()
        if force and network.masses[mass_index].is_mobile
    }


def _damping(network: Network, link: Link, length_step: float) -> float:
    if link.tables is None:
        return link.D * length_step
    _, _, array_name, array_length = link.tables
    return link.D * find_table(network.arrays, array_name, link.line).interpolate(
        length_step / array_length
    )
