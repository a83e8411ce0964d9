"""The `do` of what a player plays: `rev, every 4 (fast 2, mirror), degrade 0.3`.

Words that change some rounds or some places by chance are written as those of rhythms are; the
others are the transformations of gestures.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Container, Iterable, Mapping
from dataclasses import dataclass, replace
from itertools import takewhile

from ergon.notation.text.errors import TextError, quote
from ergon.scores.gesture.transforms import ARGUMENT_COUNTS, EXAMPLES, Transform, parse_transform
from ergon.scores.pattern.chain_parser import ChainParser
from ergon.scores.pattern.cycle_forms import HALF
from ergon.scores.pattern.cycle_table import FORM_BY_WORD
from ergon.scores.pattern.cycle_transforms import MAX_TRANSFORMS
from ergon.scores.pattern.turns import Rule, Turn, iterations

Change = Transform | Turn

_SEGMENT = re.compile(r"[^,()]*")
_WORD = re.compile(r"\S+")


@dataclass(frozen=True, slots=True)
class TurnForm:
    """A word that changes some of what is played: what it does, an example, and its rule."""

    description: str
    example: str
    rule: Callable[..., Rule]


def _sometimes(probability: float = HALF) -> Rule:
    return Rule("sometimes", (float(probability),))


TURN_FORMS: Mapping[str, TurnForm] = {
    "palindrome": TurnForm(
        "every second round backwards", "palindrome", lambda: Rule("whenmod", (2, 1))
    ),
    "every": TurnForm(
        "a change of the first of every so many rounds",
        "every 4 rev",
        lambda period: Rule("every", (period,)),
    ),
    "whenmod": TurnForm(
        "a change of those of every so many rounds that have at least a number, from 0",
        "whenmod 4 3 mirror",
        lambda period, least: Rule("whenmod", (period, least)),
    ),
    "iter": TurnForm(
        "each round of a pattern begins one of so many shares of its names later",
        "iter 4",
        lambda shares: Rule("iter", (shares,)),
    ),
    "chunk": TurnForm(
        "a change of one of so many shares of a round: the first, then the second, and so on",
        "chunk 4 mirror",
        lambda shares: Rule("chunk", (shares,)),
    ),
    "sometimes": TurnForm(
        "a change of half of the gestures, or of the share before it, by chance",
        "sometimes 0.3 rev",
        _sometimes,
    ),
    "often": TurnForm(
        "a change of three quarters of the gestures, by chance",
        "often scale 0.5",
        lambda: _sometimes(0.75),
    ),
    "rarely": TurnForm(
        "a change of a quarter of the gestures, by chance",
        "rarely fast 2",
        lambda: _sometimes(0.25),
    ),
    "degrade": TurnForm(
        "without half of the gestures, or the share after it, by chance", "degrade 0.4", _sometimes
    ),
}
# Transformations that change what is played without another one behind them.
_TRANSFORMS_BY_WORD: Mapping[str, tuple[Transform, ...]] = {
    "palindrome": (Transform("rev"),),
    "degrade": (),
    "iter": (),
}
_EXAMPLE_BY_WORD = {word: form.example for word, form in TURN_FORMS.items()}


def parse_chain(text: str) -> tuple[Change, ...]:
    """Read transformations separated by commas. Raises TextError."""
    return _Parser(text).read_chain()


def parse_change(change_text: str) -> Change:
    """Read one transformation. Raises TextError."""
    chain = parse_chain(change_text)
    if len(chain) > 1:
        message = (
            f"{quote(change_text)} is not one transformation; write one in each item of a list"
        )
        raise TextError(message, length=len(change_text))
    return chain[0]


def parse_first(
    pattern_text: str, text_place: int, text_start: int, other_words: Container[str]
) -> tuple[Change, int]:
    """Read the transformation at a place of a text, and where it ends: at the latest at one of
    `other_words`, which are no values. Raises TextError.
    """
    parser = _Parser(pattern_text, text_start, text_place, other_words)
    change = parser.read_transform()
    return change, len(pattern_text[: parser.cursor].rstrip())


def is_turn(text: str) -> bool:
    """Whether a transformation changes only some of what is played."""
    return next(iter(text.split()), "") in TURN_FORMS


def as_turns(chain: Iterable[Change]) -> tuple[tuple[Transform, ...], tuple[Turn, ...]]:
    """The transformations up to the first that changes only some places, and the others as
    turns.
    """
    leading_transforms: list[Transform] = []
    later_turns: list[Turn] = []
    for change in chain:
        if later_turns or isinstance(change, Turn):
            later_turns.append(as_turn(change))
        else:
            leading_transforms.append(change)
    return tuple(leading_transforms), tuple(later_turns)


def as_turn(change: Change) -> Turn:
    """A change as a turn; a transformation is one of all rounds."""
    return change if isinstance(change, Turn) else Turn(1, (change,))


def split_chain(chain_text: str) -> tuple[str, ...]:
    """The texts of transformations, parted by the commas that are in no parentheses."""
    depth, chain_parts = 0, [""]
    for chain_sign in chain_text:
        depth += (chain_sign == "(") - (chain_sign == ")")
        if chain_sign == "," and depth == 0:
            chain_parts.append("")
        else:
            chain_parts[-1] += chain_sign
    return tuple(part.strip() for part in chain_parts)


class _Parser(ChainParser[Change]):
    """Reads the changes of a chain.

    Among `other_words`, the words of a line, a transformation takes no more words than it has
    values.
    """

    def __init__(
        self, text: str, start: int = 0, place: int = 0, other_words: Container[str] | None = None
    ) -> None:
        super().__init__(text, start, place)
        self.other_words = other_words
        self.n_transforms = 0

    def read_transform(self) -> Change:
        """One transformation, with what it takes."""
        self.peek()
        begin_place, typed_word = self.cursor, self.next_word()
        change_form = TURN_FORMS.get(typed_word)
        if change_form is None:
            return self.read_gesture_transform()
        self.n_transforms += 1
        if self.n_transforms > MAX_TRANSFORMS:
            message = f"a line has at most {MAX_TRANSFORMS} transformations of rounds; remove some"
            raise self.mistake(message, begin_place, len(typed_word))
        form_with_example = replace(FORM_BY_WORD[typed_word], example=change_form.example)
        self.cursor += len(typed_word)
        rule = change_form.rule(*self.read_values(form_with_example, begin_place, typed_word))
        inner_change = (
            _TRANSFORMS_BY_WORD[typed_word]
            if typed_word in _TRANSFORMS_BY_WORD
            else self.read_inner(form_with_example, begin_place, typed_word)
        )
        if any(True for _ in iterations(turn for turn in inner_change if isinstance(turn, Turn))):
            message = f"'iter' changes the order of all rounds; write it before '{typed_word}': "
            raise self.mistake(
                f"{message}iter 4, {change_form.example}", begin_place, len(typed_word)
            )
        length = len(self.text[begin_place : self.cursor].rstrip())
        is_rest = typed_word == "degrade"
        return Turn(1, inner_change, rule, is_rest, self.start + begin_place, length)

    def read_gesture_transform(self) -> Transform:
        """A transformation of a gesture itself."""
        match = _SEGMENT.match(self.text, self.cursor)
        transform_text = match.group() if match else ""
        if self.other_words is not None:
            word_matches = [*_WORD.finditer(transform_text)]
            count = 1 + ARGUMENT_COUNTS.get(word_matches[0].group(), 0) if word_matches else 0
            value_words = takewhile(self.is_value, word_matches[1:count])
            words_taken = [*word_matches[:1], *value_words]
            transform_text = transform_text[: words_taken[-1].end()] if words_taken else ""
        begin = self.cursor
        self.cursor += len(transform_text)
        return parse_transform(transform_text, self.start + begin, _EXAMPLE_BY_WORD)

    def is_value(self, word: re.Match[str]) -> bool:
        """Whether a word may be a value of a transformation."""
        return self.other_words is None or word.group() not in self.other_words

    def example(self, transform: Change) -> tuple[str, str]:
        """The word of a transformation, and an example of it."""
        begin = transform.offset - self.start
        word = self.text[begin:].split()[0].rstrip(",()")
        return word, TURN_FORMS[word].example if word in TURN_FORMS else EXAMPLES[word]
