"""Points in space that springs join: chains, cloths, discs, blocks, balls, meshes.

Consecutive springs of equal length form one run of the engine, which is computed five times as
fast as single springs.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import NotRequired

from ergon import _core
from ergon.instruments.space.mesh import AXIS_ORDER_BY_UP, Mesh, placed_points
from ergon.instruments.space.points import (
    PointsFields,
    Vector,
    add_points,
    interpolated,
    mats_by_axis,
)

Cell = tuple[int, ...]  # the number of a point along each axis of a lattice
Spring = tuple[int, int, float]  # first point, second point, rest length [m]


@dataclass(frozen=True, slots=True)
class Run:
    """`count` equal springs; both end indices rise by one from each spring to the next."""

    first: int
    second: int
    count: int
    rest: float
    K: float
    Z: float


@dataclass(frozen=True, slots=True)
class Net:
    """Positions of points [m], which of them are held, and the springs that join them."""

    positions: Sequence[Vector]
    is_held: Sequence[bool]
    runs: Iterable[Run]


class NetFields(PointsFields):
    """Fields that every net has."""

    K: float
    Z: float
    yields: float | None
    breaks: float | None
    stretch: NotRequired[float]


class ChainFields(NetFields):
    """Those of a CHAIN."""

    masses: int
    ends: str
    rest: float | None


class ClothFields(NetFields):
    """Those of a CLOTH."""

    sides: tuple[int, int]
    across: Vector
    up: Vector
    shear: float
    held: str


class DiscFields(NetFields):
    """Those of a DISC."""

    rings: int
    across: float
    normal: Vector | None
    held: str


class BlockFields(NetFields):
    """Those of a BLOCK."""

    sides: tuple[int, ...]
    span: int
    held: str


class BallFields(NetFields):
    """Those of a BALL."""

    points: int
    across: float
    span: int


class MeshFields(NetFields):
    """Those of a MESH."""

    file: Mesh
    up: str
    scale: float
    held: str


def add(network: _core.Network, net_name: str, net: Net, net_fields: NetFields) -> int:
    """Add a net; returns the index of the first MAT. Raises EngineError."""
    first_mat, n, axis_count = (
        add_points(network, net_name, net_fields, net.positions, net.is_held),
        len(net.positions),
        net_fields["axes"],
    )
    for run in net.runs:
        if run.count < 1 or run.K == 0.0 == run.Z:
            continue
        network.space_ref(
            f"{net_name}.link" if net_name else "link",
            mats_by_axis(first_mat + run.first, n, axis_count),
            mats_by_axis(first_mat + run.second, n, axis_count),
            count=run.count,
            rest=run.rest / (1.0 + net_fields.get("stretch", 0.0)),
            K=run.K,
            Z=run.Z,
            yields=net_fields["yields"],
            breaks=net_fields["breaks"],
        )
    return first_mat


def chain(chain_fields: ChainFields) -> Net:
    """Points in a row, each joined to the next."""
    n, start, stop = (
        chain_fields["masses"],
        chain_fields["from"],
        chain_fields["to"],
    )
    places = [interpolated(start, stop, i / (n - 1)) for i in range(n)]
    is_held = [False] * n
    is_held[0] = chain_fields["ends"] in ("fixed", "left")
    is_held[-1] = chain_fields["ends"] == "fixed"
    rest_length = (
        math.dist(start, stop) / (n - 1) if chain_fields["rest"] is None else chain_fields["rest"]
    )
    return Net(
        places, is_held, [Run(0, 1, n - 1, rest_length, chain_fields["K"], chain_fields["Z"])]
    )


def cloth(cloth_fields: ClothFields) -> Net:
    """Points row by row, with springs along each row, along each column, and across each cell."""
    (n_columns, n_rows), axes = cloth_fields["sides"], cloth_fields["axes"]
    corner, row_vector, column_vector = (
        cloth_fields["at"],
        cloth_fields["across"],
        cloth_fields["up"],
    )
    positions = [
        tuple(
            corner[axis]
            + row_vector[axis] * (i / max(1, n_columns - 1))
            + column_vector[axis] * (j / max(1, n_rows - 1))
            for axis in range(axes)
        )
        for j in range(n_rows)
        for i in range(n_columns)
    ]
    first_and_last_column, first_and_last_row = (0, n_columns - 1), (0, n_rows - 1)
    is_held: Callable[[int, int], bool] = {
        "corners": lambda i, j: i in first_and_last_column and j in first_and_last_row,
        "top": lambda i, j: j == n_rows - 1,
        "rim": lambda i, j: i in first_and_last_column or j in first_and_last_row,
    }.get(cloth_fields["held"], lambda i, j: False)
    held = [is_held(i, j) for j in range(n_rows) for i in range(n_columns)]

    def run(first: int, second: int, n_springs: int, stiffness: float, damping: float) -> Run:
        return Run(
            first,
            second,
            n_springs,
            math.dist(positions[first], positions[second]),
            stiffness,
            damping,
        )

    def runs() -> Iterator[Run]:
        spring, shear = (cloth_fields["K"], cloth_fields["Z"]), (cloth_fields["shear"], 0.0)
        for j in range(n_rows if n_columns > 1 else 0):
            yield run(j * n_columns, j * n_columns + 1, n_columns - 1, *spring)
        if n_rows > 1:
            yield run(0, n_columns, (n_rows - 1) * n_columns, *spring)
        for j in range(n_rows - 1 if n_columns > 1 else 0):
            yield run(j * n_columns, (j + 1) * n_columns + 1, n_columns - 1, *shear)
            yield run(j * n_columns + 1, (j + 1) * n_columns, n_columns - 1, *shear)

    return Net(positions, held, runs())


def disc(disc_fields: DiscFields) -> Net:
    """Points of a triangular lattice, in rings around a middle."""
    n_rings, centre, axes = disc_fields["rings"], disc_fields["at"], disc_fields["axes"]
    spacing = 0.5 * disc_fields["across"] / n_rings
    u, v = _plane_axes(disc_fields["normal"])
    row_height = math.sqrt(0.75)
    # The axes of the cells are 60 degrees apart.
    numbers = range(-n_rings, n_rings + 1)
    cells = [(q, r) for r in numbers for q in numbers if abs(q + r) <= n_rings]
    places = [
        tuple(
            centre[axis] + spacing * ((q + 0.5 * r) * u[axis] + row_height * r * v[axis])
            for axis in range(axes)
        )
        for q, r in cells
    ]
    held_ring = {"rim": n_rings, "middle": 0}.get(disc_fields["held"])
    held = [max(abs(q), abs(r), abs(q + r)) == held_ring for q, r in cells]
    springs = _lattice_springs(cells, [((1, 0), spacing), ((0, 1), spacing), ((-1, 1), spacing)])
    return Net(places, held, _runs_of_equal_springs(springs, disc_fields))


def _plane_axes(normal: Vector | None) -> tuple[Vector, Vector]:
    """Two unit vectors perpendicular to each other and to a normal; without a normal the first two
    axes.

    Duff et al., Journal of Computer Graphics Techniques 6 (2017).
    """
    x, y, z = (0.0, 0.0, 1.0) if normal is None else normal
    length = math.hypot(x, y, z)
    x, y, z = x / length, y / length, z / length
    sign = math.copysign(1.0, z)
    a = -1.0 / (sign + z)
    b = x * y * a
    return (1.0 + sign * x * x * a, sign * b, -sign * x), (b, sign + y * y * a, -y)


def block(block_fields: BlockFields) -> Net:
    """A box of points on a lattice, each joined to its neighbours."""
    corner, opposite_corner, sides = (
        block_fields["from"],
        block_fields["to"],
        block_fields["sides"],
    )
    spacing = [
        (b - a) / max(1, n - 1) for a, b, n in zip(corner, opposite_corner, sides, strict=True)
    ]
    cells = _lattice_cells_of_box(sides)
    places = [
        tuple(a + i * step for a, i, step in zip(corner, cell, spacing, strict=True))
        for cell in cells
    ]
    top_index = sides[-1] - 1
    is_held: Callable[[Cell], bool] = {
        "bottom": lambda cell: cell[-1] == 0,
        "top": lambda cell: cell[-1] == top_index,
        "rim": lambda cell: any(i in (0, n - 1) for i, n in zip(cell, sides, strict=True)),
    }.get(block_fields["held"], lambda cell: False)
    springs = _lattice_springs(cells, _neighbours(block_fields["span"], spacing))
    return Net(
        places,
        [is_held(cell) for cell in cells],
        _runs_of_equal_springs(springs, block_fields),
    )


def ball(ball_fields: BallFields) -> Net:
    """The points of a lattice that lie in a sphere or a circle, each joined to its neighbours."""
    centre, n = ball_fields["at"], ball_fields["points"]
    spacing, middle = ball_fields["across"] / (n - 1), 0.5 * (n - 1)
    cells = [cell for cell in _lattice_cells_of_box((n,) * len(centre)) if _is_in_ball(cell, n)]
    places = [
        tuple(a + (i - middle) * spacing for a, i in zip(centre, cell, strict=True))
        for cell in cells
    ]
    springs = _lattice_springs(cells, _neighbours(ball_fields["span"], [spacing] * len(centre)))
    return Net(places, [False] * len(cells), _runs_of_equal_springs(springs, ball_fields))


def _is_in_ball(cell: Cell, n: int) -> bool:
    """Whether a cell of a lattice n wide is no farther from its middle than the outermost cell on
    an axis.
    """
    return sum((2 * i - n + 1) ** 2 for i in cell) <= (n - 1) ** 2


def mesh(mesh_fields: MeshFields) -> Net:
    """The points of a file, joined along its edges."""
    model, up = mesh_fields["file"], mesh_fields["up"]
    positions = list(placed_points(model, mesh_fields["scale"], up, mesh_fields["at"]))
    heights = [point[AXIS_ORDER_BY_UP[up][-1]] for point in model.points]
    held_height = {"bottom": min(heights), "top": max(heights)}.get(mesh_fields["held"])
    springs = ((a, b, math.dist(positions[a], positions[b])) for a, b in model.edges)
    return Net(
        positions,
        [height == held_height for height in heights],
        _runs_of_equal_springs(springs, mesh_fields),
    )


# The number of points of a net.
COUNTS: dict[str, Callable[..., int]] = {
    "CLOTH": lambda fields: math.prod(fields["sides"]),
    "BLOCK": lambda fields: math.prod(fields["sides"]),
    "DISC": lambda fields: 3 * fields["rings"] * (fields["rings"] + 1) + 1,
    "BALL": lambda fields: _count_cells_in_ball(fields["points"], fields["axes"]),
    "MESH": lambda fields: len(fields["file"].points) if fields["file"] else 1,
}


def _count_cells_in_ball(n: int, axes: int) -> int:
    """The number of cells of a lattice in a ball that is n cells wide."""
    squares = [(2 * i - n + 1) ** 2 for i in range(n)]
    sums = {0: 1}
    for _ in range(axes):
        new_sums: dict[int, int] = {}
        for square_sum, n_cells in sums.items():
            for square in squares:
                if square_sum + square <= (n - 1) ** 2:
                    new_sums[square_sum + square] = new_sums.get(square_sum + square, 0) + n_cells
        sums = new_sums
    return sum(sums.values())


# --- lattices -----------------------------------------------------------------------------------


def _lattice_cells_of_box(counts: Sequence[int]) -> list[Cell]:
    """All cells of a box, the first axis fastest."""
    return [cell[::-1] for cell in itertools.product(*(range(n) for n in reversed(counts)))]


def _neighbours(span: int, spacing: Sequence[float]) -> Iterator[tuple[Cell, float]]:
    """Steps to all neighbours within `span` along each axis that come later in order, with
    their lengths [m].
    """
    for step in itertools.product(range(-span, span + 1), repeat=len(spacing)):
        if step[::-1] > (0,) * len(step):
            yield step, math.hypot(*(i * size for i, size in zip(step, spacing, strict=True)))


def _lattice_springs(
    cells: Sequence[Cell], steps: Iterable[tuple[Cell, float]]
) -> Iterator[Spring]:
    """Springs from each cell to the cells one step away, for each step in turn."""
    index_by_cell = {cell: number for number, cell in enumerate(cells)}
    for step, rest_length in steps:
        for index, cell in enumerate(cells):
            neighbour = index_by_cell.get(tuple(i + j for i, j in zip(cell, step, strict=True)))
            if neighbour is not None:
                yield index, neighbour, rest_length


def _runs_of_equal_springs(springs: Iterable[Spring], net_fields: NetFields) -> Iterator[Run]:
    """Springs with K and Z as runs of consecutive ones."""
    # Along a run both ends rise by one with the number of the spring.
    runs = itertools.groupby(
        enumerate(springs), lambda item: (item[1][0] - item[0], item[1][1] - item[0], item[1][2])
    )
    for (first_offset, second_offset, rest_length), run_springs in runs:
        number, _ = next(run_springs)
        n_springs = 1 + sum(1 for _ in run_springs)
        yield Run(
            first_offset + number,
            second_offset + number,
            n_springs,
            rest_length,
            net_fields["K"],
            net_fields["Z"],
        )
