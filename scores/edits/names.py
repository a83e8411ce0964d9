"""Names of a score: finds free ones, and defines gestures, takes and the seed."""

from __future__ import annotations

from collections.abc import Container
from itertools import count

from ergon.notation.tables.fields import Values
from ergon.notation.text import document, edit
from ergon.notation.text.document import Scalar
from ergon.notation.text.edit import EditError
from ergon.scores.edits.texts import Texts


def free_name(wanted_name: str, taken_names: Container[str], *, is_numbered: bool = False) -> str:
    """The first of NAME, NAME-2, NAME-3 … that is not taken; if numbered, of NAME-1,
    NAME-2 …
    """
    if wanted_name not in taken_names and not is_numbered:
        return wanted_name
    numbers = count(1 if is_numbered else 2)
    return next(
        candidate
        for number in numbers
        if (candidate := f"{wanted_name}-{number}") not in taken_names
    )


def define(score_texts: Texts, gesture_name: str, notation: str) -> Texts:
    """Write a gesture's notation in the file where it is defined; its other options stay.

    Raises EditError.
    """
    names, _ = score_texts.names()
    named_entry = names.tables["gestures"].get(gesture_name)
    notation_text = edit.quoted(notation)
    if named_entry is None:
        if "." in gesture_name:
            raise EditError(f"no file that the score uses defines a gesture {gesture_name}")
        return score_texts.put(("gestures", gesture_name), notation_text)
    if not isinstance(named_entry.values, Values):
        raise EditError(f"the definition of {gesture_name} has mistakes")
    gesture_node, file_name = named_entry.values.node, named_entry.values.node.document.file
    path = ("gestures", named_entry.values.context.name)
    if isinstance(gesture_node, Scalar) and not gesture_node.is_empty:
        return score_texts.put(path, notation_text, file_name)
    if isinstance(gesture_node, document.Mapping) and "points" in gesture_node.entries:
        if len(gesture_node.entries) == 1:
            return score_texts.put(path, notation_text, file_name)
        score_texts = score_texts.put((*path, "notation"), notation_text, file_name)
        return score_texts.remove((*path, "points"), file=file_name)
    return score_texts.put((*path, "notation"), notation_text, file_name)


def define_take(texts: Texts, name: str, file: str, channel: str | None = None) -> Texts:
    """Define a take of a recording. Raises EditError."""
    take_fields: dict[str, edit.Tree] = {"file": file, **({"channel": channel} if channel else {})}
    return texts.put(("takes", name), edit.flow(take_fields))


def set_seed(texts: Texts, number: int) -> Texts:
    """Set the seed."""
    return texts.put(("seed",), str(number))
