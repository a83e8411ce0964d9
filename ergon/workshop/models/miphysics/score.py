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
from ergon.workshop.models.miphysics.start import drag_viscosity, initial_position, initial_speeds
from ergon.workshop.models.naming import Names

RATES = (100, 192_000)  # [Hz] that a model may have
_MILLI = 1e-3
_DISTANCE_MAX, _SPEED_MAX, _GRAVITY_MAX = 1e6, 1e9, 1e5  # [mm], [mm/s], [m/s²] of a score
_NO_LETTER = re.compile(r"\W", re.ASCII)


@dataclass(slots=True)
class _ScoreDraft:
    network: Network
    rate: int
    names: Names = field(default_factory=Names)
    mass_modules: dict[str, str] = field(default_factory=dict)
    space_modules: list[tuple[str, str]] = field(default_factory=list)  # modules: name, text
    axis_modules: list[tuple[str, str]] = field(default_factory=list)
    wall_modules: dict[tuple[int, float], str] = field(default_factory=dict)

    def new_name(self, name: str) -> str:
        word = _NO_LETTER.sub("_", name)
        return self.names.new(word if word[:1].isalpha() else f"m{word}")


def score_text(network: Network, score_title: str, rate: int) -> str:
    """The text of a score that moves as a model does at a rate [Hz]. Raises ModelError with the
    line.
    """
    draft = _ScoreDraft(network, rate)
    masses_by_name = {mass.name: mass for mass in network.masses}
    for link in network.links:
        _check_link(link, masses_by_name)
    if network.gravity * rate * rate * _MILLI > _GRAVITY_MAX:
        message = f"gravity is {network.gravity:g} a sample²: at {rate:,} Hz a score holds up to "
        raise ModelError(f"{message}{_GRAVITY_MAX / (rate * rate * _MILLI):g}; set a lower rate")
    for mass in network.masses:
        if "mass" in mass.values:
            _checked_mass(draft, mass)
    start_speeds = initial_speeds(network, rate)
    for mass in network.masses:
        draft.mass_modules[mass.name] = draft.new_name(mass.name)
        if mass.kind.endswith("3D"):
            _add_point(draft, mass, start_speeds.get(mass.name, (0.0, 0.0, 0.0)))
        else:
            _add_mass_1d(draft, mass)
    for link in network.links:
        if link.kind == "SpringDamper1D":
            _add_spring_1d(draft, link, masses_by_name)
        else:
            _add_link(draft, link)
    return "\n".join(_lines(draft, score_title)) + "\n"


