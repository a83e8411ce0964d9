"""The first bang of pmpd, in which links do not act yet."""

from __future__ import annotations

from ergon.workshop.models.pmpd.network import Link, Network
from ergon.workshop.models.pmpd.tables import table


def first_bang(network: Network) -> dict[int, float]:
    """Move the masses by one bang; returns the forces that links then have in addition to those of
    a score's links.

    In its first bang pmpd moves masses by the forces sent to it, then reads the links for the
    first time. Their dampers feel all movement since they were made.
    """
    for model_mass in network.masses:
        if model_mass.is_mobile:
            model_mass.v += model_mass.f / model_mass.M
            model_mass.x += model_mass.v
        else:
            model_mass.v = 0.0
    extra_forces: dict[int, float] = {}
    for model_link in network.links:
        a, b = network.masses[model_link.a], network.masses[model_link.b]
        link_length = a.x - b.x
        length_change, relative_step = link_length - model_link.before, a.v - b.v
        # A score's damper feels the step of a mass too, so only the rest counts, above rounding.
        if abs(length_change - relative_step) <= 1e-12 * max(
            abs(link_length), abs(model_link.before)
        ):
            continue
        if not (model_link.Lmin <= link_length < model_link.Lmax) or link_length == 0.0:
            continue
        extra_force = _damping(network, model_link, length_change) - _damping(
            network, model_link, relative_step
        )
        extra_forces[model_link.a] = extra_forces.get(model_link.a, 0.0) - extra_force
        extra_forces[model_link.b] = extra_forces.get(model_link.b, 0.0) + extra_force
    return {
        mass_index: force
        for mass_index, force in extra_forces.items()
        if force and network.masses[mass_index].is_mobile
    }


def _damping(network: Network, model_link: Link, length_step: float) -> float:
    if model_link.tables is None:
        return model_link.D * length_step
    _, _, array, table_length = model_link.tables
    return model_link.D * table(network.arrays, array, model_link.line).interpolate(
        length_step / table_length
    )
