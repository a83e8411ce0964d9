"""Rhythms at the prompt: `d1 = "kick*4, ~ snare" f do every 4 rev`, and what is done to a voice."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from ergon.notation.text.errors import TextError, quote
from ergon.repl.language import values
from ergon.repl.language.commands import When
from ergon.repl.language.forms import Slot, Words, form
from ergon.repl.language.scope import Scope, playable_instruments
from ergon.repl.language.striking import (
    NAMED_VALUE,
    DoStrikes,
    StrikeModules,
    check_options,
    split_trailing_level,
)
from ergon.repl.language.transforming import (
    checked_transforms,
    split_at_transforms,
    transform_completions,
)
from ergon.repl.language.values import Completion, CompletionContext, Value
from ergon.scores.edits.transformed import NO_TRANSFORMS
from ergon.scores.pattern.struck import name_of, notes_of
from ergon.scores.pattern.words import parse_strikes
from ergon.scores.reading.rhythms import ANY_WORD, checked_text, compiled_rhythm, level_of

_OPTION_EXAMPLES = {
    "to": "bell",
    "impulse": "f",
    "cycle": "1bar",
    "times": "4",
    "for": "8bar",
    "until": "C",
    "skip": "2",
}


def _read_rhythm(
    slot_text: str, scope: Scope, earlier_values: Mapping[str, Any]
) -> Mapping[str, str]:
    """The fields of strikes with a rhythm, as texts; the form is tried for quotes alone."""
    quote_end = slot_text.find('"', 1)
    if quote_end < 0:
        message = "the quote at the end of the rhythm is missing"
        raise TextError(message, length=len(slot_text), suggestion=f'{slot_text}"')
    rhythm, text_after, after_offset = (
        slot_text[1:quote_end],
        slot_text[quote_end + 1 :],
        quote_end + 1,
    )
    options_text, transforms_start = split_at_transforms(text_after)
    placed_words, placed_options = parse_strikes(options_text, _OPTION_EXAMPLES)
    placed_words, placed_options = split_trailing_level(placed_words, placed_options, ())
    try:
        if placed_words:
            message = (
                f"{quote(placed_words[0].text)} does not belong here: after the rhythm come "
                "levels, "
            )
            message += f"such as f, and {', '.join(_OPTION_EXAMPLES)}, do"
            raise TextError(
                message, offset=placed_words[0].offset, length=len(placed_words[0].text)
            )
        check_options({name: word for name, word in placed_options.items() if name != "to"}, scope)
        target_word = placed_options.get("to")
        if target_word is not None and target_word.text.split(".")[0] not in playable_instruments(
            scope
        ):
            error = values.unknown_instrument_error(
                target_word.text, "an instrument", playable_instruments(scope), scope
            )
            error.offset = target_word.offset
            raise error
    except TextError as error:
        error.offset += after_offset
        raise
    strike_fields = {name: word.text for name, word in placed_options.items()}
    target_name = strike_fields.get("to") or (
        earlier_values["name"] if earlier_values["name"] in playable_instruments(scope) else ""
    )
    try:
        checked_text(rhythm)
        _check_words(rhythm, target_name, scope, has_impulse="impulse" in strike_fields)
    except TextError as error:
        error.offset += 1
        raise
    strike_fields = {
        "rhythm": rhythm,
        **({"to": target_name} if target_name else {}),
        **strike_fields,
    }
    if transforms_start is not None:
        strike_fields["do"] = checked_transforms(
            text_after[transforms_start:], after_offset + transforms_start, rhythm
        )
    return strike_fields


def _check_words(rhythm_text: str, target_name: str, scope: Scope, *, has_impulse: bool) -> None:
    """Refuse words that name nothing, and those that need a level. Raises TextError."""
    for struck_leaf in compiled_rhythm(rhythm_text, "").leaves:
        struck_name = name_of(struck_leaf)
        if notes_of(struck_name) or struck_name == ANY_WORD:
            if target_name:
                struck_name = target_name
            else:
                message = (
                    f"whose is {quote(struck_name)}? write `to` and an instrument after the rhythm"
                )
                raise TextError(message, offset=struck_leaf.offset, length=len(struck_name))
        part_name = struck_name.split(".")[0]
        error = None
        if part_name not in playable_instruments(scope) and part_name not in scope.keys:
            error = values.unknown_instrument_error(
                part_name,
                "an instrument or a key",
                (*playable_instruments(scope), *scope.keys),
                scope,
            )
        elif part_name not in scope.acts and not has_impulse and level_of(struck_leaf) is None:
            message = (
                f"the impulse is missing: {quote(part_name)} does not say how it is played; write "
            )
            error = TextError(f"{message}it after the rhythm, such as 2mNs", length=len(part_name))
        if error is not None:
            error.offset = struck_leaf.offset
            raise error


def _completions(context: CompletionContext) -> Iterator[Completion]:
    if not context.earlier_words:
        yield Completion('"', 'a rhythm in quotes, such as "kick*4, ~ snare"')
        return
    if not context.earlier_words[0].startswith('"'):
        return
    if "do" in context.earlier_words:
        yield from transform_completions(
            context.earlier_words[context.earlier_words.index("do") + 1 :]
        )
    elif context.earlier_words[-1] in _OPTION_EXAMPLES:
        yield Completion(_OPTION_EXAMPLES[context.earlier_words[-1]], "")
    else:
        names = (*_OPTION_EXAMPLES, "do")
        yield from (Completion(name, "") for name in names if name not in context.earlier_words)


def _read_transforms(text: str, scope: Scope, earlier_values: Mapping[str, Any]) -> str:
    if earlier_values["name"] in scope.players:  # the form before reads it
        raise TextError(f"{quote(earlier_values['name'])} is a player", length=1)
    return text if text == NO_TRANSFORMS else checked_transforms(text, 0, "x")


def _transform_completions(context: CompletionContext) -> Iterator[Completion]:
    if not context.earlier_words:
        yield Completion(NO_TRANSFORMS, "ends all transformations")
    yield from transform_completions(context.earlier_words)


RHYTHM_VALUE = Value('a rhythm in quotes, such as "kick*4"', _read_rhythm, _completions)
DO_VALUE = Value("transformations, such as every 4 rev", _read_transforms, _transform_completions)


def rhythm(name: str, fields: Mapping[str, str], *, when: When, words: Words) -> StrikeModules:
    """Strikes with a rhythm."""
    return StrikeModules(name, fields, when=when, words=words)


# fmt: off
DO_STRIKES_FORM = form("do", "d", "transforms further what strikes play; `none` ends that",
    "rain do every 4 rev, ply 2", DoStrikes,
    Slot("name", "NAME", values.TRANSFORMED_STRIKES),
    Slot("do", "TRANSFORMATION, …|none", DO_VALUE, takes_many=True), begins_with_subject=True)
RHYTHM_FORM = form("=", "=", "plays a rhythm again and again, from here on",
    'd1 = "bell*2 ~ bell" 2mNs', rhythm,
    Slot("name", "NAME", NAMED_VALUE),
    Slot("fields", '"RHYTHM" [LEVEL …] [to INSTRUMENT] [cycle LENGTH] [do …] …',
    RHYTHM_VALUE, takes_many=True), begins_with_subject=True,
    needs_quotes=True)
# fmt: on
