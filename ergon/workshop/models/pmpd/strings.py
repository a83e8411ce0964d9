"""Equal masses in a row with equal links: a score writes them as one STRING."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass

from ergon.workshop.models.pmpd.network import Link, Mass, Network

_LEAST = 3  # masses


@dataclass(frozen=True, slots=True)
class Row:
    """`count` masses from `first` on, and the links between neighbours, by their indices."""

    first: int
    count: int
    links: frozenset[int]
    link: Link


def rows(
    network: Network, moved: Collection[int], is_plain: Callable[[Link], bool]
) -> dict[int, Row]:
    """Rows of masses, by their first ones. `moved` masses are in no row, and its links are
    plain.
    """
    masses = network.masses
    between: dict[int, int] = {}  # the first link from a mass to the next one
    for at, link in enumerate(network.links):
        low, high = sorted((link.a, link.b))
        if high == low + 1 and link.L == 0.0 and is_plain(link):
            between.setdefault(low, at)
    found: dict[int, Row] = {}
    first = 0
    while first < len(masses):
        own: list[int] = []
        kind = _matter(masses[first], first in moved)
        last = first
        while kind is not None and last in between and last + 1 < len(masses):
            at = between[last]
            if _matter(masses[last + 1], last + 1 in moved) != kind:
                break
            if own and _tie(network.links[at]) != _tie(network.links[own[0]]):
                break
            own.append(at)
            last += 1
        if last - first + 1 >= _LEAST:
            found[first] = Row(first, last - first + 1, frozenset(own), network.links[own[0]])
        first = last + 1
    return found


def _matter(one: Mass, is_moved: bool) -> tuple[object, ...] | None:
    """The properties that all masses of a row share; None for a mass that cannot be in a row."""
    is_free = one.is_mobile and not one.D and not is_moved
    return (one.of, one.M, one.x, one.v) if is_free else None


def _tie(link: Link) -> tuple[object, ...]:
    return link.of, link.K, link.D
