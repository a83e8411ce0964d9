"""Constants of laws, and masses, that follow a MAT: their values depend on its position."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from ergon.instruments.model import Module, Target
from ergon.notation.tables import value_kinds
from ergon.notation.tables.compound import NamesOf
from ergon.notation.tables.fields import Field, Record, Values
from ergon.notation.tables.shapes import MISSING, Name, Shape

CONSTANTS_MAX = 4  # constants of one law


@dataclass(frozen=True, slots=True)
class Following:
    """A value that changes from `start` to `stop` while a MAT moves from -offset [m] by `span` [m].

    `of` is the MAT: a Name as written, a Target after names are looked up.
    """

    of: Name | Target
    start: float
    stop: float
    offset: float
    span: float


def follows_field(value_shape: Shape, endpoint: Shape, doc: str) -> Field:
    """The field `follows`, with parameters by name; `value_shape` reads their values."""

    def build(following_values: Values) -> Any:
        if following_values["span"] == 0.0:
            message = (
                f"{following_values.context.label('span')}: 0 m would change nothing; write a "
                "length"
            )
            following_values.error("E105", message, "span")
            return MISSING
        names = ("of", "from", "to", "offset", "span")
        return Following(*(following_values[name] for name in names))

    following_fields = (
        Field("of", endpoint, "the MAT by whose position it goes", required=True),
        Field("from", value_shape, "its value where that is at 0 m, and below", required=True),
        Field("to", value_shape, "its value where that is at `span`, and beyond", required=True),
        Field("offset", value_kinds.POSITION, "added to the position", 0.0),
        Field("span", value_kinds.POSITION, "how far it is from one end to the other", 1.0),
    )
    record = Record(
        "following", "a value that depends on the position of a MAT", following_fields, build
    )
    return Field("follows", NamesOf(record, "parameter"), doc, ())


def followings(module: Module) -> Mapping[str, Following]:
    """The parameters of a module that follow a MAT, by name."""
    if module.kind not in ("LNL", "MAS"):
        return {}
    return module.fields.get("follows") or {}


def targets(module: Module) -> Iterator[Target]:
    """The MATs that parameters of a module follow."""
    return (
        following.of
        for following in followings(module).values()
        if isinstance(following.of, Target)
    )


def check_mass(mass_values: Values) -> None:
    """Report another parameter of a MAS than M, and a mass that is not above 0."""
    for name, following in written_followings(mass_values).items():
        if name != "M":
            message = f"{mass_values.context.label('follows')}: of a MAS only M follows a MAT"
            mass_values.error("E111", message, "follows")
        elif following is not MISSING and min(following.start, following.stop) <= 0.0:
            message = f"{mass_values.context.label('follows')}: a mass is above 0"
            mass_values.error("E105", message, "follows")


def written_followings(values: Values) -> Mapping[str, Any]:
    """What follows by its name, as it is written; in space nothing does."""
    return (values["follows"] or {}) if "follows" in values.record.by_name else {}


def check_constants(law_values: Values) -> None:
    """Report a constant of a law that has a value of its own too, and too many that follow."""
    written_names = written_followings(law_values)
    for written_name in written_names:
        if written_name in law_values.nodes:
            message = (
                f"{law_values.context.label(written_name)}: it follows a MAT too; keep one of the "
                "two"
            )
            law_values.error("E111", message, written_name)
    if len(written_names) > CONSTANTS_MAX:
        message = (
            f"{law_values.context.label('follows')}: at most {CONSTANTS_MAX} constants of a law "
            "follow MATs"
        )
        law_values.error("E105", message, "follows")


def engine_values(
    module: Module, mat: Callable[[Target], int]
) -> list[tuple[str, tuple[int, float, float, float, float]]]:
    """The following parameters by name: index of the MAT, offset, span, and the values at both ends
    of the span.
    """
    return [
        (name, (mat(value.of), value.offset, value.span, value.start, value.stop))
        for name, value in followings(module).items()
        if isinstance(value.of, Target)
    ]
