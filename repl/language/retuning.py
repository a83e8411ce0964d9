"""The words after `set vib.tuning`: another tuning of an instrument, or of the score."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from ergon.notation.clock.positions import Length
from ergon.notation.tables.tuning_fields import TUNING
from ergon.notation.text.errors import TextError, quote
from ergon.notation.text.spelling import nearest
from ergon.repl.language import values
from ergon.repl.language.commands import Command, When, Word
from ergon.repl.language.forms import OVER_SLOT, Slot, form
from ergon.repl.language.scope import Scope


@dataclass(frozen=True, slots=True)
class Retune(Command):
    """`set vib.tuning edo 19`: move an instrument, or the score, to another tuning, gliding for the
    length `over`; without fields to that of the score, or to equal steps.
    """

    target: str
    fields: Mapping[str, str]
    over: Length | None


_WORD_PATTERN = re.compile(r"\S+")
_FIELD_EXAMPLES = {
    "edo": "19",
    "A4": "442Hz",
    "scale": "tune.scl",
    "keys": "tune.kbm",
    "root": "D4",
}
_OFF_WORD = "off"


def _tunable_names(scope: Scope) -> dict[str, str]:
    """What may be tuned: the score, and every instrument as a whole, each with a hint."""
    hint_by_name = scope.instruments
    instrument_names = [
        name for name in hint_by_name if name.rpartition(".")[0] not in hint_by_name
    ]
    return {"tuning": "of the score"} | {
        f"{name}.tuning": hint_by_name[name] for name in instrument_names
    }


def _read_target(slot_text: str, scope: Scope, _: Mapping[str, Any]) -> str:
    tunable_names = _tunable_names(scope)
    if slot_text not in tunable_names:
        raise values.unknown_name_error(slot_text, "a tuning", tuple(tunable_names))
    return slot_text


def _target_completions(context: values.CompletionContext) -> Iterator[values.Completion]:
    for target, hint in _tunable_names(context.scope).items():
        yield values.Completion(target, f"the tuning {hint}" if target == "tuning" else hint)


def _read_fields(slot_text: str, _scope: Scope, _read: Mapping[str, Any]) -> dict[str, str]:
    """The fields of a tuning; none for `off`. Raises TextError."""
    placed_words = [(match.start(), match.group()) for match in _WORD_PATTERN.finditer(slot_text)]
    if slot_text.strip() == _OFF_WORD:
        return {}
    for field_name, pattern in TUNING.value_pattern_by_field.items():
        if len(placed_words) == 1 and (match := re.fullmatch(pattern, placed_words[0][1])):
            return {field_name: match[1]}
    tuning_fields: dict[str, str] = {}
    for (name_offset, field_name), (word_offset, value_text) in zip(
        placed_words[::2], placed_words[1::2], strict=False
    ):
        if field_name not in TUNING.by_name or field_name in tuning_fields:
            field_list = ", ".join(TUNING.by_name)
            message = (
                f"{quote(field_name)} says nothing of a tuning; it has {field_list}, each once"
            )
            suggestion = TUNING.synonyms.get(field_name) or nearest(field_name, TUNING.by_name)
            raise TextError(
                message, offset=name_offset, length=len(field_name), suggestion=suggestion
            )
        values.check_word(TUNING, field_name, value_text, word_offset)
        tuning_fields[field_name] = value_text
    if len(placed_words) % 2:
        name_offset, field_name = placed_words[-1]
        example = (
            f"{field_name} {_FIELD_EXAMPLES[field_name]}"
            if field_name in _FIELD_EXAMPLES
            else "edo 19, A4 442Hz or off"
        )
        message = f"a value is missing after {quote(field_name)}, such as {example}"
        raise TextError(message, offset=name_offset, length=len(field_name))
    return tuning_fields


def _completions(context: values.CompletionContext) -> Iterator[values.Completion]:
    if len(context.earlier_words) % 2:
        if (field_name := context.earlier_words[-1]) in _FIELD_EXAMPLES:
            yield values.Completion(_FIELD_EXAMPLES[field_name], TUNING.by_name[field_name].doc)
        return
    for field_name, field in TUNING.by_name.items():
        if field_name not in context.earlier_words:
            yield values.Completion(field_name, field.doc)
    if not context.earlier_words:
        yield values.Completion(_OFF_WORD, "the tuning of the score, or equal steps")


TARGET_VALUE = values.Value(
    "the tuning of an instrument, or of the score", _read_target, _target_completions
)
FIELDS_VALUE = values.Value("a tuning, such as edo 19", _read_fields, _completions)


def retune(
    target: str,
    fields: Mapping[str, str],
    over: Length | None = None,
    *,
    when: When,
    words: Mapping[str, Word],
) -> Retune:
    """`set vib.tuning edo 19 over 2s`."""
    return Retune(target, fields, over, when=when, words=words)


# fmt: off
SET_TUNING_FORM = form("set", "set", "another tuning for an instrument, or for the score",
    "set bell.tuning edo 19", retune,
    Slot("target", "INSTRUMENT.tuning|tuning", TARGET_VALUE),
    Slot("fields", "edo N|A4 HERTZ|scale FILE [keys FILE]|off …", FIELDS_VALUE,
    takes_many=True), OVER_SLOT)
# fmt: on
