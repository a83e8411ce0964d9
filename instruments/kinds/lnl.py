"""LNL: a link whose force is a law of elongation and rate."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TypedDict

from ergon import _core
from ergon.instruments import following
from ergon.instruments.kinds.kind import BETWEEN, ENDPOINT, Quantities, module_kind
from ergon.notation.tables import value_kinds
from ergon.notation.tables.compound import ListOf, Pair
from ergon.notation.tables.fields import Field, Values
from ergon.notation.tables.shapes import Text
from ergon.notation.text.errors import TextError

MAX_LAW = 2_000  # characters of a law
MAX_POINTS = 10_000  # points of a law


def _law_text(law_text: str) -> str:
    if not law_text.strip() or len(law_text) > MAX_LAW:
        message = f"a law has from 1 to {MAX_LAW} characters, such as k*d + q*d**3"
        raise TextError(message, length=max(1, min(len(law_text), 80)), code="E207")
    return law_text


LAW_SHAPE = Text(_law_text, "a law, such as k*d + q*d**3, or the name of one", types=("string",))
LAW_FIELDS = (
    Field("law", LAW_SHAPE, "force over elongation d [m]"),
    Field("damping", LAW_SHAPE, "force over elongation d and its rate v [m/s]"),
    Field(
        "points",
        ListOf(Pair(value_kinds.POSITION, value_kinds.PUSH), 2, MAX_POINTS),
        "elongations and forces, joined by straight lines",
    ),
)


def _fields(quantities: Quantities) -> tuple[Field, ...]:
    doc = "constants of the law that depend on the position of a MAT"
    return (
        BETWEEN,
        *LAW_FIELDS,
        Field("rest", value_kinds.POSITION, "elongation that counts as d = 0", 0.0),
        following.follows_field(quantities.law_constant, ENDPOINT, doc),
    )


def _check(module_values: Values) -> None:
    if module_values.written("law") and module_values.written("points"):
        message = (
            f"{module_values.context.label('points')}: `law` is written too; keep one of the two"
        )
        module_values.error("E111", message, "points")
    following.check_constants(module_values)


def _complete(values: Values, fields: dict[str, object]) -> None:
    fields["constants"] = dict(values.free)
    if "interval" in values.by_name:
        fields["interval"] = values.by_name["interval"]


class LawFields(TypedDict):
    """The law of a module as it is built."""

    law: str | None
    damping: str | None
    constants: Mapping[str, float]
    points: Sequence[tuple[float, float]] | None
    rest: float


def compiled_law(fields: LawFields, reach: float = 1.0) -> _core.Law:
    """The compiled law of a module, behind a lever if `reach` is not 1."""
    return _core.Law(fields["law"], fields["damping"], fields["constants"], fields["points"], reach)


def _add(network: _core.Network, name: str, a: int, b: int, fields: LawFields, reach: float) -> int:
    return network.lnl(name, a, b, compiled_law(fields, reach), rest=fields["rest"])


LNL = module_kind(
    "LNL",
    "link",
    "a non-linear link",
    _fields,
    # Free names in an LNL are its law's constants.
    free=lambda quantities: quantities.law_constant,
    role="law",
    check=_check,
    complete=_complete,
    add=_add,
)
