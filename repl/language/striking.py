"""The words after `strikes`: modules, then the fields of strikes as in a score."""

from __future__ import annotations

from collections.abc import Container, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ergon.notation.tables import value_kinds
from ergon.notation.tables.shapes import NAME, Text
from ergon.notation.tables.strengths import is_level
from ergon.notation.text.errors import TextError, quote
from ergon.repl.language import amounts, values
from ergon.repl.language.commands import BlockCommand, When, Word
from ergon.repl.language.forms import Slot, form
from ergon.repl.language.scope import Scope, playable_instruments
from ergon.repl.language.transforming import (
    checked_transforms,
    split_at_transforms,
    transform_completions,
)
from ergon.scores.pattern.values import parse_values
from ergon.scores.pattern.words import Word as PlacedWord
from ergon.scores.pattern.words import parse_strikes
from ergon.scores.reading.automatable import amount_reader
from ergon.scores.reading.rhythms import words_of
from ergon.scores.reading.strike_tables import STRIKES_RECORD


@dataclass(frozen=True, slots=True)
class DoStrikes(BlockCommand):
    """`d1 do rev`: transform further what strikes play; `none` ends all transformations."""

    name: str
    do: str


@dataclass(frozen=True, slots=True)
class StrikeModules(BlockCommand):
    """`rain strikes sky.all every 1/2 impulse 2mNs`: replace what `rain` strikes.

    The fields are those of `strikes:` in a score, as texts.
    """

    name: str
    fields: Mapping[str, str]

    @property
    def struck(self) -> tuple[str, ...]:
        """The paths of what may be struck: those after `to`, and the words of a rhythm."""
        return (*self.fields.get("to", "").split(), *words_of(self.fields.get("rhythm", "")))


# The impulse of notes of an instrument that does not say how it is played.
_DEFAULT_IMPULSE = "1mNs"
# An example of each option of `strikes`.
OPTION_EXAMPLES = {
    "every": "1/2",
    "rate": "0.5Hz",
    "impulse": "2mNs",
    "times": "8",
    "for": "4bar",
    "until": "C",
    "chance": "0.6",
    "euclid": "3 8",
    "swing": "0.6",
    "skip": "5",
    "sweep": "inward",
    "path": "1 0deg -> 0.3 360deg",
    "width": "0.05",
    "mass": "2g",
    "speed": "1m/s",
}


def _read_strikes(
    slot_text: str, scope: Scope, earlier_values: Mapping[str, Any]
) -> Mapping[str, str]:
    """The fields of the strikes, as texts."""
    first_word = slot_text.split()[0]
    if first_word in scope.phrases and first_word not in playable_instruments(
        scope
    ):  # leave the line to the next form
        raise values.unknown_instrument_error(
            first_word, "an instrument or a key", (*playable_instruments(scope), *scope.keys), scope
        )
    options_text, transforms_start = split_at_transforms(slot_text)
    module_words, placed_options = parse_strikes(options_text, OPTION_EXAMPLES)
    module_words, placed_options = split_trailing_level(
        module_words, placed_options, (*playable_instruments(scope), *scope.keys)
    )
    if not module_words:
        message = "the modules are missing: rain strikes bell.m every 1 impulse 2mNs"
        raise TextError(message, length=len(slot_text))
    for module_word in module_words:
        part_name = module_word.text.split(".")[0]
        if part_name not in playable_instruments(scope) and part_name not in scope.keys:
            error = values.unknown_instrument_error(
                part_name,
                "an instrument or a key",
                (*playable_instruments(scope), *scope.keys),
                scope,
            )
            error.offset += module_word.offset
            raise error
    check_options(placed_options, scope)
    unplayable_words = (
        strikes_word.text
        for strikes_word in module_words
        if strikes_word.text.split(".")[0] not in scope.acts
    )
    if not placed_options.keys() & {"impulse", "mass"} and (name := next(unplayable_words, None)):
        message = f"the impulse is missing: {quote(name.split('.')[0])} does not say how it is "
        raise TextError(
            f"{message}played; write for instance impulse 2mNs", offset=len(options_text)
        )
    target_words = " ".join(module.text for module in module_words)
    return {
        "to": target_words,
        **{name: word.text for name, word in placed_options.items()},
        **_transforms_field(slot_text, transforms_start),
    }


def _transforms_field(slot_text: str, transforms_start: int | None) -> dict[str, str]:
    """The field of the transformations that begin at `transforms_start`, if there are any."""
    return (
        {}
        if transforms_start is None
        else {"do": checked_transforms(slot_text[transforms_start:], transforms_start, "x")}
    )


def split_trailing_level(
    earlier_words: Sequence[PlacedWord],
    placed_options: dict[str, PlacedWord],
    known_names: Container[str],
) -> tuple[list[PlacedWord], dict[str, PlacedWord]]:
    """Words before the options, without strengths at their end, which become `impulse`."""
    words_stop = len(earlier_words)
    while (
        words_stop
        and earlier_words[words_stop - 1].text not in known_names
        and is_level(earlier_words[words_stop - 1].text)
    ):
        words_stop -= 1
    if words_stop == len(earlier_words) or "impulse" in placed_options:
        return [*earlier_words], placed_options
    text = " ".join(word.text for word in earlier_words[words_stop:])
    return [*earlier_words[:words_stop]], {
        "impulse": PlacedWord(text, earlier_words[words_stop].offset),
        **placed_options,
    }


