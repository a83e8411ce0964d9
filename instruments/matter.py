"""Strings and plates of a material: computes mass, pitch, stiffness and decay from size and
tension.

Written fields (`M`, `f`, `t60`, `inharmonicity`, `bending`) take precedence over computed ones.
Only sums, products and roots are used, so that results have the same bits on every machine.
"""

from __future__ import annotations

from dataclasses import replace
from math import ceil, isfinite, pi, sqrt
from typing import Any, NamedTuple

from ergon.common.decay import LN_1000
from ergon.instruments.materials import Material
from ergon.instruments.stiff import INHARMONICITY_MAX
from ergon.notation.tables.fields import Values

# Fields that describe material and size; the other fields are computed from them.
MATTER_FIELDS = ("material", "length", "diameter", "thickness", "tension")
AUDIBLE_FREQUENCY_MAX = 5_000.0  # [Hz] bodies get enough masses for modes up to here
_SECOND_DECAY_FREQUENCY = 2_000.0  # [Hz] of a body's second decay; at least four times its pitch
_AIR_DENSITY, _AIR_VISCOSITY = 1.204, 1.81e-5  # [kg/m³], [Pa·s] at 20 °C
_STRING_MASSES_LIMITS, _PLATE_MASSES_LIMITS = (
    (40, 300),
    (150, 500),
)  # (least, most) masses by default
_DISC_RINGS_LIMITS = (3, 60)  # (least, most) rings of a disc
_SIDE_MASSES_LIMITS = (7, 121)  # (least, most) masses along a side of a plate that bends


class _MatterError(Exception):
    """A mistake: its code, its sentence (to follow the field's name), and the field."""

    def __init__(self, code: str, message: str, field: str = "") -> None:
        super().__init__(message)
        self.code, self.message, self.field = code, message, field


def from_material(kind: str, values: Values, *, quietly: bool = False) -> Values | None:
    """The fields of a body, with mass, pitch, stiffness and decay computed from its material.

    None if an error was reported, or if fields are missing and `quietly` is set.
    """
    resolve_fields = {"STRING": _string_fields, "PLATE": _plate}.get(kind)
    if resolve_fields is None:
        return values
    try:
        if not values.written("material"):
            _refuse_size_without_material(kind, values)
            return values
        if any(name not in values.by_name for name in values.nodes):
            return None  # a field was refused already
        resolved_fields = resolve_fields(values, values.by_name["material"])
    except _MatterError as refused:
        if not quietly:
            field_label = values.context.label(refused.field)
            values.error(refused.code, f"{field_label}: {refused.message}", refused.field)
        return None
    material_node = values.nodes["material"]
    dropped_fields = (*MATTER_FIELDS, "masses") if kind == "PLATE" else MATTER_FIELDS
    fields = {name: value for name, value in values.by_name.items() if name not in dropped_fields}
    nodes = {name: node for name, node in values.nodes.items() if name not in dropped_fields}
    resolved_fields = {name: value for name, value in resolved_fields.items() if value is not None}
    nodes |= {name: nodes.get(name, material_node) for name in resolved_fields}
    return replace(values, by_name={**fields, **resolved_fields}, nodes=nodes)


def _refuse_size_without_material(kind: str, body_values: Values) -> None:
    material_fields = (*MATTER_FIELDS, "masses") if kind == "PLATE" else MATTER_FIELDS
    for field_name in material_fields:
        if body_values.written(field_name):
            message = "a size in metres needs a material; write for instance `material: steel` too"
            raise _MatterError("E103", message, field_name)
    for field_name, member_count in (
        ("radius", "radius: 12, rings"),
        ("sides", "sides: [40, 25], masses"),
    ):
        if _is_size(body_values.by_name.get(field_name)):
            message = "a size in metres needs a material; write for instance `material: bronze` "
            message += f"too, or {member_count}"
            raise _MatterError("E103", message, field_name)


def _is_size(value: Any) -> bool:
    """Whether a radius or two sides are lengths in metres, not numbers of masses."""
    return any(
        isinstance(number, float) for number in (value if isinstance(value, tuple) else (value,))
    )


