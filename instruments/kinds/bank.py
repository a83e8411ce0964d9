"""BANK: many CEL."""

from __future__ import annotations

from typing import TypedDict

from ergon import _core
from ergon.instruments.kinds import bodies
from ergon.instruments.kinds.kind import Quantities, module_kind, present_fields
from ergon.instruments.modal import BANK_DECAYS_SHAPE, BANK_GAINS_SHAPE, BANK_PITCHES_SHAPE, Each
from ergon.notation.tables import value_kinds
from ergon.notation.tables.fields import Field
from ergon.notation.tables.shapes import choice


def _fields(quantities: Quantities) -> tuple[Field, ...]:
    return (
        Field(
            "count",
            value_kinds.integer(1, bodies.MAX_MODULES, "10000"),
            "how many CEL",
            required=True,
        ),
        Field(
            "M",
            value_kinds.MASS_OR_NUMBER if quantities.is_ca else value_kinds.MASS,
            "mass of each",
            required=True,
        ),
        Field(
            "f", BANK_PITCHES_SHAPE, "frequencies, spread by logarithm, or of each", required=True
        ),
        Field(
            "t60", BANK_DECAYS_SHAPE, "decays: low for high f where even, or of each", required=True
        ),
        Field("gain", BANK_GAINS_SHAPE, "of a list: how much faster than the mass M each moves"),
        Field("modes", value_kinds.PATH, "a CSV file of f, t60 and gain, instead of lists"),
        Field("spread", choice("random", "even"), "how f and t60 are spread", "even"),
        Field(
            "place",
            choice("line", "spiral", "galaxy"),
            "positions of the members on the bench",
            "line",
        ),
        Field(
            "hole",
            value_kinds.HOLE,
            "radius of the highest pitch of a galaxy over that of the lowest",
            0.3,
        ),
        Field("angles", choice("random", "even"), "how a galaxy lies around its middle", "even"),
        *bodies.START_FIELDS,
    )


class BankFields(TypedDict):
    """Its fields as it is built."""

    count: int
    M: float
    f: Each | tuple[float, float]
    t60: Each | tuple[float, float]
    gain: tuple[float, ...] | None
    place: str
    hole: float
    angles: str
    spread: str


def _add(network: _core.Network, bank_name: str, bank_fields: BankFields, seed: int) -> int:
    if isinstance(bank_fields["f"], Each):
        masses = (bank_fields["M"] / gain for gain in bank_fields["gain"] or ())
        cells = list(zip(bank_fields["f"], bank_fields["t60"], masses, strict=True))
        placing = present_fields(bank_fields, "place", "hole", "angles")
        return network.cells(bank_name, cells=cells, **placing, seed=seed)
    options = ("count", "M", "f", "t60", "spread", "place", "hole", "angles")
    return network.bank(bank_name, **present_fields(bank_fields, *options), seed=seed)


def _count(fields: BankFields) -> int:
    return fields["count"]


BANK = module_kind(
    "BANK",
    "generator",
    "many CEL",
    _fields,
    glidable_parameters=("f", "t60"),
    source_fields=("modes",),
    add=_add,
    count=_count,
)
