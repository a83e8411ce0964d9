"""How an instrument is played: its acts, each with what is struck and how softly and how hard."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from ergon.instruments.drawing import FIELDS, WORDS, DrawnActs, Pressing
from ergon.instruments.model import Act, Hold, Module
from ergon.notation.tables import quantities as q
from ergon.notation.tables import value_kinds as k
from ergon.notation.tables.compound import ListOf, NamesOf
from ergon.notation.tables.fields import Field, Record, Values
from ergon.notation.tables.shapes import MISSING, Name, Reference
from ergon.notation.tables.strengths import ImpulseRange

_ANY_REACH = 1e-3, 1e-2  # N·s
READY = ListOf(Reference("acts, such as strike"), 1, single=True)
LEVEL_DOC = "how loud a stroke at mf is at a gain of 0 dB, measured"
LOUDNESS = k.quantity(q.LOUDNESS)
_MODULES = ListOf(Reference("modules, such as beater", ("modules",)), 1, single=True)


RELEASE = Record(
    "release",
    "what the end of a note does",
    (
        Field(
            "at",
            _MODULES,
            "what its impulse strikes; where the note begins, against it",
            None,
            True,
        ),
        Field("impulse", k.quantity(q.IMPULSE), "impulse of an ergon", None, True),
    ),
)


def play_table(module: Record) -> NamesOf:
    """The table of `play:`, in which modules are written as `module` says."""
    fields = (
        Field("at", _MODULES, "what is struck", shown="its only module"),
        Field("impulse", k.IMPULSES, "those of its softest and of its hardest stroke"),
        *FIELDS,
        Field(
            "with",
            NamesOf(module, "module", has_loops=True),
            "modules that are there once a line plays it",
        ),
        Field("release", RELEASE, "what the end of a note does", shown="nothing"),
        Field("lasts", k.CONTACT_TIME, "how long a stroke lasts; 0s: an instant", shown="0.19ms"),
        Field("turns", k.BOOLEAN, "each second stroke goes backwards, as a bow does", False),
    )
    return NamesOf(Record("act", "a way in which an instrument is played", fields), "act")


def acts(
    values: Values, modules_of: Callable[[Mapping[str, Any]], tuple[Module, ...]]
) -> tuple[Act, ...]:
    """The acts of an instrument; the first is what a stroke without further words means.

    A module of the name of an act, or of one that an act brings, replaces it. Reports acts
    that have no range.
    """
    result = []
    written: dict[str, Any] = values["play"] or {}
    drawn = DrawnActs(written)
    for name, body in written.items():
        if body is MISSING or (body.written("impulse") and body["impulse"] is None):
            continue
        pressing = drawn.pressing(body)
        struck = _struck(body, pressing)
        if struck is None:
            continue
        places, reach = struck
        brought = drawn.modules(body, modules_of)
        holds = tuple(
            Hold((Name(mass, body.place),), each) for mass, each in pressing if (mass,) != places
        )
        result.append(
            Act(
                name,
                places,
                reach,
                body.place,
                brought,
                holds=(*_release(body), *holds),
                is_drawn=bool(pressing) and pressing[0].mass in places,
                lasts=body["lasts"],
            )
        )
    return tuple(result)


def _struck(body: Values, pressing: list[Pressing]) -> tuple[tuple[Name, ...], ImpulseRange] | None:
    """What an act strikes, with its impulses; None if that is not known, which is reported."""
    if body["impulse"] is None:
        if body["at"]:
            body.error("E103", f"{body.context.label('')} has no 'impulse': 3mNs..40mNs, say", "at")
            return None
        if pressing:
            mass, reach = pressing[0]
            return (Name(mass, body.place),), reach
        if not any(body.written(word) for word in WORDS):
            message = (
                f"{body.context.label('')} has no 'impulse': the softest and the hardest stroke"
            )
            body.error("E103", f"{message}, such as 3mNs..40mNs; a bow has `draw` and `press`")
        return None
    soft, hard = body["impulse"]
    if not 0.0 < soft < hard:
        message = f"{body.context.label('impulse')}: the softest and the hardest stroke are "
        body.error("E202", message + "expected, both above 0, such as 3mNs..40mNs", "impulse")
        soft, hard = _ANY_REACH  # strikes by this act are not refused once more
    return body["at"] or (), ImpulseRange(soft, hard, body["turns"])


def _release(body: Values) -> tuple[Hold, ...]:
    written = body["release"]
    if written is None or not all(name in written.by_name for name in ("at", "impulse")):
        return ()
    impulse = written["impulse"]
    return (Hold(written["at"], ImpulseRange(impulse, impulse), is_lifted=True),)
