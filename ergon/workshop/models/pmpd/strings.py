"""Equal masses in a row with equal links: a score writes them as one STRING."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass

from ergon.workshop.models.pmpd.network import Link, Mass, Network

_MASSES_MIN = 3  # masses


@dataclass(frozen=True, slots=True)
class Row:
    """`n_masses` masses from `first_mass` on, and the links between neighbours, by their
    indices.
    """

    first_mass: int
    n_masses: int
    links: frozenset[int]
    link: Link


def find_rows(
    network: Network, moved_masses: Collection[int], is_spring: Callable[[Link], bool]
) -> dict[int, Row]:
    """Rows of masses, by their first ones. `moved_masses` masses are in no row, and its links are
    plain.
    """
    masses = network.masses
    link_to_next: dict[int, int] = {}  # the first link from a mass to the next one
    for index, link in enumerate(network.links):
        first, second = sorted((link.a, link.b))
        if second == first + 1 and link.L == 0.0 and is_spring(link):
            link_to_next.setdefault(first, index)
    row_by_first: dict[int, Row] = {}
    first_mass = 0
    while first_mass < len(masses):
        links_in_row: list[int] = []
        mass_key = _mass_key(masses[first_mass], first_mass in moved_masses)
        last_mass = first_mass
        while mass_key is not None and last_mass in link_to_next and last_mass + 1 < len(masses):
            next_link = link_to_next[last_mass]
            if _mass_key(masses[last_mass + 1], last_mass + 1 in moved_masses) != mass_key:
                break
            if links_in_row and _link_key(network.links[next_link]) != _link_key(
                network.links[links_in_row[0]]
            ):
                break
            links_in_row.append(next_link)
            last_mass += 1
        if last_mass - first_mass + 1 >= _MASSES_MIN:
            row_by_first[first_mass] = Row(
                first_mass,
                last_mass - first_mass + 1,
                frozenset(links_in_row),
                network.links[links_in_row[0]],
            )
        first_mass = last_mass + 1
    return row_by_first


def _mass_key(mass: Mass, is_moved: bool) -> tuple[object, ...] | None:
    """The properties that all masses of a row share; None for a mass that cannot be in a row."""
    is_free = mass.is_mobile and not mass.air_damping and not is_moved
    return (mass.class_name, mass.M, mass.x, mass.v) if is_free else None


def _link_key(link: Link) -> tuple[object, ...]:
    return link.class_name, link.K, link.D
