"""Transformations of some of what is played: `4th do mirror`, `every 4 rev`, `sometimes 0.3 rev`.

Rounds and draws by chance decide: a round is one pass through the names of a pattern.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import count
from math import floor
from typing import NamedTuple

from ergon.notation.text.errors import TextError
from ergon.scores.gesture.transforms import ARGUMENT_COUNTS, Transform, parse_transform

ORDINAL = re.compile(r"([0-9]{1,4})(?:st|nd|rd|th)")
_CLAUSE = re.compile(rf"\s*+(?:{ORDINAL.pattern})\s++do(?:\s++|$)")
_NEXT = re.compile(rf"(?<=\s)every\s+(?={ORDINAL.pattern}(?:\s|$))")
_OMIT_EMPTY = {"hash_omits_empty": True}
# One transformation: from its word up to a comma or to the word of the next transformation.
_RULE_WORDS = "|".join(ARGUMENT_COUNTS)
_TRANSFORM = re.compile(rf"[^\s,]+(?:\s+(?!(?:{_RULE_WORDS})(?:[\s,]|$))[^\s,]+)*")


@dataclass(frozen=True, slots=True)
class Rule:
    """A rule that selects places for a change, by the word of a transformation and its values.

    `number` is that of its draws by chance.
    """

    word: str
    values: tuple[float, ...] = ()
    number: int = 0


@dataclass(frozen=True, slots=True)
class Turn:
    """Transformations of every nth round, or of the places that a rule names.

    What `leaves_out` a place plays nothing there. `offset` and `length` are its place in the text.
    """

    nth: int
    do: tuple[Transform | Turn, ...]
    rule: Rule | None = field(default=None, metadata=_OMIT_EMPTY)
    leaves_out: bool = field(default=False, metadata=_OMIT_EMPTY)
    offset: int = field(default=0, metadata=_OMIT_EMPTY)
    length: int = field(default=0, metadata=_OMIT_EMPTY)

    def transforms(self) -> Iterator[Transform]:
        """All transformations that it may do."""
        for inner in self.do:
            yield from inner.transforms() if isinstance(inner, Turn) else (inner,)


class Occasion(NamedTuple):
    """A place of a pattern: its round from 0, and how much of the round is over (0 to 1).

    `draw(number, probability)` decides by chance whether an event with this probability happens.
    """

    round: int
    share: float
    draw: Callable[[int, float], bool]


_RULE_TESTS: Mapping[str, Callable[[Rule, Occasion], bool]] = {
    "every": lambda rule, occasion: occasion.round % rule.values[0] == 0,
    "whenmod": lambda rule, occasion: occasion.round % rule.values[0] >= rule.values[1],
    "chunk": lambda rule, occasion: (
        floor(occasion.share * rule.values[0] + _SHARE_TOLERANCE) == occasion.round % rule.values[0]
    ),
    "sometimes": lambda rule, occasion: occasion.draw(rule.number, rule.values[0]),
    "iter": lambda *_: True,  # see `iterations`
}
_SHARE_TOLERANCE = 1e-9


def due_transforms(turns: Iterable[Turn], occasion: Occasion) -> Iterator[Transform | None]:
    """The transformations of a place, left to right; None where one leaves the place out."""
    for turn in turns:
        rule = turn.rule
        if (occasion.round + 1) % turn.nth or not (
            rule is None or _RULE_TESTS[rule.word](rule, occasion)
        ):
            continue
        if turn.leaves_out:
            yield None
        for inner in turn.do:
            if isinstance(inner, Turn):
                yield from due_transforms((inner,), occasion)
            else:
                yield inner


def iterations(turns: Iterable[Turn]) -> Iterator[int]:
    """The shares of a pattern by which `iter` begins each round later."""
    for turn in turns:
        if turn.rule is not None and turn.rule.word == "iter":
            yield int(turn.rule.values[0])


def with_numbers(turns: Iterable[Turn], numbers: Iterator[int] | None = None) -> tuple[Turn, ...]:
    """The turns with their rules numbered in the order written, so that each rule has draws of
    its own.
    """
    numbers = numbers or count(1)
    return tuple([_with_rule_number(turn, numbers) for turn in turns])


def _with_rule_number(turn: Turn, turn_numbers: Iterator[int]) -> Turn:
    rule = turn.rule and replace(turn.rule, number=next(turn_numbers))
    numbered_transforms = [
        _with_rule_number(transform, turn_numbers) if isinstance(transform, Turn) else transform
        for transform in turn.do
    ]
    return replace(turn, do=tuple(numbered_transforms), rule=rule)


def parse(pattern_text: str, text_start: int = 0) -> tuple[Turn, ...]:
    """Read `4th do mirror`, and further clauses that begin with `every`.

    Raises TextError with offsets into the text plus `text_start`.
    """
    parsed_turns = []
    clause_offset = 0
    for next_match in (*_NEXT.finditer(pattern_text), None):
        clause_text = pattern_text[
            clause_offset : next_match.start() if next_match else len(pattern_text)
        ]
        parsed_turns.append(_parse_clause(clause_text, text_start + clause_offset))
        clause_offset = next_match.end() if next_match else 0
    return tuple(parsed_turns)


def _parse_clause(pattern_text: str, text_start: int) -> Turn:
    match = _CLAUSE.match(pattern_text)
    if match is None or int(match[1]) == 0:
        message = f"'{pattern_text.strip()[:40]}' is not written like 4th do mirror"
        raise TextError(message, offset=text_start, length=max(1, len(pattern_text.strip())))
    transforms = []
    for verb_match in _TRANSFORM.finditer(pattern_text, match.end()):
        transforms.append(parse_transform(verb_match.group(), text_start + verb_match.start()))
    if not transforms or pattern_text.rstrip().endswith(","):
        raise TextError(
            "'do' needs a transformation: 4th do mirror", offset=text_start + len(pattern_text) - 1
        )
    return Turn(int(match[1]), tuple(transforms))
