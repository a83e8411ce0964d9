"""Points in space: single ones, grains in a box, and a surface over the masses of a body."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import NotRequired, TypedDict

from ergon import _core

Vector = tuple[float, ...]
Chance = Callable[[int], _core.Chance]

# Random places that are tried for one grain before a box counts as full: the densest packings found
# in this way fill 0.38 of space, and take some hundred tries a grain at 0.9 of that (Widom 1966).
PLACEMENT_TRIES = 2_000


class PointFields(TypedDict):
    """Fields of a single point as it is built."""

    axes: int
    X0: Vector
    M: NotRequired[float]
    V0: NotRequired[Vector | None]
    drag: NotRequired[float]


# Where a body is; each has those that its table says.
_Where = TypedDict("_Where", {"from": Vector, "to": Vector, "at": Vector}, total=False)


class PointsFields(_Where):
    """Fields of many points."""

    axes: int
    M: float
    V0: NotRequired[Vector | None]
    drag: float


class GrainsFields(PointsFields):
    """Those of GRAINS."""

    count: int
    scatter: float
    apart: float | None


class SurfaceFields(_Where):
    """Those of a SURFACE."""

    across: float


def mats_by_axis(first: int, count: int, axes: int) -> list[int]:
    """The MATs of a point, axis by axis, if `count` points were added at once."""
    return [first + axis * count for axis in range(axes)]


def interpolated(start: Vector, stop: Vector, fraction: float) -> Vector:
    """The position at a share of the way from `start` to `stop`."""
    return tuple(a + (b - a) * fraction for a, b in zip(start, stop, strict=True))


def unit_vector(direction: Vector | None) -> Vector | None:
    """A direction as a unit vector with three components; None for None."""
    if direction is None:
        return None
    length = math.hypot(*direction)
    return (*(component / length for component in direction), 0.0)[:3]


def add_point(network: _core.Network, name: str, fields: PointFields) -> int:
    """Add a single point; returns the index of its first MAT. Raises EngineError."""
    n_axes = fields["axes"]
    return network.points(
        name,
        axes=n_axes,
        M=[fields.get("M", 0.0)],
        X0=fields["X0"],
        V0=fields.get("V0") or (0.0,) * n_axes,
        Z=fields.get("drag", 0.0),
        numbered=False,
    )


def add_points(
    network: _core.Network,
    points_name: str,
    point_fields: PointsFields,
    point_positions: Sequence[Vector],
    held: Sequence[bool],
) -> int:
    """Add points that share a mass; returns the index of the first MAT. Raises EngineError."""
    axis_count, n = point_fields["axes"], len(point_positions)
    v0 = point_fields.get("V0") or (0.0,) * axis_count
    point_mass = point_fields["M"] / max(1, n - sum(held))
    return network.points(
        points_name,
        axes=axis_count,
        M=[0.0 if is_held else point_mass for is_held in held],
        X0=[place[axis] for axis in range(axis_count) for place in point_positions],
        V0=[v0[axis] for axis in range(axis_count) for _ in point_positions],
        Z=point_fields["drag"],
    )


def add_surface(
    network: _core.Network, points_name: str, surface_fields: SurfaceFields, masses: range
) -> list[int]:
    """Add fixed points below the masses of a body; returns the first MAT along each axis.

    The last axis is that of the masses. Raises EngineError.
    """
    surface_position, across, n = surface_fields["at"], surface_fields["across"], len(masses)
    places = [network.position_of(mat) for mat in masses]
    x0 = [surface_position[0] + across * place.x for place in places]
    if len(surface_position) > 1:
        x0 += [surface_position[1] + across * place.y for place in places]
    first = network.points(
        points_name, axes=len(surface_position), M=[0.0] * n, X0=x0, V0=[0.0] * len(x0)
    )
    return [*range(first, first + len(x0), n), masses.start]


# --- grains -------------------------------------------------------------------------------------


def add_grains(
    network: _core.Network,
    points_name: str,
    grain_fields: GrainsFields,
    chance: Chance,
    module_label: str,
) -> int:
    """Add free points in a box; returns the index of the first MAT. Raises EngineError."""
    start_corner, stop_corner, n = grain_fields["from"], grain_fields["to"], grain_fields["count"]
    if grain_fields["apart"] is None:
        grain_positions = _lattice_positions(
            start_corner, stop_corner, n, grain_fields["scatter"], chance
        )
    else:
        grain_positions = _packed_positions(
            start_corner, stop_corner, n, grain_fields["apart"], chance
        )
        if len(grain_positions) < n:
            message = (
                f"{module_label}: {len(grain_positions):,} of {n:,} points found a random place at "
                "least "
            )
            message += (
                f"{grain_fields['apart']:g} m from all others; make the box larger, or `apart` "
                "smaller"
            )
            error = _core.EngineError(message)
            error.module, error.refusals = module_label, []
            raise error
    return add_points(network, points_name, grain_fields, grain_positions, [False] * n)


def _lattice_positions(
    start_corner: Vector, stop_corner: Vector, n: int, scatter: float, chance: Chance
) -> list[Vector]:
    """Positions on a lattice with equal spacing along all axes, as wide as the box allows, filled
    axis by axis.
    """
    spacing, counts = _widest_lattice(
        [abs(b - a) for a, b in zip(start_corner, stop_corner, strict=True)], n
    )
    offset_max = 0.5 * spacing * scatter
    lattice_positions = []
    for i in range(n):
        grain_position, rest_index, chance_of_grain = [], i, chance(i) if offset_max else None
        for a, b, count in zip(start_corner, stop_corner, counts, strict=True):
            rest_index, index = divmod(rest_index, count)
            offset = (
                chance_of_grain.uniform(-offset_max, offset_max)
                if chance_of_grain is not None
                else 0.0
            )
            grain_position.append(a + math.copysign(index * spacing, b - a) + offset)
        lattice_positions.append(tuple(grain_position))
    return lattice_positions


def _widest_lattice(box_sides: Sequence[float], n: int) -> tuple[float, list[int]]:
    """The widest spacing [m] at which a lattice in a box has n places, and the number along each
    axis.
    """

    def counts(spacing: float) -> list[int]:
        return [int(side / spacing) + 1 for side in box_sides]

    low_spacing, high_spacing = 0.0, max(box_sides)
    if n == 1 or high_spacing == 0.0:
        return high_spacing, [n] + [1] * (len(box_sides) - 1)
    low_spacing = high_spacing / n
    for _ in range(60):  # to full precision
        middle = 0.5 * (low_spacing + high_spacing)
        low_spacing, high_spacing = (
            (middle, high_spacing) if math.prod(counts(middle)) >= n else (low_spacing, middle)
        )
    return low_spacing, counts(low_spacing)


def _packed_positions(
    box_start: Vector, box_stop: Vector, n: int, distance_min: float, chance: Chance
) -> list[Vector]:
    """Random places, each at least `apart` [m] from those before; fewer than n if no more fit.

    Random sequential addition (Widom, Journal of Chemical Physics 44, 1966).
    """
    sides = [sorted(ends) for ends in zip(box_start, box_stop, strict=True)]
    points_by_cell: dict[tuple[int, ...], list[Vector]] = {}

    def is_free(place: Vector, cell: tuple[int, ...]) -> bool:
        return all(
            math.dist(place, other) >= distance_min
            for other in _neighbouring_points(points_by_cell, cell)
        )

    grain_positions: list[Vector] = []
    for i in range(n):
        chance_of_grain = chance(i)
        for _ in range(PLACEMENT_TRIES):
            drawn_position = tuple(chance_of_grain.uniform(low, high) for low, high in sides)
            # Cells are as wide as the distance, so that nearer points are in neighbouring cells.
            position_cell = tuple(math.floor(x / distance_min) for x in drawn_position)
            if is_free(drawn_position, position_cell):
                break
        else:
            return grain_positions
        grain_positions.append(drawn_position)
        points_by_cell.setdefault(position_cell, []).append(drawn_position)
    return grain_positions


def _neighbouring_points(
    cells: Mapping[tuple[int, ...], list[Vector]], cell: tuple[int, ...]
) -> Iterator[Vector]:
    """The places in a cell and in its neighbours."""
    for step in itertools.product((-1, 0, 1), repeat=len(cell)):
        yield from cells.get(tuple(i + j for i, j in zip(cell, step, strict=True)), ())
