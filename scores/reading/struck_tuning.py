"""The tuning in which strikes are read: that of the instruments whose notes they name."""

from __future__ import annotations

from contextlib import AbstractContextManager
from typing import Any

from ergon.instruments.names import PartNames
from ergon.notation.tables import tuning
from ergon.notation.tables.fields import Values
from ergon.notation.text.errors import quote
from ergon.scores.reading import melodies

# Fields by which notes are moved, ordered or spelled, which depends on the tuning.
_TUNED_FIELDS = ("transpose", "do", "rhythm", "notes")


def strikes_tuning(
    strike_values: Values, phrase: Any, part_names: PartNames
) -> AbstractContextManager[None] | None:
    """The context in which strikes, which may play a phrase, are read.

    Notes as they are written are looked up in each instrument by its own tuning. Instruments of
    different tunings have nothing else in common: None after a report of what would move notes.
    """
    if not part_names.tunings:
        return tuning.used(part_names.tuning)
    target_names = strike_values["to"] or ()
    tuned_fields = [f"`{name}`" for name in strike_values.written(*_TUNED_FIELDS)]
    if isinstance(phrase, Values):
        target_names = melodies.notes_in(phrase, strike_values)
        if melodies.has_note_file(phrase) or phrase["do"]:
            tuned_fields.append(f"phrase {quote(strike_values['play'])}")
    tunings = {name: part_names.tuning_of(name) for name in target_names}
    first_name, first_tuning = next(iter(tunings.items()), ("", part_names.tuning))
    contrary_name = next(
        (name for name in tunings if not _is_same(tunings[name], first_tuning)), None
    )
    if contrary_name is None:
        return tuning.used(first_tuning)
    if not tuned_fields:
        return tuning.used(part_names.tuning)
    message = (
        f"{strike_values.context.label('')}: {quote(first_name)} and {quote(contrary_name)} have "
        "different tunings, "
    )
    message += f"and {tuned_fields[0]} is read in one tuning; write strikes for each of the two"
    strike_values.error("E111", message, next(iter(strike_values.written(*_TUNED_FIELDS, "play"))))
    return None


def _is_same(first_tuning: tuning.Tuning | None, second_tuning: tuning.Tuning | None) -> bool:
    return (first_tuning or tuning.PLAIN) == (second_tuning or tuning.PLAIN)
