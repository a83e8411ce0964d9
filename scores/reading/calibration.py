"""A measured key: adds what its calibration file says to what the score says of the key."""

from __future__ import annotations

import math
from dataclasses import replace
from math import pi

from ergon.common.decay import LN_1000
from ergon.instruments.model import Module
from ergon.instruments.read import with_ground_point
from ergon.notation.tables.fields import Values
from ergon.notation.tables.shapes import MISSING, Context, Name
from ergon.notation.text.files import Files
from ergon.notation.text.values import Place
from ergon.scores.reading.measured_tables import CALIBRATION_RECORD

# The end of travel under a key that no spring carries: its least stiffness [N/m], and the largest
# distance by which the weight may press it in [m].
_TRAVEL_END_STIFFNESS, _TRAVEL_END_YIELD_MAX = 20e3, 20e-6


def measured_values(key_values: Values, files: Files) -> Values | None:
    """The measured values of the key; None without `calib`, or if an error was reported."""
    if key_values["calib"] is None:
        return None
    folder = key_values.nodes["calib"].document.folder
    document = files.required(key_values["calib"], folder, key_values.place_of("calib"))
    if document is None or document.root is None:
        return None
    measured = CALIBRATION_RECORD.read(
        document.root, "", Context(key_values.context.collector, "a calibration")
    )
    return None if measured is MISSING else measured


def with_measured_fields(key_values: Values, measured: Values) -> Values:
    """The fields of a key, with measured ones where the key itself writes none.

    A key begins at its measured rest position, unless it says otherwise. Without it the spring
    carries the measured weight where both balance, or the key lies on the end of its travel.
    """
    if measured.written("weight") and measured.written("rest"):
        message = f"{measured.context.label('weight')}: `rest` is written too, where spring and "
        measured.error("E111", f"{message}weight balance; keep one of the two", "weight")
    module_fields, module_nodes = dict(key_values.by_name), dict(key_values.nodes)
    has_place = key_values.context.place is not None
    sources_by_field = {name: name for name in ("M", "K", "Z", "travel")}
    if not key_values["simple"]:
        sources_by_field |= {"rest": "rest", "X0": "rest"}
    for field_name, source_field in sources_by_field.items():
        node = key_values.nodes.get(field_name)
        is_own = node is not None and has_place and _is_inside(node.place, key_values)
        if source_field in measured.by_name and not is_own:
            module_fields[field_name], module_nodes[field_name] = (
                measured.by_name[source_field],
                measured.nodes[source_field],
            )
    filled_values = Values(
        key_values.record,
        key_values.node,
        key_values.context,
        module_fields,
        module_nodes,
        key_values.free,
    )
    if _has_weight(filled_values, measured):
        travel_end, stiffness = resting_end(filled_values, measured), filled_values["K"]
        resting_position = (
            -measured["weight"] / stiffness if travel_end is None and stiffness else travel_end
        )
        if resting_position is None:
            message = (
                f"{key_values.context.label('')}: no spring carries the weight of the measured "
                "key; "
            )
            key_values.error("E103", f"{message}write `travel`, on whose end it lies")
        for field_name in ("X0",) if travel_end is not None else ("rest", "X0"):
            if field_name not in module_fields and resting_position is not None:
                module_fields[field_name], module_nodes[field_name] = (
                    resting_position,
                    measured.nodes["weight"],
                )
    return filled_values


def resting_end(section_values: Values, measured: Values) -> float | None:
    """The end of travel [m] on which the weight of a key lies; None if its spring carries it."""
    key_weight, stiffness, travel = (
        measured["weight"],
        section_values["K"],
        section_values["travel"],
    )
    if travel is None or not _has_weight(section_values, measured):
        return None
    low_travel, high_travel = travel
    if stiffness and low_travel <= -key_weight / stiffness <= high_travel:
        return None
    return float(low_travel if key_weight > 0.0 else high_travel)


def _has_weight(values: Values, measured: Values) -> bool:
    """Whether the measured weight is not yet part of a position of rest."""
    return bool(measured["weight"]) and not values["simple"] and not values.written("rest")


