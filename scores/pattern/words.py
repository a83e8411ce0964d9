"""A play in words: `lean every 8 times 2 do scale 0.5, mirror until C layer`, `knock lean every 1`.

The words are the fields of a part and the transformations; the REPL reads the same words after
`plays`, and a row of a part's table has them after its position.
"""

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

from ergon.notation.tables.strengths import is_level
from ergon.notation.text.errors import TextError
from ergon.notation.text.spelling import nearest
from ergon.scores.gesture.transforms import ARGUMENTS, ARITY
from ergon.scores.pattern.order import Group, name_of
from ergon.scores.pattern.order import parse as parse_order
from ergon.scores.pattern.turn_chain import Change, parse_first
from ergon.scores.pattern.turns import ORDINAL
from ergon.scores.pattern.turns import parse as parse_turns

Called = Callable[[str, int], str]

# Options, each with an example of its value; None for a flag.
OPTIONS = {
    "at": "A",
    "every": "1",
    "times": "8",
    "until": "C",
    "chance": "0.6",
    "euclid": "3 8",
    "swing": "0.6",
    "skip": "5",
    "touch": "tracked",
    "ergons": "particle",
    "grain": "5ms",
    "join": "20ms",
    "force_limit": "5N",
    "rate": "4kHz",
    "layer": None,
}
# The option that is written `every 4th do mirror`: it has no keyword of its own.
NTH = "nth"
# Options of a pattern that may also be names of gestures: the first word of a play is a name.
_PATTERN_WORDS = ("chance", "euclid", "swing", "skip")
_KNOWN = (*OPTIONS, "do", *ARITY)
_SIGNS = frozenset(",()*~")  # signs that a single name does not have
_WORD = re.compile(r",|[^\s,]+")
_COMMENT = re.compile(r"(?:^|(?<=\s))#.*")


class Word(NamedTuple):
    """A value as written, and where it begins in the text."""

    text: str
    offset: int


@dataclass(frozen=True, slots=True)
class PlayWords:
    """What is played, its options as written (a flag is `true`), and its transformations.

    `order` is what is played as a pattern; None if that is one name.
    """

    what: Word
    options: dict[str, Word]
    do: tuple[Change, ...] = ()
    order: Group | None = None


@dataclass(frozen=True, slots=True)
class Row:
    """A row of a part's table: a position, and what is played there."""

    at: Word
    play: PlayWords


def parse(text: str, start: int = 0, called: Called | None = None) -> PlayWords:
    """Read a play; `called` returns the name that a word at an offset stands for.

    Raises TextError with offsets into the text plus `start`.
    """
    words = [Word(w.group(), w.start()) for w in _WORD.finditer(text)]
    if not words or (
        words[0].text in (*OPTIONS, "do", ",") and words[0].text not in _PATTERN_WORDS
    ):
        raise TextError(
            "the gesture or take is missing; write for instance knock every 1",
            offset=start + (words[0].offset if words else 0),
            length=len(words[0].text) if words else 1,
        )
    options: dict[str, Word] = {}
    if len(words) == 1 and words[0].text.isidentifier():  # most plays
        return PlayWords(Word(words[0].text, start + words[0].offset), options)
    stop = 1
    while stop < len(words) and words[stop].text not in (*_KNOWN, ","):
        stop += 1
    what_word, order = _order(text, words[:stop], start, called)
    chain: list[Change] = []
    wanting: str | None = None  # a `do` or a comma that a transformation must follow
    i = stop
    while i < len(words):
        word, offset = words[i]
        place = start + offset
        if word in ARITY or wanting is not None:
            change, end = parse_first(text, offset, start, _KNOWN)
            chain.append(change)
            wanting, i = (
                None,
                next((n for n in range(i, len(words)) if words[n].offset >= end), len(words)),
            )
        elif word == "do" or (word == "," and chain and words[i - 1].text not in OPTIONS):
            wanting, i = word, i + 1
        elif word in OPTIONS:
            name, i, value = _value(text, words, i, start, OPTIONS, word)
            if name in options:
                raise TextError(f"'{word}' is written twice", offset=place, length=len(word))
            options[name] = Word(value.text, start + value.offset)
        elif OPTIONS.get(words[i - 1].text, "") is None:
            flag = words[i - 1].text
            raise TextError(
                f"'{flag}' takes no value; remove '{word[:40]}'",
                offset=place,
                length=len(word),
            )
        else:
            raise _unknown(words[i], start)
    if wanting is not None:
        last_word = words[-1]
        raise TextError(
            f"'{wanting}' needs a transformation: do scale 0.5, mirror",
            offset=start + last_word.offset,
            length=len(last_word.text),
        )
    if NTH in options:
        parse_turns(options[NTH].text, options[NTH].offset)
    return PlayWords(what_word, options, tuple(chain), order)