def check_options(options: Mapping[str, PlacedWord], scope: Scope) -> None:
    """Check the values of options. Raises TextError."""
    for name, option_word in options.items():
        shape = amounts.POSITION_VALUE if name == "until" else STRIKES_RECORD.by_name[name].shape
        try:
            if isinstance(shape, Text):
                shape.parse(option_word.text)
            else:
                amounts.POSITION_VALUE.read(option_word.text, scope, {})
        except TextError as error:
            error.offset += option_word.offset
            raise


def _completions(context: values.CompletionContext) -> Iterator[values.Completion]:
    last_word = context.earlier_words[-1] if context.earlier_words else ""
    if "do" in context.earlier_words:
        yield from transform_completions(
            context.earlier_words[context.earlier_words.index("do") + 1 :]
        )
        return
    if last_word in OPTION_EXAMPLES:
        yield values.Completion(
            OPTION_EXAMPLES[last_word].split()[0], STRIKES_RECORD.by_name[last_word].doc
        )
        return
    if context.earlier_words and context.earlier_words[0] in context.scope.phrases:
        return
    if not any(word in OPTION_EXAMPLES for word in context.earlier_words):
        yield from values.struck_completions(context)
    if context.earlier_words:
        for name in OPTION_EXAMPLES:
            if name not in context.earlier_words:
                yield values.Completion(name, STRIKES_RECORD.by_name[name].doc)
        if any(word in OPTION_EXAMPLES for word in context.earlier_words):
            yield values.Completion("do", STRIKES_RECORD.by_name["do"].doc)


def _read_strikes_name(slot_text: str, scope: Scope, _: Mapping[str, Any]) -> str:
    if not NAME.fullmatch(slot_text) or slot_text in values.RESERVED_WORDS:
        message = f"{quote(slot_text)} is not a name: a letter, then letters, digits, '-' and '_'"
        raise TextError(message, length=len(slot_text))
    return slot_text


def _read_notes(
    slot_text: str, scope: Scope, earlier_values: Mapping[str, Any]
) -> Mapping[str, str]:
    """The fields of strikes that have notes, as texts."""
    options_text, transforms_start = split_at_transforms(slot_text)
    note_words, placed_options = parse_strikes(options_text, OPTION_EXAMPLES)
    note_words, placed_options = split_trailing_level(note_words, placed_options, ())
    notes_end = note_words[-1].offset + len(note_words[-1].text) if note_words else 0
    parse_values(slot_text[:notes_end], amount_reader(value_kinds.PITCH.parse, "f"), is_pitch=True)
    check_options(placed_options, scope)
    if not placed_options.keys() & {"every", "euclid"}:
        message = "the length of a step is missing: every 1"
        raise TextError(message, offset=notes_end, length=max(1, len(options_text) - notes_end))
    written_fields = {name: word.text for name, word in placed_options.items()} | _transforms_field(
        slot_text, transforms_start
    )
    has_impulse = earlier_values["name"].split(".")[0] in scope.acts or written_fields.keys() & {
        "impulse",
        "mass",
    }
    default_impulse = {} if has_impulse else {"impulse": _DEFAULT_IMPULSE}
    return {
        "to": earlier_values["name"],
        "notes": " ".join(slot_text[:notes_end].split()),
        **written_fields,
        **default_impulse,
    }


def _note_completions(context: values.CompletionContext) -> Iterator[values.Completion]:
    if context.earlier_words:
        names = playable_instruments(context.scope)
        yield from (
            completion for completion in _completions(context) if completion.text not in names
        )
    else:
        yield values.Completion("A3", "notes, a scale or a chord such as A3.minor")


def _read_struck_name(text: str, scope: Scope, _: Mapping[str, Any]) -> str:
    if text.split(".")[0] not in playable_instruments(scope):
        raise values.unknown_instrument_error(
            text, "an instrument", playable_instruments(scope), scope
        )
    return text


PLAYED_ON = values.Value(
    "an instrument or one of its CELs",
    _read_struck_name,
    lambda context: values.name_completions(playable_instruments(context.scope)),
)
NOTES_VALUE = values.Value("notes and the length of a step", _read_notes, _note_completions)
STRIKING_VALUE = values.Value("modules and how they are struck", _read_strikes, _completions)
NAMED_VALUE = values.Value("a name for the strikes", _read_strikes_name, lambda context: ())


def strikes(
    name: str, fields: Mapping[str, str], when: When, words: Mapping[str, Word]
) -> StrikeModules:
    """Make the command; strikes with notes have the name of the module that they strike."""
    return StrikeModules(name.replace(".", "-"), fields, when=when, words=words)


# fmt: off
STRIKES_FORM = form("strikes", "str", "strikes modules without a key",
    "rain strikes bell every 1 impulse 2mNs", strikes,
    Slot("name", "NAME", NAMED_VALUE),
    Slot("fields", "MODULE … [every LENGTH] [impulse …] [chance P] [euclid N N] [do …] …",
    STRIKING_VALUE, takes_many=True), begins_with_subject=True)
NOTES_FORM = form("notes", "no", "strikes an instrument at the pitches of a pattern",
    "bell notes A3 C4 E4 euclid 5 8", strikes,
    Slot("name", "INSTRUMENT", PLAYED_ON),
    Slot("fields", "NOTE … [every LENGTH] [euclid N N] [impulse …] [chance P] [do …] …",
    NOTES_VALUE, takes_many=True), begins_with_subject=True)
# fmt: on
