"""Strings and plates of a material: computes mass, pitch, stiffness and decay from size and
tension.

Written fields (`M`, `f`, `t60`, `inharmonicity`, `bending`) take precedence over computed ones.
Only sums, products and roots are used, so that results have the same bits on every machine.
"""

from __future__ import annotations

from dataclasses import replace
from math import ceil, isfinite, pi, sqrt
from typing import Any

from ergon.common.decay import LN_1000
from ergon.instruments.materials import Material
from ergon.instruments.stiff import INHARMONICITY_MAX
from ergon.notation.tables.fields import Values

# Fields that describe material and size; the other fields are computed from them.
MATTER = ("material", "length", "diameter", "thickness", "tension")
AUDIBLE_TOP = 5_000.0  # [Hz] bodies get enough masses for modes up to here
_HELD = 2_000.0  # [Hz] of a body's second decay; at least four times its pitch
_AIR_DENSITY, _AIR_VISCOSITY = 1.204, 1.81e-5  # [kg/m³], [Pa·s] at 20 °C
_STRING_MASSES, _MASSES = (40, 300), (150, 500)  # (least, most) masses by default
_RINGS = (3, 60)  # (least, most) rings of a disc
_SIDES = (7, 121)  # (least, most) masses along a side of a plate that bends


class _Refused(Exception):
    """A mistake: its code, its sentence (to follow the field's name), and the field."""

    def __init__(self, code: str, message: str, field: str = "") -> None:
        super().__init__(message)
        self.code, self.message, self.field = code, message, field


def from_material(kind: str, values: Values, *, quietly: bool = False) -> Values | None:
    """The fields of a body, with mass, pitch, stiffness and decay computed from its material.

    None if an error was reported, or if fields are missing and `quietly` is set.
    """
    resolve = {"STRING": _string, "PLATE": _plate}.get(kind)
    if resolve is None:
        return values
    try:
        if not values.written("material"):
            _needs_material(kind, values)
            return values
        if any(name not in values.by_name for name in values.nodes):
            return None  # a field was refused already
        resolved = resolve(values, values.by_name["material"])
    except _Refused as refused:
        if not quietly:
            where = values.context.label(refused.field)
            values.error(refused.code, f"{where}: {refused.message}", refused.field)
        return None
    place = values.nodes["material"]
    gone = (*MATTER, "masses") if kind == "PLATE" else MATTER
    fields = {name: value for name, value in values.by_name.items() if name not in gone}
    nodes = {name: node for name, node in values.nodes.items() if name not in gone}
    resolved = {name: value for name, value in resolved.items() if value is not None}
    nodes |= {name: nodes.get(name, place) for name in resolved}
    return replace(values, by_name={**fields, **resolved}, nodes=nodes)


def _needs_material(kind: str, values: Values) -> None:
    needing = (*MATTER, "masses") if kind == "PLATE" else MATTER
    for name in needing:
        if values.written(name):
            message = "a size in metres needs a material; write for instance `material: steel` too"
            raise _Refused("E103", message, name)
    for name, count in (("radius", "radius: 12, rings"), ("sides", "sides: [40, 25], masses")):
        if _is_size(values.by_name.get(name)):
            message = "a size in metres needs a material; write for instance `material: bronze` "
            message += f"too, or {count}"
            raise _Refused("E103", message, name)


def _is_size(value: Any) -> bool:
    """Whether a radius or two sides are lengths in metres, not numbers of masses."""
    return any(isinstance(one, float) for one in (value if isinstance(value, tuple) else (value,)))


def _open(values: Values, names: tuple[str, ...], what: str) -> str:
    """The name in `names` that is not written, and follows from the others; refuses none or
    several.
    """
    missing = [name for name in names if name not in values.by_name]
    words = f"{', '.join(names[:-1])} and {names[-1]}"
    if not missing:
        others = f"{', '.join(names[:-2])} and {names[-2]}"
        message = f"{others} already determine it; remove one of {words}"
        raise _Refused("E111", message, names[-1])
    if len(missing) > 1:
        need = f"{what} needs all but one of {words}; write {' or '.join(missing)} too"
        raise _Refused("E103", need)
    return missing[0]


def _root(square: float) -> float:
    if not square > 0.0 or not isfinite(square):
        message = "bending alone would make a body of this size sound higher than `f`; make it "
        raise _Refused("E202", message + "thinner or longer, or write a higher f", "f")
    return sqrt(square)


