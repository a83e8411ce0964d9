"""The kinds of modules by name: all that is asked of a kind, and groups of kinds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from ergon.instruments import proxies, space
from ergon.instruments.kinds.bank import BANK
from ergon.instruments.kinds.bristle import BRISTLE
from ergon.instruments.kinds.but import BUT
from ergon.instruments.kinds.dry import DRY
from ergon.instruments.kinds.inputs import ENF, ENX
from ergon.instruments.kinds.kind import BETWEEN, ENDPOINT, Kind
from ergon.instruments.kinds.lnl import LAW_FIELDS, LNL
from ergon.instruments.kinds.magnet import MAGNET
from ergon.instruments.kinds.modes import MODES
from ergon.instruments.kinds.plate import PLATE
from ergon.instruments.kinds.points import CEL, MAS, SOL
from ergon.instruments.kinds.springs import FRO, REF, RES
from ergon.instruments.kinds.string import STRING
from ergon.instruments.model import Form
from ergon.instruments.space import fields as space_fields
from ergon.notation.tables.fields import Record

_SINGLE_AXIS_KINDS = (
    *(MAS, SOL, CEL),
    *(RES, FRO, REF, BUT, LNL, BRISTLE, DRY, MAGNET),
    *(STRING, PLATE, BANK, MODES),
)


def _kinds_by_name() -> dict[str, Kind]:
    proxy = proxies.proxy_record(ENDPOINT)
    kinds_by_name = {kind.name: kind for kind in _SINGLE_AXIS_KINDS}
    kinds_by_name["PROXY"] = Kind("PROXY", "mat", {"si": proxy, "ca": proxy}, check=proxies.check)
    for name, (family, table) in space_fields.tables(BETWEEN, ENDPOINT, LAW_FIELDS).items():
        known_kind = kinds_by_name.get(name, Kind(name, family, {}))
        kinds_by_name[name] = replace(known_kind, tables={**known_kind.tables, "space": table})
    return {**kinds_by_name, "ENX": ENX, "ENF": ENF}


KINDS = _kinds_by_name()
MAT_KINDS = tuple(name for name, kind in KINDS.items() if kind.family == "mat")
LINK_KINDS = tuple(name for name, kind in KINDS.items() if kind.family == "link")
GENERATOR_KINDS = tuple(name for name, kind in KINDS.items() if kind.family == "generator")
BODY_KINDS = ("STRING", "PLATE")  # generators whose masses lie beside each other
POINT_KINDS = (*MAT_KINDS, *GENERATOR_KINDS)  # kinds that have <M> points
FOLLOWER_KINDS = ("PROXY", "SURFACE")  # kinds whose points follow masses of other modules


# Fields that earlier versions did not have, with their defaults: a digest omits a field with its
# default, so that digests of older scores do not change.
HASH_OMITS_DEFAULTS: dict[str, Any] = {
    "inharmonicity": None,
    "stretching": 0.0,
    "sides": None,
    "bending": None,
    "gain": None,
    "hole": 0.3,
    "angles": "even",
    "friction": 0.0,
    "apart": None,
    "follows": (),
    "stretch": 0.0,
    "box": None,
    "cohesion": None,
    "reach": None,
}


def links_with(*roles: str) -> frozenset[str]:
    """The kinds of links of some roles: linear, contact, law, friction."""
    return frozenset(name for name in LINK_KINDS if KINDS[name].role in roles)


def tables(form: Form, names: tuple[str, ...] = tuple(KINDS)) -> dict[str, Record]:
    """Tables by kind, for the kinds that an instrument of a form may have."""
    return {name: KINDS[name].tables[form] for name in names if form in KINDS[name].tables}


def with_optional_fields(table: Record) -> Record:
    """The table with all fields optional: others may come from `like:` or `from:`."""
    fields = tuple(replace(field, required=False) for field in table.fields)
    return replace(table, fields=fields)


def member_count(kind: str, fields: Mapping[str, Any]) -> int:
    """The number of members of a module: MATs, or points in space."""
    return space.count(kind, fields) if "axes" in fields else KINDS[kind].count(fields)
