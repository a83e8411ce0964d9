"""Characters to words: lines that go on, comments, quotes, and what nobody can have meant."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import NamedTuple

from ergon.notation.text.errors import TextError
from ergon.repl.language.commands import Word

MAX_LINE = 10_000  # characters; the longest line of a performance has some hundreds
MAX_PASTE = 100_000  # characters of one submission, read and checked while the sound goes on
MAX_LINES = 200  # of one submission: four screens

_COMMENT = re.compile(r"(?:^|(?<=\s))#.*")
_PYTHON = re.compile(r"\s*py\s")  # what follows is Python's, with its own comments
_WORD = re.compile(r'"[^"]*"|\S+')


class Line(NamedTuple):
    """A line without its comment, joined with those that it goes on in.

    `start` is where it begins in the submitted text; a joint counts as many characters as before.
    """

    text: str
    start: int


def lines(text: str) -> Iterator[Line]:
    """Yield the lines of a submission. Raises TextError for what is too long or cannot be typed."""
    if len(text) > MAX_PASTE:
        raise TextError(f"this text has {len(text):,} characters; {MAX_PASTE:,} are the most")
    if text.count("\n") > MAX_LINES:
        raise TextError(f"this text has more than {MAX_LINES} lines")
    joined, start, offset = "", 0, 0
    for line in text.split("\n"):
        if len(joined) + len(line) > MAX_LINE:
            message = f"this line has {len(joined) + len(line):,} characters"
            raise TextError(f"{message}; {MAX_LINE:,} are the most", offset=offset)
        _refuse_strange(line, offset)
        said = line if _PYTHON.match(line) else _COMMENT.sub("", line)
        start = start if joined else offset
        offset += len(line) + 1
        if goes_on(line):
            joined += said.rstrip()[:-1].ljust(len(line)) + " "
            continue
        if (joined + said).strip():
            yield Line(joined + said, start)
        joined = ""
    if joined.strip():
        yield Line(joined, start)


def goes_on(line: str) -> bool:
    r"""Whether a line ends in "\\", outside a comment."""
    return line.rstrip().endswith("\\") and not _COMMENT.search(line)


def is_whole(text: str) -> bool:
    r"""Whether a submission is complete: its last line does not end in "\\"."""
    return not goes_on(text[text.rfind("\n") + 1 :][-MAX_LINE:])


def split(line: Line) -> list[Word]:
    """The words of a line; what stands between double quotes is one."""
    start = line.start
    return [Word(w.group(), start + w.start(), start + w.end()) for w in _WORD.finditer(line.text)]


def comment(line: str) -> int:
    """Where the comment of a physical line begins; its length where it has none."""
    match = None if _PYTHON.match(line) else _COMMENT.search(line)
    return match.start() if match else len(line)


def _refuse_strange(line: str, offset: int) -> None:
    if line.isprintable():
        return
    strange = [i for i, c in enumerate(line) if not c.isprintable() and c not in "\t\r"]
    if strange:
        first, last = strange[0], strange[-1]
        message = (
            f"this line contains a character that has no meaning here (U+{ord(line[first]):04X})"
        )
        part = line[first : last + 1]
        clean = "".join(c if c.isprintable() else " " if c.isspace() else "" for c in part)
        raise TextError(message, offset=offset + first, length=len(part), suggestion=clean)
