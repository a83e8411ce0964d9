"""MODES: a body of which modes and their levels are known."""

from __future__ import annotations

from typing import TypedDict

from ergon import _core
from ergon.instruments.kinds.kind import Quantities, module_kind
from ergon.instruments.modal import (
    BAND_RECORD,
    MODES_DECAYS_SHAPE,
    MODES_PITCHES_SHAPE,
    PLACES_SHAPE,
)
from ergon.notation.tables import value_kinds
from ergon.notation.tables.fields import Field


def _fields(quantities: Quantities) -> tuple[Field, ...]:
    return (
        Field(
            "M",
            value_kinds.MASS_OR_NUMBER if quantities.is_ca else value_kinds.MASS,
            "mass of a mode where its level is 1",
            required=True,
        ),
        Field("f", MODES_PITCHES_SHAPE, "frequency of each mode", required=True),
        Field("t60", MODES_DECAYS_SHAPE, "decay of each mode, or of all", required=True),
        Field(
            "places", PLACES_SHAPE, "points of it: how far each mode moves there", shown="point: 1"
        ),
        Field("band", BAND_RECORD, "more modes, which are drawn between two frequencies"),
        Field("modes", value_kinds.PATH, "a CSV file of f, t60 and levels, instead of lists"),
    )


class ModesFields(TypedDict):
    """Its fields as it is built."""

    M: float
    f: tuple[float, ...]
    t60: tuple[float, ...]
    places: tuple[tuple[str, tuple[float, ...]], ...]


def _add(network: _core.Network, name: str, fields: ModesFields, seed: int) -> int:
    modes = list(zip(fields["f"], fields["t60"], strict=True))
    levels = list(zip(*(levels for _, levels in fields["places"]), strict=True))
    return network.modal(name, M=fields["M"], modes=modes, levels=levels)


def _count(fields: ModesFields) -> int:
    return len(fields["places"])


MODES = module_kind(
    "MODES",
    "generator",
    "a body of which modes and their levels are known",
    _fields,
    source_fields=("modes", "band"),
    add=_add,
    count=_count,
)
