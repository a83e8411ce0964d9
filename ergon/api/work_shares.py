"""How the work of a plan is shared out among processes, and what bounds its time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ergon.rendering.remote import group_by_cost
from ergon.rendering.stretches import is_expensive

if TYPE_CHECKING:
    from ergon._core import PlanRow, Simulation


@dataclass(frozen=True, slots=True)
class WorkPiece:
    """What one process computes as a whole: the parts in it, and its `cost` [s per s of sound]."""

    parts: tuple[str, ...]
    cost: float


@dataclass(frozen=True, slots=True)
class Shares:
    """The work of `count` processes [s per s of sound] and of `home`, by the table of costs.

    `dearest` is the most expensive piece, which cannot be split; None if nothing is shared.
    Home, this process, also mixes, which the table does not count.
    """

    count: int
    loads: tuple[float, ...]
    home: float
    dearest: WorkPiece | None

    @property
    def total(self) -> float:
        """The work of one process that computes everything."""
        return sum(self.loads) + self.home

    @property
    def longest(self) -> float:
        """The largest work of a process: the least time that a second of sound takes."""
        return max(*self.loads, self.home, 0.0)

    @property
    def bound(self) -> float:
        """The largest possible speed-up over one process, with any number of processes."""
        least = max(self.home, self.dearest.cost if self.dearest else 0.0)
        return self.total / least if least else 1.0


def work_pieces(
    simulation: Simulation, rows: Sequence[PlanRow], rate: float
) -> tuple[WorkPiece, ...]:
    """The islands that other processes can compute, with the names of the parts in them."""
    pieces = []
    rows_left = [row for row in rows if row.cost > 0.0 and row.what != "oscillators"]
    for island in simulation.storable():
        cost = 1e-9 * rate * island.cost
        names_in_piece: dict[str, None] = {}
        cost_left = cost
        while rows_left and cost_left > 1e-9 * cost:  # rows stand in the order of islands
            row = rows_left.pop(0)
            cost_left -= row.cost
            names_in_piece.update(dict.fromkeys(row.parts))
        if is_expensive(island):
            pieces.append(WorkPiece(tuple(names_in_piece), cost))
    return tuple(pieces)


def share_out(pieces: Sequence[WorkPiece], total_cost: float, count: int) -> Shares:
    """Share out pieces among `count` processes; home computes the rest of the `total_cost` work."""
    costs = [piece.cost for piece in pieces]
    loads = [sum(costs[i] for i in group) for group in group_by_cost(costs, count)]
    loads += [0.0] * (count - len(loads))
    home_cost = max(0.0, total_cost - sum(costs))
    dearest = max(pieces, key=lambda piece: piece.cost, default=None)
    return Shares(count, tuple(loads), home_cost, dearest)