def _pitch(f: float) -> float:
    if 0.0 < f <= 1e6:
        return f
    message = f"its lowest mode would sound at {f:.3g} Hz; the maximum is 1e+06 Hz"
    raise _Refused("E202", message + ": make it larger or slacker", "material")


# --- a round wire under tension -------------------------------------------------------------------


def _string(values: Values, matter: Material) -> dict[str, Any]:
    fields = dict(values.by_name)
    stretch = 2.0 if values["ends"] == "left" else 1.0  # a quarter of a wave fits, not a half
    if "M" in fields:
        if "length" not in fields:
            raise _Refused("E103", "a written mass needs the length too", "M")
        share = _string_share(values["ends"], fields.get("masses", _STRING_MASSES[0]))
        line = fields["M"] / (share * fields["length"])
        fields.setdefault("diameter", sqrt(4.0 * line / (pi * matter.density)))
        values = replace(values, by_name=fields)
    unknown = _open(values, ("length", "diameter", "f", "tension"), "a STRING of a material")
    plain = bool(values.written("stiffness"))
    bent = 0.0 if plain else fields.get("inharmonicity")  # B, if it is written
    length, diameter = fields.get("length", 0.0) * stretch, fields.get("diameter", 0.0)
    line = matter.density * pi * diameter * diameter / 4.0  # [kg/m]
    if "M" in fields:
        line = fields["M"] / (share * fields["length"])
    f, tension = fields.get("f", 0.0), fields.get("tension", 0.0)
    young = matter.young if bent is None else 0.0
    stiff = pi * pi * young * pi * diameter * diameter * diameter * diameter / 64.0  # π²·E·I
    more = 1.0 + (bent or 0.0)
    if unknown == "tension":
        tension = 4.0 * length * length * line * f * f / more - stiff / (length * length)
        _root(tension)
    elif unknown == "length":
        rise = 4.0 * line * f * f / more
        length = _root((tension + sqrt(tension * tension + 4.0 * rise * stiff)) / (2.0 * rise))
    elif unknown == "diameter":
        a = pi * pi * pi * young / (64.0 * length * length)
        b = matter.density * pi * f * f * length * length / more
        square = b * b - 4.0 * a * tension
        diameter = sqrt(2.0 * tension / (b + _root(square)))
        line = matter.density * pi * diameter * diameter / 4.0
        stiff = pi * pi * pi * young * diameter * diameter * diameter * diameter / 64.0
    inharmonicity = bent if bent is not None else stiff / (tension * length * length)
    if inharmonicity > INHARMONICITY_MAX:
        message = f"the inharmonicity would be {inharmonicity:.3g}, above the maximum of "
        message += f"{INHARMONICITY_MAX:g}; take a thinner or longer wire, or more tension"
        raise _Refused("E202", message, "diameter" if values.written("diameter") else "")
    if unknown == "f":
        f = _pitch(sqrt(tension / line * (1.0 + inharmonicity)) / (2.0 * length))
    low, high = _STRING_MASSES
    masses = fields.get("masses") or min(max(low, ceil(2.0 * AUDIBLE_TOP / f)), high)
    mass = line * length / stretch * _string_share(values["ends"], masses)
    resolved = {"masses": masses, "M": fields.get("M", mass), "f": f}
    if not plain:
        resolved["inharmonicity"] = inharmonicity
    if "t60" not in fields:
        curved = stiff / (pi * pi)
        resolved["t60"] = _decays(
            f, lambda at: _string_loss(at, line, diameter, tension, curved, matter.loss)
        )
    return resolved


def _string_share(ends: str, masses: int) -> float:
    """The share of a string's mass in its moving masses; the rest is in its fixed ends."""
    return masses / (masses + {"fixed": 1.0, "left": 0.5, "free": 0.0}[ends])


def _string_loss(
    f: float, line: float, diameter: float, tension: float, curved: float, loss: float
) -> float:
    """1/Q of a partial: losses to the air (Stokes) and in bending, after Valette and after
    Woodhouse.
    """
    air = sqrt(pi * _AIR_VISCOSITY * _AIR_DENSITY * f)
    drag = 2.0 * pi * (_AIR_VISCOSITY + diameter * air)  # [N·s/m²]
    wave = 2.0 * pi * f
    return drag / (line * wave) + loss * curved * line * wave * wave / (tension * tension)


