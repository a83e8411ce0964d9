"""Values in the lines of a block: `$n`, `$tick`, and `$tick[C4 E4 G4]`, one of several in turn."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence

from ergon.notation.text.errors import TextError, quote

TICK_NAME = "tick"  # how often the block has run by its rule before
MAX_VALUES = 16  # values of a block
_MAX_TICKS = 64  # numbers of a run with which lines are tried when they are defined
_NAME_PATTERN = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,31}")
_VALUE_PATTERN = re.compile(r"[^\s\[\]$#\"\\]{1,100}")
_SETTING_PATTERN = re.compile(r"\s*\$([^\s=]*)\s*=\s*(.*?)\s*")
_REFERENCE_PATTERN = re.compile(r"\$([A-Za-z][A-Za-z0-9_]{0,31})(?:\[([^\[\]$]*)\])?")


def parse_setting(line: str) -> tuple[str, str] | None:
    """The name and the value of a line `$n = 8`; None if it is another line. Raises TextError."""
    setting_match = _SETTING_PATTERN.fullmatch(line)
    return None if setting_match is None else check_setting(setting_match[1], setting_match[2])


def check_setting(value_name: str, value_text: str) -> tuple[str, str]:
    """A name and its value, if they may be that. Raises TextError."""
    if not _NAME_PATTERN.fullmatch(value_name):
        message = (
            f"{quote(value_name)} is not the name of a value: a letter, then letters, digits and _"
        )
        raise TextError(message, length=max(1, len(value_name)))
    if value_name == TICK_NAME:
        raise TextError("$tick counts the runs of a block: call the value something else")
    if not _VALUE_PATTERN.fullmatch(value_text):
        raise TextError(f"{quote(value_text)} is not a value: write one word, such as 8 or bell")
    return value_name, value_text


def with_values(block_lines: Iterable[str], value_words: Sequence[str]) -> list[str]:
    """The lines of a block with their values, without the lines that set them.

    `value_words` are values as they are written where the block is run: `16` for the first that the
    block sets, or `n=16`. Raises TextError.
    """
    block_lines = [*block_lines]
    values_by_name = default_values(block_lines)
    value_names = [*values_by_name]
    for word_index, value_word in enumerate(value_words):
        value_name, equals_sign, value_text = value_word.partition("=")
        if not equals_sign:
            if word_index >= len(value_names):
                message = (
                    f"the block takes {_value_count_text(len(value_names))}, and "
                    f"{quote(value_word)} is one "
                    "more"
                )
                raise TextError(message, length=len(value_word))
            value_name, value_text = value_names[word_index], value_word
        elif value_name not in (*value_names, TICK_NAME):
            values_text = f"; it has {', '.join(value_names)}" if value_names else ", nor any other"
            raise TextError(
                f"the block has no value {quote(value_name)}{values_text}", length=len(value_word)
            )
        if not _VALUE_PATTERN.fullmatch(value_text):
            raise TextError(
                f"{quote(value_text)} is not a value: write one word", length=len(value_word)
            )
        values_by_name[value_name] = value_text
    values_by_name.setdefault(TICK_NAME, "0")
    return [
        _filled_line(line, values_by_name) for line in block_lines if parse_setting(line) is None
    ]


def default_values(block_lines: Iterable[str]) -> dict[str, str]:
    """The values that the lines of a block set, in their order. Raises TextError."""
    values_by_name = dict(
        name_and_value
        for line in block_lines
        if (name_and_value := parse_setting(line)) is not None
    )
    if len(values_by_name) > MAX_VALUES:
        raise TextError(f"this block has {len(values_by_name)} values; {MAX_VALUES} are the most")
    return values_by_name


def has_tick(block_lines: Iterable[str]) -> bool:
    """Whether any line has `$tick`."""
    return any(
        match[1] == TICK_NAME for line in block_lines for match in _REFERENCE_PATTERN.finditer(line)
    )


def line_variants(block_line: str, values_by_name: Mapping[str, str]) -> Iterator[str]:
    """A line as it is in successive runs, with all of the words in its brackets. Raises
    TextError.
    """
    choice_counts = [
        len((match[2] or "").split()) for match in _REFERENCE_PATTERN.finditer(block_line)
    ]
    for run_number in range(min(max(choice_counts, default=1) or 1, _MAX_TICKS)):
        yield _filled_line(block_line, {**values_by_name, TICK_NAME: str(run_number)})


def _filled_line(line_text: str, values_by_name: Mapping[str, str]) -> str:
    def chosen_value(bracket_match: re.Match[str]) -> str:
        value_name, choice_text = bracket_match[1], bracket_match[2]
        if value_name not in values_by_name:
            message = (
                f"${value_name} has no value: begin the block with def NAME {value_name}=8:, or "
                "use $tick"
            )
            raise TextError(message, offset=bracket_match.start(), length=len(bracket_match[0]))
        value_text = values_by_name[value_name]
        if choice_text is None:
            return value_text
        choices = choice_text.split()
        if not value_text.isdecimal() or not choices:
            missing_text = (
                f"${value_name} is {value_text}, and counts"
                if choices
                else f"${value_name}[] needs"
            )
            message = f"{missing_text} words in brackets from 0 on: $tick[C4 E4 G4]"
            raise TextError(message, offset=bracket_match.start(), length=len(bracket_match[0]))
        return choices[int(value_text) % len(choices)]

    return _REFERENCE_PATTERN.sub(chosen_value, line_text)


def _value_count_text(count: int) -> str:
    return "no value" if not count else f"{count} value{'s' if count > 1 else ''}"