def key_modules(
    key_cel: Module, measured: Values, travel_end: float | None = None
) -> tuple[Module, ...]:
    """The modules of a key: its CEL, the modes that swing on it, its dry friction, and its weight
    if it lies on the `travel_end` of its travel [m].
    """
    key_modes = [mode for mode in measured["modes"] or () if mode is not MISSING]
    moving_mass = key_cel.fields["M"]
    if isinstance(moving_mass, float) and key_modes:
        moving_mass -= sum(mode["M"] for mode in key_modes)
        if moving_mass <= 0.0:
            message = (
                f"{measured.context.label('modes')}: the modes are as heavy as the key, of whose "
            )
            message += "mass they are a part"
            measured.error("E202", message, "modes")
            return (key_cel,)
    built_modules = [replace(key_cel, fields={**key_cel.fields, "M": moving_mass})]
    for number, mode in enumerate(key_modes, 1):
        built_modules += _mode_modules(f"mode {number}", mode, key_cel)
    built_modules += _dry_friction(measured)
    if travel_end is not None:
        built_modules += _weight_and_rest(measured, travel_end, key_cel)
    return tuple(built_modules)


def key_constants(measured: Values) -> tuple[float, float, float | None] | None:
    """Mass without modes [kg], damping [N·s/m] and delay [s] of the real key."""
    modes = [mode for mode in measured["modes"] or () if mode is not MISSING]
    moving_mass, damping = measured["M"], measured["Z"]
    if not isinstance(moving_mass, float) or not isinstance(damping, float):
        return None
    return max(0.0, moving_mass - sum(mode["M"] for mode in modes)), damping, measured["delay"]


def _mode_modules(mode_name: str, mode_values: Values, key_cel: Module) -> tuple[Module, Module]:
    omega, sigma = 2.0 * pi * mode_values["f"], LN_1000 / mode_values["t60"]
    mass = mode_values["M"]
    point_fields = {"M": mass, "X0": key_cel.fields["X0"], "V0": key_cel.fields["V0"]}
    spring_fields = {"K": mass * omega * omega, "Z": 2.0 * mass * sigma, "rest": 0.0}
    end_names = (Name("", mode_values.place), Name(mode_name, mode_values.place))
    return (
        Module(mode_name, "MAS", point_fields, mode_values.place),
        Module(
            f"{mode_name} spring", "REF", {"between": end_names, **spring_fields}, mode_values.place
        ),
    )


def _dry_friction(measured: Values) -> tuple[Module, ...]:
    friction_level, static_friction, stiffness = (
        measured[name] for name in ("dry", "static", "presliding")
    )
    if not friction_level:
        return ()
    if stiffness and static_friction is not None and static_friction < friction_level:
        message = f"{measured.context.label('static')}: static is below dry; with presliding the "
        message += "friction falls from static to dry"
        measured.error("E111", message, "static")
        return ()
    friction_place = measured.place_of("dry")
    friction_fields = {
        "to": Name("", friction_place),
        "between": None,
        "F": friction_level,
        "K": stiffness or None,
        "static": static_friction or None,
        "speed": measured["static_speed"] or 0.001,
    }
    return with_ground_point(Module("dry", "DRY", friction_fields, friction_place))


def _weight_and_rest(measured: Values, travel_end: float, key_cel: Module) -> tuple[Module, ...]:
    """The weight of a key, and the end of travel on which it rests still: a critically damped
    contact.
    """
    key_weight, weight_place = measured["weight"], measured.place_of("weight")
    contact_force = abs(key_weight + (key_cel.fields["K"] or 0.0) * travel_end)
    stiffness = max(_TRAVEL_END_STIFFNESS, contact_force / _TRAVEL_END_YIELD_MAX)
    contact_position = travel_end + math.copysign(contact_force / stiffness, key_weight)
    key_name, stop_name = Name("", weight_place), Name("end of travel", weight_place)
    contact_fields = {
        "between": (key_name, stop_name),
        "K": stiffness,
        "Z": 2.0 * math.sqrt(stiffness * key_cel.fields["M"]),
        "gap": 0.0,
        "side": "above" if key_weight > 0.0 else "below",
        "contact": "plain",
        "restitution": 1.0,
        "exponent": 1.0,
        "clamp": True,
        "steps": 2,
    }
    weight_fields = {"to": key_name, "from": -key_weight, "at": None, "scale": 1.0}
    return (
        Module(stop_name, "SOL", {"X0": contact_position}, weight_place),
        Module("end of travel contact", "BUT", contact_fields, weight_place),
        Module("weight", "ENF", weight_fields, weight_place),
    )


def _is_inside(written_place: Place, values: Values) -> bool:
    """Whether a place lies in the node of these values, not in a node that `like` brought in."""
    node = values.node
    first_place, last_place = node.place, node.document.place(max(node.start, node.end - 1))
    value_position = (written_place.line, written_place.column)
    return written_place.file == first_place.file and (
        first_place.line,
        first_place.column,
    ) <= value_position <= (last_place.line, last_place.column)