def _decays(f: float, loss: Any) -> Any:
    """T60 at the lowest mode and at a higher frequency, with a ratio that dampers of a row or mesh
    can have.
    """
    high = max(_HELD, 4.0 * f)
    if loss(f) <= 0.0:
        return None
    low_t60, high_t60 = (LN_1000 / (pi * at * loss(at)) for at in (f, high))
    ratio = high / f
    return (f, low_t60), (high, min(max(high_t60, low_t60 / (ratio * ratio)), low_t60))


# --- plates and membranes -------------------------------------------------------------------------


def _plate(values: Values, matter: Material) -> dict[str, Any]:
    fields = dict(values.by_name)
    is_disc = _is_size(fields.get("radius"))
    _plate_form(values, "disc" if is_disc else "rectangle")
    is_membrane = _is_membrane(values)
    rim = "fixed" if is_membrane else values["rim"]
    wide, high = (2.0 * fields["radius"],) * 2 if is_disc else fields["sides"]
    area = pi * wide * high / 4.0 if is_disc else wide * high
    if "M" in fields and "thickness" not in fields:
        mesh, share = _mesh(is_disc, rim, wide, high, fields.get("masses", _MASSES[0]), is_membrane)
        fields["thickness"] = fields["M"] / (share * area * matter.density)
        values = replace(values, by_name=fields)
    names = ("thickness", "f", "tension") if is_membrane else ("thickness", "f")
    unknown = _open(values, names, "a PLATE of a material and a size")
    thickness, f, tension = (fields.get(name, 0.0) for name in ("thickness", "f", "tension"))
    poisson = fields.get("bending") or matter.poisson
    wave = 2.0 * pi * f
    if is_membrane:
        shape = _DISC_MEMBRANE / fields["radius"] if is_disc else _held(wide, high)
        if unknown == "tension":
            tension = thickness * matter.density * (wave / shape) * (wave / shape)
        elif unknown == "thickness":
            thickness = tension * (shape / wave) * (shape / wave) / matter.density
        speed = sqrt(tension / (thickness * matter.density))
        f = f or _pitch(shape * speed / (2.0 * pi))
        # As many masses as put the highest mode of the lattice at AUDIBLE_TOP.
        need = 1.6 * pi * area * AUDIBLE_TOP * AUDIBLE_TOP / (speed * speed)
    else:
        young = matter.young if matter.across is None else sqrt(matter.young * matter.across)
        shape = (
            _disc(rim, poisson, fields["radius"])
            if is_disc
            else _rectangle(rim, poisson, wide, high)
        )
        flexural_speed = sqrt(young / (12.0 * matter.density * (1.0 - poisson * poisson)))  # [m/s]
        thickness = thickness or wave / (shape * flexural_speed)
        f = f or _pitch(shape * flexural_speed * thickness / (2.0 * pi))
        need = (1.9 if rim == "free" else 1.2) * area * AUDIBLE_TOP / (flexural_speed * thickness)
    masses = fields.get("masses") or min(max(_MASSES[0], ceil(need)), _MASSES[1])
    mesh, share = _mesh(is_disc, rim, wide, high, masses, is_membrane)
    mass = thickness * matter.density * area * share
    resolved = {**mesh, "rim": rim, "M": fields.get("M", mass), "f": f}
    if not is_membrane:
        resolved["bending"] = poisson
    if "t60" not in fields:
        resolved["t60"] = _decays(f, lambda _: matter.loss)
    return resolved


def _is_membrane(values: Values) -> bool:
    """Whether tension alone holds the plate in shape; `bending: false` says so too."""
    return "tension" in values.by_name or values.by_name.get("bending", True) is None


def _plate_form(values: Values, shape: str) -> None:
    """Refuse fields that contradict each other."""
    fields = values.by_name
    if values.written("radius") and values.written("sides"):
        raise _Refused("E111", "`radius` is written too; keep one of the two", "sides")
    if not _is_size(fields.get("radius" if shape == "disc" else "sides")):
        message = "a PLATE of a material needs its size: radius: 30cm, or sides: [40cm, 25cm]"
        raise _Refused("E103", message)
    if fields.get("shape", shape) != shape:
        message = f"a PLATE of a material with this size is a {shape}; remove the shape"
        raise _Refused("E111", message, "shape")
    if not _is_membrane(values):
        return
    if fields.get("bending") is not None:
        message = "a membrane under tension does not bend; remove one of tension and bending"
        raise _Refused("E111", message, "bending")
    if fields.get("rim") == "free":
        message = "a membrane under tension is held at its rim; write `rim: fixed`"
        raise _Refused("E111", message, "rim")


