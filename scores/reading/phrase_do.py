"""Transformations of a phrase: of its entries first, then those of rhythms."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TypeVar

from ergon.notation.tables.compound import Either, ListOf
from ergon.notation.tables.fields import Values
from ergon.notation.tables.named_values import parse_with_names
from ergon.notation.tables.shapes import Text
from ergon.notation.text.errors import TextError, quote
from ergon.scores.gesture.transforms import (
    GESTURE_ARGUMENT_COUNTS,
    MEANINGS,
    Transform,
    parse_transform,
)
from ergon.scores.pattern.cycle_table import FORM_BY_WORD
from ergon.scores.pattern.cycle_transforms import parse_transforms


def split_transforms(chain_text: str, is_rhythm: bool = False) -> tuple[tuple[Transform, ...], str]:
    """The transformations of entries in `stretch 2, every 4 rev`, and those of rhythms as a text.

    From the first that only rhythms have on (`is_rhythm`: from the beginning) all are of rhythms.
    Raises TextError.
    """
    gesture_transforms: list[Transform] = []
    part_start = 0
    while part_start <= len(chain_text):
        stop = chain_text.find(",", part_start)
        part_text = chain_text[part_start : stop if stop >= 0 else len(chain_text)]
        word = next(iter(part_text.split()), "")
        if is_rhythm or (word in FORM_BY_WORD and word not in GESTURE_ARGUMENT_COUNTS):
            parse_transforms(chain_text[part_start:], part_start)
            return tuple(gesture_transforms), chain_text[part_start:].strip()
        gesture_transforms.append(parse_transform(part_text, part_start))
        part_start += len(part_text) + 1
    return tuple(gesture_transforms), ""


def _parse_entries_transforms(chain_text: str) -> tuple[Transform, ...]:
    """The transformations of a phrase itself. Raises TextError for those of rhythms."""
    chain, rhythm_text = split_transforms(chain_text)
    if rhythm_text:
        first_word = rhythm_text.split()[0]
        message = (
            f"{quote(first_word)} is of rhythms; write it in `do` of the strikes that play the "
            "phrase"
        )
        raise TextError(message, offset=chain_text.index(rhythm_text), length=len(first_word))
    return chain


def _parse_entry_transforms(entry_text: str) -> Transform:
    chain = _parse_entries_transforms(entry_text)
    if len(chain) != 1:
        message = f"{quote(entry_text)} is not one transformation; write one in each item of a list"
        raise TextError(message, length=len(entry_text))
    return chain[0]


_EXAMPLE_TEXT = "such as stretch 2, reverse"
# The `do` of a phrase.
DO = Either(
    scalar=Text(
        _parse_entries_transforms,
        f"transformations, {_EXAMPLE_TEXT}",
        types=("string",),
        has_values=True,
        meanings=MEANINGS,
    ),
    sequence=ListOf(
        Text(
            _parse_entry_transforms,
            "a transformation, such as reverse",
            types=("string",),
            has_values=True,
            meanings=MEANINGS,
        )
    ),
)


def phrase_transforms(phrase_values: Values) -> tuple[tuple[Transform, ...], str] | None:
    """The transformations of strikes that play a phrase, as `split_transforms` returns them; None
    if an error was reported.
    """
    rhythm_texts: list[str] = []

    def parse(text: str) -> tuple[Transform, ...]:
        phrase_chain, rhythm_text = split_transforms(text, is_rhythm=bool(rhythm_texts))
        rhythm_texts.extend([rhythm_text] if rhythm_text else [])
        return phrase_chain

    phrase_chain = read_transforms(phrase_values, parse)
    return None if phrase_chain is None else (tuple(phrase_chain), ", ".join(rhythm_texts))


def rhythm_transforms(strike_values: Values) -> str | None:
    """The transformations of a rhythm as one text, without names of values; None if an error was
    reported.
    """

    def parse(text: str) -> tuple[str]:
        parse_transforms(text)
        return (text,)

    texts = read_transforms(strike_values, parse)
    return None if texts is None else ", ".join(texts)


_Transform = TypeVar("_Transform")


def read_transforms(
    strike_values: Values, parse: Callable[[str], Iterable[_Transform]]
) -> list[_Transform] | None:
    """The transformations of strikes, as `parse` reads a text; None if an error was reported."""
    all_transforms: list[_Transform] = []
    for text_node in strike_values["do"] or ():
        try:
            all_transforms += parse_with_names(text_node, parse)
        except TextError as error:
            strike_values.context.text_error(error, text_node, "do")
            return None
    return all_transforms
