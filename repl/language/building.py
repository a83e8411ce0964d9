"""Builds lines from values, for the methods of `ergon.Session`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ergon.repl.language import values
from ergon.repl.language.automating import MIDI_FILE
from ergon.repl.language.blocks import NEW_BLOCK
from ergon.repl.language.forms import Form, Slot
from ergon.repl.language.library import FAMILY_VALUE
from ergon.repl.language.playing import PLAYING_VALUE
from ergon.repl.language.verbs import FORMS, forms_of

# Method names for verbs that are not valid Python names.
VERB_BY_METHOD = {"define": "=", "look": "?", "define_block": "def"}
VERB_BY_FUNCTION = {
    **{form.verb: form.verb for form in FORMS if form.verb not in VERB_BY_METHOD.values()},
    **VERB_BY_METHOD,
}
TIME_NAMES = ("now", "at", "in", "sync")  # the names of a time


def build_line(verb: str, slot_values: Sequence[object], named_values: Mapping[str, object]) -> str:
    """The line of a verb, from values in the order in which they are written, or by name.

    A name is the word that comes before a value (`over`, `as_`, `K`), an option of `plays`, or
    one of `now=True`, `at=`, `in_=`. Values that are None or False are left out. Raises
    TypeError if the verb has no such form, ValueError for a value of more than one line.
    """
    present_values = {name.rstrip("_"): value for name, value in named_values.items()}
    present_values = {
        name: value
        for name, value in present_values.items()
        if value is not None and value is not False
    }
    for verb_form in forms_of(verb):
        # A time is accepted only by verbs that take one.
        time_words = {
            name: present_values[name]
            for name in TIME_NAMES
            if name in present_values and verb_form.takes_time
        }
        untimed_values = {
            name: value for name, value in present_values.items() if name not in time_words
        }
        words = _words_in_order(verb_form, slot_values, untimed_values)
        if words is not None and len(time_words) <= 1:
            return " ".join([*words, *_option_words(time_words)])
    raise TypeError("write it as " + ", or: ".join(form.usage for form in forms_of(verb)))


def _words_in_order(
    verb_form: Form, slot_values: Sequence[object], named_values: Mapping[str, object]
) -> list[str] | None:
    """The words of a line without its time; None where the values do not fit the form."""
    remaining_values = dict(named_values)
    value_by_slot: dict[int, object] = {}
    for slot_index, slot in enumerate(verb_form.slots):
        for slot_name in (slot.keyword.rstrip("="), slot.field):
            if slot_name in remaining_values and slot_index not in value_by_slot:
                value_by_slot[slot_index] = remaining_values.pop(slot_name)
        for slot_name in slot.value.first_words if slot.value is not None else ():
            if slot_name in remaining_values and slot_index not in value_by_slot:
                value_by_slot[slot_index] = _option_words(
                    {slot_name: remaining_values.pop(slot_name)}
                )[0]
    open_slots = [
        slot_number
        for slot_number in range(len(verb_form.slots))
        if slot_number not in value_by_slot
    ]
    # If there are more values than required places, they fill optional places from the left.
    n_spare = len(slot_values) - sum(
        not verb_form.slots[slot_number].optional for slot_number in open_slots
    )
    value_iterator = iter(slot_values)
    for slot_index in open_slots:
        if verb_form.slots[slot_index].optional:
            if n_spare <= 0:
                continue
            n_spare -= 1
        elif n_spare < 0:
            return None
        value_by_slot[slot_index] = next(value_iterator)
    option_words = (
        _option_words(remaining_values)
        if any(slot.value is PLAYING_VALUE for slot in verb_form.slots)
        else []
    )
    if n_spare > 0 or (remaining_values and not option_words):
        return None
    slot_texts = [
        _slot_text(verb_form.slots[slot_number], value_by_slot[slot_number])
        for slot_number in sorted(value_by_slot)
    ]
    if None in slot_texts:
        return None
    words = [word for word in slot_texts if word is not None] + option_words
    words.insert(1 if verb_form.begins_with_subject else 0, verb_form.verb)
    return words


def _slot_text(form_slot: Slot, slot_value: object) -> str | None:
    slot_text = _option_text(slot_value)
    if form_slot.value is None:  # a word that stands alone
        return form_slot.keyword if slot_value is True or slot_text == form_slot.keyword else None
    if form_slot.value is NEW_BLOCK:
        return f"{slot_text}:"
    if form_slot.value in (values.FILE_VALUE, MIDI_FILE, FAMILY_VALUE) and " " in slot_text:
        slot_text = f'"{slot_text}"'
    return (
        form_slot.keyword + slot_text
        if form_slot.keyword.endswith("=")
        else f"{form_slot.keyword} {slot_text}".lstrip()
    )


def _option_words(named_values: Mapping[str, object]) -> list[str]:
    """Options of `plays`; `do` is last, because it takes the rest of a line."""
    option_names = sorted(named_values, key=lambda name: name == "do")
    return [
        name if named_values[name] is True else f"{name} {_option_text(named_values[name])}"
        for name in option_names
    ]


def _option_text(option_value: object) -> str:
    words_text = (
        ", ".join(map(str, option_value))
        if isinstance(option_value, list | tuple)
        else str(option_value)
    )
    if "\n" in words_text:
        raise ValueError("a value must be on one line")
    return words_text