def _missing_name(module_values: Values, field_names: tuple[str, ...], noun: str) -> str:
    """The name in `field_names` that is not written, and follows from the others; refuses none or
    several.
    """
    missing_names = [name for name in field_names if name not in module_values.by_name]
    names_text = f"{', '.join(field_names[:-1])} and {field_names[-1]}"
    if not missing_names:
        other_names = f"{', '.join(field_names[:-2])} and {field_names[-2]}"
        message = f"{other_names} already determine it; remove one of {names_text}"
        raise _MatterError("E111", message, field_names[-1])
    if len(missing_names) > 1:
        need_sentence = (
            f"{noun} needs all but one of {names_text}; write {' or '.join(missing_names)} too"
        )
        raise _MatterError("E103", need_sentence)
    return missing_names[0]


def _root_of_positive(square: float) -> float:
    if not square > 0.0 or not isfinite(square):
        message = "bending alone would make a body of this size sound higher than `f`; make it "
        raise _MatterError("E202", message + "thinner or longer, or write a higher f", "f")
    return sqrt(square)


def _checked_pitch(frequency: float) -> float:
    if 0.0 < frequency <= 1e6:
        return frequency
    message = f"its lowest mode would sound at {frequency:.3g} Hz; the maximum is 1e+06 Hz"
    raise _MatterError("E202", message + ": make it larger or slacker", "material")


# --- a round wire under tension -------------------------------------------------------------------


class _Wire(NamedTuple):
    """A string as a wire; what is not known yet is 0.

    `length` of half a wave [m], `diameter` [m], `line_density` [kg/m], `tension` [N], and
    `bending_term`, π²·E·I [N·m²].
    """

    length: float
    diameter: float
    line_density: float
    tension: float
    bending_term: float


def _tuned_wire(
    wire: _Wire, unknown_name: str, pitch: tuple[float, float], young: float, matter: Material
) -> _Wire:
    """The wire with the tension, length or diameter that gives its pitch.

    `pitch`: the pitch [Hz], and the square of it over that without stiffness; `young`: the modulus
    that bends it [Pa]. Raises _MatterError.
    """
    length, _, line_density, tension, bending_term = wire
    frequency, stiff_ratio_squared = pitch
    if unknown_name == "tension":
        tension = (
            4.0 * length * length * line_density * frequency * frequency / stiff_ratio_squared
            - bending_term / (length * length)
        )
        _root_of_positive(tension)
        return wire._replace(tension=tension)
    if unknown_name == "length":
        wave_term = 4.0 * line_density * frequency * frequency / stiff_ratio_squared
        length = _root_of_positive(
            (tension + sqrt(tension * tension + 4.0 * wave_term * bending_term)) / (2.0 * wave_term)
        )
        return wire._replace(length=length)
    if unknown_name != "diameter":
        return wire
    a = pi * pi * pi * young / (64.0 * length * length)
    b = matter.density * pi * frequency * frequency * length * length / stiff_ratio_squared
    discriminant = b * b - 4.0 * a * tension
    diameter = sqrt(2.0 * tension / (b + _root_of_positive(discriminant)))
    return wire._replace(
        diameter=diameter,
        line_density=matter.density * pi * diameter * diameter / 4.0,
        bending_term=pi * pi * pi * young * diameter * diameter * diameter * diameter / 64.0,
    )


