"""How an instrument is played: its acts, each with what is struck and how softly and how hard."""

from __future__ import annotations

from typing import Any

from ergon.instruments.model import Act
from ergon.notation.tables import quantities as q
from ergon.notation.tables import value_kinds as k
from ergon.notation.tables.fields import Field, Record, Values
from ergon.notation.tables.shapes import MISSING, ListOf, NamesOf, Reference

ACT = Record(
    "act",
    "a way in which an instrument is played",
    (
        Field(
            "at",
            ListOf(Reference("modules, such as beater", ("modules",)), 1, single=True),
            "what is struck",
            shown="its only module",
        ),
        Field(
            "impulse",
            k.IMPULSES,
            "the impulses of its softest and of its hardest stroke",
            required=True,
        ),
    ),
)
PLAY = NamesOf(ACT, "act")
_ANY_REACH = 1e-3, 1e-2  # N·s
LEVEL_DOC = "how loud a stroke at mf is at a gain of 0 dB, measured"
LOUDNESS = k.quantity(q.LOUDNESS)


def acts(values: Values) -> tuple[Act, ...]:
    """The acts of an instrument; the first is what a stroke without further words means.

    Reports acts that have no range and those that have the name of a module.
    """
    modules = values["modules"] or {}
    found = []
    written: dict[str, Any] = (values["play"] or {}) if "play" in values.record.by_name else {}
    for name, body in written.items():
        if body is MISSING or body["impulse"] is None:
            continue
        soft, hard = body["impulse"]
        if name in modules:
            message = f"{body.context.of('')}: a module has this name; give the act another"
            body.context.error("E303", message, body.place)
            continue
        if not 0.0 < soft < hard:
            message = f"{body.context.of('impulse')}: the softest and the hardest stroke are "
            body.error("E202", message + "expected, both above 0, such as 3mNs..40mNs", "impulse")
            soft, hard = _ANY_REACH  # strikes by this act are not refused once more
        found.append(Act(name, body["at"] or (), (soft, hard), body.place))
    return tuple(found)
