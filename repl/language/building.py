"""Builds lines from values, for the methods of `ergon.Session`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ergon.repl.language import values as v
from ergon.repl.language.automating import MIDI_FILE
from ergon.repl.language.blocks import NEW_BLOCK
from ergon.repl.language.forms import Form, Slot
from ergon.repl.language.library import FAMILY
from ergon.repl.language.playing import PLAYING
from ergon.repl.language.verbs import FORMS, forms_of

# Method names for verbs that are not valid Python names.
VERB_OF_METHOD = {"define": "=", "look": "?", "define_block": "def"}
FUNCTIONS = {
    **{form.verb: form.verb for form in FORMS if form.verb not in VERB_OF_METHOD.values()},
    **VERB_OF_METHOD,
}
WHEN = ("now", "at", "in", "sync")  # the names of a time


def build_line(verb: str, values: Sequence[object], named: Mapping[str, object]) -> str:
    """The line of a verb, from values in the order in which they are written, or by name.

    A name is the word that comes before a value (`over`, `as_`, `K`), an option of `plays`, or
    one of `now=True`, `at=`, `in_=`. Values that are None or False are left out. Raises
    TypeError if the verb has no such form, ValueError for a value of more than one line.
    """
    options = {name.rstrip("_"): value for name, value in named.items()}
    options = {
        name: value for name, value in options.items() if value is not None and value is not False
    }
    for form in forms_of(verb):
        # A time is accepted only by verbs that take one.
        when = {name: options[name] for name in WHEN if name in options and form.timed}
        rest = {name: value for name, value in options.items() if name not in when}
        words = _words_in_order(form, values, rest)
        if words is not None and len(when) <= 1:
            return " ".join([*words, *_options(when)])
    raise TypeError("write it as " + ", or: ".join(form.written for form in forms_of(verb)))


def _words_in_order(
    form: Form, arguments: Sequence[object], named: Mapping[str, object]
) -> list[str] | None:
    """The words of a line without its time; None where the values do not fit the form."""
    rest = dict(named)
    bound: dict[int, object] = {}
    for number, slot in enumerate(form.slots):
        for name in (slot.lead.rstrip("="), slot.field):
            if name in rest and number not in bound:
                bound[number] = rest.pop(name)
        for name in slot.value.heads if slot.value is not None else ():
            if name in rest and number not in bound:
                bound[number] = _options({name: rest.pop(name)})[0]
    open_ = [number for number in range(len(form.slots)) if number not in bound]
    # If there are more values than required places, they fill optional places from the left.
    spare = len(arguments) - sum(not form.slots[number].optional for number in open_)
    values = iter(arguments)
    for number in open_:
        if form.slots[number].optional:
            if spare <= 0:
                continue
            spare -= 1
        elif spare < 0:
            return None
        bound[number] = next(values)
    options = _options(rest) if any(slot.value is PLAYING for slot in form.slots) else []
    if spare > 0 or (rest and not options):
        return None
    slot_texts = [_slot_text(form.slots[number], bound[number]) for number in sorted(bound)]
    if None in slot_texts:
        return None
    words = [word for word in slot_texts if word is not None] + options
    words.insert(1 if form.subject else 0, form.verb)
    return words


def _slot_text(slot: Slot, value: object) -> str | None:
    text = _text(value)
    if slot.value is None:  # a word that stands alone
        return slot.lead if value is True or text == slot.lead else None
    if slot.value is NEW_BLOCK:
        return f"{text}:"
    if slot.value in (v.FILE, MIDI_FILE, FAMILY) and " " in text:
        text = f'"{text}"'
    return slot.lead + text if slot.lead.endswith("=") else f"{slot.lead} {text}".lstrip()


def _options(named: Mapping[str, object]) -> list[str]:
    """Options of `plays`; `do` is last, because it takes the rest of a line."""
    order = sorted(named, key=lambda name: name == "do")
    return [name if named[name] is True else f"{name} {_text(named[name])}" for name in order]


def _text(value: object) -> str:
    text = ", ".join(map(str, value)) if isinstance(value, list | tuple) else str(value)
    if "\n" in text:
        raise ValueError("a value must be on one line")
    return text
