"""The order in which a pattern plays: `knock lean knock`, `knock (lean lean) ~`, `choose a b c`.

    pattern := [choose | walk | shuffle] item+
    item    := (name | '~' | '(' pattern ')') ['*' count]

Every item of the outermost pattern takes one step, `~` rests for one. A group takes one step
too, which its items share evenly; a group with a count is repeated, and each of its items takes
a step, as in the gesture notation. `choose` and `walk` play one of their items in each round and
take one step; `shuffle` plays all of them in a new order in each round.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Literal, NamedTuple, get_args

from ergon.notation.tables.shapes import NAME
from ergon.notation.text.errors import TextError
from ergon.notation.text.spelling import nearest

Choice = Literal["in turn", "choose", "walk", "shuffle"]
# Ways to choose that have a keyword; `in turn` is the default.
CHOICE_WORDS: tuple[Choice, ...] = get_args(Choice)[1:]

REST = "~"
MAX_DEPTH = 8  # groups inside groups, as in the notation of gestures
MAX_PLACES = 10_000  # places of a round
_TOO_MANY_MESSAGE = f"this pattern has more than {MAX_PLACES:,} places in a round"

_TOKEN = re.compile(r"(\()|(\)|[^\s()*]+)(?:\s*+\*\s*+([^\s()]*+))?|(\*)")


@dataclass(frozen=True, slots=True)
class Leaf:
    """One name, or a rest (None)."""

    name: str | None
    span: int = 1
    places: int = 1


@dataclass(frozen=True, slots=True)
class Group:
    """Items that share `span` steps; `site` identifies the group in random draws.

    `steps` is how many steps the group would take if it stood alone, `places` the largest number
    of items that begin in one round.
    """

    way: Choice
    items: tuple[Leaf | Group, ...]
    site: int
    span: int
    steps: int
    places: int

    @property
    def is_steady(self) -> bool:
        """Whether items begin at the same instants in each round, whatever is drawn."""
        if self.way == "in turn":
            return all(isinstance(item, Leaf) or item.is_steady for item in self.items)
        return all(isinstance(item, Leaf) for item in self.items)

    def leaves(self) -> Iterator[Leaf]:
        """All names that may be played, in the order written."""
        for group_item in self.items:
            if isinstance(group_item, Group):
                yield from group_item.leaves()
            elif group_item.name is not None:
                yield group_item


ReadName = Callable[[str, int], str | tuple[str, ...]]


class _OpenBracket(NamedTuple):
    """A bracket that is not closed yet."""

    offset: int
    way: list[Choice]
    # Each with its count and the offset of its first character.
    items: list[tuple[Leaf | _OpenBracket, int | None, int]]


def parse(pattern_text: str, read_name: ReadName | None = None) -> Group:
    """Read a pattern; `read_name` returns the name or names that a word at an offset stands for.

    Without `read_name` words are names of gestures and takes. Raises TextError with the characters
    at fault.
    """
    read_name = read_name or name_of
    stripped_text = pattern_text.strip()
    if stripped_text in CHOICE_WORDS:  # the name of a gesture
        name = read_name(stripped_text, pattern_text.index(stripped_text))
        return single_name_pattern(name if isinstance(name, str) else stripped_text)
    stack = [_OpenBracket(0, ["in turn"], [])]
    for token_match in _TOKEN.finditer(pattern_text):
        opened, typed_word, item_count, star = token_match.groups()
        open_group = stack[-1]
        if star:
            message = "'*' repeats the name or the group before it: knock*2, (knock lean)*2"
            raise TextError(message, offset=token_match.start(4))
        if opened:
            if len(stack) > MAX_DEPTH:
                message = f"groups are nested more than {MAX_DEPTH} deep"
                raise TextError(message, offset=token_match.start())
            stack.append(_OpenBracket(token_match.start(), ["in turn"], []))
            continue
        n_repeats = (
            None if item_count is None else _repetition_count(item_count, token_match.start(3))
        )
        if typed_word != ")":
            choice = _choice_of_sign(typed_word)
            if choice is not None and not open_group.items and open_group.way == ["in turn"]:
                open_group.way[:] = [choice]
                continue
            word_offset = token_match.start(2)
            leaves = _leaves_of_word(typed_word, word_offset, read_name)
            if (n_repeats or 1) * len(leaves) > MAX_PLACES:
                raise TextError(_TOO_MANY_MESSAGE, offset=word_offset, length=len(typed_word))
            for _ in range(n_repeats or 1):  # several names of one word are repeated together
                open_group.items.extend((leaf, None, word_offset) for leaf in leaves)
            continue
        if len(stack) == 1:
            raise TextError("')' has no '(' before it", offset=token_match.start(2))
        _check_not_empty(stack.pop())
        stack[-1].items.append((open_group, n_repeats, open_group.offset))
    if len(stack) > 1:
        raise TextError("this group is not closed; write ( … )", offset=stack[-1].offset)
    _check_not_empty(stack[0], len(pattern_text))
    return _GroupBuilder().build_group(stack[0], 1)


def single_name_pattern(name: str) -> Group:
    """The pattern of one name."""
    return Group("in turn", (Leaf(name),), 0, 1, 1, 1)


def _choice_of_sign(word: str) -> Choice | None:
    return next((choice_word for choice_word in CHOICE_WORDS if choice_word == word), None)


def _leaves_of_word(typed_word: str, word_offset: int, name_reader: ReadName) -> list[Leaf]:
    if typed_word == REST:
        return [Leaf(None)]
    if typed_word in CHOICE_WORDS:
        message = (
            f"'{typed_word}' must be at the beginning of a pattern or a group: ({typed_word} knock "
            "lean)"
        )
        raise TextError(message, offset=word_offset, length=len(typed_word))
    names = name_reader(typed_word, word_offset)
    return [Leaf(names)] if isinstance(names, str) else [Leaf(name) for name in names]


def name_of(leaf_word: str, word_offset: int) -> str:
    """The word, if it may be the name of a gesture or a take. Raises TextError."""
    if not all(NAME.fullmatch(part) for part in leaf_word.split(".")):
        message = f"'{leaf_word[:40]}' is not the name of a gesture or a take"
        suggestion = nearest(leaf_word, CHOICE_WORDS)
        raise TextError(message, offset=word_offset, length=len(leaf_word), suggestion=suggestion)
    return leaf_word


def _repetition_count(count_text: str, word_offset: int) -> int:
    if not re.fullmatch(r"[0-9]{1,5}", count_text) or not 1 <= int(count_text) <= MAX_PLACES:
        message = (
            f"'{count_text[:40]}' is not a number of repetitions; write knock*2 or (knock lean)*2"
        )
        raise TextError(message, offset=word_offset, length=max(1, len(count_text)))
    return int(count_text)


def _check_not_empty(group: _OpenBracket, group_length: int = 1) -> None:
    if not group.items:
        choice = group.way[0]
        subject = "this group" if choice == "in turn" else f"'{choice}'"
        message = f"{subject} has no names; write for instance {choice} knock lean"
        if choice == "in turn":
            message = f"{subject} has no names; write for instance (knock lean)"
        raise TextError(message, offset=group.offset, length=max(1, group_length))


class _GroupBuilder:
    """Expands repetition counts, and numbers the groups."""

    def __init__(self) -> None:
        self.n_sites = 0
        self.n_places = 0

    def build_group(self, open_group: _OpenBracket, span: int | None) -> Group:
        """A group that takes `span` steps; None: as many as it has."""
        group_choice, site = open_group.way[0], self.n_sites
        self.n_sites += 1
        group_items: list[Leaf | Group] = []
        for open_item, item_count, word_offset in open_group.items:
            for _ in range(item_count or 1):
                if isinstance(open_item, Leaf):
                    group_items.append(open_item)
                    self.n_places += 1
                else:
                    group_items.append(self.build_group(open_item, None if item_count else 1))
                if self.n_places > MAX_PLACES:
                    raise TextError(_TOO_MANY_MESSAGE, offset=word_offset)
        if group_choice in ("choose", "walk"):
            steps, places = 1, max(item.places for item in group_items)
        else:
            steps = sum(item.span for item in group_items)
            places = sum(item.places for item in group_items)
        return Group(group_choice, tuple(group_items), site, span or steps, steps, places)
