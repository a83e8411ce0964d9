"""The description of a kind of module, from which its tables, its checks and its construction
follow.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple

from ergon.instruments.model import Form
from ergon.notation.tables import value_kinds
from ergon.notation.tables.compound import ListOf
from ergon.notation.tables.fields import Field, Record, Values
from ergon.notation.tables.shapes import Reference, Shape
from ergon.notation.text.errors import with_article

Family = Literal["mat", "link", "generator", "input"]
# The role of a link in analyses of a network, by its force: linear, contact, law or friction.
Role = Literal["linear", "contact", "law", "friction"]
Fields = Mapping[str, Any]

ENDPOINT = Reference(
    "a module, such as m, bell.m, gong.centre or a key", ("modules", "instruments", "keys")
)
BETWEEN = Field(
    "between",
    ListOf(ENDPOINT, 2, 2),
    "the two MATs that it joins: [a, b]; of a range, as in [a, string.3..8], each",
    required=True,
)


class Quantities(NamedTuple):
    """How the values of an instrument are written: with units, or as numbers of a discrete
    network.
    """

    mass: Shape
    stiffness: Shape
    damping: Shape
    bristle_stiffness: Shape  # a stiffness that is above 0
    force: Shape  # above 0
    speed: Shape
    law_constant: Shape
    is_ca: bool


SI = Quantities(
    *(
        value_kinds.MASS,
        value_kinds.STIFFNESS,
        value_kinds.DAMPING,
        value_kinds.STIFFNESS,
        value_kinds.FORCE,
        value_kinds.SPEED,
        value_kinds.CONSTANT,
    ),
    is_ca=False,
)
CA = Quantities(
    *(
        value_kinds.POSITIVE,
        value_kinds.NUMBER,
        value_kinds.NUMBER,
        value_kinds.POSITIVE,
        value_kinds.POSITIVE,
        value_kinds.POSITIVE,
        value_kinds.NUMBER,
    ),
    is_ca=True,
)


def accept_all(values: Values) -> None:
    """Accept any fields: none of them contradict each other."""


def keep_written(values: Values, fields: object) -> None:
    """Leave the fields as they are written."""


def single_mat(fields: Fields) -> int:
    """A module is one MAT."""
    return 1


def only_in_space(*_: Any) -> int:
    """Kinds without an `add` are built by `ergon.instruments.space`, or follow other masses."""
    raise TypeError("this kind is not built on one axis")


@dataclass(frozen=True, slots=True)
class Kind:
    """A kind of module: its family, and its table for each form of instrument that may have it.

    `glidable_parameters` may change while a piece plays; a generator changes as a whole.
    `source_fields`: fields from which others are made. `scaled_fields`: for a link, the fields that
    the engine's factors of K and of Z multiply.
    `lever_powers`: the power of a lever's ratio that multiplies a field that no other kind has.
    `check` reports fields that contradict each other. `complete` turns fields into those that
    are built. `add` builds: (network, name, fields, seed) of a MAT or a generator, (network,
    name, a, b, fields, reach) of a link; both return an index. `count` is the number of MATs.
    A module is built as one of `built_kind`, if that is not empty.
    """

    name: str
    family: Family
    tables: Mapping[Form, Record]
    glidable_parameters: tuple[str, ...] = ()
    source_fields: tuple[str, ...] = ()
    scaled_fields: tuple[str, str] = ("K", "Z")
    role: Role = "linear"
    lever_powers: Mapping[str, int] = field(default_factory=dict)
    check: Callable[[Values], None] = accept_all
    complete: Callable[..., None] = keep_written
    add: Callable[..., int] = only_in_space
    count: Callable[..., int] = single_mat
    built_kind: str = ""

    @property
    def table(self) -> Record:
        """The table in SI units, or that of a kind that exists only in space."""
        return self.tables.get("si") or self.tables["space"]


def module_kind(
    name: str,
    family: Family,
    doc: str,
    fields_of: Callable[[Quantities], tuple[Field, ...]],
    *,
    free: Callable[[Quantities], Shape] | None = None,
    synonyms: Mapping[str, str] | None = None,
    space: Callable[[Quantities], tuple[Field, ...]] | None = None,
    **more: Any,
) -> Kind:
    """A kind whose fields are those of `fields_of`, with units or without, and of `space` in space;
    `free` reads fields of other names, and `synonyms` has names that others use.
    """

    def table(columns: tuple[Field, ...], quantities: Quantities) -> Record:
        free_shape = free(quantities) if free else None
        return Record("module", doc, columns, free=free_shape, synonyms=synonyms or {})

    tables: dict[Form, Record] = {"si": table(fields_of(SI), SI), "ca": table(fields_of(CA), CA)}
    if space:
        tables["space"] = table(space(SI), SI)
    return Kind(name, family, tables, **more)


def present_fields(fields: Fields, *names: str) -> dict[str, Any]:
    """The fields with these names, without those that are None."""
    return {name: fields[name] for name in names if fields.get(name) is not None}


def require_one_of(module_values: Values, kind_name: str, *alternatives: str) -> None:
    """Report a module that has none of some fields."""
    if not module_values.written(*alternatives):
        message = (
            f"{module_values.context.label('')}: {with_article(kind_name)} needs "
            f"{' or '.join(alternatives)}"
        )
        module_values.error("E103", message)
