"""Patterns of values: notes, scales and chords by name, quantities with units, factors."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from ergon import _core
from ergon.notation.tables import quantities as q
from ergon.notation.tables import tuning
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
    text: str, read: ReadAmount, *, is_pitch: bool = False
) -> tuple[Group, Mapping[str, Amount]]:
    """Read a pattern of values: its order, and the amount of each of its names.

    `read` reads an amount; among pitches `A3.minor` is a scale or a chord. Raises TextError with
    the characters at fault.
    """
    amounts: dict[str, Amount] = {}

    def called(word: str, offset: int) -> str | tuple[str, ...]:
        try:
            is_root = word[:1].isalpha() and "." in tuning.spelled(word)
            if is_pitch and is_root and not word.startswith("x"):
                scale_values = _scale(word)
                amounts.update(scale_values)
                return tuple(scale_values)
            amounts[word] = read(word)
        except TextError as error:
            error.offset += offset
            raise
        return word

    order = parse(text, called)
    return order, amounts


def _scale(word: str) -> dict[str, Amount]:
    root, _, name = tuning.spelled(word).partition(".")
    base = q.frequency(root)
    if name not in SCALES:
        message = f"{quote(name)} is not the name of a scale or a chord"
        near = nearest(name, SCALES)
        raise TextError(
            message, offset=len(word) - len(name), length=max(1, len(name)), suggestion=near
        )
    if not tuning.current().is_plain:
        words = zip(SCALES[name], chord(root, name), strict=True)
        return {f"{word}.{n}": Amount(q.frequency(note)) for n, note in words}
    return {
        f"{word}.{n}": Amount(base * _core.pow(2.0, n / 12.0) if n else base) for n in SCALES[name]
    }
