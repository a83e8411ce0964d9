"""A measured key: adds what its calibration file says to what the score says of the key."""

from __future__ import annotations

import math
from dataclasses import replace
from math import log, pi

from ergon.instruments.model import Module
from ergon.instruments.read import with_ground_point
from ergon.notation.tables.fields import Values
from ergon.notation.tables.shapes import MISSING, Context, Name
from ergon.notation.text.files import Files
from ergon.notation.text.values import Place
from ergon.scores.reading.measured_tables import CALIBRATION

_DECAY = 3.0 * log(10.0)  # σ·T60
# The end of travel under a key that no spring carries: its least stiffness [N/m], and the largest
# distance by which the weight may press it in [m].
_END_STIFFNESS, _END_YIELDS = 20e3, 20e-6


def measured_values(values: Values, files: Files) -> Values | None:
    """The measured values of the key; None without `calib`, or if an error was reported."""
    if values["calib"] is None:
        return None
    folder = values.nodes["calib"].document.folder
    document = files.required(values["calib"], folder, values.place_of("calib"))
    if document is None or document.root is None:
        return None
    measured = CALIBRATION.read(
        document.root, "", Context(values.context.collector, "a calibration")
    )
    return None if measured is MISSING else measured


def with_measured_fields(values: Values, measured: Values) -> Values:
    """The fields of a key, with measured ones where the key itself writes none.

    A key begins at its measured rest position, unless it says otherwise. Without it the spring
    carries the measured weight where both balance, or the key lies on the end of its travel.
    """
    if measured.written("weight") and measured.written("rest"):
        message = f"{measured.context.label('weight')}: `rest` is written too, where spring and "
        measured.error("E111", f"{message}weight balance; keep one of the two", "weight")
    fields, nodes = dict(values.by_name), dict(values.nodes)
    has_place = values.context.place is not None
    names = {name: name for name in ("M", "K", "Z", "travel")}
    if not values["simple"]:
        names |= {"rest": "rest", "X0": "rest"}
    for name, source in names.items():
        node = values.nodes.get(name)
        is_own = node is not None and has_place and _inside(node.place, values)
        if source in measured.by_name and not is_own:
            fields[name], nodes[name] = measured.by_name[source], measured.nodes[source]
    complete = Values(values.record, values.node, values.context, fields, nodes, values.free)
    if _has_weight(complete, measured):
        end, stiffness = resting_end(complete, measured), complete["K"]
        balance = -measured["weight"] / stiffness if end is None and stiffness else end
        if balance is None:
            message = (
                f"{values.context.label('')}: no spring carries the weight of the measured key; "
            )
            values.error("E103", f"{message}write `travel`, on whose end it lies")
        for name in ("X0",) if end is not None else ("rest", "X0"):
            if name not in fields and balance is not None:
                fields[name], nodes[name] = balance, measured.nodes["weight"]
    return complete


def resting_end(values: Values, measured: Values) -> float | None:
    """The end of travel [m] on which the weight of a key lies; None if its spring carries it."""
    weight, stiffness, travel = measured["weight"], values["K"], values["travel"]
    if travel is None or not _has_weight(values, measured):
        return None
    low, high = travel
    if stiffness and low <= -weight / stiffness <= high:
        return None
    return float(low if weight > 0.0 else high)


def _has_weight(values: Values, measured: Values) -> bool:
    """Whether the measured weight is not yet part of a position of rest."""
    return bool(measured["weight"]) and not values["simple"] and not values.written("rest")


