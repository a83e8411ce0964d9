"""A piece with all its springs, or only its contacts, stiffer by a factor."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from math import sqrt
from typing import Any

from ergon.instruments.model import Module
from ergon.instruments.module_kinds import links_with
from ergon.scores.reading.piece import Piece

_CONTACTS = links_with("contact", "law", "friction")


def stiffer(piece: Piece, factor: float, *, contacts_only: bool = False) -> Piece:
    """The piece with the stiffness of its instruments times `factor`; keys stay as they are.

    A frequency that sets a stiffness is multiplied by the square root of the factor.
    """
    instruments = {
        name: replace(
            instrument,
            modules=tuple(
                module
                if contacts_only and module.kind not in _CONTACTS
                else _stiffer(module, factor)
                for module in instrument.modules
            ),
        )
        for name, instrument in piece.instruments.items()
    }
    return replace(piece, instruments=instruments)


def has_contacts(piece: Piece) -> bool:
    """Whether `contacts_only` would change anything."""
    modules = (m for instrument in piece.instruments.values() for m in instrument.modules)
    return any(_stiffer(m, 2.0).fields != m.fields for m in modules if m.kind in _CONTACTS)


def _stiffer(module: Module, factor: float) -> Module:
    module_fields: Mapping[str, Any] = module.fields
    fields = dict(module_fields)
    for name in ("K", "sigma0", "hardening", "stretching"):
        if fields.get(name):
            fields[name] = fields[name] * factor
    frequency = fields.get("f")
    if module.kind != "LNL" and frequency is not None:
        frequency_factor = sqrt(factor)
        fields["f"] = (
            tuple(f * frequency_factor for f in frequency)
            if isinstance(frequency, tuple)
            else frequency * frequency_factor
        )
    if fields.get("law") is not None:
        fields["law"] = f"{factor!r}*({fields['law']})"
    if fields.get("points") is not None:
        fields["points"] = tuple((d, force * factor) for d, force in fields["points"])
    return replace(module, fields=fields)