def _string_fields(values: Values, matter: Material) -> dict[str, Any]:
    fields = dict(values.by_name)
    length_factor = 2.0 if values["ends"] == "left" else 1.0  # a quarter of a wave fits, not a half
    if "M" in fields:
        if "length" not in fields:
            raise _MatterError("E103", "a written mass needs the length too", "M")
        moving_mass_ratio = _moving_mass_ratio(
            values["ends"], fields.get("masses", _STRING_MASSES_LIMITS[0])
        )
        line_density = fields["M"] / (moving_mass_ratio * fields["length"])
        fields.setdefault("diameter", sqrt(4.0 * line_density / (pi * matter.density)))
        values = replace(values, by_name=fields)
    unknown_name = _missing_name(
        values, ("length", "diameter", "f", "tension"), "a STRING of a material"
    )
    has_written_stiffness = bool(values.written("stiffness"))
    # The coefficient of inharmonicity B, if it is written.
    written_inharmonicity = 0.0 if has_written_stiffness else fields.get("inharmonicity")
    diameter = fields.get("diameter", 0.0)
    line_density = matter.density * pi * diameter * diameter / 4.0  # [kg/m]
    if "M" in fields:
        line_density = fields["M"] / (moving_mass_ratio * fields["length"])
    wire_frequency = fields.get("f", 0.0)
    young = matter.young if written_inharmonicity is None else 0.0
    wire = _Wire(
        length=fields.get("length", 0.0) * length_factor,
        diameter=diameter,
        line_density=line_density,
        tension=fields.get("tension", 0.0),
        bending_term=pi * pi * young * pi * diameter * diameter * diameter * diameter / 64.0,
    )
    # Square of the pitch over that without stiffness.
    stiff_ratio_squared = 1.0 + (written_inharmonicity or 0.0)
    wire = _tuned_wire(wire, unknown_name, (wire_frequency, stiff_ratio_squared), young, matter)
    length, diameter, line_density, tension, bending_term = wire
    inharmonicity = (
        written_inharmonicity
        if written_inharmonicity is not None
        else bending_term / (tension * length * length)
    )
    if inharmonicity > INHARMONICITY_MAX:
        message = f"the inharmonicity would be {inharmonicity:.3g}, above the maximum of "
        message += f"{INHARMONICITY_MAX:g}; take a thinner or longer wire, or more tension"
        raise _MatterError("E202", message, "diameter" if values.written("diameter") else "")
    if unknown_name == "f":
        wire_frequency = _checked_pitch(
            sqrt(tension / line_density * (1.0 + inharmonicity)) / (2.0 * length)
        )
    low, high = _STRING_MASSES_LIMITS
    masses = fields.get("masses") or min(
        max(low, ceil(2.0 * AUDIBLE_FREQUENCY_MAX / wire_frequency)), high
    )
    mass = line_density * length / length_factor * _moving_mass_ratio(values["ends"], masses)
    string_fields = {"masses": masses, "M": fields.get("M", mass), "f": wire_frequency}
    if not has_written_stiffness:
        string_fields["inharmonicity"] = inharmonicity
    if "t60" not in fields:
        bending_stiffness = bending_term / (pi * pi)
        string_fields["t60"] = _decays(
            wire_frequency,
            lambda frequency: _string_loss(
                frequency, line_density, diameter, tension, bending_stiffness, matter.loss
            ),
        )
    return string_fields


def _moving_mass_ratio(ends: str, masses: int) -> float:
    """The share of a string's mass in its moving masses; the rest is in its fixed ends."""
    return masses / (masses + {"fixed": 1.0, "left": 0.5, "free": 0.0}[ends])


def _string_loss(
    frequency: float,
    line_density: float,
    diameter: float,
    tension: float,
    bending_stiffness: float,
    material_loss: float,
) -> float:
    """1/Q of a partial: losses to the air (Stokes) and in bending, after Valette and after
    Woodhouse.
    """
    viscous_layer = sqrt(pi * _AIR_VISCOSITY * _AIR_DENSITY * frequency)
    air_drag = 2.0 * pi * (_AIR_VISCOSITY + diameter * viscous_layer)  # [N·s/m²]
    angular_frequency = 2.0 * pi * frequency
    return air_drag / (
        line_density * angular_frequency
    ) + material_loss * bending_stiffness * line_density * angular_frequency * angular_frequency / (
        tension * tension
    )


def _decays(f_low: float, loss: Any) -> Any:
    """T60 at the lowest mode and at a higher frequency, with a ratio that dampers of a row or mesh
    can have.
    """
    f_high = max(_SECOND_DECAY_FREQUENCY, 4.0 * f_low)
    if loss(f_low) <= 0.0:
        return None
    low_t60, high_t60 = (
        LN_1000 / (pi * frequency * loss(frequency)) for frequency in (f_low, f_high)
    )
    ratio = f_high / f_low
    return (f_low, low_t60), (
        f_high,
        min(max(high_t60, low_t60 / (ratio * ratio)), low_t60),
    )


# --- plates and membranes -------------------------------------------------------------------------


