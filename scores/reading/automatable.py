"""Which parameters of which modules may change while a piece plays, and why others may not.

`scores/staging/automating.py` changes them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import chain
from typing import Any, NamedTuple

from ergon.instruments.model import Instrument, Module
from ergon.instruments.module_kinds import KINDS, LINKS
from ergon.instruments.transpose import is_interval, is_slow, parse_interval
from ergon.notation.tables import quantities as q
from ergon.notation.tables import value_kinds as k
from ergon.notation.tables.shapes import Text
from ergon.notation.text.errors import TextError, quote, with_article
from ergon.scores.pattern.values import Amount, ReadAmount

# By the kind of a module; a generator changes as a whole.
PARAMETERS: Mapping[str, tuple[str, ...]] = {
    **{name: kind.gliding for name, kind in KINDS.items() if kind.gliding},
    "INSTRUMENT": ("f",),
}
ALL = tuple(dict.fromkeys(chain.from_iterable(PARAMETERS.values())))
# Fields that a factor of the pitch does not scale: an instrument that has one cannot glide as a
# whole.
_STIFFENING = ("hardening", "stretching")


class Automatable(NamedTuple):
    """A part, one of its modules, and whether its values are algorithmic."""

    part: str
    module: Module
    is_ca: bool


def named_module(
    name: str, keys: Mapping[str, Any], instruments: Mapping[str, Any]
) -> Automatable | None:
    """The module of a name such as `bell.s`; None if there is no such module."""
    words = name.split(".")
    for count in range(len(words), 0, -1):  # names that a file brings in have dots themselves
        part = ".".join(words[:count])
        owner = keys.get(part) or instruments.get(part)
        if owner is None:
            continue
        module_name = ".".join(words[count:])
        is_ca = isinstance(owner, Instrument) and owner.ca_rate is not None
        for module in owner.modules:
            if module.name == module_name:
                return Automatable(part, module, is_ca)
        if not module_name and (all_of_it := pitched_module(owner)) is not None:
            return Automatable(part, all_of_it, is_ca)
    return None


def named_modules(
    name: str,
    keys: Mapping[str, Any],
    instruments: Mapping[str, Any],
    families: Mapping[str, Sequence[str]],
) -> list[Automatable]:
    """The module of a name, or that of each note that is played of an instrument with notes.

    `families` are the instruments with notes, each with the names of its notes.
    """
    if (automatable := named_module(name, keys, instruments)) is not None:
        return [automatable]
    words = name.split(".")
    for count in range(len(words), 0, -1):
        notes = families.get(".".join(words[:count]), ())
        names = (".".join((note, *words[count:])) for note in notes)
        if played := [k for n in names if (k := named_module(n, {}, instruments)) is not None]:
            return played
    return []


def pitched_module(owner: Any) -> Module | None:
    """An instrument of several modules as one module with its named pitch; None if it has no named
    pitch.
    """
    if not isinstance(owner, Instrument) or owner.pitch is None:
        return None
    return Module("", "INSTRUMENT", {"f": owner.pitch, "modules": owner.modules}, owner.place)


def moved(owner: Instrument) -> list[Module]:
    """The modules whose pitch moves with that of the instrument: those that `transpose` moves."""
    able = PARAMETERS.keys() - {"INSTRUMENT"}
    return [
        module
        for module in owner.modules
        if module.kind in able and not is_slow(module.kind, module.fields)
    ]


def _stays(module: Module) -> str | None:
    """Why an instrument with this module cannot glide as a whole; None if it can."""
    if module.kind == "LNL" and (module.fields["law"] or module.fields["points"]):
        return f"the law of its {module.shown_kind} {module.name} does not change while it plays"
    if module.kind == "MODES":
        return f"its MODES {module.name} do not change while they play"
    if module.fields.get("contact") == "magic":
        return f"the magic contact {module.name} chooses its own K and Z"
    for name in _STIFFENING:
        if module.fields.get(name):
            return f"`{name}` of its {module.kind} {module.name} does not change while it plays"
    return None


def refusal(module: Module, parameter: str, *, is_ca: bool) -> str | None:
    """Why a parameter of a module cannot change while it plays; None if it can."""
    parameters = PARAMETERS.get(module.kind, ())
    if module.kind == "INSTRUMENT" and not is_ca and parameter == "f":
        reason = next(filter(None, map(_stays, module.fields["modules"])), None)
        return reason and f"cannot glide as a whole: {reason}; glide its modules"
    if is_ca:
        return "has algorithmic values, which stay as they are; only values in SI units change"
    if not parameters:
        able = ", ".join(kind for kind in PARAMETERS if kind != "INSTRUMENT")
        return (
            f"is {with_article(module.shown_kind)}, which does not change while it plays; {able} do"
        )
    if module.kind == "INSTRUMENT" and parameter not in parameters:
        return f"has several modules: of the whole only f changes; name a module for {parameter}"
    if parameter not in parameters:
        word = " and ".join(parameters)
        return f"is a {module.kind}, of which only {word} change while it plays"
    if module.kind == "BUT" and module.fields.get("contact") == "magic":
        return "is a magic contact, which chooses its own K and Z"
    if module.kind in ("STRING", "PLATE") and parameter == "t60":
        t60 = module.fields.get("t60")
        if t60 is None:
            return "has no t60 of its own, so it has no dampers; write one"
        if not isinstance(t60, float):
            several = "has a t60 for each of several frequencies, which stay as they are"
            return f"{several}; a single t60 may change"
    if module.kind in LINKS and not module.fields.get(parameter):
        return f"has no {parameter} of its own that could change; write one above 0"
    return None


def reader(module: Module, parameter: str, *, is_one_of_many: bool = False) -> ReadAmount:
    """The function that reads an amount of a parameter; `is_one_of_many` if all notes of an
    instrument have that module.
    """
    if is_one_of_many and parameter == "f":
        return amount_reader(_only_interval, parameter)
    if module.kind == "BANK":
        return amount_reader(_only_factor, parameter)
    if parameter in ("f", "t60"):
        return amount_reader((k.PITCH if parameter == "f" else k.DURATION).parse, parameter)
    shape = KINDS[module.kind].table.by_name[parameter].shape
    assert isinstance(shape, Text)
    return amount_reader(shape.parse, parameter)


def amount_reader(read: Callable[[str], float], parameter: str) -> ReadAmount:
    """The function that reads an amount: a value, which `read` reads, or a factor (`x1.5`) of the
    parameter's own value; of a pitch also an interval (`2st`, `-50cents`).
    """

    def amount(word: str) -> Amount:
        if word.startswith("x"):
            return Amount(q.factor(word), is_factor=True)
        if parameter == "f" and is_interval(word):
            return Amount(parse_interval(word).ratio, is_factor=True)
        return Amount(read(word))

    return amount


def _only_factor(text: str) -> float:
    message = f"{quote(text)}: the members of a BANK have values of their own; write a factor, x1.5"
    raise TextError(message, length=max(1, len(text)), code="E201")


def _only_interval(text: str) -> float:
    """Refuse a pitch where every note has a pitch of its own. Raises TextError."""
    message = f"{quote(text)}: the notes have pitches of their own; write an interval, 2st, or x1.5"
    raise TextError(message, length=max(1, len(text)), code="E201")


FACTOR = Text(_only_factor, "a factor, such as x1.5")
INTERVAL_OR_FACTOR = Text(_only_interval, "an interval, such as 2st, or a factor, such as x1.5")
