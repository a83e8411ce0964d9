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

    places: Sequence[Vector]
    held: Sequence[bool]
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
        add_points(network, net_name, net_fields, net.places, net.held),
        len(net.places),
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
    n, start_position, stop_position = (
        chain_fields["masses"],
        chain_fields["from"],
        chain_fields["to"],
    )
    places = [interpolated(start_position, stop_position, i / (n - 1)) for i in range(n)]
    is_held = [False] * n
    is_held[0] = chain_fields["ends"] in ("fixed", "left")
    is_held[-1] = chain_fields["ends"] == "fixed"
    rest_length = (
        math.dist(start_position, stop_position) / (n - 1)
        if chain_fields["rest"] is None
        else chain_fields["rest"]
    )
    return Net(
        places, is_held, [Run(0, 1, n - 1, rest_length, chain_fields["K"], chain_fields["Z"])]
    )


def cloth(cloth_fields: ClothFields) -> Net:
    """Points row by row, with springs along each row, along each column, and across each cell."""
    (across, rows_up), axes = cloth_fields["sides"], cloth_fields["axes"]
    corner, right_step, upwards = cloth_fields["at"], cloth_fields["across"], cloth_fields["up"]
    point_positions = [
        tuple(
            corner[axis]
            + right_step[axis] * (i / max(1, across - 1))
            + upwards[axis] * (j / max(1, rows_up - 1))
            for axis in range(axes)
        )
        for j in range(rows_up)
        for i in range(across)
    ]
    row_sides, ends = (0, across - 1), (0, rows_up - 1)
    is_held: Callable[[int, int], bool] = {
        "corners": lambda i, j: i in row_sides and j in ends,
        "top": lambda i, j: j == rows_up - 1,
        "rim": lambda i, j: i in row_sides or j in ends,
    }.get(cloth_fields["held"], lambda i, j: False)
    held = [is_held(i, j) for j in range(rows_up) for i in range(across)]

    def run(
        low_index: int, high_index: int, spring_count: int, stiffness: float, damping: float
    ) -> Run:
        return Run(
            low_index,
            high_index,
            spring_count,
            math.dist(point_positions[low_index], point_positions[high_index]),
            stiffness,
            damping,
        )

    def runs() -> Iterator[Run]:
        spring, shear = (cloth_fields["K"], cloth_fields["Z"]), (cloth_fields["shear"], 0.0)
        for j in range(rows_up if across > 1 else 0):
            yield run(j * across, j * across + 1, across - 1, *spring)
        if rows_up > 1:
            yield run(0, across, (rows_up - 1) * across, *spring)
        for j in range(rows_up - 1 if across > 1 else 0):
            yield run(j * across, (j + 1) * across + 1, across - 1, *shear)
            yield run(j * across + 1, (j + 1) * across, across - 1, *shear)

    return Net(point_positions, held, runs())


def disc(disc_fields: DiscFields) -> Net:
    """Points of a triangular lattice, in rings around a middle."""
    ring_count, disc_position, axes = disc_fields["rings"], disc_fields["at"], disc_fields["axes"]
    spacing = 0.5 * disc_fields["across"] / ring_count
    right_step, upwards = _plane_axes(disc_fields["normal"])
    row_height = math.sqrt(0.75)
    # The axes of the cells are 60 degrees apart.
    numbers = range(-ring_count, ring_count + 1)
    lattice_cells = [(q, r) for r in numbers for q in numbers if abs(q + r) <= ring_count]
    places = [
        tuple(
            disc_position[axis]
            + spacing * ((q + 0.5 * r) * right_step[axis] + row_height * r * upwards[axis])
            for axis in range(axes)
        )
        for q, r in lattice_cells
    ]
    ring = {"rim": ring_count, "middle": 0}.get(disc_fields["held"])
    held = [max(abs(q), abs(r), abs(q + r)) == ring for q, r in lattice_cells]
    springs = _lattice_springs(
        lattice_cells, [((1, 0), spacing), ((0, 1), spacing), ((-1, 1), spacing)]
    )
    return Net(places, held, _runs_of_equal_springs(springs, disc_fields))


def _plane_axes(normal: Vector | None) -> tuple[Vector, Vector]:
    """Two unit vectors perpendicular to each other and to a normal; without a normal the first two
    axes.

    Duff et al., Journal of Computer Graphics Techniques 6 (2017).
    """
    x, y, z = (0.0, 0.0, 1.0) if normal is None else normal
    length = math.hypot(x, y, z)
    x, y, z = x / length, y / length, z / length
    z_sign = math.copysign(1.0, z)
    a = -1.0 / (z_sign + z)
    b = x * y * a
    return (1.0 + z_sign * x * x * a, z_sign * b, -z_sign * x), (b, z_sign + y * y * a, -y)


