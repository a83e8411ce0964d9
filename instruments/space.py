"""Modules of an instrument in space: points with two or three coordinates, rows and cloths of them.

Links of such an instrument measure the distance of two points, and act along the line between them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from ergon import _core
from ergon.notation.tables import value_kinds as k
from ergon.notation.tables.fields import Field, Record
from ergon.notation.tables.shapes import ListOf, Shape, choice

AXES = ("x", "y", "z")
MAX_POINTS = 500_000  # of one CHAIN, CLOTH or GRAINS: one and a half million coordinates

PLACE = ListOf(k.POSITION, 2, 3)
MIDDLE = ListOf(k.POSITION, 1, 2)
VELOCITY = ListOf(k.SPEED, 2, 3)
DIRECTION = ListOf(k.NUMBER, 2, 3)
SIDES = ListOf(k.integer(1, 2_000, "40"), 2, 2)

_Vector = tuple[float, ...]
Chance = Callable[[int], _core.Chance]
Family = Literal["mat", "link", "generator"]


@dataclass(frozen=True, slots=True)
class Space:
    """How many axes an instrument has, and the gravity [m/s²] against the last of them."""

    axes: int
    gravity: float


def tables(between: Field, endpoint: Shape) -> dict[str, tuple[Family, Record]]:
    """Of each kind its family and its table, by the table of ends and what one is written as."""
    mass = Field("M", k.MASS, "mass", required=True)
    whole = Field("M", k.MASS, "mass of all its points together", required=True)
    x0 = Field("X0", PLACE, "position at the beginning, axis by axis", required=True)
    v0 = Field("V0", VELOCITY, "velocity at the beginning, axis by axis", shown="at rest")
    drag = Field("drag", k.DAMPING, "viscosity of what surrounds each point", 0.0)
    stiff = Field("K", k.STIFFNESS, "stiffness")
    damp = Field("Z", k.DAMPING, "viscosity", 0.0)
    rest = Field(
        "rest",
        k.SPAN,
        "distance at which the spring has no force",
        shown="the distance at the beginning",
    )
    memory = (
        Field(
            "yields",
            k.FORCE,
            "greatest force of the spring, either way: beyond it the rest length follows for good",
            shown="never",
        ),
        Field(
            "breaks",
            k.SIZE,
            "how much longer than its rest length it breaks, for good",
            shown="never",
        ),
    )
    springs = (
        Field("K", k.STIFFNESS, "stiffness of each spring", required=True),
        Field("Z", k.DAMPING, "viscosity of each spring", 0.0),
    )
    chain = (
        Field("masses", k.integer(2, MAX_POINTS, "20"), "how many points", required=True),
        whole,
        Field("from", PLACE, "where the first point begins", required=True),
        Field("to", PLACE, "where the last point begins", required=True),
        *springs,
        *memory,
        rest,
        Field("ends", choice("fixed", "free", "left"), "which of its end points are held", "fixed"),
        drag,
    )
    cloth = (
        Field("sides", SIDES, "points across, and up", required=True),
        whole,
        Field("at", PLACE, "where its first corner begins", required=True),
        Field("across", PLACE, "from there to the corner at the end of a row", required=True),
        Field("up", PLACE, "from there to the corner at the end of a column", required=True),
        *springs,
        *memory,
        Field("shear", k.STIFFNESS, "stiffness of the springs across each mesh, both ways", 0.0),
        Field(
            "held", choice("nothing", "corners", "top", "rim"), "which points are held", "nothing"
        ),
        drag,
    )
    grains = (
        Field("count", k.integer(1, MAX_POINTS, "200"), "how many points", required=True),
        whole,
        Field(
            "from", PLACE, "one corner of the box that they fill at the beginning", required=True
        ),
        Field("to", PLACE, "the opposite corner of the box", required=True),
        Field(
            "scatter",
            k.PROPORTION,
            "how far points lie beside their places, as a share of what they are apart",
            0.0,
        ),
        v0,
        drag,
    )
    surface = (
        Field(
            "of",
            endpoint,
            "a STRING or a PLATE, or some of its masses, such as gong.plate or string.3..8",
            required=True,
        ),
        Field("at", MIDDLE, "where its middle lies, along all axes but the last", required=True),
        Field("across", k.SIZE, "how wide the whole STRING or PLATE is", required=True),
    )
    near = Field(
        "K",
        k.STIFFNESS,
        "stiffness of the spring that it is at distances far below `core`",
        required=True,
    )
    core = Field(
        "core",
        k.SIZE,
        "distance beyond which the force falls: far away as one over the square of the distance",
        required=True,
    )
    contact = (
        between,
        Field("K", k.STIFFNESS, "stiffness", required=True),
        damp,
        Field(
            "gap",
            k.POSITION,
            "distance of the two points at which they touch: the sum of two radii; from a plane it "
            "may be below 0",
            required=True,
        ),
        Field(
            "side",
            choice("outside", "inside"),
            "inside: the second end is held in a sphere around the first, whose radius is gap",
            "outside",
        ),
        Field(
            "normal",
            DIRECTION,
            "the first end is a plane through its point: the direction away from it on the side of "
            "the second",
            shown="a sphere",
        ),
        Field("exponent", k.EXPONENT, "power of the depth (1.5: Hertz)", 1.0),
        Field("clamp", k.TRUTH, "never pull at the exit", False),
    )
    return {
        "MAS": ("mat", Record("module", "a point mass in space", (mass, x0, v0, drag))),
        "SOL": ("mat", Record("module", "a fixed point in space", (x0,))),
        "CHAIN": ("generator", Record("module", "points in a row, joined by springs", chain)),
        "CLOTH": ("generator", Record("module", "a net of points and springs", cloth)),
        "GRAINS": ("generator", Record("module", "free points in a box", grains)),
        "SURFACE": (
            "generator",
            Record("module", "masses of one axis as points, which move along the last", surface),
        ),
        "RES": (
            "link",
            Record("module", "a spring along a distance", (between, stiff, rest, *memory)),
        ),
        "FRO": ("link", Record("module", "a damper along a distance", (between, damp))),
        "REF": (
            "link",
            Record(
                "module",
                "a spring and damper along a distance",
                (between, stiff, damp, rest, *memory),
            ),
        ),
        "ATTRACTION": (
            "link",
            Record("module", "masses that attract each other", (between, near, core)),
        ),
        "BUT": ("link", Record("module", "a contact of spheres, or with a wall", contact)),
    }


def count(kind: str, fields: Mapping[str, Any]) -> int:
    """How many points a module has."""
    if kind == "CLOTH":
        across, up = fields["sides"]
        return int(across * up)
    if kind == "SURFACE":
        return int(fields["of"].count)
    return int(fields.get("masses") or fields.get("count") or 1)


def add(
    network: _core.Network, kind: str, name: str, fields: Mapping[str, Any], chance: Chance
) -> int:
    """Add the points of a module, and the springs of a generator; the index of the first MAT.

    `chance` gives the random numbers of a member by its index. Raises EngineError.
    """
    if kind == "GRAINS":
        return _grains(network, name, fields, chance)
    return {"CHAIN": _chain, "CLOTH": _cloth}.get(kind, _point)(network, name, fields)


def along(first: int, count: int, axes: int) -> list[int]:
    """The MATs of a point, axis by axis, where `count` points were added at once."""
    return [first + axis * count for axis in range(axes)]


def add_surface(
    network: _core.Network, name: str, fields: Mapping[str, Any], masses: range
) -> list[int]:
    """Add fixed points below the masses of a body; the first MAT along each axis.

    The last axis is that of the masses. Raises EngineError.
    """
    at, across, n = fields["at"], fields["across"], len(masses)
    places = [network.position_of(mat) for mat in masses]
    x0 = [at[0] + across * place.x for place in places]
    if len(at) > 1:
        x0 += [at[1] + across * place.y for place in places]
    first = network.points(name, axes=len(at), M=[0.0] * n, X0=x0, V0=[0.0] * len(x0))
    return [*range(first, first + len(x0), n), masses.start]


def unit(direction: _Vector | None) -> _Vector | None:
    """A direction as a vector of length 1 with three components; None where there is none."""
    if direction is None:
        return None
    length = math.hypot(*direction)
    return (*(one / length for one in direction), 0.0)[:3]


def _point(network: _core.Network, name: str, fields: Mapping[str, Any]) -> int:
    axes = fields["axes"]
    return network.points(
        name,
        axes=axes,
        M=[fields.get("M", 0.0)],
        X0=fields["X0"],
        V0=fields.get("V0") or (0.0,) * axes,
        Z=fields.get("drag", 0.0),
        numbered=False,
    )


def _points(
    network: _core.Network,
    name: str,
    fields: Mapping[str, Any],
    places: Sequence[_Vector],
    held: Sequence[bool],
) -> int:
    axes, n = fields["axes"], len(places)
    v0 = fields.get("V0") or (0.0,) * axes
    each = fields["M"] / max(1, n - sum(held))
    return network.points(
        name,
        axes=axes,
        M=[0.0 if is_held else each for is_held in held],
        X0=[place[axis] for axis in range(axes) for place in places],
        V0=[v0[axis] for axis in range(axes) for _ in places],
        Z=fields["drag"],
    )


def _chain(network: _core.Network, name: str, fields: Mapping[str, Any]) -> int:
    n, axes = fields["masses"], fields["axes"]
    start, stop = fields["from"], fields["to"]
    places = [_between(start, stop, i / (n - 1)) for i in range(n)]
    held = [False] * n
    held[0] = fields["ends"] in ("fixed", "left")
    held[-1] = fields["ends"] == "fixed"
    first = _points(network, name, fields, places, held)
    rest = math.dist(start, stop) / (n - 1) if fields["rest"] is None else fields["rest"]
    network.space_ref(
        f"{name}.link" if name else "link",
        along(first, n, axes),
        along(first + 1, n, axes),
        count=n - 1,
        rest=rest,
        K=fields["K"],
        Z=fields["Z"],
        yields=fields["yields"],
        breaks=fields["breaks"],
    )
    return first


def _grains(network: _core.Network, name: str, fields: Mapping[str, Any], chance: Chance) -> int:
    """Points on a square lattice that is as wide as the box allows, filled axis by axis."""
    start, stop, n = fields["from"], fields["to"], fields["count"]
    spacing, counts = _lattice([abs(b - a) for a, b in zip(start, stop, strict=True)], n)
    spread = 0.5 * spacing * fields["scatter"]
    places = []
    for i in range(n):
        place, rest, own = [], i, chance(i) if spread else None
        for a, b, count in zip(start, stop, counts, strict=True):
            rest, at = divmod(rest, count)
            beside = own.uniform(-spread, spread) if own is not None else 0.0
            place.append(a + math.copysign(at * spacing, b - a) + beside)
        places.append(tuple(place))
    return _points(network, name, fields, places, [False] * n)


def _lattice(sides: Sequence[float], n: int) -> tuple[float, list[int]]:
    """The widest spacing [m] at which a lattice in a box has n places, and how many each way."""

    def counts(spacing: float) -> list[int]:
        return [int(side / spacing) + 1 for side in sides]

    low, high = 0.0, max(sides)
    if n == 1 or high == 0.0:
        return high, [n] + [1] * (len(sides) - 1)
    low = high / n
    for _ in range(60):  # to the last digit
        middle = 0.5 * (low + high)
        low, high = (middle, high) if math.prod(counts(middle)) >= n else (low, middle)
    return low, counts(low)


def _cloth(network: _core.Network, name: str, fields: Mapping[str, Any]) -> int:
    """Row by row: springs along each row, along each column, and across each mesh."""
    (across, up), axes = fields["sides"], fields["axes"]
    n = across * up
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
    held = [_is_held(fields["held"], i, j, across, up) for j in range(up) for i in range(across)]
    first = _points(network, name, fields, places, held)
    link = f"{name}.link" if name else "link"

    def join(low: int, high: int, count: int, stiffness: float, damping: float) -> None:
        if count < 1 or stiffness == 0.0 == damping:
            return
        network.space_ref(
            link,
            along(first + low, n, axes),
            along(first + high, n, axes),
            count=count,
            rest=math.dist(places[low], places[high]),
            K=stiffness,
            Z=damping,
            yields=fields["yields"],
            breaks=fields["breaks"],
        )

    spring, shear = (fields["K"], fields["Z"]), fields["shear"]
    for j in range(up):
        join(j * across, j * across + 1, across - 1, *spring)
    if up > 1:
        join(0, across, n - across, *spring)
    for j in range(up - 1):
        join(j * across, (j + 1) * across + 1, across - 1, shear, 0.0)
        join(j * across + 1, (j + 1) * across, across - 1, shear, 0.0)
    return first


def _between(start: _Vector, stop: _Vector, share: float) -> _Vector:
    return tuple(a + (b - a) * share for a, b in zip(start, stop, strict=True))


def _is_held(held: str, i: int, j: int, across: int, up: int) -> bool:
    sides, ends = i in (0, across - 1), j in (0, up - 1)
    is_top = j == up - 1
    return {"corners": sides and ends, "top": is_top, "rim": sides or ends}.get(held, False)
