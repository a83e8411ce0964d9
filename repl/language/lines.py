"""Characters to words: continued lines, comments, quotes, and characters that are not allowed."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import NamedTuple

from ergon.notation.text.errors import TextError
from ergon.repl.language.commands import Word

MAX_LINE = 10_000  # characters; the longest line of a performance has some hundreds
MAX_PASTE = 100_000  # characters of one submission, read and checked while the sound goes on
MAX_LINES = 200  # lines of one submission: four screens

_COMMENT_PATTERN = re.compile(r"(?:^|(?<=\s))#.*")
_PYTHON_PATTERN = re.compile(r"\s*py\s")  # the rest of the line is Python, with its own comments
# The head of a block, whose lines follow.
_BLOCK_PATTERN = re.compile(r"\s*def\s+\S+(?:\s+[^\s:]+=[^\s:]+)*:\s*")
_END_WORD = "end"
_WORD_PATTERN = re.compile(r'"[^"]*"|\S+')


class Line(NamedTuple):
    """A line without its comment, joined with the lines that continue it.

    `start` is where it begins in the submitted text. Joining keeps the number of characters, so
    that places in the line are places in the text.
    """

    text: str
    start: int


def submitted_lines(submitted_text: str) -> Iterator[Line]:
    """Yield the lines of a submission. Raises TextError if it is too long or has a character that
    cannot be typed.

    `def NAME:` is one line with those below it, up to `end` or an empty line.
    """
    if len(submitted_text) > MAX_PASTE:
        raise TextError(
            f"this text has {len(submitted_text):,} characters; {MAX_PASTE:,} are the most"
        )
    if submitted_text.count("\n") > MAX_LINES:
        raise TextError(f"this text has more than {MAX_LINES} lines")
    joined_text, line_start, line_offset = "", 0, 0
    open_block: Line | None = None  # the part that is read so far
    for typed_line in submitted_text.split("\n"):
        if len(joined_text) + len(typed_line) > MAX_LINE:
            message = f"this line has {len(joined_text) + len(typed_line):,} characters"
            raise TextError(f"{message}; {MAX_LINE:,} are the most", offset=line_offset)
        _check_characters(typed_line, line_offset)
        code_text = (
            typed_line
            if _PYTHON_PATTERN.match(typed_line)
            else _COMMENT_PATTERN.sub("", typed_line)
        )
        line_start = line_start if joined_text else line_offset
        line_offset += len(typed_line) + 1
        if is_continued(typed_line):
            joined_text += code_text.rstrip()[:-1].ljust(len(typed_line)) + " "
            continue
        joined_line, joined_text = Line(joined_text + code_text, line_start), ""
        if open_block is not None and (
            not typed_line.strip() or joined_line.text.strip() == _END_WORD
        ):
            yield open_block
            open_block = None
        elif open_block is not None:
            open_block = _block_with_line(open_block, joined_line)
        elif _BLOCK_PATTERN.fullmatch(joined_line.text):
            open_block = joined_line
        elif joined_line.text.strip():
            yield joined_line
    if joined_text.strip():
        open_block = (
            Line(joined_text, line_start)
            if open_block is None
            else _block_with_line(open_block, Line(joined_text, line_start))
        )
    if open_block is not None:
        yield open_block


def _block_with_line(block: Line, line: Line) -> Line:
    """A block with one more line, at the place where that line was typed."""
    text = block.text.ljust(line.start - block.start - 1) + "\n" + line.text
    return Line(text, block.start)


def is_continued(line: str) -> bool:
    r"""Whether a line ends in "\\", outside a comment."""
    return line.rstrip().endswith("\\") and not _COMMENT_PATTERN.search(line)


def is_complete(submitted_text: str) -> bool:
    r"""Whether a submission is complete: its last line does not end in "\\", and its blocks end."""
    if is_continued(submitted_text[submitted_text.rfind("\n") + 1 :][-MAX_LINE:]):
        return False
    is_open = False
    for line_text in submitted_text[:MAX_PASTE].split("\n"):
        if is_open:
            is_open = line_text.strip() not in ("", _END_WORD)
        else:
            is_open = _BLOCK_PATTERN.fullmatch(_COMMENT_PATTERN.sub("", line_text)) is not None
    return not is_open


def split_words(line: Line) -> list[Word]:
    """The words of a line; text between double quotes is one word."""
    line_start = line.start
    return [
        Word(word_match.group(), line_start + word_match.start(), line_start + word_match.end())
        for word_match in _WORD_PATTERN.finditer(line.text)
    ]


def comment_start(line: str) -> int:
    """Where the comment of a physical line begins; the length of the line if it has none."""
    comment_match = None if _PYTHON_PATTERN.match(line) else _COMMENT_PATTERN.search(line)
    return comment_match.start() if comment_match else len(line)


def _check_characters(line_text: str, text_offset: int) -> None:
    if line_text.isprintable():
        return
    unprintable_offsets = [
        offset for offset, c in enumerate(line_text) if not c.isprintable() and c not in "\t\r"
    ]
    if unprintable_offsets:
        first_strange, last_strange = unprintable_offsets[0], unprintable_offsets[-1]
        message = (
            "this line contains a character that has no meaning here "
            f"(U+{ord(line_text[first_strange]):04X})"
        )
        strange_text = line_text[first_strange : last_strange + 1]
        printable_text = "".join(
            c if c.isprintable() else " " if c.isspace() else "" for c in strange_text
        )
        raise TextError(
            message,
            offset=text_offset + first_strange,
            length=len(strange_text),
            suggestion=printable_text,
        )
