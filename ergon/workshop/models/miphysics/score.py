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
_FARTHEST, _FASTEST, _HEAVIEST = 1e6, 1e9, 1e5  # [mm], [mm/s], [m/s²] of a score
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


def written(network: Network, title: str, rate: int) -> str:
    """The text of a score that moves as a model does at a rate [Hz]. Raises ModelError with the
    line.
    """
    writing = _Writing(network, rate)
    masses_by_name = {mass.name: mass for mass in network.masses}
    for link in network.links:
        _joined(link, masses_by_name)
    if network.gravity * rate * rate * _MILLI > _HEAVIEST:
        message = f"gravity is {network.gravity:g} a sample²: at {rate:,} Hz a score holds up to "
        raise ModelError(f"{message}{_HEAVIEST / (rate * rate * _MILLI):g}; set a lower rate")
    for mass in network.masses:
        if "mass" in mass.values:
            _heavy(writing, mass)
    begin = speeds(network, rate)
    for mass in network.masses:
        writing.masses[mass.name] = writing.new(mass.name)
        if mass.kind.endswith("3D"):
            _point(writing, mass, begin.get(mass.name, (0.0, 0.0, 0.0)))
        else:
            _mass(writing, mass)
    for link in network.links:
        if link.kind == "SpringDamper1D":
            _spring(writing, link, masses_by_name)
        else:
            _link(writing, link)
    return "\n".join(_lines(writing, title)) + "\n"


def _joined(link: Part, masses_by_name: dict[str, Part]) -> None:
    """Raises ModelError if a link joins a mass that does not exist, or of a kind that does not fit
    it.
    """
    for end in link.ends:
        if end not in masses_by_name:
            near = nearest(end, masses_by_name)
            raise ModelError(f"no mass is called {quote(end)}", link.line, near)
        if masses_by_name[end].kind.endswith("1D") != link.kind.endswith("1D"):
            axes = "one axis" if masses_by_name[end].kind.endswith("1D") else "three axes"
            message = f"{quote(end)} has {axes}, and {link.kind} joins others; that is not built"
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


def _heavy(writing: _Writing, part: Part) -> float:
    mass = part.values["mass"]
    if not mass > writing.network.friction:
        message = f"mass is {mass:g}: it is above 0, and above the friction of the medium"
        raise ModelError(message, part.line)
    return mass


def _number(value: float) -> str:
    return repr(int(value)) if value == int(value) and abs(value) < 1e15 else repr(value)


# --- in space -----------------------------------------------------------------------------------


def _vector(values: tuple[float, ...], unit: str) -> str:
    return f"[{', '.join(f'{_number(value)}{unit}' for value in values)}]"


def _point(writing: _Writing, part: Part, speed: tuple[float, float, float]) -> None:
    for value in place(part):
        _within(part, "a place", value, _FARTHEST)
    fields = [f"X0: {_vector(place(part), 'mm')}"]
    kind = "SOL"
    if part.kind != "Ground3D":
        kind, mass = "MAS", _heavy(writing, part)
        fields.insert(0, f"M: {_number(mass)}kg")
        if any(speed):
            fast = tuple(value * writing.rate for value in speed)
            for value in fast:
                _within(part, "a speed", value, _FASTEST)
            fields.append(f"V0: {_vector(fast, 'mm/s')}")
        if writing.network.friction:
            fields.append(f"drag: {drag(writing.network.friction, mass)!r}*viscous")
    writing.space.append((writing.masses[part.name], f"{kind}: {{{', '.join(fields)}}}"))


_KINDS = {"Spring3D": "RES", "Damper3D": "FRO", "SpringDamper3D": "REF"}


def _link(writing: _Writing, link: Part) -> None:
    values = link.values
    end_masses = [writing.masses[end] for end in link.ends]
    kind = _KINDS.get(link.kind, "BUT")
    if link.kind == "PlaneContact3D":
        axis = int(values["orientation"])
        end_masses.insert(0, _wall(writing, axis, values["position"], link))
    written_fields = [f"between: [{', '.join(end_masses)}]"]
    written_fields += [f"K: {_number(values['stiffness'])}*stiff"] if "stiffness" in values else []
    written_fields += [f"Z: {_number(values['damping'])}*viscous"] if "damping" in values else []
    if kind == "BUT":
        written_fields.append(f"gap: {_number(values['drest'])}mm")
        if link.kind == "PlaneContact3D":
            written_fields.append(
                f"normal: {_vector(tuple(float(i == axis) for i in range(3)), '')}"
            )
        elif link.kind != "Contact3D":
            written_fields.append("side: inside")
    elif "drest" in values:
        written_fields.append(f"rest: {_number(values['drest'])}mm")
    writing.space.append((writing.new(link.name), f"{kind}: {{{', '.join(written_fields)}}}"))


