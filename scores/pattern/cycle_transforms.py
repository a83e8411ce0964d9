"""Transformations of patterns in cycles: `every 4 rev, off 1/8 transpose 12st, degrade 0.4`.

They act from left to right. One that changes only a part, or a copy, takes the transformation that
follows it, up to the next comma, or several in parentheses: `every 4 (rev, fast 2)`.
"""

from __future__ import annotations

from ergon.notation.text.errors import TextError, quote
from ergon.notation.text.spelling import nearest
from ergon.scores.pattern import cycle_arguments as read
from ergon.scores.pattern.chain_parser import ChainParser
from ergon.scores.pattern.cycle_forms import CycleTransform, Form, apply
from ergon.scores.pattern.cycle_table import FORM_BY_WORD
from ergon.scores.pattern.cycles import Cycles

__all__ = ["apply", "parse_transforms"]

MAX_TEXT = 4_000  # characters
MAX_TRANSFORMS = 32
# More than the operators of a text: each transformation has as many numbers.
_OPERATOR_NUMBERS_PER_TRANSFORM = 1 << 24

# Words of other languages and of gestures, with ours.
_SUGGESTED_WORDS = {
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
_NO_SOUND_FILE_REASON = "a stroke makes its sound anew, and there is no recording to change"
_REASON_BY_REFUSED_WORD = {
    "jux": "a struck body sounds where it is, and strokes have no sides; use superimpose",
    "pan": "a struck body sounds where it is; move it by the route of its instrument",
    "chop": f"{_NO_SOUND_FILE_REASON}; use ply",
    "striate": f"{_NO_SOUND_FILE_REASON}; use ply",
    "speed": f"{_NO_SOUND_FILE_REASON}; use transpose or fast",
}


def parse_transforms(transforms_text: str, text_start: int = 0) -> tuple[CycleTransform, ...]:
    """Read transformations. Raises TextError with offsets into the text plus `text_start`."""
    if len(transforms_text) > MAX_TEXT:
        message = f"transformations have at most {MAX_TEXT:,} characters"
        raise TextError(
            message, offset=text_start + MAX_TEXT, length=len(transforms_text) - MAX_TEXT
        )
    return _Parser(transforms_text, text_start).read_chain()


_OPENING_BRACKETS, _CLOSING_BRACKETS = "([{<", ")]}>"


class _Parser(ChainParser[CycleTransform]):
    """Reads transformations of cycles, and counts them."""

    def __init__(self, text: str, start: int) -> None:
        super().__init__(text, start)
        self.n_transforms = 0

    def example(self, transform: CycleTransform) -> tuple[str, str]:
        """The word of a transformation, and an example of it."""
        return transform.word, transform.form.example

    def read_transform(self) -> CycleTransform:
        """One transformation, with what it takes."""
        self.peek()
        begin_place, typed_word = self.cursor, self.next_word()
        transform_form = FORM_BY_WORD.get(typed_word)
        if transform_form is None:
            raise self.unknown_word_error(typed_word)
        self.n_transforms += 1
        if self.n_transforms > MAX_TRANSFORMS:
            message = f"a pattern has at most {MAX_TRANSFORMS} transformations; remove some"
            raise self.mistake(message, begin_place, len(typed_word))
        first_number = self.n_transforms * _OPERATOR_NUMBERS_PER_TRANSFORM
        self.cursor += len(typed_word)
        transform_values = self.read_values(transform_form, begin_place, typed_word)
        if transform_form.takes_rhythm:
            transform_values = (
                self.read_rhythm(transform_form, begin_place, typed_word, first_number),
            )
        inner_transforms: tuple[CycleTransform, ...] = ()
        if transform_form.takes_change:
            inner_transforms = self.read_inner(transform_form, begin_place, typed_word)
        transform_length = len(self.text[begin_place : self.cursor].rstrip())
        mistake = transform_form.check(*transform_values)
        if mistake is not None:
            raise self.mistake(mistake, begin_place, transform_length)
        return CycleTransform(
            typed_word,
            transform_form,
            first_number,
            transform_values,
            inner_transforms,
            self.start + begin_place,
            transform_length,
        )

    def read_rhythm(self, form: Form, begin: int, word: str, number: int) -> Cycles[bool]:
        """The rhythm up to the next comma or parenthesis that is in no brackets of its text."""
        self.peek()
        start_place, depth = self.cursor, 0
        while next_sign := self.text[self.cursor : self.cursor + 1]:
            if depth == 0 and next_sign in ",)":
                break
            depth += (next_sign in _OPENING_BRACKETS) - (
                next_sign in _CLOSING_BRACKETS and depth > 0
            )
            self.cursor += 1
        if start_place == self.cursor:
            message = f"'{word}' needs a rhythm; write for instance {form.example}"
            raise self.mistake(message, begin, len(word))
        return read.parse_beats(
            self.text[start_place : self.cursor], self.start + start_place, number
        )

    def unknown_word_error(self, word: str) -> TextError:
        """The mistake of a word that is no transformation."""
        verb_names = ", ".join(FORM_BY_WORD)
        if not word:
            message = f"a transformation is missing here; known are {verb_names}"
            last_offset = len(self.text[: self.cursor].rstrip()) - 1
            return self.mistake(message, self.cursor if self.peek() else max(0, last_offset))
        if word in _REASON_BY_REFUSED_WORD:
            message = f"{quote(word)} is not a transformation here: {_REASON_BY_REFUSED_WORD[word]}"
            return self.mistake(message, self.cursor, len(word))
        message = f"unknown transformation {quote(word)}; known are {verb_names}"
        suggestion = _SUGGESTED_WORDS.get(word) or nearest(word, FORM_BY_WORD)
        return self.mistake(message, self.cursor, len(word), suggestion)
