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
    for model_link in network.links:
        _joined(model_link, masses_by_name)
    if network.gravity * rate * rate * _MILLI > _GRAVITY_MAX:
        message = f"gravity is {network.gravity:g} a sample²: at {rate:,} Hz a score holds up to "
        raise ModelError(f"{message}{_GRAVITY_MAX / (rate * rate * _MILLI):g}; set a lower rate")
    for model_mass in network.masses:
        if "mass" in model_mass.values:
            _heavy(writing, model_mass)
    start_speeds = speeds(network, rate)
    for model_mass in network.masses:
        writing.masses[model_mass.name] = writing.new(model_mass.name)
        if model_mass.kind.endswith("3D"):
            _point(writing, model_mass, start_speeds.get(model_mass.name, (0.0, 0.0, 0.0)))
        else:
            _mass(writing, model_mass)
    for model_link in network.links:
        if model_link.kind == "SpringDamper1D":
            _spring(writing, model_link, masses_by_name)
        else:
            _link(writing, model_link)
    return "\n".join(_lines(writing, score_title)) + "\n"


def _joined(model_link: Part, masses_by_name: dict[str, Part]) -> None:
    """Raises ModelError if a link joins a mass that does not exist, or of a kind that does not fit
    it.
    """
    for link_end in model_link.ends:
        if link_end not in masses_by_name:
            suggestion = nearest(link_end, masses_by_name)
            raise ModelError(f"no mass is called {quote(link_end)}", model_link.line, suggestion)
        if masses_by_name[link_end].kind.endswith("1D") != model_link.kind.endswith("1D"):
            axes = "one axis" if masses_by_name[link_end].kind.endswith("1D") else "three axes"
            message = (
                f"{quote(link_end)} has {axes}, and {model_link.kind} joins others; that is not "
                "built"
            )
            raise ModelError(message, model_link.line)
    if len(set(model_link.ends)) < len(model_link.ends):
        raise ModelError(f"it joins {quote(model_link.ends[0])} to itself", model_link.line)
    for name in ("stiffness", "damping"):
        if model_link.values.get(name, 0.0) < 0.0:
            message = f"{name} is {model_link.values[name]:g}: below 0 it makes energy"
            raise ModelError(message, model_link.line)
    if model_link.kind != "SpringDamper1D" and model_link.values.get("drest", 0.0) < 0.0:
        raise ModelError(
            f"drest is {model_link.values['drest']:g}: a distance is 0 or more", model_link.line
        )
    if model_link.values.get("orientation", 0.0) not in (0.0, 1.0, 2.0):
        message = f"orientation is {model_link.values['orientation']:g}: 0, 1 or 2 for x, y or z"
        raise ModelError(message, model_link.line)


def _within(part: Part, field_name: str, value: float, value_max: float) -> None:
    if not abs(value) <= value_max:
        raise ModelError(f"{field_name} is {value:g}: a score holds up to {value_max:g}", part.line)


def _heavy(writing: _Writing, model_part: Part) -> float:
    part_mass = model_part.values["mass"]
    if not part_mass > writing.network.friction:
        message = f"mass is {part_mass:g}: it is above 0, and above the friction of the medium"
        raise ModelError(message, model_part.line)
    return part_mass


def _number(value: float) -> str:
    return repr(int(value)) if value == int(value) and abs(value) < 1e15 else repr(value)


# --- in space -----------------------------------------------------------------------------------


def _vector(values: tuple[float, ...], unit: str) -> str:
    return f"[{', '.join(f'{_number(value)}{unit}' for value in values)}]"


def _point(writing: _Writing, model_part: Part, speed: tuple[float, float, float]) -> None:
    for component_value in place(model_part):
        _within(model_part, "a place", component_value, _DISTANCE_MAX)
    module_fields = [f"X0: {_vector(place(model_part), 'mm')}"]
    mass_kind = "SOL"
    if model_part.kind != "Ground3D":
        mass_kind, mass_amount = "MAS", _heavy(writing, model_part)
        module_fields.insert(0, f"M: {_number(mass_amount)}kg")
        if any(speed):
            speed_per_second = tuple(value * writing.rate for value in speed)
            for component_value in speed_per_second:
                _within(model_part, "a speed", component_value, _SPEED_MAX)
            module_fields.append(f"V0: {_vector(speed_per_second, 'mm/s')}")
        if writing.network.friction:
            module_fields.append(f"drag: {drag(writing.network.friction, mass_amount)!r}*viscous")
    writing.space.append(
        (writing.masses[model_part.name], f"{mass_kind}: {{{', '.join(module_fields)}}}")
    )


_KINDS = {"Spring3D": "RES", "Damper3D": "FRO", "SpringDamper3D": "REF"}


def _link(writing: _Writing, model_link: Part) -> None:
    link_values = model_link.values
    end_masses = [writing.masses[end] for end in model_link.ends]
    link_kind = _KINDS.get(model_link.kind, "BUT")
    if model_link.kind == "PlaneContact3D":
        axis_index = int(link_values["orientation"])
        end_masses.insert(0, _wall(writing, axis_index, link_values["position"], model_link))
    written_fields = [f"between: [{', '.join(end_masses)}]"]
    written_fields += (
        [f"K: {_number(link_values['stiffness'])}*stiff"] if "stiffness" in link_values else []
    )
    written_fields += (
        [f"Z: {_number(link_values['damping'])}*viscous"] if "damping" in link_values else []
    )
    if link_kind == "BUT":
        written_fields.append(f"gap: {_number(link_values['drest'])}mm")
        if model_link.kind == "PlaneContact3D":
            written_fields.append(
                f"normal: {_vector(tuple(float(i == axis_index) for i in range(3)), '')}"
            )
        elif model_link.kind != "Contact3D":
            written_fields.append("side: inside")
    elif "drest" in link_values:
        written_fields.append(f"rest: {_number(link_values['drest'])}mm")
    writing.space.append(
        (writing.new(model_link.name), f"{link_kind}: {{{', '.join(written_fields)}}}")
    )


