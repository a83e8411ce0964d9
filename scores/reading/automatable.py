"""Which parameters of which modules may change while a piece plays, and why others may not.

`scores/staging/automating.py` changes them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import chain
from typing import Any, NamedTuple

from ergon.instruments.model import Instrument, Module
from ergon.instruments.module_kinds import KINDS, LINK_KINDS
from ergon.instruments.transpose import is_interval, keeps_pitch, parse_interval
from ergon.notation.tables import quantities, value_kinds
from ergon.notation.tables.shapes import Text
from ergon.notation.text.errors import TextError, quote, with_article
from ergon.scores.pattern.values import Amount, ReadAmount

# By the kind of a module; a generator changes as a whole.
GLIDE_PARAMETERS: Mapping[str, tuple[str, ...]] = {
    **{name: kind.glidable_parameters for name, kind in KINDS.items() if kind.glidable_parameters},
    "INSTRUMENT": ("f",),
}
ALL_PARAMETERS = tuple(dict.fromkeys(chain.from_iterable(GLIDE_PARAMETERS.values())))
# Fields that a factor of the pitch does not scale: an instrument that has one cannot glide as a
# whole.
_STIFFENING_FIELDS = ("hardening", "stretching")


class Automatable(NamedTuple):
    """A part, one of its modules, and whether its values are algorithmic."""

    part: str
    module: Module
    is_ca: bool


def named_module(
    module_path: str, keys: Mapping[str, Any], instruments: Mapping[str, Any]
) -> Automatable | None:
    """The module of a name such as `bell.s`; None if there is no such module."""
    name_words = module_path.split(".")
    for word_count in range(
        len(name_words), 0, -1
    ):  # names that a file brings in have dots themselves
        part_name = ".".join(name_words[:word_count])
        part_owner = keys.get(part_name) or instruments.get(part_name)
        if part_owner is None:
            continue
        module_name = ".".join(name_words[word_count:])
        is_ca = isinstance(part_owner, Instrument) and part_owner.ca_rate is not None
        for module in part_owner.modules:
            if module.name == module_name:
                return Automatable(part_name, module, is_ca)
        if not module_name and (pitched := pitched_module(part_owner)) is not None:
            return Automatable(part_name, pitched, is_ca)
    return None


def named_modules(
    module_path: str,
    keys: Mapping[str, Any],
    instruments: Mapping[str, Any],
    families: Mapping[str, Sequence[str]],
) -> list[Automatable]:
    """The module of a name, or that of each note that is played of an instrument with notes.

    `families` are the instruments with notes, each with the names of its notes.
    """
    if (single_module := named_module(module_path, keys, instruments)) is not None:
        return [single_module]
    path_words = module_path.split(".")
    for count in range(len(path_words), 0, -1):
        notes = families.get(".".join(path_words[:count]), ())
        names = (".".join((note, *path_words[count:])) for note in notes)
        if played_modules := [
            automatable_module
            for note_name in names
            if (automatable_module := named_module(note_name, {}, instruments)) is not None
        ]:
            return played_modules
    return []


def pitched_module(instrument: Any) -> Module | None:
    """An instrument of several modules as one module with its named pitch; None if it has no named
    pitch.
    """
    if not isinstance(instrument, Instrument) or instrument.pitch is None:
        return None
    return Module(
        "", "INSTRUMENT", {"f": instrument.pitch, "modules": instrument.modules}, instrument.place
    )


def transposed_modules(instrument: Instrument) -> list[Module]:
    """The modules whose pitch moves with that of the instrument: those that `transpose` moves."""
    glided_kinds = GLIDE_PARAMETERS.keys() - {"INSTRUMENT"}
    return [
        module
        for module in instrument.modules
        if module.kind in glided_kinds and not keeps_pitch(module.kind, module.fields)
    ]


def _glide_obstacle(part_module: Module) -> str | None:
    """Why an instrument with this module cannot glide as a whole; None if it can."""
    if part_module.kind == "LNL" and (part_module.fields["law"] or part_module.fields["points"]):
        return (
            f"the law of its {part_module.shown_kind} {part_module.name} does not change while it "
            "plays"
        )
    if part_module.kind == "MODES":
        return f"its MODES {part_module.name} do not change while they play"
    if part_module.fields.get("contact") == "magic":
        return f"the magic contact {part_module.name} chooses its own K and Z"
    for field_name in _STIFFENING_FIELDS:
        if part_module.fields.get(field_name):
            return (
                f"`{field_name}` of its {part_module.kind} {part_module.name} does not change "
                "while it plays"
            )
    return None


def refusal(part_module: Module, parameter_name: str, *, is_ca: bool) -> str | None:
    """Why a parameter of a module cannot change while it plays; None if it can."""
    known_parameters = GLIDE_PARAMETERS.get(part_module.kind, ())
    if part_module.kind == "INSTRUMENT" and not is_ca and parameter_name == "f":
        reason = next(filter(None, map(_glide_obstacle, part_module.fields["modules"])), None)
        return reason and f"cannot glide as a whole: {reason}; glide its modules"
    if is_ca:
        return "has algorithmic values, which stay as they are; only values in SI units change"
    if not known_parameters:
        glided_kinds = ", ".join(kind for kind in GLIDE_PARAMETERS if kind != "INSTRUMENT")
        return (
            f"is {with_article(part_module.shown_kind)}, which does not change while it plays; "
            f"{glided_kinds} do"
        )
    if part_module.kind == "INSTRUMENT" and parameter_name not in known_parameters:
        return (
            f"has several modules: of the whole only f changes; name a module for {parameter_name}"
        )
    if parameter_name not in known_parameters:
        parameters_text = " and ".join(known_parameters)
        return f"is a {part_module.kind}, of which only {parameters_text} change while it plays"
    if part_module.kind == "BUT" and part_module.fields.get("contact") == "magic":
        return "is a magic contact, which chooses its own K and Z"
    if part_module.kind in ("STRING", "PLATE") and parameter_name == "t60":
        t60 = part_module.fields.get("t60")
        if t60 is None:
            return "has no t60 of its own, so it has no dampers; write one"
        if not isinstance(t60, float):
            t60_reason = "has a t60 for each of several frequencies, which stay as they are"
            return f"{t60_reason}; a single t60 may change"
    if part_module.kind in LINK_KINDS and not part_module.fields.get(parameter_name):
        return f"has no {parameter_name} of its own that could change; write one above 0"
    return None


def reader(part_module: Module, parameter_name: str, *, is_one_of_many: bool = False) -> ReadAmount:
    """The function that reads an amount of a parameter; `is_one_of_many` if all notes of an
    instrument have that module.
    """
    if is_one_of_many and parameter_name == "f":
        return amount_reader(_parse_interval_or_factor, parameter_name)
    if part_module.kind == "BANK":
        return amount_reader(_parse_factor, parameter_name)
    if parameter_name in ("f", "t60"):
        return amount_reader(
            (value_kinds.PITCH if parameter_name == "f" else value_kinds.DURATION).parse,
            parameter_name,
        )
    shape = KINDS[part_module.kind].table.by_name[parameter_name].shape
    assert isinstance(shape, Text)
    return amount_reader(shape.parse, parameter_name)


def amount_reader(read_number: Callable[[str], float], parameter: str) -> ReadAmount:
    """The function that reads an amount: a value, which `read_number` reads, or a factor (`x1.5`)
    of the parameter's own value; of a pitch also an interval (`2st`, `-50cents`).
    """

    def read_amount(amount_word: str) -> Amount:
        if amount_word.startswith("x"):
            return Amount(quantities.factor(amount_word), is_factor=True)
        if parameter == "f" and is_interval(amount_word):
            return Amount(parse_interval(amount_word).ratio, is_factor=True)
        return Amount(read_number(amount_word))

    return read_amount


def _parse_factor(text: str) -> float:
    message = f"{quote(text)}: the members of a BANK have values of their own; write a factor, x1.5"
    raise TextError(message, length=max(1, len(text)), code="E201")


def _parse_interval_or_factor(text: str) -> float:
    """Refuse a pitch where every note has a pitch of its own. Raises TextError."""
    message = f"{quote(text)}: the notes have pitches of their own; write an interval, 2st, or x1.5"
    raise TextError(message, length=max(1, len(text)), code="E201")


FACTOR = Text(_parse_factor, "a factor, such as x1.5")
INTERVAL_OR_FACTOR = Text(
    _parse_interval_or_factor, "an interval, such as 2st, or a factor, such as x1.5"
)
