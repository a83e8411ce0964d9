"""Transformations of patterns in cycles: `every 4 rev, off 1/8 transpose 12st, degrade 0.4`.

They act from left to right. One that changes only a part, or a copy, takes the transformation that
follows it, up to the next comma, or several in parentheses: `every 4 (rev, fast 2)`.
"""

from __future__ import annotations

import re
from typing import Any

from ergon.notation.text.errors import TextError, quote
from ergon.notation.text.spelling import nearest
from ergon.scores.pattern import cycle_arguments as read
from ergon.scores.pattern.cycle_forms import CycleTransform, Form, apply
from ergon.scores.pattern.cycle_table import TABLE
from ergon.scores.pattern.cycles import Cycles

__all__ = ["apply", "parse_transforms"]

MAX_TEXT = 4_000  # characters
MAX_TRANSFORMS = 32
_NUMBERS = 1 << 24  # more than the operators of a text: each transformation has as many numbers

# Words of other languages and of gestures, with ours.
_SUGGESTED = {
    "reverse": "rev",
    "mirror": "rev",
    "hurry": "fast",
    "density": "fast",
    "stretch": "slow",
    "shift": "late",
    "stut": "echo",
    "stutter": "ply",
    "gain": "scale",
    "up": "transpose",
    "almostAlways": "often",
    "almostNever": "rarely",
    "staccato": "legato",
    "clip": "legato",
    "rolledBy": "rolled",
    "arpeggiate": "arp",
    "arpeggio": "arp",
    "flam": "grace",
    "tremolando": "tremolo",
}
_NO_SOUND_FILE = "a stroke makes its sound anew, and there is no recording to change"
_REFUSED = {
    "jux": "a struck body sounds where it is, and strokes have no sides; use superimpose",
    "pan": "a struck body sounds where it is; move it by the route of its instrument",
    "chop": f"{_NO_SOUND_FILE}; use ply",
    "striate": f"{_NO_SOUND_FILE}; use ply",
    "speed": f"{_NO_SOUND_FILE}; use transpose or fast",
}


def parse_transforms(text: str, start: int = 0) -> tuple[CycleTransform, ...]:
    """Read transformations. Raises TextError with offsets into the text plus `start`."""
    if len(text) > MAX_TEXT:
        message = f"transformations have at most {MAX_TEXT:,} characters"
        raise TextError(message, offset=start + MAX_TEXT, length=len(text) - MAX_TEXT)
    return _Parser(text, start).chain()


_WORD = re.compile(r"[^\s,()]+")
_VALUE = re.compile(r"[+-]?\.?[0-9][^\s,()]*")
_DEEPER, _HIGHER = "([{<", ")]}>"


