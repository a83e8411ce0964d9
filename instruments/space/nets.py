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
from ergon.instruments.space.mesh import TURNS, Mesh, placed
from ergon.instruments.space.points import PointsFields, Vector, add_points, along, between

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


def add(network: _core.Network, name: str, net: Net, fields: NetFields) -> int:
    """Add a net; returns the index of the first MAT. Raises EngineError."""
    first, n, axes = (
        add_points(network, name, fields, net.places, net.held),
        len(net.places),
        fields["axes"],
    )
    for run in net.runs:
        if run.count < 1 or run.K == 0.0 == run.Z:
            continue
        network.space_ref(
            f"{name}.link" if name else "link",
            along(first + run.first, n, axes),
            along(first + run.second, n, axes),
            count=run.count,
            rest=run.rest / (1.0 + fields.get("stretch", 0.0)),
            K=run.K,
            Z=run.Z,
            yields=fields["yields"],
            breaks=fields["breaks"],
        )
    return first


def chain(fields: ChainFields) -> Net:
    """Points in a row, each joined to the next."""
    n, start, stop = fields["masses"], fields["from"], fields["to"]
    places = [between(start, stop, i / (n - 1)) for i in range(n)]
    held = [False] * n
    held[0] = fields["ends"] in ("fixed", "left")
    held[-1] = fields["ends"] == "fixed"
    rest = math.dist(start, stop) / (n - 1) if fields["rest"] is None else fields["rest"]
    return Net(places, held, [Run(0, 1, n - 1, rest, fields["K"], fields["Z"])])


def cloth(fields: ClothFields) -> Net:
    """Points row by row, with springs along each row, along each column, and across each cell."""
    (across, up), axes = fields["sides"], fields["axes"]
    corner, right, upwards = fields["at"], fields["across"], fields["up"]
    places = [
        tuple(
            corner[axis]
            + right[axis] * (i / max(1, across - 1))
            + upwards[axis] * (j / max(1, up - 1))
            for axis in range(axes)
        )
        for j in range(up)
        for i in range(across)
    ]
    sides, ends = (0, across - 1), (0, up - 1)
    is_held: Callable[[int, int], bool] = {
        "corners": lambda i, j: i in sides and j in ends,
        "top": lambda i, j: j == up - 1,
        "rim": lambda i, j: i in sides or j in ends,
    }.get(fields["held"], lambda i, j: False)
    held = [is_held(i, j) for j in range(up) for i in range(across)]

    def run(low: int, high: int, count: int, stiffness: float, damping: float) -> Run:
        return Run(low, high, count, math.dist(places[low], places[high]), stiffness, damping)

    def runs() -> Iterator[Run]:
        spring, shear = (fields["K"], fields["Z"]), (fields["shear"], 0.0)
        for j in range(up if across > 1 else 0):
            yield run(j * across, j * across + 1, across - 1, *spring)
        if up > 1:
            yield run(0, across, (up - 1) * across, *spring)
        for j in range(up - 1 if across > 1 else 0):
            yield run(j * across, (j + 1) * across + 1, across - 1, *shear)
            yield run(j * across + 1, (j + 1) * across, across - 1, *shear)

    return Net(places, held, runs())


def disc(fields: DiscFields) -> Net:
    """Points of a triangular lattice, in rings around a middle."""
    rings, position, axes = fields["rings"], fields["at"], fields["axes"]
    spacing = 0.5 * fields["across"] / rings
    right, upwards = _plane(fields["normal"])
    height = math.sqrt(0.75)
    # The axes of the cells are 60 degrees apart.
    numbers = range(-rings, rings + 1)
    cells = [(q, r) for r in numbers for q in numbers if abs(q + r) <= rings]
    places = [
        tuple(
            position[axis] + spacing * ((q + 0.5 * r) * right[axis] + height * r * upwards[axis])
            for axis in range(axes)
        )
        for q, r in cells
    ]
    ring = {"rim": rings, "middle": 0}.get(fields["held"])
    held = [max(abs(q), abs(r), abs(q + r)) == ring for q, r in cells]
    springs = _springs(cells, [((1, 0), spacing), ((0, 1), spacing), ((-1, 1), spacing)])
    return Net(places, held, _equal(springs, fields))


def _plane(normal: Vector | None) -> tuple[Vector, Vector]:
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


