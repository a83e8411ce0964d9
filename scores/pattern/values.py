"""Patterns of values: notes, scales and chords by name, quantities with units, factors."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from ergon import _core
from ergon.notation.tables import quantities, tuning
from ergon.notation.tables.notes import SCALES, chord
from ergon.notation.text.errors import TextError, quote
from ergon.notation.text.spelling import nearest
from ergon.scores.pattern.order import Group, parse


@dataclass(frozen=True, slots=True)
class Amount:
    """A value in SI units, or a factor of the parameter's own value."""

    value: float
    is_factor: bool = False

    def applied_to(self, value: float) -> float:
        """The value, given the parameter's own."""
        return self.value * value if self.is_factor else self.value


ReadAmount = Callable[[str], Amount]


def parse_values(
    values_text: str, read_amount: ReadAmount, *, is_pitch: bool = False
) -> tuple[Group, Mapping[str, Amount]]:
    """Read a pattern of values: its order, and the amount of each of its names.

    `read_amount` reads an amount; among pitches `A3.minor` is a scale or a chord. Raises TextError
    with the characters at fault.
    """
    amounts: dict[str, Amount] = {}

    def read_name(typed_word: str, word_offset: int) -> str | tuple[str, ...]:
        try:
            is_root = typed_word[:1].isalpha() and "." in tuning.spelled(typed_word)
            if is_pitch and is_root and not typed_word.startswith("x"):
                scale_values = _scale(typed_word)
                amounts.update(scale_values)
                return tuple(scale_values)
            amounts[typed_word] = read_amount(typed_word)
        except TextError as error:
            error.offset += word_offset
            raise
        return typed_word

    pattern_order = parse(values_text, read_name)
    return pattern_order, amounts


def _scale(scale_word: str) -> dict[str, Amount]:
    root_note, _, scale_name = tuning.spelled(scale_word).partition(".")
    base_frequency = quantities.frequency(root_note)
    if scale_name not in SCALES:
        message = f"{quote(scale_name)} is not the name of a scale or a chord"
        suggestion = nearest(scale_name, SCALES)
        raise TextError(
            message,
            offset=len(scale_word) - len(scale_name),
            length=max(1, len(scale_name)),
            suggestion=suggestion,
        )
    if not tuning.current().is_plain:
        words = zip(SCALES[scale_name], chord(root_note, scale_name), strict=True)
        return {f"{scale_word}.{n}": Amount(quantities.frequency(note)) for n, note in words}
    return {
        f"{scale_word}.{n}": Amount(
            base_frequency * _core.pow(2.0, n / 12.0) if n else base_frequency
        )
        for n in SCALES[scale_name]
    }
