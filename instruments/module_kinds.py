"""The kinds of modules: the fields of each, with units and meaning."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal

from ergon.instruments import following, proxies, space
from ergon.instruments.bodies import DECAY, Bending
from ergon.instruments.materials import MATERIAL
from ergon.instruments.modal import (
    BANK_DECAYS,
    BANK_GAINS,
    BANK_PITCHES,
    MODES_DECAYS,
    MODES_PITCHES,
    PLACES,
)
from ergon.instruments.model import Form
from ergon.instruments.space import fields as space_fields
from ergon.instruments.spread import GAP
from ergon.instruments.stiff import INHARMONICITY, STRETCHING
from ergon.notation.tables import value_kinds as k
from ergon.notation.tables.fields import Field, Record, Values
from ergon.notation.tables.shapes import (
    MISSING,
    Context,
    Either,
    ListOf,
    Name,
    Pair,
    Reference,
    Shape,
    Text,
    choice,
    wrong_shape,
)
from ergon.notation.text.document import Node, Scalar
from ergon.notation.text.errors import TextError

MAX_MODULES = 2_000_000  # of one generator: some 200 MB of state and parameters
MAX_RADIUS = 400  # of a PLATE: half a million masses, whose lowest mode takes ten seconds to find
MAX_LAW = 2_000  # characters of a law
MAX_POINTS = 10_000  # of a law given by points

Family = Literal["mat", "link", "generator", "input"]


@dataclass(frozen=True, slots=True)
class Kind:
    """A module kind: its family, and its table for each form of instrument that may have it.

    `gliding`: the parameters that may change while a piece plays; a generator changes as a
    whole. `scaled`: for a link, the fields that the engine's factors of K and of Z multiply.
    """

    name: str
    family: Family
    tables: Mapping[Form, Record]
    gliding: tuple[str, ...] = ()
    scaled: tuple[str, str] = ("K", "Z")

    @property
    def table(self) -> Record:
        """The table in SI units, or that of a kind that exists only in space."""
        return self.tables.get("si") or self.tables["space"]


def _law(text: str) -> str:
    if not text.strip() or len(text) > MAX_LAW:
        message = f"a law has from 1 to {MAX_LAW} characters, such as k*d + q*d**3"
        raise TextError(message, length=max(1, min(len(text), 80)), code="E207")
    return text


LAW = Text(_law, "a law, such as k*d + q*d**3, or the name of one", types=("string",))
ENDPOINT = Reference(
    "a module, such as m, bell.m, gong.centre or a key", ("modules", "instruments", "keys")
)
BETWEEN = Field(
    "between",
    ListOf(ENDPOINT, 2, 2),
    "the two MATs that it joins: [a, b]; of a range, as in [a, string.3..8], each",
    required=True,
)


@dataclass(frozen=True, slots=True)
class Start:
    """`X0: {at: centre, x: 1mm}`: members, and the value at which they start."""

    at: Name
    value: float


def _start(name: str, unit: Shape, letter: str) -> Shape:
    def build(values: Values) -> Start:
        return Start(values["at"], values[letter])

    fields = (
        Field("at", Reference("members, such as centre, 12 or 3..8"), "which members", None, True),
        Field(letter, unit, "the value", None, True),
    )
    one = Record("start", f"{name} of some members", fields, build)
    return Either(unit, one, ListOf(one))


def _mats_and_links(ca: bool) -> dict[str, tuple[Record, tuple[str, ...]]]:
    """The table of each kind, and its parameters that may glide."""
    mass, stiffness, damping = (
        (k.POSITIVE, k.NUMBER, k.NUMBER) if ca else (k.MASS, k.STIFFNESS, k.DAMPING)
    )
    m = Field("M", mass, "mass", required=True)
    x0 = Field("X0", k.POSITION, "position at the beginning", 0.0)
    v0 = Field("V0", k.SPEED, "velocity at the beginning", 0.0)
    stiff = Field("K", stiffness, "stiffness")
    damp = Field("Z", damping, "viscosity")
    rest = Field("rest", k.POSITION, "elongation at which the spring has no force", 0.0)
    pitch = Field("f", k.PITCH, "damped frequency, instead of K")
    decay = Field("t60", k.DURATION, "time to fall by 60 dB, instead of Z", shown="no decay")
    cel = (m, stiff, damp, pitch, decay, x0, v0, rest)
    link = (BETWEEN, stiff, damp, rest)
    heavier = following.field(mass, ENDPOINT, "that M goes by where another MAT is")
    constant = k.NUMBER if ca else k.CONSTANT  # free names in an LNL are its law's constants
    # Description, fields, and the names of those that may glide.
    tables = {
        "MAS": ("a point mass", (m, x0, v0, heavier), ""),
        "SOL": ("a fixed point", (x0,), ""),
        "CEL": ("a mass on a spring to the ground, with viscosity", cel, "f t60 K Z M"),
        "RES": ("a spring", (BETWEEN, stiff, rest), "K"),
        "FRO": ("a damper", (BETWEEN, damp), "Z"),
        "REF": ("a spring and damper", link, "K Z"),
        "BUT": ("a one-sided contact: the first of `between` strikes the second", _but(ca), "K Z"),
        "LNL": ("a non-linear link", _lnl(constant), ""),
        "BRISTLE": (
            "friction with memory: bristles that bend, then slip",
            _bristle(ca),
            "sigma0 Fc",
        ),
        "DRY": ("dry friction: it sticks up to a level, then slides", _dry(ca), "F"),
    }
    return {
        name: (
            Record("module", doc, fields, free=constant if name == "LNL" else None),
            tuple(gliding.split()),
        )
        for name, (doc, fields, gliding) in tables.items()
    }


def _but(ca: bool) -> tuple[Field, ...]:
    exponent_stiffness = k.NUMBER if ca else k.STIFFNESS
    return (
        BETWEEN,
        Field("K", exponent_stiffness, "stiffness (magic chooses its own)"),
        Field("Z", k.NUMBER if ca else k.DAMPING, "viscosity while they touch", 0.0),
        Field("gap", GAP, "distance at which they touch; of a range also one for each", 0.0),
        Field("side", choice("below", "above"), "side from which the first MAT comes", "below"),
        Field(
            "contact",
            choice("plain", "exact", "magic"),
            "CA's own rule, the energy-exact one, or a rebound of exact restitution",
            "plain",
        ),
        Field("restitution", k.UNIT_RATIO, "speed after a rebound over speed before (magic)", 1.0),
        Field("exponent", k.EXPONENT, "power of the penetration (1.5: Hertz)", 1.0),
        Field("clamp", k.BOOLEAN, "never pull at the exit", False),
        Field("steps", k.integer(2, 1000, "4"), "samples that a magic contact lasts", 2),
    )


def _lnl(constant: Shape) -> tuple[Field, ...]:
    rest = Field("rest", k.POSITION, "elongation that counts as d = 0", 0.0)
    doc = "constants of the law that go by where a MAT is"
    return (BETWEEN, *_law_fields(), rest, following.field(constant, ENDPOINT, doc))


def _law_fields() -> tuple[Field, ...]:
    return (
        Field("law", LAW, "force over elongation d [m]"),
        Field("damping", LAW, "force over elongation d and its rate v [m/s]"),
        Field(
            "points",
            ListOf(Pair(k.POSITION, k.PUSH), 2, MAX_POINTS),
            "elongations and forces, joined by straight lines",
        ),
    )


def _bristle(ca: bool) -> tuple[Field, ...]:
    stiffness, damping, force, speed = (
        (k.POSITIVE, k.NUMBER, k.POSITIVE, k.POSITIVE)
        if ca
        else (k.STIFFNESS, k.DAMPING, k.FORCE, k.SPEED)
    )
    return (
        BETWEEN,
        Field("sigma0", stiffness, "stiffness of the bristles", required=True),
        Field("sigma1", damping, "damping of the bristles", 0.0),
        Field("sigma2", damping, "viscosity between the two MATs", 0.0),
        Field("Fc", force, "friction of a fast slide", required=True),
        Field("Fs", force, "friction of the slowest slide", shown="Fc"),
        Field("vs", speed, "speed at which friction has fallen most of the way to Fc", 0.001),
    )


def _dry(ca: bool) -> tuple[Field, ...]:
    stiffness, force, speed = (
        (k.POSITIVE, k.POSITIVE, k.POSITIVE) if ca else (k.STIFFNESS, k.FORCE, k.SPEED)
    )
    return (
        Field("to", ENDPOINT, "the MAT that rubs on the ground, instead of `between`"),
        replace(BETWEEN, doc="the two MATs that rub on each other: [a, b]", required=False),
        Field("F", force, "level of the friction while they slide", required=True),
        Field("K", stiffness, "stiffness before they slide (presliding)", shown="rigid"),
        Field("static", force, "level near rest", shown="F"),
        Field("speed", speed, "speed at which the level has fallen most of the way to F", 0.001),
    )


_RADIUS = k.count_or_size(
    1, MAX_RADIUS, f"a whole number from 1 to {MAX_RADIUS}, such as 12, or a length, such as 30cm"
)
_SIDE = k.count_or_size(
    1,
    2 * MAX_RADIUS + 1,
    f"a whole number from 1 to {2 * MAX_RADIUS + 1}, such as 40, or a length, such as 40cm",
)
_SIDES = Pair(_SIDE, _SIDE)


def _generators(ca: bool) -> dict[str, tuple[Record, tuple[str, ...]]]:
    """The table of each generator, and its parameters that may glide."""
    m = Field("M", k.MASS, "mass of the whole body", required=True)
    f = Field("f", k.PITCH, "lowest mode that is not rigid", required=not ca)
    t60 = Field(
        "t60", DECAY, "decay of that mode, or of modes at these frequencies", shown="no decay"
    )
    # A body of a discrete network is given by K and Z of its links.
    links = (
        Field("K", k.NUMBER, "K of each of its links, instead of f"),
        Field("Z", k.NUMBER, "Z of each of its links, instead of t60"),
    )
    hardening = Field("hardening", k.HARDENING, "q of k·d + q·d³ on every link", 0.0)
    starts = (
        Field("X0", _start("X0", k.POSITION, "x"), "positions at the beginning", 0.0),
        Field("V0", _start("V0", k.SPEED, "v"), "velocities at the beginning", 0.0),
    )
    material = Field(
        "material", MATERIAL, "what it is made of: sets M, f, t60 and stiffness from its size"
    )
    string = (
        Field("masses", k.integer(1, MAX_MODULES, "60"), "how many MAS in a row", required=True),
        material,
        Field("length", k.SIZE, "length of a wire of that material"),
        Field("diameter", k.SIZE, "diameter of that wire"),
        Field("tension", k.FORCE, "tension of that wire"),
        m,
        f,
        t60,
        *(links if ca else ()),
        Field("ends", choice("fixed", "free", "left"), "which ends are held", "fixed"),
        Field(
            "stiffness",
            k.RATIO,
            "springs to neighbours but one, which lower partials (see inharmonicity)",
            0.0,
        ),
        Field(
            "inharmonicity",
            INHARMONICITY,
            "B of partials f·n·√((1 + B·n²)/(1 + B)), or the wire that has it",
            shown="that of a row of springs",
        ),
        hardening,
        Field(
            "stretching",
            STRETCHING,
            "q of q·S·d on every link, S the sum of the squares of all elongations; or the wire",
            0.0,
        ),
        *starts,
    )
    plate = (
        Field("shape", choice("hex", "square", "rectangle", "disc"), "form of the mesh", "hex"),
        Field("radius", _RADIUS, "rings round its centre; with a material its size"),
        Field("sides", _SIDES, "masses across and up a rectangle; with a material its size"),
        material,
        Field("thickness", k.SIZE, "thickness of a sheet of that material"),
        Field("tension", k.SURFACE_TENSION, "pull on each metre of it: it is a membrane"),
        Field("masses", k.integer(1, MAX_MODULES, "400"), "about how many, with a material"),
        m,
        f,
        t60,
        *(links if ca else ()),
        Field("rim", choice("free", "fixed"), "whether the rim is held", "free"),
        Field("bending", Bending(), "whether it resists curvature, as metal does", shown="false"),
        hardening,
        *starts,
    )
    bank = (
        Field("count", k.integer(1, MAX_MODULES, "10000"), "how many CEL", required=True),
        Field("M", k.MASS, "mass of each", required=True),
        Field("f", BANK_PITCHES, "frequencies, spread by logarithm, or of each", required=True),
        Field("t60", BANK_DECAYS, "decays: low for high f where even, or of each", required=True),
        Field("gain", BANK_GAINS, "of a list: how much faster than the mass M each moves"),
        Field("modes", k.PATH, "a CSV file of f, t60 and gain, instead of lists"),
        Field("spread", choice("random", "even"), "how f and t60 are spread", "even"),
        Field(
            "place",
            choice("line", "spiral", "galaxy"),
            "positions of the members on the bench",
            "line",
        ),
        Field(
            "hole", k.HOLE, "radius of the highest pitch of a galaxy over that of the lowest", 0.3
        ),
        *starts,
    )
    modes = (
        Field("M", k.MASS, "mass of a mode where its level is 1", required=True),
        Field("f", MODES_PITCHES, "frequency of each mode", required=True),
        Field("t60", MODES_DECAYS, "decay of each mode, or of all", required=True),
        Field("places", PLACES, "points of it: how far each mode moves there", shown="point: 1"),
        Field("modes", k.PATH, "a CSV file of f, t60 and levels, instead of lists"),
    )
    known = "a body of which modes and their levels are known"
    return {
        "STRING": (
            Record("module", "masses in a row", string, meant={"held": "ends"}),
            ("f", "t60"),
        ),
        "PLATE": (Record("module", "a mesh of masses", plate), ("f", "t60")),
        "BANK": (Record("module", "many CEL", bank), ("f", "t60")),
        "MODES": (Record("module", known, modes), ()),
    }


@dataclass(frozen=True)
class Source(Shape):
    """What drives an ENX or ENF: a take's name, or a constant."""

    constant: Text

    def read(self, node: Node, name: str, context: Context) -> Any:
        """Read a node."""
        if not isinstance(node, Scalar):
            return wrong_shape(self, node, name, context)
        if re.fullmatch(r"[a-z]+\d+\.\d+", node.text):
            message = (
                f"{context.of(name)}: an axis of a device is not "
                "built yet; write a take or a constant"
            )
            context.error("E108", message, node.place)
            return MISSING
        if re.match(r"[+-]?[.\d]", node.text):
            return self.constant.read(node, name, context)
        return Reference(self.words()).read(node, name, context)

    def schema(self) -> dict[str, Any]:
        """As JSON Schema."""
        return {"type": ["string", "number"]}

    def words(self) -> str:
        """In words."""
        return f"a take, or {self.constant.what}"