def _plate(values: Values, matter: Material) -> dict[str, Any]:
    fields = dict(values.by_name)
    is_disc = _is_size(fields.get("radius"))
    _plate_form(values, "disc" if is_disc else "rectangle")
    is_membrane = _is_membrane(values)
    rim = "fixed" if is_membrane else values["rim"]
    width, height = (2.0 * fields["radius"],) * 2 if is_disc else fields["sides"]
    area = pi * width * height / 4.0 if is_disc else width * height
    if "M" in fields and "thickness" not in fields:
        mesh, mass_ratio = _mesh_fields(
            is_disc,
            rim,
            width,
            height,
            fields.get("masses", _PLATE_MASSES_LIMITS[0]),
            is_membrane,
        )
        fields["thickness"] = fields["M"] / (mass_ratio * area * matter.density)
        values = replace(values, by_name=fields)
    names = ("thickness", "f", "tension") if is_membrane else ("thickness", "f")
    unknown_name = _missing_name(values, names, "a PLATE of a material and a size")
    thickness, f, tension = (fields.get(name, 0.0) for name in ("thickness", "f", "tension"))
    poisson = fields.get("bending") or matter.poisson
    angular_frequency = 2.0 * pi * f
    if is_membrane:
        shape_factor = (
            _DISC_MEMBRANE_COEFFICIENT / fields["radius"]
            if is_disc
            else _membrane_wave_number(width, height)
        )
        if unknown_name == "tension":
            tension = (
                thickness
                * matter.density
                * (angular_frequency / shape_factor)
                * (angular_frequency / shape_factor)
            )
        elif unknown_name == "thickness":
            thickness = (
                tension
                * (shape_factor / angular_frequency)
                * (shape_factor / angular_frequency)
                / matter.density
            )
        speed = sqrt(tension / (thickness * matter.density))
        f = f or _checked_pitch(shape_factor * speed / (2.0 * pi))
        # As many masses as put the highest mode of the lattice at AUDIBLE_FREQUENCY_MAX.
        n_needed = 1.6 * pi * area * AUDIBLE_FREQUENCY_MAX * AUDIBLE_FREQUENCY_MAX / (speed * speed)
    else:
        young = matter.young if matter.across is None else sqrt(matter.young * matter.across)
        shape_factor = (
            _disc_factor(rim, poisson, fields["radius"])
            if is_disc
            else _rectangle_factor(rim, poisson, width, height)
        )
        flexural_speed = sqrt(young / (12.0 * matter.density * (1.0 - poisson * poisson)))  # [m/s]
        thickness = thickness or angular_frequency / (shape_factor * flexural_speed)
        f = f or _checked_pitch(shape_factor * flexural_speed * thickness / (2.0 * pi))
        n_needed = (
            (1.9 if rim == "free" else 1.2)
            * area
            * AUDIBLE_FREQUENCY_MAX
            / (flexural_speed * thickness)
        )
    masses = fields.get("masses") or min(
        max(_PLATE_MASSES_LIMITS[0], ceil(n_needed)), _PLATE_MASSES_LIMITS[1]
    )
    mesh, mass_ratio = _mesh_fields(is_disc, rim, width, height, masses, is_membrane)
    mass = thickness * matter.density * area * mass_ratio
    plate_fields = {**mesh, "rim": rim, "M": fields.get("M", mass), "f": f}
    if not is_membrane:
        plate_fields["bending"] = poisson
    if "t60" not in fields:
        plate_fields["t60"] = _decays(f, lambda _: matter.loss)
    return plate_fields


def _is_membrane(values: Values) -> bool:
    """Whether tension alone holds the plate in shape; `bending: false` says so too."""
    return "tension" in values.by_name or values.by_name.get("bending", True) is None


def _plate_form(values: Values, shape: str) -> None:
    """Refuse fields that contradict each other."""
    fields = values.by_name
    if values.written("radius") and values.written("sides"):
        raise _MatterError("E111", "`radius` is written too; keep one of the two", "sides")
    if not _is_size(fields.get("radius" if shape == "disc" else "sides")):
        message = "a PLATE of a material needs its size: radius: 30cm, or sides: [40cm, 25cm]"
        raise _MatterError("E103", message)
    if fields.get("shape", shape) != shape:
        message = f"a PLATE of a material with this size is a {shape}; remove the shape"
        raise _MatterError("E111", message, "shape")
    if not _is_membrane(values):
        return
    if fields.get("bending") is not None:
        message = "a membrane under tension does not bend; remove one of tension and bending"
        raise _MatterError("E111", message, "bending")
    if fields.get("rim") == "free":
        message = "a membrane under tension is held at its rim; write `rim: fixed`"
        raise _MatterError("E111", message, "rim")