def _mesh(
    is_disc: bool, rim: str, wide: float, high: float, masses: int, is_membrane: bool
) -> tuple[dict[str, Any], float]:
    """The fields of a mesh of about `masses` masses, and the share of the material's mass in
    them.
    """
    if is_disc:
        rings, rings_max = _RINGS
        while 3 * rings * (rings + 1) + 1 < masses and rings < rings_max:
            rings += 1
        inner = (rings - 0.5) / rings
        share = inner * inner if rim == "fixed" else 1.0
        return {"shape": "disc", "radius": rings}, share
    # The number of gaps between masses, including those to a fixed rim.
    more = 1 if rim == "fixed" else -1
    low, rings_max = _SIDES[0] + more, (_SIDES[1] if not is_membrane else 4 * _SIDES[1]) + more
    short, long = min(wide, high), max(wide, high)
    ratio = long / short
    first = max(low, round(sqrt(masses / ratio)) + more)
    gaps = [n for n in range(first, first + 4) if n * ratio <= rings_max]
    if not gaps:
        message = f"its sides are {ratio:.3g} to 1, more than a mesh of at most {rings_max - more} "
        raise _Refused("E202", message + "masses a side can have; make it squarer", "sides")
    best = min(gaps, key=lambda n: abs(round(n * ratio) / (n * ratio) - 1.0))
    counts = best - more, round(best * ratio) - more
    sides = counts if wide < high else counts[::-1]
    share = counts[0] * counts[1] / (best * round(best * ratio)) if rim == "fixed" else 1.0
    return {"shape": "rectangle", "sides": sides}, share


# ω·√(ρ·h/D) [1/m²] of the lowest mode of a plate, and ω/c [1/m] of a membrane's. Polynomials in
# Poisson's ratio (and the ratio of sides), fitted to the characteristic equations of a disc
# (Leissa, Vibration of Plates, NASA SP-160, 1969, ch. 2) and to a Ritz series of a free rectangle.

_DISC_MEMBRANE = 2.404825557695773
_DISC = {
    "free": (6.15301, -2.20388, -1.37126, -0.118062, -0.849569),
    "fixed": (4.44362, 1.82306, -0.698604, 0.30724, -0.0999956),
}
_TWISTED = (
    (15.133223, -0.605767, 0.284518),
    (1.614902, 4.115308, -1.173665),
    (-1.146143, -3.365339, 0.486508),
    (0.220704, 0.868969, 0.079616),
)
_BENT = (
    (22.373254, -0.004368, 0.023071),
    (-0.002054, 0.195579, -0.450152),
    (-0.010423, 0.212839, 16.327338),
    (0.016133, -0.535223, -21.653713),
)


def _polynomial(coefficients: tuple[float, ...], x: float) -> float:
    total = 0.0
    for coefficient in reversed(coefficients):
        total = total * x + coefficient
    return total


def _disc(rim: str, poisson: float, radius: float) -> float:
    return _polynomial(_DISC[rim], poisson) / (radius * radius)


def _held(wide: float, high: float) -> float:
    return pi * sqrt(1.0 / (wide * wide) + 1.0 / (high * high))


def _rectangle(rim: str, poisson: float, wide: float, high: float) -> float:
    """ω·√(ρ·h/D) of a rectangle [1/m²]; with a free rim its lowest mode bends along its length, or
    twists.
    """
    if rim == "fixed":
        wave = _held(wide, high)
        return wave * wave
    long, q = max(wide, high), min(wide, high) / max(wide, high)
    bent, twisted = (
        _polynomial(tuple(_polynomial(row, poisson) for row in table), q)
        for table in (_BENT, _TWISTED)
    )
    bent *= sqrt(1.0 - poisson * poisson)
    twisted *= sqrt(1.0 - poisson) / q
    lowest = twisted if q > 0.8 else bent if q < 0.45 else min(bent, twisted)
    return lowest / (long * long)