def _order(
    text: str, words: list[Word], start: int, name_reader: Called | None
) -> tuple[Word, Group | None]:
    """What is played, and its pattern unless it is one name."""
    for word_before, word in pairwise(words):
        if word.text[0].isdigit():  # a value: the word before it is a misspelt option
            raise _unknown(word if word_before is words[0] else word_before, start)
    first_word, last_word = words[0], words[-1]
    order_word = Word(
        text[first_word.offset : last_word.offset + len(last_word.text)], start + first_word.offset
    )
    if len(words) == 1 and not _SIGNS & set(order_word.text):
        return order_word, None
    make: Called = name_reader or (lambda word, _: word)

    def name(word: str, offset: int) -> str:
        return make(name_of(word, offset), order_word.offset + offset)

    try:
        return order_word, parse_order(order_word.text, name)
    except TextError as error:
        error.offset += order_word.offset
        raise


def parse_strikes(
    text: str, examples_by_word: Mapping[str, str]
) -> tuple[list[Word], dict[str, Word]]:
    """Read modules, and the options of strikes; `examples_by_word` has an example of each option's
    value.

    Raises TextError.
    """
    words = [Word(w.group(), w.start()) for w in _WORD.finditer(text)]
    stop = next((i for i, word in enumerate(words) if word.text in examples_by_word), len(words))
    options: dict[str, Word] = {}
    i = stop
    while i < len(words):
        word, offset = words[i]
        if word not in examples_by_word:
            if "impulse" not in examples_by_word or not _is_worded_level(word):
                raise _unknown(words[i], 0, examples_by_word)
            # A level may stand behind the options, without its keyword.
            name, i, value = _value(text, words, i - 1, 0, examples_by_word, "impulse")
        else:
            name, i, value = _value(text, words, i, 0, examples_by_word, word)
        if name == NTH:
            message = f"'every {value.text.split()[0]}' changes every so many plays of a gesture; "
            message += "strikes of modules have no points to change"
            raise TextError(message, offset=offset, length=len(word))
        if name in options:
            raise TextError(f"'{word}' is written twice", offset=offset, length=len(word))
        options[name] = value
    return words[:stop], options


def _is_worded_level(word: str) -> bool:
    """Whether a word is a level with letters, such as `f` or `2mNs`: a number alone may be the end
    of the value before it.
    """
    return is_level(word) and any(map(str.isalpha, word))


