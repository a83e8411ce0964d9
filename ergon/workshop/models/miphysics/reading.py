"""From a model file of miPhysics (XML) to its masses and links, each with its line."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from xml.parsers import expat

from ergon.notation.text.errors import quote
from ergon.notation.text.spelling import nearest
from ergon.workshop.models.errors import ModelError

ELEMENTS_MAX = 200_000  # elements
_DEPTH_MAX = 8
_PLACE = ("initPos.x", "initPos.y", "initPos.z")
_SPEED = ("initVel.x", "initVel.y", "initVel.z")

# The values of each kind; those of masses begin with their place.
MASSES: Mapping[str, tuple[str, ...]] = {
    "Ground3D": _PLACE,
    "Mass3D": (*_PLACE, *_SPEED, "mass"),
    "Ground1D": _PLACE,
    "Mass1D": (*_PLACE, *_SPEED, "mass"),
    "Osc1D": (*_PLACE, *_SPEED, "mass", "stiffness", "damping"),
}
LINKS: Mapping[str, tuple[str, ...]] = {
    "Spring3D": ("stiffness", "drest"),
    "Damper3D": ("damping",),
    "SpringDamper3D": ("stiffness", "damping", "drest"),
    "Rope3D": ("stiffness", "damping", "drest"),
    "Bubble3D": ("stiffness", "damping", "drest"),
    "Contact3D": ("stiffness", "damping", "drest"),
    "PlaneContact3D": ("stiffness", "damping", "drest", "orientation", "position"),
    "SpringDamper1D": ("stiffness", "damping", "drest"),
}
_REFUSED_WORDS = {
    "Osc3D": "a point in space that its own place pulls back is not built yet",
    "Mass2DPlane": "a mass that stays in a plane is not built yet",
    "Mass3DSimple": "it has gone from miPhysics, and nothing says what it was",
    "HapticInput3D": "a device in space is not built yet",
    "PosInput3D": "a device in space is not built yet",
    "Attractor3D": "its law of distance is not built yet",
}


@dataclass(frozen=True, slots=True)
class Part:
    """A mass or a link: its kind, its name, the masses that it joins, and its values by name."""

    kind: str
    name: str
    ends: tuple[str, ...]
    values: Mapping[str, float]
    line: int


@dataclass(slots=True)
class Network:
    """The content of a file; gravity [m per sample²] acts against the third axis."""

    gravity: float = 0.0
    friction: float = 0.0
    masses: list[Part] = field(default_factory=list)
    links: list[Part] = field(default_factory=list)


def is_model(text: str) -> bool:
    """Whether a text is XML with masses, as miPhysics writes it."""
    return text.lstrip().startswith("<") and "<MAT>" in text[:20_000]


def parse(xml_text: str) -> Network:
    """The masses and links of a file. Raises ModelError with the line at fault."""
    model_parser = _ModelParser()
    parser = expat.ParserCreate("utf-8")
    # Only a document type can declare entities: without one, nothing expands and nothing is loaded.
    parser.StartDoctypeDeclHandler = model_parser.refuse
    parser.StartElementHandler = model_parser.start
    parser.EndElementHandler = model_parser.end
    model_parser.current_line = lambda: parser.CurrentLineNumber
    try:
        parser.Parse(xml_text.encode("utf-8", "replace"), True)
    except expat.ExpatError as error:
        message = expat.errors.messages[error.code]
        raise ModelError(f"the XML is not well formed: {message}", error.lineno) from None
    if not model_parser.network.masses:
        raise ModelError("it has no masses", parser.CurrentLineNumber)
    return model_parser.network


class _ModelParser:
    def __init__(self) -> None:
        self.network, self.path, self.n_elements = Network(), list[str](), 0
        self.line_by_mass: dict[str, int] = {}
        self.gravity, self.gravity_direction = 0.0, (0.0, 0.0, 1.0)
        self.current_line: Callable[[], int] = int

    def refuse(self, *_: object) -> None:
        raise ModelError("the XML has a document type, which is not read", self.current_line())

    def start(self, tag: str, attributes: dict[str, str]) -> None:
        self.n_elements += 1
        self.path.append(tag)
        if self.n_elements > ELEMENTS_MAX:
            raise ModelError(
                f"the XML has more than {ELEMENTS_MAX:,} elements", self.current_line()
            )
        if len(self.path) > _DEPTH_MAX:
            raise ModelError(f"elements are nested deeper than {_DEPTH_MAX}", self.current_line())
        path_below_root = self.path[1:]
        if len(path_below_root) == 1 and tag not in ("global", "MAT", "Link", "Interaction"):
            known_elements = ("global", "MAT", "Link")
            raise ModelError(
                f"{quote(tag)} is not part of a model",
                self.current_line(),
                nearest(tag, known_elements),
            )
        if len(path_below_root) == 2 and path_below_root[0] == "global":
            self.read_global(tag, attributes)
        if len(path_below_root) == 3 and path_below_root[0] == "MAT":
            self.read_part(path_below_root[1], attributes, MASSES, self.network.masses)
        elif len(path_below_root) == 3 and path_below_root[0] in ("Link", "Interaction"):
            self.read_part(path_below_root[1], attributes, LINKS, self.network.links)

    def end(self, tag: str) -> None:
        self.path.pop()
        if tag == "global":
            gravity_vector = [self.gravity * component for component in self.gravity_direction]
            if gravity_vector[0] or gravity_vector[1] or gravity_vector[2] < 0.0:
                message = "gravity goes along another axis than z, which is not built yet"
                raise ModelError(message, self.current_line())
            self.network.gravity = gravity_vector[2]

    def read_global(self, tag: str, attributes: Mapping[str, str]) -> None:
        if tag == "gravity":
            self.gravity = self.number(attributes, "gravity")
        elif tag == "friction":
            self.network.friction = self.number(attributes, "friction")
            if self.network.friction < 0.0:
                raise ModelError("friction is below 0, which gives energy", self.current_line())
        elif tag == "vector":
            x, y, z = (self.number(attributes, f"pos.{axis}") for axis in "xyz")
            self.gravity_direction = (x, y, z)
        else:
            known_elements = ("gravity", "friction", "vector")
            message = f"{quote(tag)} is not part of what holds for all"
            raise ModelError(message, self.current_line(), nearest(tag, known_elements))

    def read_part(
        self,
        kind: str,
        attributes: Mapping[str, str],
        value_names: Mapping[str, tuple[str, ...]],
        parts: list[Part],
    ) -> None:
        line = self.current_line()
        if kind in _REFUSED_WORDS:
            raise ModelError(f"{kind}: {_REFUSED_WORDS[kind]}", line)
        if kind not in value_names:
            noun = "masses" if value_names is MASSES else "links"
            message = f"{quote(kind)} is not a kind of {noun}"
            raise ModelError(message, line, nearest(kind, value_names))
        name = attributes.get("name", "")
        if not name:
            raise ModelError(f"a {kind} has no name", line)
        if value_names is MASSES:  # links may have one name, for nothing calls them
            if name in self.line_by_mass:
                raise ModelError(
                    f"{quote(name)} is the name of line {self.line_by_mass[name]} too",
                    line,
                )
            self.line_by_mass[name] = line
        ends: tuple[str, ...] = ()
        if value_names is LINKS:
            ends = (attributes.get("m1", ""),)
            if kind != "PlaneContact3D":
                ends += (attributes.get("m2", ""),)
        values = {
            value_name: self.number(attributes, value_name) for value_name in value_names[kind]
        }
        parts.append(Part(kind, name, ends, values, line))

    def number(self, attributes: Mapping[str, str], name: str) -> float:
        text = attributes.get(name)
        if text is None:
            raise ModelError(f"{name} is missing", self.current_line())
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not math.isfinite(value) or "_" in text:
            raise ModelError(f"{name} is {quote(text)}, which is not a number", self.current_line())
        return value
