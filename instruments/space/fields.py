"""Fields of the modules of an instrument in space."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

from ergon.notation.tables import value_kinds as k
from ergon.notation.tables.fields import Field, Record
from ergon.notation.tables.shapes import ListOf, Shape, choice

MAX_POINTS = 500_000  # of one generator: one and a half million coordinates
MAX_SPRINGS = 2_000_000  # of one generator

PLACE = ListOf(k.POSITION, 2, 3)
MIDDLE = ListOf(k.POSITION, 1, 2)
VELOCITY = ListOf(k.SPEED, 2, 3)
DIRECTION = ListOf(k.NUMBER, 2, 3)
WIDTHS = ListOf(k.SIZE, 2, 3)
UP = choice("x", "y", "z")
SIDES = ListOf(k.integer(1, 2_000, "40"), 2, 2)
COUNTS = ListOf(k.integer(1, 2_000, "8"), 2, 3)

Family = Literal["mat", "link", "generator"]

# The shape of a contact's first end, if it is that of a file.
WALL = Record(
    "surface of a file",
    "triangles that points touch on either side",
    (
        Field(
            "file",
            k.PATH,
            "a Wavefront OBJ or a glTF file, whose origin lies at the first end",
            required=True,
        ),
        Field("scale", k.SIZE, "length of one unit of the file", 1.0, shown="1 m"),
        Field("up", UP, "which axis of the file is the last of the space", "z"),
    ),
)


def tables(
    between: Field, endpoint: Shape, law: tuple[Field, ...]
) -> dict[str, tuple[Family, Record]]:
    """The family and the table of each kind, given the fields for ends and laws.

    `endpoint` reads an end.
    """
    mass = Field("M", k.MASS, "mass", required=True)
    mass_field = Field("M", k.MASS, "mass of all its points together", required=True)
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
    length = replace(rest, doc="distance that counts as d = 0")
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
    stretch = Field(
        "stretch",
        k.PROPORTION,
        "how much longer than at rest springs are at the beginning, as a share of that",
        0.0,
    )
    chain = (
        Field("masses", k.integer(2, MAX_POINTS, "20"), "how many points", required=True),
        mass_field,
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
        mass_field,
        Field("at", PLACE, "where its first corner begins", required=True),
        Field("across", PLACE, "from there to the corner at the end of a row", required=True),
        Field("up", PLACE, "from there to the corner at the end of a column", required=True),
        *springs,
        *memory,
        stretch,
        Field("shear", k.STIFFNESS, "stiffness of the springs across each mesh, both ways", 0.0),
        Field(
            "held", choice("nothing", "corners", "top", "rim"), "which points are held", "nothing"
        ),
        drag,
    )
    span = Field(
        "span", k.integer(1, 3, "1"), "how many places away along each axis points are joined", 1
    )
    disc = (
        Field("rings", k.integer(1, 400, "8"), "rings of points around its middle", required=True),
        mass_field,
        Field("at", PLACE, "where its middle begins", required=True),
        Field("across", k.SIZE, "how wide it is, from corner to corner", required=True),
        Field(
            "normal",
            DIRECTION,
            "with three axes the direction that it faces",
            shown="the last axis",
        ),
        *springs,
        *memory,
        stretch,
        Field("held", choice("nothing", "rim", "middle"), "which points are held", "nothing"),
        v0,
        drag,
    )
    block = (
        Field("sides", COUNTS, "points along each axis", required=True),
        mass_field,
        Field("from", PLACE, "where its first corner begins", required=True),
        Field("to", PLACE, "where the opposite corner begins", required=True),
        *springs,
        *memory,
        stretch,
        span,
        Field(
            "held", choice("nothing", "bottom", "top", "rim"), "which points are held", "nothing"
        ),
        v0,
        drag,
    )
    ball = (
        Field("points", k.integer(3, 200, "9"), "points along its diameter", required=True),
        mass_field,
        Field("at", PLACE, "where its middle begins", required=True),
        Field("across", k.SIZE, "its diameter", required=True),
        *springs,
        *memory,
        stretch,
        span,
        v0,
        drag,
    )
    mesh = (
        Field(
            "file",
            k.PATH,
            "a Wavefront OBJ or a glTF file: its vertices are points, edges of its faces and lines "
            "springs",
            required=True,
        ),
        mass_field,
        Field("at", PLACE, "where the origin of the file lies", required=True),
        Field("scale", k.SIZE, "length of one unit of the file", 1.0, shown="1 m"),
        Field("up", UP, "which axis of the file is the last of the space", "z"),
        *springs,
        *memory,
        stretch,
        Field(
            "held",
            choice("nothing", "bottom", "top"),
            "which points are held: the lowest, or the highest",
            "nothing",
        ),
        v0,
        drag,
    )
    grains = (
        Field("count", k.integer(1, MAX_POINTS, "200"), "how many points", required=True),
        mass_field,
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
        Field(
            "apart",
            k.SIZE,
            "places are random, and at least so far from each other",
            shown="a square lattice",
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
        Field(
            "box",
            WIDTHS,
            "the second end is held in a box around the first: how wide it is along each axis; gap "
            "is the distance of a wall at which they touch",
            shown="none",
        ),
        Field(
            "mesh",
            WALL,
            "the first end is a surface of triangles around its point, which the second touches",
            shown="none",
        ),
        Field("exponent", k.EXPONENT, "power of the depth (1.5: Hertz)", 1.0),
        Field("clamp", k.BOOLEAN, "never pull at the exit", False),
        Field(
            "friction",
            k.FRICTION,
            "coefficient of dry friction across the line of the contact: its greatest force as a "
            "share of the push",
            0.0,
        ),
        Field(
            "cohesion",
            k.FORCE,
            "how strongly the contact also pulls: what has touched sticks",
            shown="none",
        ),
        Field(
            "reach",
            k.SIZE,
            "how far beyond touching it pulls, evenly less and less",
            shown="needed with cohesion",
        ),
    )
    return {
        "MAS": ("mat", Record("module", "a point mass in space", (mass, x0, v0, drag))),
        "SOL": ("mat", Record("module", "a fixed point in space", (x0,))),
        "CHAIN": (
            "generator",
            Record("module", "points in a row, joined by springs", chain, meant={"held": "ends"}),
        ),
        "CLOTH": ("generator", Record("module", "a net of points and springs", cloth)),
        "DISC": ("generator", Record("module", "a round net of triangles", disc)),
        "BLOCK": ("generator", Record("module", "a box of points and springs", block)),
        "BALL": ("generator", Record("module", "a ball of points and springs", ball)),
        "MESH": ("generator", Record("module", "points and springs of a file", mesh)),
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
        "LNL": (
            "link",
            Record("module", "a law of a distance", (between, *law, length), free=k.CONSTANT),
        ),
        "ATTRACTION": (
            "link",
            Record("module", "masses that attract each other, in all pairs", (between, near, core)),
        ),
        "BUT": ("link", Record("module", "a contact of spheres, or with a wall", contact)),
    }