def _check_link(link: Part, masses_by_name: dict[str, Part]) -> None:
    """Raises ModelError if a link joins a mass that does not exist, or of a kind that does not fit
    it.
    """
    for mass_name in link.ends:
        if mass_name not in masses_by_name:
            suggestion = nearest(mass_name, masses_by_name)
            raise ModelError(f"no mass is called {quote(mass_name)}", link.line, suggestion)
        if masses_by_name[mass_name].kind.endswith("1D") != link.kind.endswith("1D"):
            axes_text = (
                "one axis" if masses_by_name[mass_name].kind.endswith("1D") else "three axes"
            )
            message = (
                f"{quote(mass_name)} has {axes_text}, and {link.kind} joins others; "
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


def _check_range(part: Part, field_name: str, value: float, value_max: float) -> None:
    if not abs(value) <= value_max:
        raise ModelError(f"{field_name} is {value:g}: a score holds up to {value_max:g}", part.line)


def _checked_mass(draft: _ScoreDraft, mass: Part) -> float:
    mass_kg = mass.values["mass"]
    if not mass_kg > draft.network.friction:
        message = f"mass is {mass_kg:g}: it is above 0, and above the friction of the medium"
        raise ModelError(message, mass.line)
    return mass_kg


def _number(value: float) -> str:
    return repr(int(value)) if value == int(value) and abs(value) < 1e15 else repr(value)


# --- in space -----------------------------------------------------------------------------------


def _vector(values: tuple[float, ...], unit: str) -> str:
    return f"[{', '.join(f'{_number(value)}{unit}' for value in values)}]"


def _add_point(draft: _ScoreDraft, mass: Part, speed: tuple[float, float, float]) -> None:
    for component in initial_position(mass):
        _check_range(mass, "a place", component, _DISTANCE_MAX)
    fields = [f"X0: {_vector(initial_position(mass), 'mm')}"]
    kind = "SOL"
    if mass.kind != "Ground3D":
        kind, mass_kg = "MAS", _checked_mass(draft, mass)
        fields.insert(0, f"M: {_number(mass_kg)}kg")
        if any(speed):
            speed_per_second = tuple(value * draft.rate for value in speed)
            for component in speed_per_second:
                _check_range(mass, "a speed", component, _SPEED_MAX)
            fields.append(f"V0: {_vector(speed_per_second, 'mm/s')}")
        if draft.network.friction:
            fields.append(f"drag: {drag_viscosity(draft.network.friction, mass_kg)!r}*viscous")
    draft.space_modules.append((draft.mass_modules[mass.name], f"{kind}: {{{', '.join(fields)}}}"))


_KINDS = {"Spring3D": "RES", "Damper3D": "FRO", "SpringDamper3D": "REF"}


def _add_link(draft: _ScoreDraft, link: Part) -> None:
    values = link.values
    ends = [draft.mass_modules[mass_name] for mass_name in link.ends]
    kind = _KINDS.get(link.kind, "BUT")
    if link.kind == "PlaneContact3D":
        axis = int(values["orientation"])
        ends.insert(0, _wall(draft, axis, values["position"], link))
    fields = [f"between: [{', '.join(ends)}]"]
    fields += [f"K: {_number(values['stiffness'])}*stiff"] if "stiffness" in values else []
    fields += [f"Z: {_number(values['damping'])}*viscous"] if "damping" in values else []
    if kind == "BUT":
        fields.append(f"gap: {_number(values['drest'])}mm")
        if link.kind == "PlaneContact3D":
            fields.append(f"normal: {_vector(tuple(float(i == axis) for i in range(3)), '')}")
        elif link.kind != "Contact3D":
            fields.append("side: inside")
    elif "drest" in values:
        fields.append(f"rest: {_number(values['drest'])}mm")
    draft.space_modules.append((draft.new_name(link.name), f"{kind}: {{{', '.join(fields)}}}"))


def _wall(draft: _ScoreDraft, axis: int, position: float, link: Part) -> str:
    """The plane of a contact; contacts on the same plane share it."""
    _check_range(link, "position", position, _DISTANCE_MAX)
    if (axis, position) not in draft.wall_modules:
        name = draft.wall_modules[axis, position] = draft.new_name(f"wall_{'xyz'[axis]}")
        x0 = tuple(position if i == axis else 0.0 for i in range(3))
        draft.space_modules.append((name, f"SOL: {{X0: {_vector(x0, 'mm')}}}"))
    return draft.wall_modules[axis, position]


# --- one axis -----------------------------------------------------------------------------------


def _add_mass_1d(draft: _ScoreDraft, mass: Part) -> None:
    """Add a mass that moves along z; places are metres, because `units: ca` has numbers alone."""
    z, name = mass.values["initPos.z"], draft.mass_modules[mass.name]
    _check_range(mass, "a place", z, _DISTANCE_MAX * _MILLI)
    x0 = f"X0: {_number(z)}m"
    if mass.kind == "Ground1D":
        draft.axis_modules.append((name, f"SOL: {{{x0}}}"))
        return
    m, friction = _checked_mass(draft, mass), draft.network.friction
    fields = [f"M: {_number(m)}"]
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
        _check_range(mass, "a speed", speed, _SPEED_MAX * _MILLI)
        fields.append(f"V0: {_number(speed)}m/s")
    draft.axis_modules.append(
        (
            name,
            f"{'CEL' if len(fields) > 3 and (is_tied or friction) else 'MAS'}: "
            f"{{{', '.join(fields)}}}",
        )
    )
    if draft.network.gravity:
        weight_name = draft.new_name(f"{name}_weight")
        draft.axis_modules.append(
            (weight_name, f"ENF: {{to: {name}, from: {-draft.network.gravity * m!r}N}}")
        )


def _add_spring_1d(draft: _ScoreDraft, link: Part, masses_by_name: dict[str, Part]) -> None:
    values = link.values
    first_name, second_name = link.ends
    if not {masses_by_name[first_name].kind, masses_by_name[second_name].kind} - {"Ground1D"}:
        return  # nothing of it moves
    # d is x_b - x_a - rest in a score, and z1 - z2 - drest in the model.
    fields = [
        f"between: [{draft.mass_modules[second_name]}, {draft.mass_modules[first_name]}]",
        f"K: {_number(values['stiffness'])}",
    ]
    fields += [f"Z: {_number(values['damping'])}"]
    fields += [f"rest: {_number(values['drest'])}m"] if values["drest"] else []
    draft.axis_modules.append((draft.new_name(link.name), f"REF: {{{', '.join(fields)}}}"))


# --- text ---------------------------------------------------------------------------------------


def _lines(draft: _ScoreDraft, title: str) -> Iterator[str]:
    yield f"# From {printable(title) or 'a model'}, a model of miPhysics."
    yield (
        f"# A step of the model is a sample of 1/{draft.rate} s; --set rate=1050 makes it longer."
    )
    yield "# The file does not say what is heard: it is the mass in the middle, along z."
    yield "ergon: 1"
    yield f"rates: {{audio: {draft.rate}Hz}}"
    if draft.space_modules:
        yield "let:"
        yield f"  stiff: {draft.rate * draft.rate}N/m  # a stiffness of 1 at this rate"
        yield f"  viscous: {draft.rate}Ns/m  # a damping of 1"
    yield "instruments:"
    routes: list[tuple[str, str]] = []
    for instrument, modules, kind_ending in (
        ("space", draft.space_modules, "3D"),
        ("axis", draft.axis_modules, "1D"),
    ):
        if not modules:
            continue
        yield f"  {instrument}:"
        if kind_ending == "3D":
            yield "    space: 3  # a unit of the model is a millimetre"
            if draft.network.gravity:
                gravity = draft.network.gravity * draft.rate * draft.rate * _MILLI
                yield f"    gravity: {gravity!r}m/s2  # {draft.network.gravity!r} a sample²"
        else:
            yield "    units: ca"
            yield f"    at: {draft.rate}Hz"
        yield "    modules:"
        yield from (f"      {output_name}: {{{text}}}" for output_name, text in modules)
        mobile_names = [
            draft.mass_modules[mass.name]
            for mass in draft.network.masses
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