def _wall(writing: _Writing, axis_index: int, wall_position: float, link: Part) -> str:
    """The plane of a contact; contacts on the same plane share it."""
    _within(link, "position", wall_position, _DISTANCE_MAX)
    if (axis_index, wall_position) not in writing.walls:
        name = writing.walls[axis_index, wall_position] = writing.new(f"wall_{'xyz'[axis_index]}")
        wall_place = tuple(wall_position if i == axis_index else 0.0 for i in range(3))
        writing.space.append((name, f"SOL: {{X0: {_vector(wall_place, 'mm')}}}"))
    return writing.walls[axis_index, wall_position]


# --- one axis -----------------------------------------------------------------------------------


def _mass(writing: _Writing, model_part: Part) -> None:
    """Add a mass that moves along z; places are metres, because `units: ca` has numbers alone."""
    z, mass_name = model_part.values["initPos.z"], writing.masses[model_part.name]
    _within(model_part, "a place", z, _DISTANCE_MAX * _MILLI)
    x0 = f"X0: {_number(z)}m"
    if model_part.kind == "Ground1D":
        writing.axis.append((mass_name, f"SOL: {{{x0}}}"))
        return
    mass_amount, friction = _heavy(writing, model_part), writing.network.friction
    module_fields = [f"M: {_number(mass_amount)}"]
    is_tied = model_part.kind == "Osc1D"
    if is_tied or friction:
        k = model_part.values["stiffness"] if is_tied else 0.0
        loss = (model_part.values["damping"] if is_tied else 0.0) + friction
        if k < 0.0 or loss < 0.0:
            raise ModelError("stiffness or damping below 0 makes energy", model_part.line)
        module_fields += [f"K: {_number(k)}", f"Z: {_number(loss)}"]
        # The mass is tied to the place where it begins: the rest of a CEL.
        module_fields += [f"rest: {_number(z)}m"] if is_tied and z else []
    module_fields.append(x0)
    if speed := model_part.values["initVel.z"]:
        _within(model_part, "a speed", speed, _SPEED_MAX * _MILLI)
        module_fields.append(f"V0: {_number(speed)}m/s")
    writing.axis.append(
        (
            mass_name,
            f"{'CEL' if len(module_fields) > 3 and (is_tied or friction) else 'MAS'}: "
            f"{{{', '.join(module_fields)}}}",
        )
    )
    if writing.network.gravity:
        weight = writing.new(f"{mass_name}_weight")
        writing.axis.append(
            (weight, f"ENF: {{to: {mass_name}, from: {-writing.network.gravity * mass_amount!r}N}}")
        )


def _spring(writing: _Writing, model_link: Part, masses_by_name: dict[str, Part]) -> None:
    link_values = model_link.values
    a, b = model_link.ends
    if not {masses_by_name[a].kind, masses_by_name[b].kind} - {"Ground1D"}:
        return  # nothing of it moves
    # d is x_b - x_a - rest in a score, and z1 - z2 - drest in the model.
    written_fields = [
        f"between: [{writing.masses[b]}, {writing.masses[a]}]",
        f"K: {_number(link_values['stiffness'])}",
    ]
    written_fields += [f"Z: {_number(link_values['damping'])}"]
    written_fields += [f"rest: {_number(link_values['drest'])}m"] if link_values["drest"] else []
    writing.axis.append((writing.new(model_link.name), f"REF: {{{', '.join(written_fields)}}}"))


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
    yaml_rows: list[tuple[str, str]] = []
    for instrument, instrument_modules, axis_ending in (
        ("space", writing.space, "3D"),
        ("axis", writing.axis, "1D"),
    ):
        if not instrument_modules:
            continue
        yield f"  {instrument}:"
        if axis_ending == "3D":
            yield "    space: 3  # a unit of the model is a millimetre"
            if writing.network.gravity:
                gravity = writing.network.gravity * writing.rate * writing.rate * _MILLI
                yield f"    gravity: {gravity!r}m/s2  # {writing.network.gravity!r} a sample²"
        else:
            yield "    units: ca"
            yield f"    at: {writing.rate}Hz"
        yield "    modules:"
        yield from (f"      {name}: {{{text}}}" for name, text in instrument_modules)
        moving = [
            writing.masses[mass.name]
            for mass in writing.network.masses
            if mass.kind.endswith(axis_ending) and not mass.kind.startswith("Ground")
        ]
        if moving:
            out_mass = moving[len(moving) // 2] + (".z" if axis_ending == "3D" else "")
            yield f"    out: {{heard: {{SOX: {out_mass}}}}}"
            yaml_rows.append((f"{instrument}.heard", str(len(yaml_rows) + 1)))
    if yaml_rows:
        yield "mix:"
        yield f"  channels: {len(yaml_rows)}"
        route = ", ".join(
            f"{{from: {name}, to: {channels}, highpass: 8Hz}}" for name, channels in yaml_rows
        )
        yield f"  route: [{route}]"
        yield "  master: {normalise: -1dB}"
    yield "accuracy: {method: ca}"
    yield "render: {tail: 10s}"
