"""Names of a score: finds free ones, and defines gestures, takes and the seed."""

from __future__ import annotations

from collections.abc import Container
from itertools import count

from ergon.notation.tables.fields import Values
from ergon.notation.text import document, edit
from ergon.notation.text.document import Scalar
from ergon.notation.text.edit import EditError
from ergon.scores.edits.texts import Texts


def free_name(name: str, taken_names: Container[str], *, is_numbered: bool = False) -> str:
    """The first of `name`, `name-2`, `name-3` … that is not taken; if numbered, of `name-1`,
    `name-2` …
    """
    if name not in taken_names and not is_numbered:
        return name
    numbers = count(1 if is_numbered else 2)
    return next(free for number in numbers if (free := f"{name}-{number}") not in taken_names)


def define(texts: Texts, name: str, notation: str) -> Texts:
    """Write a gesture's notation in the file where it is defined; its other options stay.

    Raises EditError.
    """
    names, _ = texts.names()
    entry = names.tables["gestures"].get(name)
    notation_text = edit.quoted(notation)
    if entry is None:
        if "." in name:
            raise EditError(f"no file that the score uses defines a gesture {name}")
        return texts.put(("gestures", name), notation_text)
    if not isinstance(entry.values, Values):
        raise EditError(f"the definition of {name} has mistakes")
    node, file = entry.values.node, entry.values.node.document.file
    path = ("gestures", entry.values.context.name)
    if isinstance(node, Scalar) and not node.is_empty:
        return texts.put(path, notation_text, file)
    if isinstance(node, document.Mapping) and "points" in node.entries:
        if len(node.entries) == 1:
            return texts.put(path, notation_text, file)
        texts = texts.put((*path, "notation"), notation_text, file)
        return texts.remove((*path, "points"), file=file)
    return texts.put((*path, "notation"), notation_text, file)


def take(texts: Texts, name: str, file: str, channel: str | None = None) -> Texts:
    """Define a take of a recording. Raises EditError."""
    take_fields: dict[str, edit.Tree] = {"file": file, **({"channel": channel} if channel else {})}
    return texts.put(("takes", name), edit.flow(take_fields))


def seed(texts: Texts, number: int) -> Texts:
    """Set the seed."""
    return texts.put(("seed",), str(number))
