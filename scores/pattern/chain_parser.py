"""Chains of transformations, read from left to right: `every 4 rev, degrade 0.4`.

One that changes only a part takes the transformation that follows it, up to the next comma, or
several in parentheses: `every 4 (rev, fast 2)`.
"""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from typing import Any, Generic, TypeVar

from ergon.notation.text.errors import TextError, quote
from ergon.scores.pattern.cycle_forms import Form

T = TypeVar("T")

_WORD_PATTERN = re.compile(r"[^\s,()]+")
_VALUE_PATTERN = re.compile(r"[+-]?\.?[0-9][^\s,()]*")


class ChainParser(ABC, Generic[T]):
    """Reads a text from left to right; `place` is the next character."""

    def __init__(self, text: str, start: int = 0, cursor: int = 0) -> None:
        """Take a text; offsets of mistakes count from `start` before it."""
        self.text = text
        self.start = start
        self.cursor = cursor

    @abstractmethod
    def read_transform(self) -> T:
        """One transformation, with what it takes. Raises TextError."""

    @abstractmethod
    def example(self, transform: T) -> tuple[str, str]:
        """The word of a transformation, and an example of it."""

    def read_chain(self, open_offset: int | None = None) -> tuple[T, ...]:
        """Transformations up to the end, or to the parenthesis that closes the one at
        `open_offset`.
        """
        transforms = [self.read_transform()]
        while self.peek() == ",":
            self.cursor += 1
            transforms.append(self.read_transform())
        next_sign = self.peek()
        if next_sign == ")" and open_offset is not None:
            self.cursor += 1
        elif next_sign == ")":
            raise self.mistake("')' has no '(' before it: every 4 (rev, fast 2)", self.cursor)
        elif next_sign:
            previous_transform = transforms[-1]
            extra_word, (word, example) = (
                self.next_word() or next_sign,
                self.example(previous_transform),
            )
            message = f"{quote(extra_word)} does not belong to '{word}', which is written for "
            message += f"instance {example}; a comma divides transformations"
            raise self.mistake(message, self.cursor, len(extra_word))
        elif open_offset is not None:
            message = "this '(' is not closed: every 4 (rev, fast 2)"
            raise self.mistake(message, open_offset)
        return tuple(transforms)

    def read_values(self, form: Form, begin: int, word: str) -> tuple[Any, ...]:
        """The values of the arguments of a transformation."""
        argument_words: list[tuple[str, int]] = []
        while len(argument_words) < len(form.arguments[-1]):
            self.peek()
            argument_word = self.next_word()
            # A word that is not like a value is read as one only where a value must follow.
            may_end = form.takes_change or any(
                len(argument_readers) == len(argument_words) for argument_readers in form.arguments
            )
            if not argument_word or (may_end and not _VALUE_PATTERN.fullmatch(argument_word)):
                break
            argument_words.append((argument_word, self.cursor))
            self.cursor += len(argument_word)
        readers_by_count = {len(readers): readers for readers in form.arguments}
        readers = readers_by_count.get(len(argument_words))
        if readers is None:
            argument_name = form.arguments[0][len(argument_words)].description
            message = f"'{word}' needs {argument_name}; write for instance {form.example}"
            raise self.mistake(message, begin, len(word))
        return tuple(
            reader.read_argument(value, self.start + place, form.example)
            for reader, (value, place) in zip(readers, argument_words, strict=True)
        )

    def read_inner(self, form: Form, begin: int, word: str) -> tuple[T, ...]:
        """The transformation that another takes, or several in parentheses."""
        next_sign = self.peek()
        if next_sign == "(":
            self.cursor += 1
            return self.read_chain(self.cursor - 1)
        if next_sign in ("", ",", ")"):
            message = f"'{word}' needs a transformation after it; write for instance {form.example}"
            raise self.mistake(message, begin, len(word))
        return (self.read_transform(),)

    def peek(self) -> str:
        """The next character that is not white space; empty at the end."""
        while self.text[self.cursor : self.cursor + 1].isspace():
            self.cursor += 1
        return self.text[self.cursor : self.cursor + 1]

    def next_word(self) -> str:
        """The word that begins here; empty if none does."""
        match = _WORD_PATTERN.match(self.text, self.cursor)
        return match.group() if match else ""

    def mistake(
        self, message: str, place: int, length: int = 1, suggestion: str | None = None
    ) -> TextError:
        """A mistake at a place of the text."""
        offset = self.start + place
        return TextError(message, offset=offset, length=max(1, length), suggestion=suggestion)