def _input(unit: Text, quantity: str) -> Record:
    fields = (
        Field("to", ENDPOINT, "the MAT that it drives", required=True),
        Field("from", Source(unit), f"where its {quantity} comes from", required=True),
        Field("at", k.WHEN, "when a take begins", shown="the beginning"),
        Field("scale", k.NUMBER, "factor of a take", 1.0),
    )
    return Record("module", f"an imposed {quantity}", fields)


# Links whose stiffness and viscosity fields are not called K and Z (`Kind.scaled`).
_SCALED = {"BRISTLE": ("sigma0", "Fc"), "DRY": ("K", "F")}


def _all() -> dict[str, Kind]:
    kinds: dict[str, Kind] = {}
    ca = _mats_and_links(True)
    for name, (table, gliding) in _mats_and_links(False).items():
        family: Family = "link" if "between" in table.by_name else "mat"
        forms: dict[Form, Record] = {"si": table, "ca": ca[name][0]}
        kinds[name] = Kind(name, family, forms, gliding, _SCALED.get(name, ("K", "Z")))
    ca = _generators(True)
    for name, (table, gliding) in _generators(False).items():
        kinds[name] = Kind(name, "generator", {"si": table, "ca": ca[name][0]}, gliding)
    proxy = proxies.table(ENDPOINT)
    kinds["PROXY"] = Kind("PROXY", "mat", {"si": proxy, "ca": proxy})
    for name, (own, table) in space_fields.tables(BETWEEN, ENDPOINT, _law_fields()).items():
        known = kinds.get(name, Kind(name, own, {}))
        kinds[name] = replace(known, tables={**known.tables, "space": table})
    inputs = {"ENX": _input(k.POSITION, "position"), "ENF": _input(k.PUSH, "force")}
    for name, table in inputs.items():
        kinds[name] = Kind(name, "input", {"si": table, "ca": table, "space": table})
    return kinds


