"""The words of MIMS (v1) and mi-gen (v2): which arguments each takes, in which order.

A form is the points that a word joins, then the names of its values. Values in brackets may be
left out, from the last one on; values after them always stand at the end of the line.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

Dialect = Literal["v1", "v2"]
Family = Literal["param", "mass", "macro", "link", "input", "output"]


@dataclass(frozen=True, slots=True)
class Form:
    """The arguments of a word: number of points, values, optional values, values after these."""

    family: Family
    n_points: int
    values: tuple[str, ...]
    optional: tuple[str, ...] = ()
    trailing: tuple[str, ...] = ()

    @property
    def usage(self) -> str:
        """The form as documentation shows it: `@a @b K Z [thresh]`."""
        points = ("@m",) if self.n_points == 1 else ("@a", "@b")[: self.n_points]
        optional_words = (f"[{name}]" for name in self.optional)
        return " ".join((*points, *self.values, *optional_words, *self.trailing)) or "nothing"


_N_POINTS: Mapping[Family, int] = {"link": 2, "output": 1}


def _forms(family: Family, text: str, n_points: int | None = None) -> dict[str, Form]:
    forms = {}
    for line in text.strip().splitlines():
        keyword, *value_names = line.split()
        optional_indices = [index for index, name in enumerate(value_names) if name.startswith("[")]
        optional_begin = optional_indices[0] if optional_indices else len(value_names)
        optional_end = optional_indices[-1] + 1 if optional_indices else len(value_names)
        forms[keyword] = Form(
            family,
            _N_POINTS.get(family, 0) if n_points is None else n_points,
            tuple(value_names[:optional_begin]),
            tuple(name.strip("[]") for name in value_names[optional_begin:optional_end]),
            tuple(value_names[optional_end:]),
        )
    return forms


_PORTS = {
    **_forms("param", "param value\naudioParam input"),
    **_forms("input", "posInput x0"),
    **_forms("input", "frcInput", 1),
    **_forms("output", "posOutput\nfrcOutput"),
}
_V1 = {
    **_PORTS,
    **_forms(
        "mass",
        """
        ground x0
        mass   M x0 before
        massG  M gravity x0 before
        osc    M K Z x0 before
        """,
    ),
    **_forms(
        "macro",
        """
        string      N M K Z x0
        chain       N M K Z x0
        stiffString N M K K2 Z x0
        mesh        L W M K Z x0
        closedMesh  L W M K Z x0
        cornerMesh  L W M K Z x0
        """,
    ),
    **_forms(
        "link",
        """
        spring       K [Z]
        damper       Z
        springDamper K Z
        contact      K Z thresh
        detent       K Z thresh
        nlSpring     K Q Z
        nlSpring2    K Q Z
        nlSpring3    K Q Z
        nlBow        Z scale
        nlPluck      K scale
        """,
    ),
}
_V2 = {
    **_PORTS,
    **_forms(
        "mass",
        """
        ground x0
        mass   M [gravity] x0 v0
        osc    M K Z [gravity] x0 v0
        """,
    ),
    **_forms(
        "macro",
        """
        string      N M K Z [Zo] x0 v0
        chain       N M K Z [Zo] x0 v0
        stiffString N M K K2 Z [Zo] x0 v0
        mesh        L W M K Z [Zo] x0 v0
        closedMesh  L W M K Z [Zo] x0 v0
        cornerMesh  L W M K Z [Zo] x0 v0
        """,
    ),
    **_forms(
        "link",
        """
        spring         K
        damper         Z
        springDamper   K Z
        contact        K Z [thresh]
        nlContact      K Q lim Z [thresh]
        nlSpring2      K Q Z
        nlSpring3      K Q Z
        nlSpringDamper K Q lim Z
        nlBow          Z scale [smooth]
        nlPluck        K scale [Z]
        """,
    ),
}
FORMS: Mapping[Dialect, Mapping[str, Form]] = {"v1": _V1, "v2": _V2}
DIALECT_NAMES: Mapping[Dialect, str] = {"v1": "MIMS (v1)", "v2": "mi-gen (v2)"}
MESHES = ("mesh", "closedMesh", "cornerMesh")
STRINGS = ("string", "chain", "stiffString")