def block(fields: BlockFields) -> Net:
    """A box of points on a lattice, each joined to its neighbours."""
    start, stop, counts = fields["from"], fields["to"], fields["sides"]
    spacing = [(b - a) / max(1, n - 1) for a, b, n in zip(start, stop, counts, strict=True)]
    cells = _cells(counts)
    places = [
        tuple(a + i * step for a, i, step in zip(start, cell, spacing, strict=True))
        for cell in cells
    ]
    top = counts[-1] - 1
    is_held: Callable[[Cell], bool] = {
        "bottom": lambda cell: cell[-1] == 0,
        "top": lambda cell: cell[-1] == top,
        "rim": lambda cell: any(i in (0, n - 1) for i, n in zip(cell, counts, strict=True)),
    }.get(fields["held"], lambda cell: False)
    springs = _springs(cells, _neighbours(fields["span"], spacing))
    return Net(places, [is_held(cell) for cell in cells], _equal(springs, fields))


def ball(fields: BallFields) -> Net:
    """The points of a lattice that lie in a sphere or a circle, each joined to its neighbours."""
    position, n = fields["at"], fields["points"]
    spacing, middle = fields["across"] / (n - 1), 0.5 * (n - 1)
    cells = [cell for cell in _cells((n,) * len(position)) if _is_in_ball(cell, n)]
    places = [
        tuple(a + (i - middle) * spacing for a, i in zip(position, cell, strict=True))
        for cell in cells
    ]
    springs = _springs(cells, _neighbours(fields["span"], [spacing] * len(position)))
    return Net(places, [False] * len(cells), _equal(springs, fields))


def _is_in_ball(cell: Cell, n: int) -> bool:
    """Whether a cell of a lattice n wide is no farther from its middle than the outermost cell on
    an axis.
    """
    return sum((2 * i - n + 1) ** 2 for i in cell) <= (n - 1) ** 2


def mesh(fields: MeshFields) -> Net:
    """The points of a file, joined along its edges."""
    model, up = fields["file"], fields["up"]
    places = list(placed(model, fields["scale"], up, fields["at"]))
    heights = [point[TURNS[up][-1]] for point in model.points]
    end = {"bottom": min(heights), "top": max(heights)}.get(fields["held"])
    springs = ((a, b, math.dist(places[a], places[b])) for a, b in model.edges)
    return Net(places, [height == end for height in heights], _equal(springs, fields))


# The number of points of a net.
COUNTS: dict[str, Callable[..., int]] = {
    "CLOTH": lambda fields: math.prod(fields["sides"]),
    "BLOCK": lambda fields: math.prod(fields["sides"]),
    "DISC": lambda fields: 3 * fields["rings"] * (fields["rings"] + 1) + 1,
    "BALL": lambda fields: _in_ball(fields["points"], fields["axes"]),
    "MESH": lambda fields: len(fields["file"].points) if fields["file"] else 1,
}


def _in_ball(n: int, axes: int) -> int:
    """The number of cells of a lattice in a ball that is n cells wide."""
    squares = [(2 * i - n + 1) ** 2 for i in range(n)]
    sums = {0: 1}
    for _ in range(axes):
        wider: dict[int, int] = {}
        for total, count in sums.items():
            for square in squares:
                if total + square <= (n - 1) ** 2:
                    wider[total + square] = wider.get(total + square, 0) + count
        sums = wider
    return sum(sums.values())


# --- lattices -----------------------------------------------------------------------------------


def _cells(counts: Sequence[int]) -> list[Cell]:
    """All cells of a box, the first axis fastest."""
    return [cell[::-1] for cell in itertools.product(*(range(n) for n in reversed(counts)))]


def _neighbours(span: int, spacing: Sequence[float]) -> Iterator[tuple[Cell, float]]:
    """Steps to all neighbours within `span` along each axis that come later in order, with their
    lengths [m].
    """
    for step in itertools.product(range(-span, span + 1), repeat=len(spacing)):
        if step[::-1] > (0,) * len(step):
            yield step, math.hypot(*(i * size for i, size in zip(step, spacing, strict=True)))


def _springs(cells: Sequence[Cell], steps: Iterable[tuple[Cell, float]]) -> Iterator[Spring]:
    """Springs from each cell to the cells one step away, for each step in turn."""
    numbers = {cell: number for number, cell in enumerate(cells)}
    for step, rest in steps:
        for number, cell in enumerate(cells):
            there = numbers.get(tuple(i + j for i, j in zip(cell, step, strict=True)))
            if there is not None:
                yield number, there, rest


def _equal(springs: Iterable[Spring], fields: NetFields) -> Iterator[Run]:
    """Springs with K and Z as runs of consecutive ones."""
    begin, count = (0, 0, 0.0), 0
    for a, b, rest in springs:
        if count and (a, b, rest) == (begin[0] + count, begin[1] + count, begin[2]):
            count += 1
            continue
        if count:
            yield Run(begin[0], begin[1], count, begin[2], fields["K"], fields["Z"])
        begin, count = (a, b, rest), 1
    if count:
        yield Run(begin[0], begin[1], count, begin[2], fields["K"], fields["Z"])
