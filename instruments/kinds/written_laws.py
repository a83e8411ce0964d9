"""Kinds of links whose law is known: an LNL with its law written, and constants with units."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from ergon.instruments import following
from ergon.instruments.kinds.kind import (
    BETWEEN,
    ENDPOINT,
    Kind,
    Quantities,
    module_kind,
    require_one_of,
)
from ergon.notation.tables.fields import Field, Values
from ergon.notation.tables.shapes import Shape


def law_kind(
    kind_name: str,
    doc: str,
    constants: Mapping[str, tuple[Callable[[Quantities], Shape], str]],
    *,
    law: str | None = None,
    damping: str | None = None,
) -> Kind:
    """A kind whose force is `law` of the elongation d [m], plus `damping` of d and its rate v
    [m/s], which is joined on one axis and in space.

    `constants` have the shape and the meaning of each constant. Each is written, or follows a MAT.
    """

    def in_space(quantities: Quantities) -> tuple[Field, ...]:
        return (
            BETWEEN,
            *(Field(name, shape(quantities), text) for name, (shape, text) in constants.items()),
        )

    def fields(quantities: Quantities) -> tuple[Field, ...]:
        text = "constants that depend on the position of a MAT"
        return (
            *in_space(quantities),
            following.follows_field(quantities.law_constant, ENDPOINT, text),
        )

    def check(law_values: Values) -> None:
        following.check_constants(law_values)
        follows = following.written_followings(law_values)
        for constant in constants:
            if constant not in follows:
                require_one_of(law_values, kind_name, constant)

    def complete(law_values: Values, built_fields: dict[str, object]) -> None:
        written_constants = {constant: built_fields.pop(constant) for constant in constants}
        # A constant that is missing was reported; the law needs one nevertheless.
        follows = following.written_followings(law_values)
        built_fields["constants"] = {
            constant: 1.0 if value is None else value
            for constant, value in written_constants.items()
            if constant not in follows
        }
        built_fields |= {"law": law, "damping": damping, "points": None, "rest": 0.0}
        if "interval" in law_values.by_name:
            built_fields["interval"] = law_values.by_name["interval"]

    return module_kind(
        kind_name,
        "link",
        doc,
        fields,
        space=in_space,
        role="law",
        check=check,
        complete=complete,
        built_kind="LNL",
    )