def block(block_fields: BlockFields) -> Net:
    """A box of points on a lattice, each joined to its neighbours."""
    start_corner, stop_corner_index, stop_corner = (
        block_fields["from"],
        block_fields["to"],
        block_fields["sides"],
    )
    spacing = [
        (b - a) / max(1, n - 1)
        for a, b, n in zip(start_corner, stop_corner_index, stop_corner, strict=True)
    ]
    axis_counts = _lattice_cells_of_box(stop_corner)
    places = [
        tuple(a + i * step for a, i, step in zip(start_corner, cell, spacing, strict=True))
        for cell in axis_counts
    ]
    top = stop_corner[-1] - 1
    is_held: Callable[[Cell], bool] = {
        "bottom": lambda cell: cell[-1] == 0,
        "top": lambda cell: cell[-1] == top,
        "rim": lambda cell: any(i in (0, n - 1) for i, n in zip(cell, stop_corner, strict=True)),
    }.get(block_fields["held"], lambda cell: False)
    springs = _lattice_springs(axis_counts, _neighbours(block_fields["span"], spacing))
    return Net(
        places,
        [is_held(cell) for cell in axis_counts],
        _runs_of_equal_springs(springs, block_fields),
    )


def ball(ball_fields: BallFields) -> Net:
    """The points of a lattice that lie in a sphere or a circle, each joined to its neighbours."""
    ball_centre, n = ball_fields["at"], ball_fields["points"]
    spacing, middle = ball_fields["across"] / (n - 1), 0.5 * (n - 1)
    lattice_cells = [
        cell for cell in _lattice_cells_of_box((n,) * len(ball_centre)) if _is_in_ball(cell, n)
    ]
    places = [
        tuple(a + (i - middle) * spacing for a, i in zip(ball_centre, cell, strict=True))
        for cell in lattice_cells
    ]
    springs = _lattice_springs(
        lattice_cells, _neighbours(ball_fields["span"], [spacing] * len(ball_centre))
    )
    return Net(places, [False] * len(lattice_cells), _runs_of_equal_springs(springs, ball_fields))


def _is_in_ball(cell: Cell, n: int) -> bool:
    """Whether a cell of a lattice n wide is no farther from its middle than the outermost cell on
    an axis.
    """
    return sum((2 * i - n + 1) ** 2 for i in cell) <= (n - 1) ** 2


def mesh(mesh_fields: MeshFields) -> Net:
    """The points of a file, joined along its edges."""
    model, up = mesh_fields["file"], mesh_fields["up"]
    point_positions = list(placed_points(model, mesh_fields["scale"], up, mesh_fields["at"]))
    heights = [point[AXIS_ORDER_BY_UP[up][-1]] for point in model.points]
    end = {"bottom": min(heights), "top": max(heights)}.get(mesh_fields["held"])
    springs = ((a, b, math.dist(point_positions[a], point_positions[b])) for a, b in model.edges)
    return Net(
        point_positions,
        [height == end for height in heights],
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
        next_sums: dict[int, int] = {}
        for cell_sum, cell_count in sums.items():
            for square in squares:
                if cell_sum + square <= (n - 1) ** 2:
                    next_sums[cell_sum + square] = next_sums.get(cell_sum + square, 0) + cell_count
        sums = next_sums
    return sum(sums.values())


# --- lattices -----------------------------------------------------------------------------------


def _lattice_cells_of_box(counts: Sequence[int]) -> list[Cell]:
    """All cells of a box, the first axis fastest."""
    return [cell[::-1] for cell in itertools.product(*(range(n) for n in reversed(counts)))]


def _neighbours(step_span: int, spacing: Sequence[float]) -> Iterator[tuple[Cell, float]]:
    """Steps to all neighbours within `step_span` along each axis that come later in order, with
    their lengths [m].
    """
    for step in itertools.product(range(-step_span, step_span + 1), repeat=len(spacing)):
        if step[::-1] > (0,) * len(step):
            yield step, math.hypot(*(i * size for i, size in zip(step, spacing, strict=True)))


def _lattice_springs(
    lattice_cells: Sequence[Cell], steps: Iterable[tuple[Cell, float]]
) -> Iterator[Spring]:
    """Springs from each cell to the cells one step away, for each step in turn."""
    numbers_by_cell = {cell: number for number, cell in enumerate(lattice_cells)}
    for step, rest_length in steps:
        for cell_number, cell in enumerate(lattice_cells):
            neighbour = numbers_by_cell.get(tuple(i + j for i, j in zip(cell, step, strict=True)))
            if neighbour is not None:
                yield cell_number, neighbour, rest_length


def _runs_of_equal_springs(springs: Iterable[Spring], net_fields: NetFields) -> Iterator[Run]:
    """Springs with K and Z as runs of consecutive ones."""
    run_begin, run_length = (0, 0, 0.0), 0
    for first_index, second_index, rest_length in springs:
        if run_length and (first_index, second_index, rest_length) == (
            run_begin[0] + run_length,
            run_begin[1] + run_length,
            run_begin[2],
        ):
            run_length += 1
            continue
        if run_length:
            yield Run(
                run_begin[0],
                run_begin[1],
                run_length,
                run_begin[2],
                net_fields["K"],
                net_fields["Z"],
            )
        run_begin, run_length = (first_index, second_index, rest_length), 1
    if run_length:
        yield Run(
            run_begin[0], run_begin[1], run_length, run_begin[2], net_fields["K"], net_fields["Z"]
        )
