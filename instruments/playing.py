"""How an instrument is played: its acts, each with what is struck and how softly and how hard."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from ergon.instruments.drawing import BOW_ACT_FIELDS, BOW_FIELDS, DrawnActs, StruckMass
from ergon.instruments.model import Act, Hold, Module
from ergon.notation.tables import quantities, value_kinds
from ergon.notation.tables.compound import ListOf, NamesOf
from ergon.notation.tables.fields import Field, Record, Values
from ergon.notation.tables.shapes import MISSING, Name, Reference
from ergon.notation.tables.strengths import ImpulseRange

_SUBSTITUTE_IMPULSES = 1e-3, 1e-2  # N·s
READY_SHAPE = ListOf(Reference("acts, such as strike"), 1, single=True)
LEVEL_DOC = "how loud a stroke at mf is at a gain of 0 dB, measured"
LOUDNESS_SHAPE = value_kinds.quantity(quantities.LOUDNESS)
_MODULES_SHAPE = ListOf(Reference("modules, such as beater", ("modules",)), 1, single=True)


RELEASE_RECORD = Record(
    "release",
    "what the end of a note does",
    (
        Field(
            "at",
            _MODULES_SHAPE,
            "what its impulse strikes; where the note begins, against it",
            None,
            True,
        ),
        Field(
            "impulse", value_kinds.quantity(quantities.IMPULSE), "impulse of an ergon", None, True
        ),
    ),
)


def play_table(module_record: Record) -> NamesOf:
    """The table of `play:`, in which modules are written as `module_record` says."""
    act_fields = (
        Field("at", _MODULES_SHAPE, "what is struck", shown="its only module"),
        Field("impulse", value_kinds.IMPULSES, "those of its softest and of its hardest stroke"),
        *BOW_ACT_FIELDS,
        Field(
            "with",
            NamesOf(module_record, "module", has_loops=True),
            "modules that are there once a line plays it",
        ),
        Field("release", RELEASE_RECORD, "what the end of a note does", shown="nothing"),
        Field(
            "lasts",
            value_kinds.CONTACT_TIME,
            "how long a stroke lasts; 0s: an instant",
            shown="0.19ms",
        ),
        Field(
            "turns", value_kinds.BOOLEAN, "each second stroke goes backwards, as a bow does", False
        ),
    )
    return NamesOf(Record("act", "a way in which an instrument is played", act_fields), "act")


def read_acts(
    module_values: Values, modules_of: Callable[[Mapping[str, Any]], tuple[Module, ...]]
) -> tuple[Act, ...]:
    """The acts of an instrument; the first is what a stroke without further words means.

    A module of the name of an act, or of one that an act brings, replaces it. Reports acts
    that have no range.
    """
    written_acts = []
    written: dict[str, Any] = module_values["play"] or {}
    drawn_acts = DrawnActs(written)
    for act_name, act_body in written.items():
        if act_body is MISSING or (act_body.written("impulse") and act_body["impulse"] is None):
            continue
        struck_masses = drawn_acts.struck_masses(act_body)
        struck_act = _struck_modules(act_body, struck_masses)
        if struck_act is None:
            continue
        struck_places, impulse_range = struck_act
        act_modules = drawn_acts.modules(act_body, modules_of)
        holds = tuple(
            Hold((Name(mass, act_body.place),), impulses)
            for mass, impulses in struck_masses
            if (mass,) != struck_places
        )
        written_acts.append(
            Act(
                act_name,
                struck_places,
                impulse_range,
                act_body.place,
                act_modules,
                holds=(*_release_holds(act_body), *holds),
                is_drawn=bool(struck_masses) and struck_masses[0].mass in struck_places,
                lasts=act_body["lasts"],
            )
        )
    return tuple(written_acts)


def _struck_modules(
    act_body: Values, pressing: list[StruckMass]
) -> tuple[tuple[Name, ...], ImpulseRange] | None:
    """What an act strikes, with its impulses; None if that is not known, which is reported."""
    if act_body["impulse"] is None:
        if act_body["at"]:
            act_body.error(
                "E103", f"{act_body.context.label('')} has no 'impulse': 3mNs..40mNs, say", "at"
            )
            return None
        if pressing:
            mass, impulse_range = pressing[0]
            return (Name(mass, act_body.place),), impulse_range
        if not any(act_body.written(word) for word in BOW_FIELDS):
            message = (
                f"{act_body.context.label('')} has no 'impulse': the softest and the hardest stroke"
            )
            act_body.error("E103", f"{message}, such as 3mNs..40mNs; a bow has `draw` and `press`")
        return None
    softest, loudest = act_body["impulse"]
    if not 0.0 < softest < loudest:
        message = f"{act_body.context.label('impulse')}: the softest and the hardest stroke are "
        act_body.error("E202", message + "expected, both above 0, such as 3mNs..40mNs", "impulse")
        softest, loudest = _SUBSTITUTE_IMPULSES  # strikes by this act are not refused once more
    return act_body["at"] or (), ImpulseRange(softest, loudest, act_body["turns"])


def _release_holds(body: Values) -> tuple[Hold, ...]:
    release_value = body["release"]
    if release_value is None or not all(
        name in release_value.by_name for name in ("at", "impulse")
    ):
        return ()
    impulse = release_value["impulse"]
    return (Hold(release_value["at"], ImpulseRange(impulse, impulse), is_lifted=True),)
