"""A play in words: `lean every 8 times 2 do scale 0.5, mirror until C layer`.

The words are the fields of a part and the transformations; the REPL says the same after `plays`,
and a row of a part's table after its position.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

from ergon.notation.text.errors import TextError
from ergon.notation.text.spelling import nearest
from ergon.scores.gesture.transforms import ARITY, Transform, parse_do

# An option and what follows it; None for a flag.
OPTIONS = {
    "at": "A",
    "every": "1",
    "times": "8",
    "until": "C",
    "touch": "tracked",
    "ergons": "particle",
    "grain": "5ms",
    "join": "20ms",
    "force_limit": "5N",
    "rate": "4kHz",
    "layer": None,
}
_KNOWN = (*OPTIONS, "do", *ARITY)
_WORD = re.compile(r",|[^\s,]+")
_COMMENT = re.compile(r"(?:^|(?<=\s))#.*")


class Word(NamedTuple):
    """A value as written, and where it begins in the text."""

    text: str
    offset: int


@dataclass(frozen=True, slots=True)
class PlayWords:
    """What is played, its options as written (a flag is `true`), and its transformations."""

    what: Word
    options: dict[str, Word]
    do: tuple[Transform, ...] = ()


@dataclass(frozen=True, slots=True)
class Row:
    """A row of a part's table: where, and what is played there."""

    at: Word
    play: PlayWords


def parse(text: str, start: int = 0) -> PlayWords:
    """Read a play. Raises TextError with offsets into the text, `start` characters further on."""
    words = [Word(w.group(), w.start()) for w in _WORD.finditer(text)]
    if not words or words[0].text in (*OPTIONS, "do", ","):
        raise TextError(
            "the gesture or take is missing; write for instance knock every 1",
            offset=start + (words[0].offset if words else 0),
            length=len(words[0].text) if words else 1,
        )
    options: dict[str, Word] = {}
    if len(words) == 1:
        return PlayWords(Word(words[0].text, start + words[0].offset), options)
    chain: list[Transform] = []
    wanting: str | None = None  # a `do` or a comma that a transformation must follow
    i = 1
    while i < len(words):
        word, offset = words[i]
        place = start + offset
        if word in ARITY or wanting is not None:
            stop = _end_of_transform(words, i)
            last = words[stop - 1]
            chain.append(parse_do(text[offset : last.offset + len(last.text)], place))
            wanting, i = None, stop
        elif word == "do" or (word == "," and chain and words[i - 1].text not in OPTIONS):
            wanting, i = word, i + 1
        elif word in OPTIONS:
            if word in options:
                raise TextError(f"'{word}' is written twice", offset=place, length=len(word))
            value = words[i + 1] if i + 1 < len(words) else None
            if OPTIONS[word] is None:
                options[word], i = Word("true", place), i + 1
            elif value is None or value.text in _KNOWN or value.text == ",":
                raise TextError(
                    f"'{word}' needs a value: {word} {OPTIONS[word]}",
                    offset=place,
                    length=len(word),
                )
            else:
                options[word], i = Word(value.text, start + value.offset), i + 2
        elif OPTIONS.get(words[i - 1].text, "") is None:
            flag = words[i - 1].text
            raise TextError(
                f"'{flag}' takes no value; remove '{word[:40]}'",
                offset=place,
                length=len(word),
            )
        else:
            raise TextError(
                f"unknown word '{word[:40]}'",
                offset=place,
                length=len(word),
                suggestion=nearest(word, _KNOWN),
            )
    if wanting is not None:
        last = words[-1]
        raise TextError(
            f"'{wanting}' needs a transformation: do scale 0.5, mirror",
            offset=start + last.offset,
            length=len(last.text),
        )
    return PlayWords(Word(words[0].text, start + words[0].offset), options, tuple(chain))


def rows(text: str) -> Iterator[tuple[str, int]]:
    """Yield the rows of a part's table without their comments (`#`), and where each begins."""
    offset = 0
    for line in text.split("\n"):
        row = _COMMENT.sub("", line) if "#" in line else line
        if row.strip():
            yield row, offset
        offset += len(line) + 1


def parse_row(row: str, offset: int = 0) -> Row:
    """Read `at` and the words of a play. Raises TextError, `offset` characters further on."""
    cells = row.split()
    at = cells[0]
    lead = row.index(at)
    if len(cells) == 1:
        example = f"{at} knock" if at[0].isdigit() else f"1|1 {at}"
        raise TextError(
            f"a row has a position and a gesture or take; write {example[:40]}",
            offset=offset + lead,
            length=len(at),
        )
    if (
        len(cells) == 2 and "," not in cells[1] and cells[1] not in _KNOWN
    ):  # most rows of most tables
        name = Word(cells[1], offset + row.index(cells[1], lead + len(at)))
        return Row(Word(at, offset + lead), PlayWords(name, {}))
    play = parse(row[lead + len(at) :], offset + lead + len(at))
    if "at" in play.options:
        raise TextError(
            "a row begins with a position, such as 3|1 or B",
            offset=play.options["at"].offset,
            length=1,
        )
    return Row(Word(at, offset + lead), play)


def _end_of_transform(words: list[Word], first: int) -> int:
    """Where the transformation that begins at `first` ends: with its last argument."""
    stop = first + 1
    limit = stop + ARITY.get(words[first].text, 0)
    while stop < min(limit, len(words)) and words[stop].text not in (*_KNOWN, ","):
        stop += 1
    return stop
