"""A model of miPhysics as a score: points in space, and masses of one axis under `units: ca`.

A unit of length is a millimetre of the score. A step of the model is a sample, so K and Z of the
score are the model's times the square of the rate and the rate.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field

from ergon.common.terminal import printable
from ergon.notation.text.errors import quote
from ergon.notation.text.spelling import nearest
from ergon.workshop.models.errors import ModelError
from ergon.workshop.models.miphysics.reading import Network, Part
from ergon.workshop.models.miphysics.start import drag, place, speeds
from ergon.workshop.models.naming import Names

RATES = (100, 192_000)  # [Hz] that a model may have
_MILLI = 1e-3
_DISTANCE_MAX, _SPEED_MAX, _GRAVITY_MAX = 1e6, 1e9, 1e5  # [mm], [mm/s], [m/s²] of a score
_NO_LETTER = re.compile(r"\W", re.ASCII)


@dataclass(slots=True)
class _Writing:
    network: Network
    rate: int
    names: Names = field(default_factory=Names)
    masses: dict[str, str] = field(default_factory=dict)
    space: list[tuple[str, str]] = field(default_factory=list)  # modules: name, text
    axis: list[tuple[str, str]] = field(default_factory=list)
    walls: dict[tuple[int, float], str] = field(default_factory=dict)

    def new(self, name: str) -> str:
        word = _NO_LETTER.sub("_", name)
        return self.names.new(word if word[:1].isalpha() else f"m{word}")


def written(network: Network, score_title: str, rate: int) -> str:
    """The text of a score that moves as a model does at a rate [Hz]. Raises ModelError with the
    line.
    """
    writing = _Writing(network, rate)
    masses_by_name = {mass.name: mass for mass in network.masses}
    for link in network.links:
        _joined(link, masses_by_name)
    if network.gravity * rate * rate * _MILLI > _GRAVITY_MAX:
        message = f"gravity is {network.gravity:g} a sample²: at {rate:,} Hz a score holds up to "
        raise ModelError(f"{message}{_GRAVITY_MAX / (rate * rate * _MILLI):g}; set a lower rate")
    for mass in network.masses:
        if "mass" in mass.values:
            _heavy(writing, mass)
    start_speeds = speeds(network, rate)
    for mass in network.masses:
        writing.masses[mass.name] = writing.new(mass.name)
        if mass.kind.endswith("3D"):
            _point(writing, mass, start_speeds.get(mass.name, (0.0, 0.0, 0.0)))
        else:
            _mass(writing, mass)
    for link in network.links:
        if link.kind == "SpringDamper1D":
            _spring(writing, link, masses_by_name)
        else:
            _link(writing, link)
    return "\n".join(_lines(writing, score_title)) + "\n"


def _joined(link: Part, masses_by_name: dict[str, Part]) -> None:
    """Raises ModelError if a link joins a mass that does not exist, or of a kind that does not fit
    it.
    """
    for mass_name in link.ends:
        if mass_name not in masses_by_name:
            suggestion = nearest(mass_name, masses_by_name)
            raise ModelError(f"no mass is called {quote(mass_name)}", link.line, suggestion)
        if masses_by_name[mass_name].kind.endswith("1D") != link.kind.endswith("1D"):
            axis_count_words = (
                "one axis" if masses_by_name[mass_name].kind.endswith("1D") else "three axes"
            )
            message = (
                f"{quote(mass_name)} has {axis_count_words}, and {link.kind} joins others; "
                "that is not built"
            )
            raise ModelError(message, link.line)
    if len(set(link.ends)) < len(link.ends):
        raise ModelError(f"it joins {quote(link.ends[0])} to itself", link.line)
    for name in ("stiffness", "damping"):
        if link.values.get(name, 0.0) < 0.0:
            message = f"{name} is {link.values[name]:g}: below 0 it makes energy"
            raise ModelError(message, link.line)
    if link.kind != "SpringDamper1D" and link.values.get("drest", 0.0) < 0.0:
        raise ModelError(f"drest is {link.values['drest']:g}: a distance is 0 or more", link.line)
    if link.values.get("orientation", 0.0) not in (0.0, 1.0, 2.0):
        message = f"orientation is {link.values['orientation']:g}: 0, 1 or 2 for x, y or z"
        raise ModelError(message, link.line)


def _within(part: Part, field_name: str, value: float, value_max: float) -> None:
    if not abs(value) <= value_max:
        raise ModelError(f"{field_name} is {value:g}: a score holds up to {value_max:g}", part.line)


def _heavy(writing: _Writing, mass: Part) -> float:
    kilograms = mass.values["mass"]
    if not kilograms > writing.network.friction:
        message = f"mass is {kilograms:g}: it is above 0, and above the friction of the medium"
        raise ModelError(message, mass.line)
    return kilograms


def _number(value: float) -> str:
    return repr(int(value)) if value == int(value) and abs(value) < 1e15 else repr(value)


# --- in space -----------------------------------------------------------------------------------


def _vector(values: tuple[float, ...], unit: str) -> str:
    return f"[{', '.join(f'{_number(value)}{unit}' for value in values)}]"


def _point(writing: _Writing, mass: Part, speed: tuple[float, float, float]) -> None:
    for component in place(mass):
        _within(mass, "a place", component, _DISTANCE_MAX)
    fields = [f"X0: {_vector(place(mass), 'mm')}"]
    kind = "SOL"
    if mass.kind != "Ground3D":
        kind, kilograms = "MAS", _heavy(writing, mass)
        fields.insert(0, f"M: {_number(kilograms)}kg")
        if any(speed):
            speed_per_second = tuple(value * writing.rate for value in speed)
            for component in speed_per_second:
                _within(mass, "a speed", component, _SPEED_MAX)
            fields.append(f"V0: {_vector(speed_per_second, 'mm/s')}")
        if writing.network.friction:
            fields.append(f"drag: {drag(writing.network.friction, kilograms)!r}*viscous")
    writing.space.append((writing.masses[mass.name], f"{kind}: {{{', '.join(fields)}}}"))


_KINDS = {"Spring3D": "RES", "Damper3D": "FRO", "SpringDamper3D": "REF"}


def _link(writing: _Writing, link: Part) -> None:
    values = link.values
    ends = [writing.masses[mass_name] for mass_name in link.ends]
    kind = _KINDS.get(link.kind, "BUT")
    if link.kind == "PlaneContact3D":
        axis_index = int(values["orientation"])
        ends.insert(0, _wall(writing, axis_index, values["position"], link))
    fields = [f"between: [{', '.join(ends)}]"]
    fields += [f"K: {_number(values['stiffness'])}*stiff"] if "stiffness" in values else []
    fields += [f"Z: {_number(values['damping'])}*viscous"] if "damping" in values else []
    if kind == "BUT":
        fields.append(f"gap: {_number(values['drest'])}mm")
        if link.kind == "PlaneContact3D":
            fields.append(f"normal: {_vector(tuple(float(i == axis_index) for i in range(3)), '')}")
        elif link.kind != "Contact3D":
            fields.append("side: inside")
    elif "drest" in values:
        fields.append(f"rest: {_number(values['drest'])}mm")
    writing.space.append((writing.new(link.name), f"{kind}: {{{', '.join(fields)}}}"))


def _wall(writing: _Writing, axis_index: int, wall_position: float, link: Part) -> str:
    """The plane of a contact; contacts on the same plane share it."""
    _within(link, "position", wall_position, _DISTANCE_MAX)
    if (axis_index, wall_position) not in writing.walls:
        name = writing.walls[axis_index, wall_position] = writing.new(f"wall_{'xyz'[axis_index]}")
        wall_place = tuple(wall_position if i == axis_index else 0.0 for i in range(3))
        writing.space.append((name, f"SOL: {{X0: {_vector(wall_place, 'mm')}}}"))
    return writing.walls[axis_index, wall_position]


# --- one axis -----------------------------------------------------------------------------------


def _mass(writing: _Writing, mass: Part) -> None:
    """Add a mass that moves along z; places are metres, because `units: ca` has numbers alone."""
    z, name = mass.values["initPos.z"], writing.masses[mass.name]
    _within(mass, "a place", z, _DISTANCE_MAX * _MILLI)
    x0 = f"X0: {_number(z)}m"
    if mass.kind == "Ground1D":
        writing.axis.append((name, f"SOL: {{{x0}}}"))
        return
    mass_value, friction = _heavy(writing, mass), writing.network.friction
    fields = [f"M: {_number(mass_value)}"]
    is_tied = mass.kind == "Osc1D"
    if is_tied or friction:
        k = mass.values["stiffness"] if is_tied else 0.0
        viscosity = (mass.values["damping"] if is_tied else 0.0) + friction
        if k < 0.0 or viscosity < 0.0:
            raise ModelError("stiffness or damping below 0 makes energy", mass.line)
        fields += [f"K: {_number(k)}", f"Z: {_number(viscosity)}"]
        # The mass is tied to the place where it begins: the rest of a CEL.
        fields += [f"rest: {_number(z)}m"] if is_tied and z else []
    fields.append(x0)
    if speed := mass.values["initVel.z"]:
        _within(mass, "a speed", speed, _SPEED_MAX * _MILLI)
        fields.append(f"V0: {_number(speed)}m/s")
    writing.axis.append(
        (
            name,
            f"{'CEL' if len(fields) > 3 and (is_tied or friction) else 'MAS'}: "
            f"{{{', '.join(fields)}}}",
        )
    )
    if writing.network.gravity:
        weight_name = writing.new(f"{name}_weight")
        writing.axis.append(
            (weight_name, f"ENF: {{to: {name}, from: {-writing.network.gravity * mass_value!r}N}}")
        )


def _spring(writing: _Writing, link: Part, masses_by_name: dict[str, Part]) -> None:
    values = link.values
    first_name, second_name = link.ends
    if not {masses_by_name[first_name].kind, masses_by_name[second_name].kind} - {"Ground1D"}:
        return  # nothing of it moves
    # d is x_b - x_a - rest in a score, and z1 - z2 - drest in the model.
    fields = [
        f"between: [{writing.masses[second_name]}, {writing.masses[first_name]}]",
        f"K: {_number(values['stiffness'])}",
    ]
    fields += [f"Z: {_number(values['damping'])}"]
    fields += [f"rest: {_number(values['drest'])}m"] if values["drest"] else []
    writing.axis.append((writing.new(link.name), f"REF: {{{', '.join(fields)}}}"))


# --- text ---------------------------------------------------------------------------------------


def _lines(writing: _Writing, title: str) -> Iterator[str]:
    yield f"# From {printable(title) or 'a model'}, a model of miPhysics."
    yield (
        f"# A step of the model is a sample of 1/{writing.rate} s; --set rate=1050 makes it longer."
    )
    yield "# The file does not say what is heard: it is the mass in the middle, along z."
    yield "ergon: 1"
    yield f"rates: {{audio: {writing.rate}Hz}}"
    if writing.space:
        yield "let:"
        yield f"  stiff: {writing.rate * writing.rate}N/m  # a stiffness of 1 at this rate"
        yield f"  viscous: {writing.rate}Ns/m  # a damping of 1"
    yield "instruments:"
    routes: list[tuple[str, str]] = []
    for instrument, modules, kind_ending in (
        ("space", writing.space, "3D"),
        ("axis", writing.axis, "1D"),
    ):
        if not modules:
            continue
        yield f"  {instrument}:"
        if kind_ending == "3D":
            yield "    space: 3  # a unit of the model is a millimetre"
            if writing.network.gravity:
                gravity = writing.network.gravity * writing.rate * writing.rate * _MILLI
                yield f"    gravity: {gravity!r}m/s2  # {writing.network.gravity!r} a sample²"
        else:
            yield "    units: ca"
            yield f"    at: {writing.rate}Hz"
        yield "    modules:"
        yield from (f"      {output_name}: {{{text}}}" for output_name, text in modules)
        mobile_names = [
            writing.masses[mass.name]
            for mass in writing.network.masses
            if mass.kind.endswith(kind_ending) and not mass.kind.startswith("Ground")
        ]
        if mobile_names:
            out_mass = mobile_names[len(mobile_names) // 2] + (".z" if kind_ending == "3D" else "")
            yield f"    out: {{heard: {{SOX: {out_mass}}}}}"
            routes.append((f"{instrument}.heard", str(len(routes) + 1)))
    if routes:
        yield "mix:"
        yield f"  channels: {len(routes)}"
        route = ", ".join(
            f"{{from: {output_name}, to: {channel}, highpass: 8Hz}}"
            for output_name, channel in routes
        )
        yield f"  route: [{route}]"
        yield "  master: {normalise: -1dB}"
    yield "accuracy: {method: ca}"
    yield "render: {tail: 10s}"