def _wall(writing: _Writing, axis: int, position: float, link: Part) -> str:
    """The plane of a contact; contacts on the same plane share it."""
    _within(link, "position", position, _FARTHEST)
    if (axis, position) not in writing.walls:
        name = writing.walls[axis, position] = writing.new(f"wall_{'xyz'[axis]}")
        wall_place = tuple(position if i == axis else 0.0 for i in range(3))
        writing.space.append((name, f"SOL: {{X0: {_vector(wall_place, 'mm')}}}"))
    return writing.walls[axis, position]


# --- one axis -----------------------------------------------------------------------------------


def _mass(writing: _Writing, part: Part) -> None:
    """Add a mass that moves along z; places are metres, because `units: ca` has numbers alone."""
    z, name = part.values["initPos.z"], writing.masses[part.name]
    _within(part, "a place", z, _FARTHEST * _MILLI)
    x0 = f"X0: {_number(z)}m"
    if part.kind == "Ground1D":
        writing.axis.append((name, f"SOL: {{{x0}}}"))
        return
    mass, friction = _heavy(writing, part), writing.network.friction
    fields = [f"M: {_number(mass)}"]
    is_tied = part.kind == "Osc1D"
    if is_tied or friction:
        k = part.values["stiffness"] if is_tied else 0.0
        loss = (part.values["damping"] if is_tied else 0.0) + friction
        if k < 0.0 or loss < 0.0:
            raise ModelError("stiffness or damping below 0 makes energy", part.line)
        fields += [f"K: {_number(k)}", f"Z: {_number(loss)}"]
        # The mass is tied to the place where it begins: the rest of a CEL.
        fields += [f"rest: {_number(z)}m"] if is_tied and z else []
    fields.append(x0)
    if speed := part.values["initVel.z"]:
        _within(part, "a speed", speed, _FASTEST * _MILLI)
        fields.append(f"V0: {_number(speed)}m/s")
    writing.axis.append(
        (
            name,
            f"{'CEL' if len(fields) > 3 and (is_tied or friction) else 'MAS'}: "
            f"{{{', '.join(fields)}}}",
        )
    )
    if writing.network.gravity:
        weight = writing.new(f"{name}_weight")
        writing.axis.append(
            (weight, f"ENF: {{to: {name}, from: {-writing.network.gravity * mass!r}N}}")
        )


def _spring(writing: _Writing, link: Part, masses_by_name: dict[str, Part]) -> None:
    values = link.values
    a, b = link.ends
    if not {masses_by_name[a].kind, masses_by_name[b].kind} - {"Ground1D"}:
        return  # nothing of it moves
    # d is x_b - x_a - rest in a score, and z1 - z2 - drest in the model.
    written_fields = [
        f"between: [{writing.masses[b]}, {writing.masses[a]}]",
        f"K: {_number(values['stiffness'])}",
    ]
    written_fields += [f"Z: {_number(values['damping'])}"]
    written_fields += [f"rest: {_number(values['drest'])}m"] if values["drest"] else []
    writing.axis.append((writing.new(link.name), f"REF: {{{', '.join(written_fields)}}}"))


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
    rows: list[tuple[str, str]] = []
    for instrument, modules, end in (("space", writing.space, "3D"), ("axis", writing.axis, "1D")):
        if not modules:
            continue
        yield f"  {instrument}:"
        if end == "3D":
            yield "    space: 3  # a unit of the model is a millimetre"
            if writing.network.gravity:
                gravity = writing.network.gravity * writing.rate * writing.rate * _MILLI
                yield f"    gravity: {gravity!r}m/s2  # {writing.network.gravity!r} a sample²"
        else:
            yield "    units: ca"
            yield f"    at: {writing.rate}Hz"
        yield "    modules:"
        yield from (f"      {name}: {{{text}}}" for name, text in modules)
        moving = [
            writing.masses[mass.name]
            for mass in writing.network.masses
            if mass.kind.endswith(end) and not mass.kind.startswith("Ground")
        ]
        if moving:
            out_mass = moving[len(moving) // 2] + (".z" if end == "3D" else "")
            yield f"    out: {{heard: {{SOX: {out_mass}}}}}"
            rows.append((f"{instrument}.heard", str(len(rows) + 1)))
    if rows:
        yield "mix:"
        yield f"  channels: {len(rows)}"
        route = ", ".join(
            f"{{from: {name}, to: {channels}, highpass: 8Hz}}" for name, channels in rows
        )
        yield f"  route: [{route}]"
        yield "  master: {normalise: -1dB}"
    yield "accuracy: {method: ca}"
    yield "render: {tail: 10s}"
