"""Values in the lines of a block: `$n`, `$tick`, and `$tick[C4 E4 G4]`, one of several in turn."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence

from ergon.notation.text.errors import TextError, quote

TICK = "tick"  # how often the block has run by its rule before
MAX_VALUES = 16  # of a block
_MAX_TICKS = 64  # numbers of a run with which lines are tried when they are defined
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,31}")
_VALUE = re.compile(r"[^\s\[\]$#\"\\]{1,100}")
_SETTING = re.compile(r"\s*\$([^\s=]*)\s*=\s*(.*?)\s*")
_USE = re.compile(r"\$([A-Za-z][A-Za-z0-9_]{0,31})(?:\[([^\[\]$]*)\])?")


def setting(line: str) -> tuple[str, str] | None:
    """The name and the value of a line `$n = 8`; None if it is another line. Raises TextError."""
    match = _SETTING.fullmatch(line)
    return None if match is None else checked(match[1], match[2])


def checked(name: str, value: str) -> tuple[str, str]:
    """A name and its value, if they may be that. Raises TextError."""
    if not _NAME.fullmatch(name):
        message = f"{quote(name)} is not the name of a value: a letter, then letters, digits and _"
        raise TextError(message, length=max(1, len(name)))
    if name == TICK:
        raise TextError("$tick counts the runs of a block: call the value something else")
    if not _VALUE.fullmatch(value):
        raise TextError(f"{quote(value)} is not a value: write one word, such as 8 or bell")
    return name, value


def filled(lines: Iterable[str], words: Sequence[str]) -> list[str]:
    """The lines of a block with their values, without the lines that set them.

    `words` are values as they are written where the block is run: `16` for the first that the
    block sets, or `n=16`. Raises TextError.
    """
    lines = [*lines]
    values = defaults(lines)
    known = [*values]
    for number, word in enumerate(words):
        name, equals, value = word.partition("=")
        if not equals:
            if number >= len(known):
                message = f"the block takes {_count(len(known))}, and {quote(word)} is one more"
                raise TextError(message, length=len(word))
            name, value = known[number], word
        elif name not in (*known, TICK):
            some = f"; it has {', '.join(known)}" if known else ", nor any other"
            raise TextError(f"the block has no value {quote(name)}{some}", length=len(word))
        if not _VALUE.fullmatch(value):
            raise TextError(f"{quote(value)} is not a value: write one word", length=len(word))
        values[name] = value
    values.setdefault(TICK, "0")
    return [_filled_line(line, values) for line in lines if setting(line) is None]


def defaults(lines: Iterable[str]) -> dict[str, str]:
    """The values that the lines of a block set, in their order. Raises TextError."""
    values = dict(pair for line in lines if (pair := setting(line)) is not None)
    if len(values) > MAX_VALUES:
        raise TextError(f"this block has {len(values)} values; {MAX_VALUES} are the most")
    return values


def counts_runs(lines: Iterable[str]) -> bool:
    """Whether any line has `$tick`."""
    return any(match[1] == TICK for line in lines for match in _USE.finditer(line))


def variants(line: str, values: Mapping[str, str]) -> Iterator[str]:
    """A line as it is in successive runs, with all of the words in its brackets. Raises
    TextError.
    """
    rings = [len((match[2] or "").split()) for match in _USE.finditer(line)]
    for tick in range(min(max(rings, default=1) or 1, _MAX_TICKS)):
        yield _filled_line(line, {**values, TICK: str(tick)})


def _filled_line(line: str, values: Mapping[str, str]) -> str:
    def value_of(match: re.Match[str]) -> str:
        name, words = match[1], match[2]
        if name not in values:
            message = f"${name} has no value: begin the block with def NAME {name}=8:, or use $tick"
            raise TextError(message, offset=match.start(), length=len(match[0]))
        value = values[name]
        if words is None:
            return value
        some = words.split()
        if not value.isdecimal() or not some:
            what = f"${name} is {value}, and counts" if some else f"${name}[] needs"
            message = f"{what} words in brackets from 0 on: $tick[C4 E4 G4]"
            raise TextError(message, offset=match.start(), length=len(match[0]))
        return some[int(value) % len(some)]

    return _USE.sub(value_of, line)


def _count(count: int) -> str:
    return "no value" if not count else f"{count} value{'s' if count > 1 else ''}"
