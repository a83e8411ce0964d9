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
from ergon.scores.gesture.transforms import ARGUMENT_COUNTS, GESTURE_ARGUMENT_COUNTS
from ergon.scores.pattern.order import Group, name_of
from ergon.scores.pattern.order import parse as parse_order
from ergon.scores.pattern.turn_chain import Change, parse_first
from ergon.scores.pattern.turns import ORDINAL
from ergon.scores.pattern.turns import parse as parse_turns

ReadName = Callable[[str, int], str]

# Options, each with an example of its value; None for a flag.
OPTION_EXAMPLES = {
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
NTH_OPTION = "nth"
# Options of a pattern that may also be names of gestures: the first word of a play is a name.
_PATTERN_WORDS = ("chance", "euclid", "swing", "skip")
_KNOWN_WORDS = (*OPTION_EXAMPLES, "do", *GESTURE_ARGUMENT_COUNTS)
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

    `pattern` is what is played as a pattern; None if that is one name.
    """

    played: Word
    options: dict[str, Word]
    transforms: tuple[Change, ...] = ()
    pattern: Group | None = None


@dataclass(frozen=True, slots=True)
class Row:
    """A row of a part's table: a position, and what is played there."""

    at: Word
    play: PlayWords


def parse(pattern_text: str, text_start: int = 0, read_name: ReadName | None = None) -> PlayWords:
    """Read a play; `read_name` returns the name that a word at an offset stands for.

    Raises TextError with offsets into the text plus `text_start`.
    """
    placed_words = [Word(match.group(), match.start()) for match in _WORD.finditer(pattern_text)]
    _check_first_word(placed_words, text_start)
    placed_options: dict[str, Word] = {}
    if len(placed_words) == 1 and placed_words[0].text.isidentifier():  # most plays
        return PlayWords(
            Word(placed_words[0].text, text_start + placed_words[0].offset), placed_options
        )
    words_stop = 1
    while words_stop < len(placed_words) and placed_words[words_stop].text not in (
        *_KNOWN_WORDS,
        ",",
    ):
        words_stop += 1
    played_word, pattern = _play_and_pattern(
        pattern_text, placed_words[:words_stop], text_start, read_name
    )
    transforms: list[Change] = []
    unfinished_word: str | None = None  # a `do` or a comma that a transformation must follow
    word_index = words_stop
    while word_index < len(placed_words):
        option_word, option_offset = placed_words[word_index]
        option_place = text_start + option_offset
        if option_word in GESTURE_ARGUMENT_COUNTS or unfinished_word is not None:
            change, change_end = parse_first(pattern_text, option_offset, text_start, _KNOWN_WORDS)
            transforms.append(change)
            unfinished_word, word_index = (
                None,
                next(
                    (
                        later_index
                        for later_index in range(word_index, len(placed_words))
                        if placed_words[later_index].offset >= change_end
                    ),
                    len(placed_words),
                ),
            )
        elif option_word == "do" or (
            option_word == ","
            and transforms
            and placed_words[word_index - 1].text not in OPTION_EXAMPLES
        ):
            unfinished_word, word_index = option_word, word_index + 1
        elif option_word in OPTION_EXAMPLES:
            option_name, word_index, option_value = _option_value(
                pattern_text, placed_words, word_index, text_start, OPTION_EXAMPLES, option_word
            )
            if option_name in placed_options:
                raise TextError(
                    f"'{option_word}' is written twice",
                    offset=option_place,
                    length=len(option_word),
                )
            placed_options[option_name] = Word(option_value.text, text_start + option_value.offset)
        elif OPTION_EXAMPLES.get(placed_words[word_index - 1].text, "") is None:
            flag_word = placed_words[word_index - 1].text
            raise TextError(
                f"'{flag_word}' takes no value; remove '{option_word[:40]}'",
                offset=option_place,
                length=len(option_word),
            )
        else:
            raise _unknown_word_error(placed_words[word_index], text_start)
    if unfinished_word is not None:
        last_word = placed_words[-1]
        raise TextError(
            f"'{unfinished_word}' needs a transformation: do scale 0.5, mirror",
            offset=text_start + last_word.offset,
            length=len(last_word.text),
        )
    if NTH_OPTION in placed_options:
        parse_turns(placed_options[NTH_OPTION].text, placed_options[NTH_OPTION].offset)
    return PlayWords(played_word, placed_options, tuple(transforms), pattern)


def _check_first_word(placed_words: list[Word], text_start: int) -> None:
    """Raises TextError if a play does not begin with a gesture or take."""
    if not placed_words or (
        placed_words[0].text in (*OPTION_EXAMPLES, "do", ",")
        and placed_words[0].text not in _PATTERN_WORDS
    ):
        raise TextError(
            "the gesture or take is missing; write for instance knock every 1",
            offset=text_start + (placed_words[0].offset if placed_words else 0),
            length=len(placed_words[0].text) if placed_words else 1,
        )


def _play_and_pattern(
    play_text: str, placed_words: list[Word], text_start: int, name_reader: ReadName | None
) -> tuple[Word, Group | None]:
    """What is played, and its pattern unless it is one name."""
    for word_before, word in pairwise(placed_words):
        if word.text[0].isdigit():  # a value: the word before it is a misspelt option
            raise _unknown_word_error(
                word if word_before is placed_words[0] else word_before, text_start
            )
    first_word, last_word = placed_words[0], placed_words[-1]
    order_word = Word(
        play_text[first_word.offset : last_word.offset + len(last_word.text)],
        text_start + first_word.offset,
    )
    if len(placed_words) == 1 and not _SIGNS & set(order_word.text):
        return order_word, None
    read_name: ReadName = name_reader or (lambda word, _: word)

    def name(word: str, offset: int) -> str:
        return read_name(name_of(word, offset), order_word.offset + offset)

    try:
        return order_word, parse_order(order_word.text, name)
    except TextError as error:
        error.offset += order_word.offset
        raise


def parse_strikes(
    pattern_text: str, examples_by_word: Mapping[str, str]
) -> tuple[list[Word], dict[str, Word]]:
    """Read modules, and the options of strikes; `examples_by_word` has an example of each option's
    value.

    Raises TextError.
    """
    placed_words = [Word(match.group(), match.start()) for match in _WORD.finditer(pattern_text)]
    options_start = next(
        (
            word_index
            for word_index, word in enumerate(placed_words)
            if word.text in examples_by_word
        ),
        len(placed_words),
    )
    placed_options: dict[str, Word] = {}
    word_index = options_start
    while word_index < len(placed_words):
        option_word, word_offset = placed_words[word_index]
        if option_word not in examples_by_word:
            if "impulse" not in examples_by_word or not _is_worded_level(option_word):
                raise _unknown_word_error(placed_words[word_index], 0, examples_by_word)
            # A level may stand behind the options, without its keyword.
            option_name, word_index, option_value = _option_value(
                pattern_text, placed_words, word_index - 1, 0, examples_by_word, "impulse"
            )
        else:
            option_name, word_index, option_value = _option_value(
                pattern_text, placed_words, word_index, 0, examples_by_word, option_word
            )
        if option_name == NTH_OPTION:
            message = (
                f"'every {option_value.text.split()[0]}' changes every so many plays of a gesture; "
            )
            message += "strikes of modules have no points to change"
            raise TextError(message, offset=word_offset, length=len(option_word))
        if option_name in placed_options:
            raise TextError(
                f"'{option_word}' is written twice", offset=word_offset, length=len(option_word)
            )
        placed_options[option_name] = option_value
    return placed_words[:options_start], placed_options


def _is_worded_level(typed_word: str) -> bool:
    """Whether a word is a level with letters, such as `f` or `2mNs`: a number alone may be the end
    of the value before it.
    """
    return is_level(typed_word) and any(map(str.isalpha, typed_word))


def _option_value(
    pattern_text: str,
    placed_words: list[Word],
    word_index: int,
    text_start: int,
    examples_by_word: Mapping[str, str | None],
    option_word: str,
) -> tuple[str, int, Word]:
    """The option `option_word`, whose value follows word `word_index`, the index after its value,
    and the value (`true` for a flag).
    """
    option_offset = placed_words[word_index].offset
    if examples_by_word[option_word] is None:
        return option_word, word_index + 1, Word("true", option_offset)
    value_words = placed_words[word_index + 1 :]
    if option_word == "every" and value_words and ORDINAL.fullmatch(value_words[0].text):
        value_stop = _end_of_turns(placed_words, word_index)
        first_word, last_word = value_words[0], placed_words[value_stop - 1]
        return (
            NTH_OPTION,
            value_stop,
            Word(
                pattern_text[first_word.offset : last_word.offset + len(last_word.text)],
                first_word.offset,
            ),
        )
    value_count = 1
    if option_word == "euclid":
        value_count = 4 if [value.text for value in value_words[2:3]] == ["rotate"] else 2
    elif option_word == "impulse":
        other_numbers = (
            number for number, value in enumerate(value_words) if not is_level(value.text)
        )
        value_count = max(1, next(other_numbers, len(value_words)))
    elif option_word == "path":
        value_count = 2
        while [value.text for value in value_words[value_count : value_count + 1]] == ["->"]:
            value_count += 3
    value_words = value_words[:value_count]
    misplaced_word = next(
        (
            value_word
            for value_word in value_words
            if value_word.text in (*examples_by_word, *_KNOWN_WORDS, ",")
        ),
        None,
    )
    if len(value_words) < value_count or misplaced_word is not None:
        example = f"{option_word} {examples_by_word[option_word]}"
        example += " rotate 2" if option_word == "euclid" and value_count == 4 else ""
        message = f"'{option_word}' needs a value: {example}"
        raise TextError(message, offset=text_start + option_offset, length=len(option_word))
    first_word, last_word = value_words[0], value_words[-1]
    value_stop = last_word.offset + len(last_word.text)
    return (
        option_word,
        word_index + 1 + value_count,
        Word(pattern_text[first_word.offset : value_stop], first_word.offset),
    )


def _unknown_word_error(
    unknown_word: Word, text_start: int, known_words: Iterable[str] = _KNOWN_WORDS
) -> TextError:
    return TextError(
        f"unknown word '{unknown_word.text[:40]}'",
        offset=text_start + unknown_word.offset,
        length=len(unknown_word.text),
        suggestion=nearest(unknown_word.text, known_words),
    )


def rows(table_text: str) -> Iterator[tuple[str, int]]:
    """Yield the rows of a part's table without their comments (`#`), and where each begins."""
    row_offset = 0
    for table_line in table_text.split("\n"):
        row = _COMMENT.sub("", table_line) if "#" in table_line else table_line
        if row.strip():
            yield row, row_offset
        row_offset += len(table_line) + 1


def parse_row(row_text: str, row_offset: int = 0, name_reader: ReadName | None = None) -> Row:
    """Read the first cell and the words of a play. Raises TextError, at places + `row_offset`."""
    row_cells = row_text.split()
    first_cell = row_cells[0]
    cell_offset = row_text.index(first_cell)
    if len(row_cells) == 1:
        example = f"{first_cell} knock" if first_cell[0].isdigit() else f"1|1 {first_cell}"
        raise TextError(
            f"a row has a position and a gesture or take; write {example[:40]}",
            offset=row_offset + cell_offset,
            length=len(first_cell),
        )
    if (
        len(row_cells) == 2 and not _SIGNS & set(row_cells[1]) and row_cells[1] not in _KNOWN_WORDS
    ):  # most rows of most tables
        name = Word(
            row_cells[1], row_offset + row_text.index(row_cells[1], cell_offset + len(first_cell))
        )
        return Row(Word(first_cell, row_offset + cell_offset), PlayWords(name, {}))
    play_words = parse(
        row_text[cell_offset + len(first_cell) :],
        row_offset + cell_offset + len(first_cell),
        name_reader,
    )
    if "at" in play_words.options:
        raise TextError(
            "a row begins with a position, such as 3|1 or B",
            offset=play_words.options["at"].offset,
            length=1,
        )
    return Row(Word(first_cell, row_offset + cell_offset), play_words)


def _end_of_turns(placed_words: list[Word], first_turn: int) -> int:
    """The index after `every 4th do mirror` and all further clauses of that form."""
    words_stop = first_turn
    while len(placed_words) > words_stop + 1 and placed_words[words_stop].text == "every":
        if not ORDINAL.fullmatch(placed_words[words_stop + 1].text):
            break
        words_stop += 2
        if words_stop == len(placed_words) or placed_words[words_stop].text != "do":
            break
        words_stop += 1
        while words_stop < len(placed_words) and (
            placed_words[words_stop].text in (*GESTURE_ARGUMENT_COUNTS, ",")
            or placed_words[words_stop - 1].text in ("do", ",")
        ):
            words_stop = (
                words_stop + 1
                if placed_words[words_stop].text == ","
                else _end_of_transform(placed_words, words_stop)
            )
    return words_stop


def _end_of_transform(placed_words: list[Word], first_word: int) -> int:
    """The index after the transformation that begins at word `first_word`, with its arguments."""
    words_stop = first_word + 1
    words_stop_max = words_stop + ARGUMENT_COUNTS.get(placed_words[first_word].text, 0)
    while words_stop < min(words_stop_max, len(placed_words)) and placed_words[
        words_stop
    ].text not in (*_KNOWN_WORDS, ","):
        words_stop += 1
    return words_stop
