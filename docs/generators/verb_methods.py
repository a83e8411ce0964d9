"""The types of a session's methods, one for each verb, from the table of verbs.

python -m docs.generators.verb_methods repl/session/verb_methods.pyi
"""

from __future__ import annotations

import keyword
from collections.abc import Iterator
from pathlib import Path

from ergon.common.module_arguments import module_arguments
from ergon.repl.language import building
from ergon.repl.language.forms import Form, Slot
from ergon.repl.language.playing import PLAYING_VALUE
from ergon.repl.language.verbs import forms_of

_HEAD = '''\
"""The verbs of a session as methods. Made by docs.generators.verb_methods; do not edit."""

from ergon.repl.session_protocol import Reply

class VerbMethods:
    """A method for each verb of `ergon repl`, which submits its line."""

'''


def text() -> str:
    """The stub."""
    return _HEAD + "\n".join(map(_method, sorted(building.VERB_BY_FUNCTION)))


def _method(name: str) -> str:
    forms = list(forms_of(building.VERB_BY_FUNCTION[name]))
    takes_options = any(slot.value is PLAYING_VALUE for form in forms for slot in form.slots)
    names = sorted({word for form in forms for word in _words(form)})
    parameters = ["self"]
    if any(form.slots for form in forms):
        parameters.append("*in_order: object")
    elif names:
        parameters.append("*")
    if takes_options:  # those of the table of a part
        parameters.append("**named: object")
    else:
        parameters += [f"{word}: object = ..." for word in names]
    written = "\n".join(f"        {form.usage}" for form in forms).strip()
    return f'    def {name}({", ".join(parameters)}) -> Reply:\n        """{written}"""\n'


def _words(form: Form) -> Iterator[str]:
    """The names by which the values of a form may be given."""
    for slot in form.slots:
        yield from filter(str.isidentifier, map(_python_name, _slot_words(slot)))
    if form.takes_time:
        yield from map(_python_name, building.TIME_NAMES)


def _slot_words(slot: Slot) -> Iterator[str]:
    yield slot.keyword.rstrip("=")
    yield slot.field
    yield from slot.value.first_words if slot.value is not None else ()


def _python_name(word: str) -> str:
    return f"{word}_" if keyword.iskeyword(word) else word


if __name__ == "__main__":
    Path(module_arguments("FILE")[0]).write_text(text(), encoding="utf-8")
