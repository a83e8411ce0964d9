"""Families of instruments at the prompt: those that ship, and files of a score."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import PurePosixPath
from typing import Any

from ergon.notation.tables import value_kinds as k
from ergon.notation.tables.shapes import MAX_NAME, NAME
from ergon.notation.text.errors import TextError, quote
from ergon.repl.language import commands as c
from ergon.repl.language import values as v
from ergon.repl.language.forms import Words
from ergon.repl.language.scope import SUFFIXES, Scope, scores_in
from ergon.repl.language.values import Completion, CompletionContext, Value
from ergon.scores.reading.families import file_of, library


def use(family: tuple[str, str], *, when: c.When, words: Words) -> c.Use:
    """Bring in a family, from its name and its file."""
    return c.Use(*family, when=when, words=words)


def voices(*, when: c.When, words: Words) -> c.Show:
    """List who plays what."""
    return c.Show(None, when=when, words=words)


def family_hint(scope: Scope, name: str) -> str:
    """What completion says of a family: its instruments."""
    return ", ".join(scope.families.get(name, ())) or "no instruments"


def _read_family(text: str, *_: Any) -> tuple[str, str]:
    """The name of a family and its file, as a score uses it."""
    if text in library():
        return text, file_of(text)
    path = PurePosixPath(text[1:-1] if len(text) > 1 and text[0] == text[-1] == '"' else text)
    if path.suffix not in SUFFIXES:
        what = "a family of the library, or a file such as drums.yaml"
        raise v.unknown_name(text, what, library())
    if not NAME.fullmatch(path.stem) or len(path.stem) > MAX_NAME:
        message = f"{quote(path.stem)} is not a name, and the file gives the family its name: "
        message += "use letters, digits, '-' and '_'"
        raise TextError(message, length=len(text))
    return path.stem, str(k.PATH.parse(str(path)))


def _family_offers(context: CompletionContext) -> Iterator[Completion]:
    for name in library():
        yield Completion(name, family_hint(context.scope, name))
    for path in scores_in(context.scope.folder):
        yield Completion(path.name, "a file of instruments")


def _read_listed(text: str, scope: Scope, _: Mapping[str, Any]) -> str:
    if text not in scope.families:
        raise v.unknown_name(text, "a family of instruments", scope.families)
    return text


FAMILY = Value("a family, such as skins, or a file", _read_family, _family_offers)
LISTED = Value(
    "a family, such as skins",
    _read_listed,
    lambda context: (
        Completion(name, family_hint(context.scope, name)) for name in context.scope.families
    ),
)
