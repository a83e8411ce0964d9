"""Submissions to commands: one line, or several that were pasted and make one version."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from ergon.notation.text.errors import TextError, quote
from ergon.repl.language.block_values import defaults, setting, variants
from ergon.repl.language.blocks import DefineBlock
from ergon.repl.language.commands import BlockCommand, Command
from ergon.repl.language.grammar import read_command
from ergon.repl.language.library import Use
from ergon.repl.language.lines import Line, lines
from ergon.repl.language.matter import Build, Takes
from ergon.repl.language.phrases import DefinePhrase
from ergon.repl.language.playing import Define
from ergon.repl.language.refusal import Refusal
from ergon.repl.language.scope import Scope, with_name
from ergon.repl.language.striking import StrikeModules
from ergon.repl.language.verbs import VERBS
from ergon.scores.reading.families import library

MAX_CORRECTIONS = 4  # words of a line that are put right before it is offered again


def parse(text: str, scope: Scope) -> tuple[Command, ...]:
    """The commands of a submitted text; none for comments and blank lines. Raises Refusal."""
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


def first_error(text: str, scope: Scope) -> TextError | None:
    """The first mistake of a text; None where it is accepted."""
    try:
        for _ in _commands(text, scope):
            pass
    except TextError as error:
        return error
    return None


def _commands(text: str, scope: Scope) -> Iterator[Command]:
    for line in lines(text):
        read = read_command(line, scope)
        if read is None:
            continue
        if isinstance(read, DefineBlock):
            _check_block(read, scope)
        scope = _scope_after(scope, read)
        yield read


def parse_block_line(text: str, scope: Scope) -> Command:
    """The command of a line that a block may hold. Raises Refusal."""
    try:
        commands = [
            own for line in lines(text) if (own := _block_command(line, 0, scope)) is not None
        ]
        if len(commands) != 1:
            raise TextError(f"{quote(text)} is not one line of a session", length=len(text))
        return commands[0]
    except TextError as error:
        raise Refusal(error.message, error.offset, error.length, None) from None


def _check_block(block: DefineBlock, scope: Scope) -> None:
    """Refuse a block whose name is a verb, or that has a line which no block may hold."""
    if block.name in VERBS:
        word = block.words["name"]
        message = f"{quote(block.name)} is a verb: give the block another name"
        raise TextError(message, offset=word.start, length=len(block.name))
    text = block.words["lines"]
    values = defaults(block.lines)
    for line in lines(text.text):
        if setting(line.text) is not None:
            continue
        if "$" in line.text:
            scope = _check_variants(line, text.start, values, scope)
            continue
        if (read := _block_command(line, text.start, scope)) is not None:
            scope = _scope_after(scope, read)


def _check_variants(line: Line, offset: int, values: Mapping[str, str], scope: Scope) -> Scope:
    """Check a line in which values are filled in; returns the scope of those below it.

    A mistake has the place of the whole line: what was filled in has none. Raises TextError.
    """
    for text in variants(line.text, values):
        try:
            read = _block_command(Line(text, 0), 0, scope)
        except TextError as error:
            start, length = offset + line.start, len(line.text.rstrip())
            message = f"{error.message}; the line is {quote(text.strip())}"
            raise TextError(message, offset=start, length=length) from None
        if read is not None:
            scope = _scope_after(scope, read)
    return scope


def _block_command(line: Line, offset: int, scope: Scope) -> Command | None:
    """The command of a line of a block; the block's text begins at `offset`. Raises TextError."""
    read = read_command(Line(line.text, offset + line.start), scope)
    if read is None or (isinstance(read, BlockCommand) and read.when is None):
        return read
    content = line.text.strip()
    place = offset + line.start + line.text.index(content)
    why = "says when it acts, and the lines of a block act when the block is run"
    if not isinstance(read, BlockCommand):
        why = "does not change the music, moves a real hand, or is about files, history or blocks"
    message = f"a block cannot hold {quote(content)}: the line {why}"
    raise TextError(message, offset=place, length=len(content))


def _scope_after(scope: Scope, read: Command) -> Scope:
    """The scope of the lines below a command: it also has the names that the command adds."""
    if isinstance(read, Define):
        return with_name(scope, "gestures", read.name)
    if isinstance(read, DefinePhrase):
        return with_name(scope, "phrases", read.name)
    if isinstance(read, DefineBlock):
        return with_name(scope, "blocks", read.name)
    if isinstance(read, StrikeModules):
        return _scope_after_strikes(scope, read)
    if isinstance(read, Build):
        return with_name(scope, "instruments", read.name)
    if isinstance(read, Use):
        for member in library().get(read.family, ()):
            if member.name not in scope.instruments:
                scope = with_name(scope, "available", member.name)
        return scope
    if isinstance(read, Takes):
        return with_name(with_name(scope, "keys", read.key), "players", read.player)
    return scope


def _scope_after_strikes(scope: Scope, read: StrikeModules) -> Scope:
    """The scope with the name of strikes, and with the instruments that they begin to play."""
    for name in {path.partition(".")[0] for path in read.struck} & scope.available.keys():
        scope = with_name(scope, "instruments", name)
    return with_name(scope, "strikes", read.name)


def _corrected(text: str, scope: Scope, error: TextError) -> str | None:
    """The text with every suggestion applied; None if that is not accepted either."""
    for _ in range(MAX_CORRECTIONS):
        if error.suggestion is None:
            return None
        text = text[: error.offset] + error.suggestion + text[error.offset + error.length :]
        further = first_error(text, scope)
        if further is None:
            return text
        error = further
    return None
