"""Fields of the modules of an instrument in space."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

from ergon.notation.tables import value_kinds
from ergon.notation.tables.compound import ListOf
from ergon.notation.tables.fields import Field, Record
from ergon.notation.tables.shapes import Shape, choice

MAX_POINTS = 500_000  # points of one generator: 1.5 million coordinates
MAX_SPRINGS = 2_000_000  # springs of one generator

PLACE = ListOf(value_kinds.POSITION, 2, 3)
CENTRE = ListOf(value_kinds.POSITION, 1, 2)
VELOCITY = ListOf(value_kinds.SPEED, 2, 3)
DIRECTION = ListOf(value_kinds.NUMBER, 2, 3)
WIDTHS = ListOf(value_kinds.SIZE, 2, 3)
AXIS = choice("x", "y", "z")
CLOTH_COUNTS = ListOf(value_kinds.integer(1, 2_000, "40"), 2, 2)
BLOCK_COUNTS = ListOf(value_kinds.integer(1, 2_000, "8"), 2, 3)

Family = Literal["mat", "link", "generator"]

# The shape of a contact's first end that is read from a file.
SURFACE_FILE = Record(
    "surface of a file",
    "triangles that points touch on either side",
    (
        Field(
            "file",
            value_kinds.PATH,
            "a Wavefront OBJ or a glTF file, whose origin lies at the first end",
            required=True,
        ),
        Field("scale", value_kinds.SIZE, "length of one unit of the file", 1.0, shown="1 m"),
        Field("up", AXIS, "which axis of the file is the last of the space", "z"),
    ),
)


_MASS = Field("M", value_kinds.MASS, "mass", required=True)
_TOTAL_MASS = Field("M", value_kinds.MASS, "mass of all its points together", required=True)
_X0 = Field("X0", PLACE, "position at the beginning, axis by axis", required=True)
_V0 = Field("V0", VELOCITY, "velocity at the beginning, axis by axis", shown="at rest")
_DRAG = Field("drag", value_kinds.DAMPING, "viscosity of what surrounds each point", 0.0)
_STIFFNESS = Field("K", value_kinds.STIFFNESS, "stiffness")
_DAMPING = Field("Z", value_kinds.DAMPING, "viscosity", 0.0)
_REST = Field(
    "rest",
    value_kinds.SPAN,
    "distance at which the spring has no force",
    shown="the distance at the beginning",
)
_LENGTH = replace(_REST, doc="distance that counts as d = 0")
_STRENGTH_LIMITS = (
    Field(
        "yields",
        value_kinds.FORCE,
        "greatest force of the spring, either way: beyond it the rest length follows for good",
        shown="never",
    ),
    Field(
        "breaks",
        value_kinds.SIZE,
        "how much longer than its rest length it breaks, for good",
        shown="never",
    ),
)
_SPRINGS = (
    Field("K", value_kinds.STIFFNESS, "stiffness of each spring", required=True),
    Field("Z", value_kinds.DAMPING, "viscosity of each spring", 0.0),
)
_STRETCH = Field(
    "stretch",
    value_kinds.PROPORTION,
    "extension of the springs at the beginning, as a share of their rest length",
    0.0,
)
_CHAIN = (
    Field("masses", value_kinds.integer(2, MAX_POINTS, "20"), "how many points", required=True),
    _TOTAL_MASS,
    Field("from", PLACE, "where the first point begins", required=True),
    Field("to", PLACE, "where the last point begins", required=True),
    *_SPRINGS,
    *_STRENGTH_LIMITS,
    _REST,
    Field("ends", choice("fixed", "free", "left"), "which of its end points are held", "fixed"),
    _DRAG,
)
_CLOTH = (
    Field("sides", CLOTH_COUNTS, "points across, and up", required=True),
    _TOTAL_MASS,
    Field("at", PLACE, "where its first corner begins", required=True),
    Field("across", PLACE, "from there to the corner at the end of a row", required=True),
    Field("up", PLACE, "from there to the corner at the end of a column", required=True),
    *_SPRINGS,
    *_STRENGTH_LIMITS,
    _STRETCH,
    Field(
        "shear", value_kinds.STIFFNESS, "stiffness of the springs across each mesh, both ways", 0.0
    ),
    Field("held", choice("nothing", "corners", "top", "rim"), "which points are held", "nothing"),
    _DRAG,
)
_SPAN = Field(
    "span",
    value_kinds.integer(1, 3, "1"),
    "how many places away along each axis points are joined",
    1,
)
_DISC = (
    Field(
        "rings",
        value_kinds.integer(1, 400, "8"),
        "rings of points around its middle",
        required=True,
    ),
    _TOTAL_MASS,
    Field("at", PLACE, "where its middle begins", required=True),
    Field("across", value_kinds.SIZE, "how wide it is, from corner to corner", required=True),
    Field(
        "normal",
        DIRECTION,
        "with three axes the direction that it faces",
        shown="the last axis",
    ),
    *_SPRINGS,
    *_STRENGTH_LIMITS,
    _STRETCH,
    Field("held", choice("nothing", "rim", "middle"), "which points are held", "nothing"),
    _V0,
    _DRAG,
)
_BLOCK = (
    Field("sides", BLOCK_COUNTS, "points along each axis", required=True),
    _TOTAL_MASS,
    Field("from", PLACE, "where its first corner begins", required=True),
    Field("to", PLACE, "where the opposite corner begins", required=True),
    *_SPRINGS,
    *_STRENGTH_LIMITS,
    _STRETCH,
    _SPAN,
    Field("held", choice("nothing", "bottom", "top", "rim"), "which points are held", "nothing"),
    _V0,
    _DRAG,
)
_BALL = (
    Field("points", value_kinds.integer(3, 200, "9"), "points along its diameter", required=True),
    _TOTAL_MASS,
    Field("at", PLACE, "where its middle begins", required=True),
    Field("across", value_kinds.SIZE, "its diameter", required=True),
    *_SPRINGS,
    *_STRENGTH_LIMITS,
    _STRETCH,
    _SPAN,
    _V0,
    _DRAG,
)
_MESH = (
    Field(
        "file",
        value_kinds.PATH,
        "a Wavefront OBJ or a glTF file: its vertices are points, edges of its faces and lines "
        "springs",
        required=True,
    ),
    _TOTAL_MASS,
    Field("at", PLACE, "where the origin of the file lies", required=True),
    Field("scale", value_kinds.SIZE, "length of one unit of the file", 1.0, shown="1 m"),
    Field("up", AXIS, "which axis of the file is the last of the space", "z"),
    *_SPRINGS,
    *_STRENGTH_LIMITS,
    _STRETCH,
    Field(
        "held",
        choice("nothing", "bottom", "top"),
        "which points are held: the lowest, or the highest",
        "nothing",
    ),
    _V0,
    _DRAG,
)
_GRAINS = (
    Field("count", value_kinds.integer(1, MAX_POINTS, "200"), "how many points", required=True),
    _TOTAL_MASS,
    Field("from", PLACE, "one corner of the box that they fill at the beginning", required=True),
    Field("to", PLACE, "the opposite corner of the box", required=True),
    Field(
        "scatter",
        value_kinds.PROPORTION,
        "how far points lie beside their places, as a share of what they are apart",
        0.0,
    ),
    Field(
        "apart",
        value_kinds.SIZE,
        "places are random, and at least so far from each other",
        shown="a square lattice",
    ),
    _V0,
    _DRAG,
)
_ATTRACTION_STIFFNESS = Field(
    "K",
    value_kinds.STIFFNESS,
    "stiffness at distances far below `core`, where it acts as a spring",
    required=True,
)
_CORE = Field(
    "core",
    value_kinds.SIZE,
    "distance beyond which the force falls: far away as one over the square of the distance",
    required=True,
)
_SURFACE = (
    Field("at", CENTRE, "where its middle lies, along all axes but the last", required=True),
    Field("across", value_kinds.SIZE, "how wide the whole STRING or PLATE is", required=True),
)
_CONTACT = (
    Field("K", value_kinds.STIFFNESS, "stiffness", required=True),
    _DAMPING,
    Field(
        "gap",
        value_kinds.POSITION,
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
        SURFACE_FILE,
        "the first end is a surface of triangles around its point, which the second touches",
        shown="none",
    ),
    Field("exponent", value_kinds.EXPONENT, "power of the depth (1.5: Hertz)", 1.0),
    Field("clamp", value_kinds.BOOLEAN, "never pull at the exit", False),
    Field(
        "friction",
        value_kinds.FRICTION,
        "coefficient of dry friction across the line of the contact: its greatest force as a "
        "share of the push",
        0.0,
    ),
    Field(
        "cohesion",
        value_kinds.FORCE,
        "how strongly the contact also pulls: what has touched sticks",
        shown="none",
    ),
    Field(
        "reach",
        value_kinds.SIZE,
        "how far beyond touching it pulls, evenly less and less",
        shown="needed with cohesion",
    ),
)


def tables(
    between: Field, endpoint: Shape, law: tuple[Field, ...]
) -> dict[str, tuple[Family, Record]]:
    """The family and the table of each kind, given the fields for ends and laws.

    `endpoint` reads an end.
    """
    surface_masses = Field(
        "of",
        endpoint,
        "a STRING or a PLATE, or some of its masses, such as gong.plate or string.3..8",
        required=True,
    )
    return {
        "MAS": ("mat", Record("module", "a point mass in space", (_MASS, _X0, _V0, _DRAG))),
        "SOL": ("mat", Record("module", "a fixed point in space", (_X0,))),
        "CHAIN": (
            "generator",
            Record(
                "module", "points in a row, joined by springs", _CHAIN, synonyms={"held": "ends"}
            ),
        ),
        "CLOTH": ("generator", Record("module", "a net of points and springs", _CLOTH)),
        "DISC": ("generator", Record("module", "a round net of triangles", _DISC)),
        "BLOCK": ("generator", Record("module", "a box of points and springs", _BLOCK)),
        "BALL": ("generator", Record("module", "a ball of points and springs", _BALL)),
        "MESH": ("generator", Record("module", "points and springs of a file", _MESH)),
        "GRAINS": ("generator", Record("module", "free points in a box", _GRAINS)),
        "SURFACE": (
            "generator",
            Record(
                "module",
                "masses of one axis as points, which move along the last",
                (surface_masses, *_SURFACE),
            ),
        ),
        "RES": (
            "link",
            Record(
                "module",
                "a spring along a distance",
                (between, _STIFFNESS, _REST, *_STRENGTH_LIMITS),
            ),
        ),
        "FRO": ("link", Record("module", "a damper along a distance", (between, _DAMPING))),
        "REF": (
            "link",
            Record(
                "module",
                "a spring and damper along a distance",
                (between, _STIFFNESS, _DAMPING, _REST, *_STRENGTH_LIMITS),
            ),
        ),
        "LNL": (
            "link",
            Record(
                "module", "a law of a distance", (between, *law, _LENGTH), free=value_kinds.CONSTANT
            ),
        ),
        "ATTRACTION": (
            "link",
            Record(
                "module",
                "masses that attract each other, in all pairs",
                (between, _ATTRACTION_STIFFNESS, _CORE),
            ),
        ),
        "BUT": (
            "link",
            Record("module", "a contact of spheres, or with a wall", (between, *_CONTACT)),
        ),
    }