KINDS = _all()
MATS = tuple(name for name, kind in KINDS.items() if kind.family == "mat")
LINKS = tuple(name for name, kind in KINDS.items() if kind.family == "link")
GENERATORS = tuple(name for name, kind in KINDS.items() if kind.family == "generator")
BODIES = ("STRING", "PLATE")  # generators whose masses lie beside each other
HOLDERS = (*MATS, *GENERATORS)  # kinds that have <M> points
FOLLOWERS = ("PROXY", "SURFACE")  # whose points move as masses of other modules do


# Fields that earlier versions did not have, with their defaults: a digest omits a field with its
# default, so that digests of older scores do not change.
HASH_OMITS_DEFAULTS: dict[str, Any] = {
    "inharmonicity": None,
    "stretching": 0.0,
    "sides": None,
    "bending": None,
    "gain": None,
    "hole": 0.3,
    "friction": 0.0,
    "apart": None,
    "follows": (),
    "stretch": 0.0,
    "box": None,
    "cohesion": None,
    "reach": None,
}


def tables(form: Form, names: tuple[str, ...] = tuple(KINDS)) -> dict[str, Record]:
    """Tables by kind, for the kinds that an instrument of a form may have."""
    return {name: KINDS[name].tables[form] for name in names if form in KINDS[name].tables}


def with_optional_fields(table: Record) -> Record:
    """The table with all fields optional: others may come from `like:` or `from:`."""
    fields = tuple(replace(field, required=False) for field in table.fields)
    return replace(table, fields=fields)


def member_count(kind: str, fields: Mapping[str, Any]) -> int:
    """The number of members of a module: MATs, or points in space."""
    if "axes" in fields:
        return space.count(kind, fields)
    if kind == "MODES":
        return len(fields["places"])
    if kind == "PLATE":
        return _plate_count(fields["shape"], fields["rim"], fields["radius"] or 1, fields["sides"])
    return int(fields.get("masses") or fields.get("count") or 1)


def _plate_count(shape: str, rim: str, radius: int, sides: tuple[int, int] | None) -> int:
    if shape == "rectangle":
        across, up = sides or (1, 1)
        return across * up
    if shape == "square":
        return (2 * radius + 1) ** 2
    # The outermost ring of a disc is its rim; a hexagon with a fixed one has one ring more.
    rings = radius - 1 if shape == "disc" and rim == "fixed" else radius
    return 3 * rings * (rings + 1) + 1
