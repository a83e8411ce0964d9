"""The tables of keys, and of the hands that play them."""

from __future__ import annotations

from dataclasses import replace

from ergon.instruments.module_kinds import LINK_KINDS, tables
from ergon.instruments.read import MODULES_DOC, module_table
from ergon.notation.tables import value_kinds
from ergon.notation.tables.compound import ListOf, NamesOf
from ergon.notation.tables.fields import Field, Record
from ergon.notation.tables.shapes import Reference, choice

KEY_RECORD = Record(
    "key",
    "a force-feedback key (TGR), real or emulated: a mass with spring and viscosity, or a network",
    (
        Field("like", Reference("a key", ("keys",)), "begin with another key's values"),
        Field("calib", value_kinds.PATH, "a file of what the key is made of, as measured"),
        Field("simple", value_kinds.BOOLEAN, "take M, K and Z alone from that file", False),
        Field("M", value_kinds.MASS, "mass"),
        Field("K", value_kinds.STIFFNESS, "stiffness of its spring"),
        Field("Z", value_kinds.DAMPING, "viscosity", 0.0),
        Field("f", value_kinds.PITCH, "damped frequency, instead of K"),
        Field("t60", value_kinds.DURATION, "decay, instead of Z", shown="none"),
        Field("rest", value_kinds.POSITION, "position at which its spring has no force", 0.0),
        Field("X0", value_kinds.POSITION, "position at the beginning", 0.0),
        Field("V0", value_kinds.SPEED, "velocity at the beginning", 0.0),
        Field("travel", value_kinds.TRAVEL, "range of positions of the key", shown="anywhere"),
        Field(
            "delay",
            value_kinds.PAUSE,
            "how much later the piece's forces reach it, as by its motor",
            shown="as measured, or 0s",
        ),
        Field(
            "reach",
            value_kinds.POSITIVE,
            "factor from the movement of the key to that of the piece",
            1.0,
        ),
        Field("modules", NamesOf(module_table("si"), "module", has_loops=True), MODULES_DOC),
        Field("struck", Reference("a MAT of its modules"), "the MAT that ergons strike"),
        Field(
            "rate",
            value_kinds.RATE,
            "its own: audio divided by a whole number",
            shown="rates: gesture",
        ),
    ),
)
PLAYER_RECORD = Record(
    "player",
    "a hand on a key",
    (
        Field("hand", choice("virtual", "live"), "emulated, or a real hand", "virtual"),
        Field("key", Reference("a key", ("keys",)), "the key that it plays", required=True),
        Field("device", value_kinds.TITLE, "a live hand's axis, such as tgr0.3"),
        Field(
            "standin",
            Reference("a take or gesture", ("takes", "gestures")),
            "what plays in place of a real hand",
        ),
        Field("tick", value_kinds.TICK_RATE, "rate at which the device is read", shown="1000 Hz"),
    ),
    refusal_by_name={
        "follow": "following another player is not built yet",
        "sync": "synchronisation with a player is not built yet",
    },
)


def _without_between(table: Record) -> Record:
    return replace(table, fields=tuple(f for f in table.fields if f.name not in ("to", "between")))


COUPLING_RECORD = Record(
    "coupling",
    "a link through which two keys act on each other",
    (
        Field("couple", ListOf(Reference("a key", ("keys",)), 2, 2), "the two keys", required=True),
        Field("at", value_kinds.WHEN, "beginning of the link", shown="the beginning"),
        Field("until", value_kinds.WHEN, "end of the link", shown="the end"),
    ),
    kinds={name: _without_between(table) for name, table in tables("si", LINK_KINDS).items()},
    kind_required=True,
)