def _mesh_fields(
    is_disc: bool, rim: str, plate_width: float, plate_height: float, masses: int, is_membrane: bool
) -> tuple[dict[str, Any], float]:
    """The fields of a mesh of about `masses` masses, and the share of the material's mass in
    them.
    """
    if is_disc:
        ring_count, gaps_max = _DISC_RINGS_LIMITS
        while 3 * ring_count * (ring_count + 1) + 1 < masses and ring_count < gaps_max:
            ring_count += 1
        inner_radius_share = (ring_count - 0.5) / ring_count
        mass_share = inner_radius_share * inner_radius_share if rim == "fixed" else 1.0
        return {"shape": "disc", "radius": ring_count}, mass_share
    # The number of gaps between masses, including those to a fixed rim.
    extra_gaps = 1 if rim == "fixed" else -1
    gaps_min, gaps_max = (
        _SIDE_MASSES_LIMITS[0] + extra_gaps,
        (_SIDE_MASSES_LIMITS[1] if not is_membrane else 4 * _SIDE_MASSES_LIMITS[1]) + extra_gaps,
    )
    short_side, long_side = min(plate_width, plate_height), max(plate_width, plate_height)
    side_ratio = long_side / short_side
    first_gaps = max(gaps_min, round(sqrt(masses / side_ratio)) + extra_gaps)
    gap_counts = [
        gap_count
        for gap_count in range(first_gaps, first_gaps + 4)
        if gap_count * side_ratio <= gaps_max
    ]
    if not gap_counts:
        message = (
            f"its sides are {side_ratio:.3g} to 1, more than a mesh of at most "
            f"{gaps_max - extra_gaps} "
        )
        raise _MatterError("E202", message + "masses a side can have; make it squarer", "sides")
    best_gaps = min(
        gap_counts,
        key=lambda gap_count: abs(round(gap_count * side_ratio) / (gap_count * side_ratio) - 1.0),
    )
    mass_counts = best_gaps - extra_gaps, round(best_gaps * side_ratio) - extra_gaps
    sides = mass_counts if plate_width < plate_height else mass_counts[::-1]
    mass_share = (
        mass_counts[0] * mass_counts[1] / (best_gaps * round(best_gaps * side_ratio))
        if rim == "fixed"
        else 1.0
    )
    return {"shape": "rectangle", "sides": sides}, mass_share


# ω·√(ρ·h/D) [1/m²] of the lowest mode of a plate, and ω/c [1/m] of a membrane's. Polynomials in
# Poisson's ratio (and the ratio of sides), fitted to the characteristic equations of a disc
# (Leissa, Vibration of Plates, NASA SP-160, 1969, ch. 2) and to a Ritz series of a free rectangle.

_DISC_MEMBRANE_COEFFICIENT = 2.404825557695773
_DISC_COEFFICIENTS = {
    "free": (6.15301, -2.20388, -1.37126, -0.118062, -0.849569),
    "fixed": (4.44362, 1.82306, -0.698604, 0.30724, -0.0999956),
}
_TWISTING_COEFFICIENTS = (
    (15.133223, -0.605767, 0.284518),
    (1.614902, 4.115308, -1.173665),
    (-1.146143, -3.365339, 0.486508),
    (0.220704, 0.868969, 0.079616),
)
_BENDING_COEFFICIENTS = (
    (22.373254, -0.004368, 0.023071),
    (-0.002054, 0.195579, -0.450152),
    (-0.010423, 0.212839, 16.327338),
    (0.016133, -0.535223, -21.653713),
)


def _polynomial(coefficients: tuple[float, ...], x: float) -> float:
    term_sum = 0.0
    for coefficient in reversed(coefficients):
        term_sum = term_sum * x + coefficient
    return term_sum


def _disc_factor(rim: str, poisson: float, radius: float) -> float:
    return _polynomial(_DISC_COEFFICIENTS[rim], poisson) / (radius * radius)


def _membrane_wave_number(plate_width: float, plate_height: float) -> float:
    return pi * sqrt(1.0 / (plate_width * plate_width) + 1.0 / (plate_height * plate_height))


def _rectangle_factor(rim: str, poisson: float, plate_width: float, plate_height: float) -> float:
    """ω·√(ρ·h/D) of a rectangle [1/m²]; with a free rim its lowest mode bends along its length, or
    twists.
    """
    if rim == "fixed":
        wave = _membrane_wave_number(plate_width, plate_height)
        return wave * wave
    long_side, side_ratio = (
        max(plate_width, plate_height),
        min(plate_width, plate_height) / max(plate_width, plate_height),
    )
    bending_factor, twisting_factor = (
        _polynomial(tuple(_polynomial(row, poisson) for row in table), side_ratio)
        for table in (_BENDING_COEFFICIENTS, _TWISTING_COEFFICIENTS)
    )
    bending_factor *= sqrt(1.0 - poisson * poisson)
    twisting_factor *= sqrt(1.0 - poisson) / side_ratio
    lowest_factor = (
        twisting_factor
        if side_ratio > 0.8
        else bending_factor
        if side_ratio < 0.45
        else min(bending_factor, twisting_factor)
    )
    return lowest_factor / (long_side * long_side)
