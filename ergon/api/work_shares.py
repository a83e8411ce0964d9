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
    """The work of `count` processes [s per s of sound] and of `home_load`, by the table of costs.

    `costliest_piece` is the most expensive piece, which cannot be split; None if nothing is shared.
    Home, this process, also mixes, which the table does not count.
    """

    count: int
    loads: tuple[float, ...]
    home_load: float
    costliest_piece: WorkPiece | None

    @property
    def total(self) -> float:
        """The work of one process that computes everything."""
        return sum(self.loads) + self.home_load

    @property
    def largest_load(self) -> float:
        """The largest work of a process: the least time that a second of sound takes."""
        return max(*self.loads, self.home_load, 0.0)

    @property
    def speedup_max(self) -> float:
        """The largest possible speed-up over one process, with any number of processes."""
        least_work = max(self.home_load, self.costliest_piece.cost if self.costliest_piece else 0.0)
        return self.total / least_work if least_work else 1.0


def work_pieces(
    simulation: Simulation, rows: Sequence[PlanRow], rate: float
) -> tuple[WorkPiece, ...]:
    """The islands that other processes can compute, with the names of the parts in them."""
    shared_pieces = []
    remaining_rows = [row for row in rows if row.cost > 0.0 and row.what != "oscillators"]
    for island in simulation.storable():
        cost = 1e-9 * rate * island.cost
        part_names: dict[str, None] = {}
        remaining_cost = cost
        while remaining_rows and remaining_cost > 1e-9 * cost:  # rows stand in the order of islands
            row = remaining_rows.pop(0)
            remaining_cost -= row.cost
            part_names.update(dict.fromkeys(row.parts))
        if is_expensive(island):
            shared_pieces.append(WorkPiece(tuple(part_names), cost))
    return tuple(shared_pieces)


def share_out(pieces: Sequence[WorkPiece], total_cost: float, count: int) -> Shares:
    """Share out pieces among `count` processes; home computes the rest of the `total_cost` work."""
    costs = [piece.cost for piece in pieces]
    process_loads = [sum(costs[i] for i in group) for group in group_by_cost(costs, count)]
    process_loads += [0.0] * (count - len(process_loads))
    home_load = max(0.0, total_cost - sum(costs))
    costliest_piece = max(pieces, key=lambda piece: piece.cost, default=None)
    return Shares(count, tuple(process_loads), home_load, costliest_piece)