class _Parser:
    """Reads a text from left to right; `place` is the next character."""

    def __init__(self, text: str, start: int) -> None:
        self.text = text
        self.start = start
        self.place = 0
        self.count = 0

    def chain(self, opened: int | None = None) -> tuple[CycleTransform, ...]:
        """Transformations up to the end, or to the parenthesis that closes the one at `opened`."""
        transforms = [self.transform()]
        while self.peek() == ",":
            self.place += 1
            transforms.append(self.transform())
        sign = self.peek()
        if sign == ")" and opened is not None:
            self.place += 1
        elif sign == ")":
            raise self.mistake("')' has no '(' before it: every 4 (rev, fast 2)", self.place)
        elif sign:
            before = transforms[-1]
            extra, example = self.word() or sign, TABLE[before.word].example
            message = f"{quote(extra)} does not belong to '{before.word}', which is written for "
            message += f"instance {example}; a comma divides transformations"
            raise self.mistake(message, self.place, len(extra))
        elif opened is not None:
            message = "this '(' is not closed: every 4 (rev, fast 2)"
            raise self.mistake(message, opened)
        return tuple(transforms)

    def transform(self) -> CycleTransform:
        """One transformation, with what it takes."""
        self.peek()
        begin, word = self.place, self.word()
        form = TABLE.get(word)
        if form is None:
            raise self.unknown(word)
        self.count += 1
        if self.count > MAX_TRANSFORMS:
            message = f"a pattern has at most {MAX_TRANSFORMS} transformations; remove some"
            raise self.mistake(message, begin, len(word))
        number = self.count * _NUMBERS
        self.place += len(word)
        values = self.values(form, begin, word)
        if form.takes_rhythm:
            values = (self.rhythm(form, begin, word, number),)
        inner: tuple[CycleTransform, ...] = ()
        if form.takes_change:
            inner = self.inner(form, begin, word)
        length = len(self.text[begin : self.place].rstrip())
        wrong = form.check(*values)
        if wrong is not None:
            raise self.mistake(wrong, begin, length)
        return CycleTransform(word, form, number, values, inner, self.start + begin, length)

    def values(self, form: Form, begin: int, word: str) -> tuple[Any, ...]:
        """The values of the arguments of a transformation."""
        words: list[tuple[str, int]] = []
        while len(words) < len(form.arguments[-1]):
            self.peek()
            value = self.word()
            # A word that is not like a value is read as one only where a value must follow.
            may_end = form.takes_change or any(len(a) == len(words) for a in form.arguments)
            if not value or (may_end and not _VALUE.fullmatch(value)):
                break
            words.append((value, self.place))
            self.place += len(value)
        counts = {len(readers): readers for readers in form.arguments}
        readers = counts.get(len(words))
        if readers is None:
            wanted = form.arguments[0][len(words)].what
            message = f"'{word}' needs {wanted}; write for instance {form.example}"
            raise self.mistake(message, begin, len(word))
        return tuple(
            reader.argument(value, self.start + place, form.example)
            for reader, (value, place) in zip(readers, words, strict=True)
        )

    def rhythm(self, form: Form, begin: int, word: str, number: int) -> Cycles[bool]:
        """The rhythm up to the next comma or parenthesis that is in no brackets of its text."""
        self.peek()
        first, depth = self.place, 0
        while sign := self.text[self.place : self.place + 1]:
            if depth == 0 and sign in ",)":
                break
            depth += (sign in _DEEPER) - (sign in _HIGHER and depth > 0)
            self.place += 1
        if first == self.place:
            message = f"'{word}' needs a rhythm; write for instance {form.example}"
            raise self.mistake(message, begin, len(word))
        return read.parse_beats(self.text[first : self.place], self.start + first, number)

    def inner(self, form: Form, begin: int, word: str) -> tuple[CycleTransform, ...]:
        """The transformation that another takes, or several in parentheses."""
        sign = self.peek()
        if sign == "(":
            self.place += 1
            return self.chain(self.place - 1)
        if sign in ("", ",", ")"):
            message = f"'{word}' needs a transformation after it; write for instance {form.example}"
            raise self.mistake(message, begin, len(word))
        return (self.transform(),)

    def unknown(self, word: str) -> TextError:
        """The mistake of a word that is no transformation."""
        known = ", ".join(TABLE)
        if not word:
            message = f"a transformation is missing here; known are {known}"
            last = len(self.text[: self.place].rstrip()) - 1
            return self.mistake(message, self.place if self.peek() else max(0, last))
        if word in _REFUSED:
            message = f"{quote(word)} is not a transformation here: {_REFUSED[word]}"
            return self.mistake(message, self.place, len(word))
        message = f"unknown transformation {quote(word)}; known are {known}"
        near = _SUGGESTED.get(word) or nearest(word, TABLE)
        return self.mistake(message, self.place, len(word), near)

    def peek(self) -> str:
        """The next character that is not white space; empty at the end."""
        while self.text[self.place : self.place + 1].isspace():
            self.place += 1
        return self.text[self.place : self.place + 1]

    def word(self) -> str:
        """The word that begins here; empty if none does."""
        match = _WORD.match(self.text, self.place)
        return match.group() if match else ""

    def mistake(
        self, message: str, place: int, length: int = 1, near: str | None = None
    ) -> TextError:
        """A mistake at a place of the text."""
        offset = self.start + place
        return TextError(message, offset=offset, length=max(1, length), suggestion=near)
