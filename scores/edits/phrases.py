"""Phrases of a score: melodies by a name, which strikes play."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ergon.notation.text import edit
from ergon.notation.text.edit import EditError
from ergon.scores.edits.texts import Texts

_LOUD = "1mNs"  # the impulse of a phrase that says none
_TRIAL = "trial"


def define(
    texts: Texts, name: str, entries: Sequence[Mapping[str, str]], fields: Mapping[str, str]
) -> Texts:
    """Write a phrase, in place of one of its name; `fields` are `to` and `length`, where they are
    said. Raises EditError where what it strikes is not there."""
    said: dict[str, edit.Tree] = dict(fields)
    if "impulse" not in entries[0]:
        said["impulse"] = _LOUD
    said["entries"] = [_row(entry) for entry in entries]
    made = texts.put(("phrases", name), edit.flow(said))
    _check(made, name)
    return made


def _row(entry: Mapping[str, str]) -> edit.Tree:
    what = entry["what"].split()
    row: dict[str, edit.Tree] = {"at": entry["at"], "what": what[0] if len(what) == 1 else [*what]}
    return row if "impulse" not in entry else {**row, "impulse": entry["impulse"]}


def _check(texts: Texts, name: str) -> None:
    """Refuse a phrase that could not be played. Raises EditError."""
    played = texts.put(("strikes", f"{_TRIAL}-{name}"), edit.flow({"play": name, "at": "1|1"}))
    loaded = played.load()
    if loaded.piece is None:
        first = next(found for found in loaded.diagnostics if found.severity == "error")
        raise EditError(first.message.replace(f"strikes '{_TRIAL}-{name}'", f"phrase '{name}'"))
