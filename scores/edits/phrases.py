"""Phrases of a score: melodies by a name, which strikes play."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ergon.notation.text import edit
from ergon.notation.text.edit import EditError
from ergon.scores.edits.texts import Texts

_DEFAULT_IMPULSE = "1mNs"  # the default impulse of a phrase
_TRIAL_STRIKES_NAME = "trial"


def define(
    score_texts: Texts,
    phrase_name: str,
    phrase_entries: Sequence[Mapping[str, str]],
    phrase_fields: Mapping[str, str],
) -> Texts:
    """Write a phrase; it replaces a phrase of the same name. `phrase_fields` may have `to` and
    `length`. Raises EditError if the phrase cannot be played.
    """
    fields_written: dict[str, edit.Tree] = dict(phrase_fields)
    if "impulse" not in phrase_entries[0]:
        fields_written["impulse"] = _DEFAULT_IMPULSE
    fields_written["entries"] = [_phrase_row(entry) for entry in phrase_entries]
    edited_texts = score_texts.put(("phrases", phrase_name), edit.flow(fields_written))
    _check_playable(edited_texts, phrase_name)
    return edited_texts


def _phrase_row(phrase_entry: Mapping[str, str]) -> edit.Tree:
    note_words = phrase_entry["what"].split()
    row_tree: dict[str, edit.Tree] = {
        "at": phrase_entry["at"],
        "what": note_words[0] if len(note_words) == 1 else [*note_words],
    }
    return (
        row_tree
        if "impulse" not in phrase_entry
        else {**row_tree, "impulse": phrase_entry["impulse"]}
    )


def _check_playable(texts: Texts, name: str) -> None:
    """Raise EditError if a phrase cannot be played."""
    trial_texts = texts.put(
        ("strikes", f"{_TRIAL_STRIKES_NAME}-{name}"), edit.flow({"play": name, "at": "1|1"})
    )
    loaded = trial_texts.load()
    if loaded.piece is None:
        first_mistake = next(
            mistake for mistake in loaded.diagnostics if mistake.severity == "error"
        )
        raise EditError(first_mistake.message)