def key_modules(cel: Module, measured: Values, end: float | None = None) -> tuple[Module, ...]:
    """The modules of a key: its CEL, the modes that swing on it, its dry friction, and its weight
    if it lies on the `end` of its travel [m].
    """
    modes = [mode for mode in measured["modes"] or () if mode is not MISSING]
    mass = cel.fields["M"]
    if isinstance(mass, float) and modes:
        mass -= sum(mode["M"] for mode in modes)
        if mass <= 0.0:
            message = (
                f"{measured.context.label('modes')}: the modes are as heavy as the key, of whose "
            )
            message += "mass they are a part"
            measured.error("E202", message, "modes")
            return (cel,)
    modules = [replace(cel, fields={**cel.fields, "M": mass})]
    for number, mode in enumerate(modes, 1):
        modules += _mode(f"mode {number}", mode, cel)
    modules += _dry(measured)
    if end is not None:
        modules += _weight(measured, end, cel)
    return tuple(modules)


def key_constants(measured: Values) -> tuple[float, float, float | None] | None:
    """Mass without modes [kg], damping [N·s/m] and delay [s] of the real key."""
    modes = [mode for mode in measured["modes"] or () if mode is not MISSING]
    mass, damping = measured["M"], measured["Z"]
    if not isinstance(mass, float) or not isinstance(damping, float):
        return None
    return max(0.0, mass - sum(mode["M"] for mode in modes)), damping, measured["delay"]


def _mode(name: str, mode: Values, cel: Module) -> tuple[Module, Module]:
    omega, sigma = 2.0 * pi * mode["f"], _DECAY / mode["t60"]
    mass = mode["M"]
    point = {"M": mass, "X0": cel.fields["X0"], "V0": cel.fields["V0"]}
    spring = {"K": mass * omega * omega, "Z": 2.0 * mass * sigma, "rest": 0.0}
    end_names = (Name("", mode.place), Name(name, mode.place))
    return (
        Module(name, "MAS", point, mode.place),
        Module(f"{name} spring", "REF", {"between": end_names, **spring}, mode.place),
    )


def _dry(measured: Values) -> tuple[Module, ...]:
    level, static, stiffness = (measured[name] for name in ("dry", "static", "presliding"))
    if not level:
        return ()
    if stiffness and static is not None and static < level:
        message = f"{measured.context.label('static')}: static is below dry; with presliding the "
        message += "friction falls from static to dry"
        measured.error("E111", message, "static")
        return ()
    place = measured.place_of("dry")
    fields = {
        "to": Name("", place),
        "between": None,
        "F": level,
        "K": stiffness or None,
        "static": static or None,
        "speed": measured["static_speed"] or 0.001,
    }
    return with_ground_point(Module("dry", "DRY", fields, place))


def _weight(measured: Values, end: float, cel: Module) -> tuple[Module, ...]:
    """The weight of a key, and the end of travel on which it rests still: a critically damped
    contact.
    """
    weight, place = measured["weight"], measured.place_of("weight")
    contact_force = abs(weight + (cel.fields["K"] or 0.0) * end)
    stiffness = max(_END_STIFFNESS, contact_force / _END_YIELDS)
    contact_position = end + math.copysign(contact_force / stiffness, weight)
    key, stop = Name("", place), Name("end of travel", place)
    contact = {
        "between": (key, stop),
        "K": stiffness,
        "Z": 2.0 * math.sqrt(stiffness * cel.fields["M"]),
        "gap": 0.0,
        "side": "above" if weight > 0.0 else "below",
        "contact": "plain",
        "restitution": 1.0,
        "exponent": 1.0,
        "clamp": True,
        "steps": 2,
    }
    push = {"to": key, "from": -weight, "at": None, "scale": 1.0}
    return (
        Module(stop, "SOL", {"X0": contact_position}, place),
        Module("end of travel contact", "BUT", contact, place),
        Module("weight", "ENF", push, place),
    )


def _inside(place: Place, values: Values) -> bool:
    """Whether a place lies in the node of these values, not in a node that `like` brought in."""
    node = values.node
    first_place, last_place = node.place, node.document.place(max(node.start, node.end - 1))
    position = (place.line, place.column)
    return place.file == first_place.file and (
        first_place.line,
        first_place.column,
    ) <= position <= (
        last_place.line,
        last_place.column,
    )
