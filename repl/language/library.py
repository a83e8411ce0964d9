"""Families of instruments at the prompt: those that ship, and files of a score."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import PurePosixPath
from typing import Any

from ergon.notation.tables import value_kinds
from ergon.notation.tables.shapes import MAX_NAME, NAME
from ergon.notation.text.errors import TextError, quote
from ergon.repl.language import values
from ergon.repl.language.commands import Command, When
from ergon.repl.language.forms import SHOWN_SLOT, Slot, Words, form
from ergon.repl.language.scope import SCORE_SUFFIXES, Scope, scores_in, unused_family
from ergon.repl.language.values import Completion, CompletionContext, Value
from ergon.scores.reading.families import file_of, library


@dataclass(frozen=True, slots=True)
class Use(Command):
    """`use skins`: bring in the instruments of a file, whose names a line may then play."""

    family: str
    file: str


@dataclass(frozen=True, slots=True)
class Show(Command):
    """List who plays what, or show where a name is defined."""

    name: str | None


@dataclass(frozen=True, slots=True)
class ListInstruments(Command):
    """List the instruments of a family; None: those of the score, and all families."""

    family: str | None


@dataclass(frozen=True, slots=True)
class ListGestures(Command):
    """List the gestures and the takes."""


@dataclass(frozen=True, slots=True)
class ListScenes(Command):
    """List the scores beside this one, which can be played as scenes."""


def bring_family(family: tuple[str, str], *, when: When, words: Words) -> Use:
    """Bring in a family, from its name and its file."""
    return Use(*family, when=when, words=words)


def list_voices(*, when: When, words: Words) -> Show:
    """List who plays what."""
    return Show(None, when=when, words=words)


def family_hint(scope: Scope, name: str) -> str:
    """What completion says of a family: its instruments."""
    return ", ".join(scope.families.get(name, ())) or "no instruments"


def _read_family(slot_text: str, scope: Scope, _: Mapping[str, Any]) -> tuple[str, str]:
    """The name of a family and its file, as a score uses it."""
    if slot_text in library():
        return slot_text, file_of(slot_text)
    folder, _slash, family_name = slot_text.rpartition("/")
    if (known_family := unused_family(family_name, scope)) and folder in ("", known_family):
        message = (
            f"{quote(slot_text)} is an instrument: type `use {known_family}` for its family, or "
        )
        raise TextError(
            f"{message}`{family_name} = {known_family}/{family_name}` for it alone",
            length=len(slot_text),
        )
    path = PurePosixPath(
        slot_text[1:-1]
        if len(slot_text) > 1 and slot_text[0] == slot_text[-1] == '"'
        else slot_text
    )
    if path.suffix not in SCORE_SUFFIXES:
        family_noun = "a family of the library, or a file such as drums.yaml"
        raise values.unknown_name_error(slot_text, family_noun, library())
    if not NAME.fullmatch(path.stem) or len(path.stem) > MAX_NAME:
        message = f"{quote(path.stem)} is not a name, and the file gives the family its name: "
        message += "use letters, digits, '-' and '_'"
        raise TextError(message, length=len(slot_text))
    return path.stem, str(value_kinds.PATH.parse(str(path)))


def _family_offers(context: CompletionContext) -> Iterator[Completion]:
    for name in library():
        yield Completion(name, family_hint(context.scope, name))
    for path in scores_in(context.scope.folder):
        yield Completion(path.name, "a file of instruments")


def _read_listed_family(text: str, scope: Scope, _: Mapping[str, Any]) -> str:
    if text not in scope.families:
        raise values.unknown_name_error(text, "a family of instruments", scope.families)
    return text


FAMILY_VALUE = Value("a family, such as skins, or a file", _read_family, _family_offers)
LISTED_VALUE = Value(
    "a family, such as skins",
    _read_listed_family,
    lambda context: (
        Completion(name, family_hint(context.scope, name)) for name in context.scope.families
    ),
)


# fmt: off
USE_FORM = form("use", "us", "brings in a family, so that its instruments can be played",
    "use skins", bring_family, Slot("family", "FAMILY|FILE", FAMILY_VALUE))
SHOW_FORM = form("show", "sh", "lists who plays what, or shows where a name is defined",
    "show ada", Show, SHOWN_SLOT, takes_time=False)
VOICES_FORM = form("voices", "vo", "lists who plays what, and what is muted", "voices",
    list_voices, takes_time=False)
INSTRUMENTS_FORM = form("instruments", "ins", "lists the instruments of the score or of a family",
    "instruments skins", ListInstruments,
    Slot("family", "FAMILY", LISTED_VALUE, optional=True), takes_time=False)
GESTURES_FORM = form("gestures", "ge", "lists the gestures and the takes", "gestures", ListGestures,
    takes_time=False)
SCENES_FORM = form("scenes", "scenes", "lists the scenes beside the score", "scenes", ListScenes,
    takes_time=False)
# fmt: on
