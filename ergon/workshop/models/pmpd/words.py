"""The words of pmpd and pmpd~ (Pure Data), one-dimensional, and the arguments of each.

A form is a row of values, each with its kind: `mass:masses` is an index or a class of masses. A
value with `=` may be left out; its default is after the `=`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

Object = Literal["pmpd", "pmpd~"]
OBJECTS: tuple[Object, ...] = ("pmpd", "pmpd~")


@dataclass(frozen=True, slots=True)
class Value:
    """An argument of a word: its name, its kind, its default."""

    name: str
    kind: str
    default: str | None

    @property
    def notation(self) -> str:
        """The argument as documentation shows it: `[K]` may be left out."""
        return self.name if self.default is None else f"[{self.name}]"


def _values(form: str) -> tuple[Value, ...]:
    values = []
    for word in form.split():
        name_and_kind, has_default, default = word.partition("=")
        name, _, kind = name_and_kind.partition(":")
        values.append(Value(name, kind or "number", default if has_default else None))
    return tuple(values)


def _forms(text: str) -> dict[str, tuple[Value, ...]]:
    forms: dict[str, tuple[Value, ...]] = {}
    for line in text.strip().splitlines():
        words, _, form = line.partition("|")
        forms |= dict.fromkeys(words.split(), _values(form))
    return forms


# The default is 0 for pmpd~, as in all typed messages of Pure Data.
_AUDIO = _forms("""
mass | M=0 x=0
link | mass1:mass=0 mass2:mass=0 K=0 D=0
NLlink | mass1:mass mass2:mass K=0 D=0 Pow=1 L0=0 Lmin=-1e6 Lmax=1e6
inPos inPosX inForce inForceX | inlet:port=0 mass:mass=0 gain=0
outPos outPosX outSpeed outSpeedX | outlet:port=0 mass:mass=0 gain=0
pos posX | mass:mass=0 x=0
force forceX | mass:mass=0 f=0
setM | mass:mass=0 M=0
setK | link:link=0 K=0
setD | link:link=0 D=0
setNLK | NLlink:NLlink K Pow=
setNLD | NLlink:NLlink=0 D=0
setNLKPow | NLlink:NLlink=0 Pow=0
setNLL | NLlink:NLlink=0 L0=0
setNLLMin | NLlink:NLlink=0 Lmin=0
setNLLMax | NLlink:NLlink=0 Lmax=0
reset print bang |
""")
_CONTROL = _forms("""
mass | class:class=mass mobile=1 M=1 x=0
link | class:class a:masses b:masses K=0 D=0 Pow=1 Lmin=-1e6 Lmax=1e6
tabLink | class:class a:masses b:masses arrayK:array lengthK arrayD:array lengthD
pos posX setPos setPosX | masses:masses x
addPos addPosX | masses:masses x
force forceX | masses:masses f
setForce setForceX | masses:masses f
setSpeed setSpeedX | masses:masses v
setM | masses:masses M
setDEnv | masses:masses D
setFixed setMobile | masses:masses
setK | links:links K
setD | links:links D
setPow | links:links Pow
setL addL | links:links L
massPos massPosL massPosXL | masses:masses=
massSpeed massSpeedL massSpeedXL | masses:masses=
massPosMean massSpeedMean | masses:masses=
reset print infosL bang |
""")
FORMS: Mapping[Object, Mapping[str, tuple[Value, ...]]] = {"pmpd": _CONTROL, "pmpd~": _AUDIO}

# Words of the objects that a score cannot express: the reason, and the words.
_REFUSED_WORDS = {
    "space has no ends in a score; leave it out where no mass gets there, or write a BUT": """
        min minX max maxX Xmin Xmax""",
    "masses and links that change while it plays are not built yet": """
        delMass delLink setEnd setEnd1 setEnd2 grabMass setActive setInactive setLCurrent
        setNLLCurrent setMassId setLinkId setLKTab setLDTab""",
    "a damping that acts against the movement alone is not built yet": "setOverdamp",
    "it asks for numbers that nobody hears; leave it out": """
        get massInfo linkInfo massNumber linkNumber massForce massForceL linkPos linkPosL
        linkLength linkLengthL linkEnd""",
    "it is a word of two or three dimensions, which are not read yet": """
        tLink hinge iCircle iLine iMatrix iSphere iPlane iCylinder""",
}
REFUSED: Mapping[str, str] = {
    word: why for why, words in _REFUSED_WORDS.items() for word in words.split()
}


def usage_text(word: str, form: tuple[Value, ...]) -> str:
    """A message as documentation shows it: `link mass1 mass2 [K] [D]`."""
    return " ".join((word, *(value.notation for value in form)))
