"""Submissions to commands: one line, or several that were pasted and make one version."""

from __future__ import annotations

from collections.abc import Iterator

from ergon.notation.text.errors import TextError, quote
from ergon.repl.language.commands import Build, Command, Define, Takes
from ergon.repl.language.grammar import command
from ergon.repl.language.lines import lines
from ergon.repl.language.refusal import Refusal
from ergon.repl.language.scope import Scope, with_name

MAX_CORRECTIONS = 4  # words of a line that are put right before it is offered again


def parse(text: str, scope: Scope) -> tuple[Command, ...]:
    """The commands of what was submitted; none for comments and blank lines. Raises Refusal."""
    try:
        return tuple(_commands(text, scope))
    except TextError as error:
        try_ = _corrected(text, scope, error)
        message = error.message
        if error.suggestion and try_ is None:
            message += f"; did you mean {quote(error.suggestion)}?"
        if "\n" in text.strip("\n"):
            message = f"line {text.count(chr(10), 0, error.offset) + 1}: {message}"
        raise Refusal(message, error.offset, error.length, try_) from None


def mistake(text: str, scope: Scope) -> TextError | None:
    """The first mistake of a text; None where it is accepted."""
    try:
        for _ in _commands(text, scope):
            pass
    except TextError as error:
        return error
    return None


def _commands(text: str, scope: Scope) -> Iterator[Command]:
    for line in lines(text):
        read = command(line, scope)
        if read is None:
            continue
        scope = _after(scope, read)
        yield read


def _after(scope: Scope, read: Command) -> Scope:
    """The scope of the lines below a command: with the names that it adds."""
    if isinstance(read, Define):
        return with_name(scope, "gestures", read.name)
    if isinstance(read, Build):
        return with_name(scope, "instruments", read.name)
    if isinstance(read, Takes):
        return with_name(with_name(scope, "keys", read.key), "players", read.player)
    return scope


def _corrected(text: str, scope: Scope, error: TextError) -> str | None:
    """The text with every suggestion followed, when that makes a whole that would be taken."""
    for _ in range(MAX_CORRECTIONS):
        if error.suggestion is None:
            return None
        text = text[: error.offset] + error.suggestion + text[error.offset + error.length :]
        further = mistake(text, scope)
        if further is None:
            return text
        error = further
    return None