def _value(
    text: str,
    words: list[Word],
    i: int,
    start: int,
    examples_by_word: Mapping[str, str | None],
    word: str,
) -> tuple[str, int, Word]:
    """The option `word`, whose value follows word `i`, the index after its value, and the value
    (`true` for a flag).
    """
    offset = words[i].offset
    if examples_by_word[word] is None:
        return word, i + 1, Word("true", offset)
    values = words[i + 1 :]
    if word == "every" and values and ORDINAL.fullmatch(values[0].text):
        stop = _end_of_turns(words, i)
        first, last = values[0], words[stop - 1]
        return NTH, stop, Word(text[first.offset : last.offset + len(last.text)], first.offset)
    count = 1
    if word == "euclid":
        count = 4 if [value.text for value in values[2:3]] == ["rotate"] else 2
    elif word == "impulse":
        other_numbers = (number for number, value in enumerate(values) if not is_level(value.text))
        count = max(1, next(other_numbers, len(values)))
    elif word == "path":
        count = 2
        while [value.text for value in values[count : count + 1]] == ["->"]:
            count += 3
    values = values[:count]
    misplaced = next((v for v in values if v.text in (*examples_by_word, *_KNOWN, ",")), None)
    if len(values) < count or misplaced is not None:
        example = f"{word} {examples_by_word[word]}"
        example += " rotate 2" if word == "euclid" and count == 4 else ""
        message = f"'{word}' needs a value: {example}"
        raise TextError(message, offset=start + offset, length=len(word))
    first, last = values[0], values[-1]
    stop = last.offset + len(last.text)
    return word, i + 1 + count, Word(text[first.offset : stop], first.offset)


def _unknown(word: Word, start: int, known_words: Iterable[str] = _KNOWN) -> TextError:
    return TextError(
        f"unknown word '{word.text[:40]}'",
        offset=start + word.offset,
        length=len(word.text),
        suggestion=nearest(word.text, known_words),
    )


def rows(text: str) -> Iterator[tuple[str, int]]:
    """Yield the rows of a part's table without their comments (`#`), and where each begins."""
    offset = 0
    for line in text.split("\n"):
        row = _COMMENT.sub("", line) if "#" in line else line
        if row.strip():
            yield row, offset
        offset += len(line) + 1


def parse_row(row: str, offset: int = 0, name_reader: Called | None = None) -> Row:
    """Read `first_cell` and the words of a play. Raises TextError with offsets plus `offset`."""
    cells = row.split()
    first_cell = cells[0]
    lead = row.index(first_cell)
    if len(cells) == 1:
        example = f"{first_cell} knock" if first_cell[0].isdigit() else f"1|1 {first_cell}"
        raise TextError(
            f"a row has a position and a gesture or take; write {example[:40]}",
            offset=offset + lead,
            length=len(first_cell),
        )
    if (
        len(cells) == 2 and not _SIGNS & set(cells[1]) and cells[1] not in _KNOWN
    ):  # most rows of most tables
        name = Word(cells[1], offset + row.index(cells[1], lead + len(first_cell)))
        return Row(Word(first_cell, offset + lead), PlayWords(name, {}))
    play = parse(row[lead + len(first_cell) :], offset + lead + len(first_cell), name_reader)
    if "at" in play.options:
        raise TextError(
            "a row begins with a position, such as 3|1 or B",
            offset=play.options["at"].offset,
            length=1,
        )
    return Row(Word(first_cell, offset + lead), play)


def _end_of_turns(words: list[Word], first_turn: int) -> int:
    """The index after `every 4th do mirror` and all further clauses of that form."""
    stop = first_turn
    while len(words) > stop + 1 and words[stop].text == "every":
        if not ORDINAL.fullmatch(words[stop + 1].text):
            break
        stop += 2
        if stop == len(words) or words[stop].text != "do":
            break
        stop += 1
        while stop < len(words) and (
            words[stop].text in (*ARITY, ",") or words[stop - 1].text in ("do", ",")
        ):
            stop = stop + 1 if words[stop].text == "," else _end_of_transform(words, stop)
    return stop


def _end_of_transform(words: list[Word], first_word: int) -> int:
    """The index after the transformation that begins at word `first_word`, with its arguments."""
    stop = first_word + 1
    limit = stop + ARGUMENTS.get(words[first_word].text, 0)
    while stop < min(limit, len(words)) and words[stop].text not in (*_KNOWN, ","):
        stop += 1
    return stop
