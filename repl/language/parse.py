"""Submissions to commands: one line, or several that were pasted and make one version."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from ergon.notation.text.errors import TextError, quote
from ergon.repl.language.block_values import default_values, line_variants, parse_setting
from ergon.repl.language.blocks import DefineBlock
from ergon.repl.language.commands import BlockCommand, Command
from ergon.repl.language.grammar import read_command
from ergon.repl.language.library import Use
from ergon.repl.language.lines import Line, submitted_lines
from ergon.repl.language.matter import Build, Takes
from ergon.repl.language.phrases import DefinePhrase
from ergon.repl.language.playing import Define
from ergon.repl.language.refusal import Refusal
from ergon.repl.language.scope import Scope, with_name
from ergon.repl.language.striking import StrikeModules
from ergon.repl.language.verbs import LEADING_VERBS
from ergon.scores.reading.families import library

MAX_CORRECTIONS = 4  # words of a line that are put right before it is offered again


def parse(submitted_text: str, scope: Scope) -> tuple[Command, ...]:
    """The commands of a submitted text; none for comments and blank lines. Raises Refusal."""
    try:
        return tuple(_read_commands(submitted_text, scope))
    except TextError as error:
        corrected_text = _corrected_text(submitted_text, scope, error)
        message = error.message
        if error.suggestion and corrected_text is None:
            message += f"; did you mean {quote(error.suggestion)}?"
        if "\n" in submitted_text.strip("\n"):
            message = f"line {submitted_text.count(chr(10), 0, error.offset) + 1}: {message}"
        raise Refusal(message, error.offset, error.length, corrected_text) from None


def first_error(submitted_text: str, scope: Scope) -> TextError | None:
    """The first mistake of a text; None where it is accepted."""
    try:
        for _ in _read_commands(submitted_text, scope):
            pass
    except TextError as error:
        return error
    return None


def _read_commands(text: str, scope: Scope) -> Iterator[Command]:
    for line in submitted_lines(text):
        command = read_command(line, scope)
        if command is None:
            continue
        if isinstance(command, DefineBlock):
            _check_block(command, scope)
        scope = _scope_after(scope, command)
        yield command


def parse_block_line(line_text: str, scope: Scope) -> Command:
    """The command of a line that a block may hold. Raises Refusal."""
    try:
        commands = [
            command
            for line in submitted_lines(line_text)
            if (command := _block_command(line, 0, scope)) is not None
        ]
        if len(commands) != 1:
            raise TextError(
                f"{quote(line_text)} is not one line of a session", length=len(line_text)
            )
        return commands[0]
    except TextError as error:
        raise Refusal(error.message, error.offset, error.length, None) from None


def _check_block(defined_block: DefineBlock, block_scope: Scope) -> None:
    """Refuse a block whose name is a verb, or that has a line which no block may hold."""
    if defined_block.name in LEADING_VERBS:
        name_word = defined_block.words["name"]
        message = f"{quote(defined_block.name)} is a verb: give the block another name"
        raise TextError(message, offset=name_word.start, length=len(defined_block.name))
    lines_word = defined_block.words["lines"]
    values_by_name = default_values(defined_block.lines)
    for block_line in submitted_lines(lines_word.text):
        if parse_setting(block_line.text) is not None:
            continue
        if "$" in block_line.text:
            block_scope = _check_variants(block_line, lines_word.start, values_by_name, block_scope)
            continue
        if (block_command := _block_command(block_line, lines_word.start, block_scope)) is not None:
            block_scope = _scope_after(block_scope, block_command)


def _check_variants(
    block_line: Line, block_offset: int, values_by_name: Mapping[str, str], scope: Scope
) -> Scope:
    """Check a line in which values are filled in; returns the scope of those below it.

    A mistake has the place of the whole line: what was filled in has none. Raises TextError.
    """
    for variant_text in line_variants(block_line.text, values_by_name):
        try:
            command = _block_command(Line(variant_text, 0), 0, scope)
        except TextError as error:
            start, length = block_offset + block_line.start, len(block_line.text.rstrip())
            message = f"{error.message}; the line is {quote(variant_text.strip())}"
            raise TextError(message, offset=start, length=length) from None
        if command is not None:
            scope = _scope_after(scope, command)
    return scope


def _block_command(block_line: Line, block_offset: int, scope: Scope) -> Command | None:
    """The command of a line of a block, whose text begins at `block_offset`. Raises TextError."""
    command = read_command(Line(block_line.text, block_offset + block_line.start), scope)
    if command is None or (isinstance(command, BlockCommand) and command.when is None):
        return command
    line_content = block_line.text.strip()
    content_offset = block_offset + block_line.start + block_line.text.index(line_content)
    refusal_reason = "says when it acts, and the lines of a block act when the block is run"
    if not isinstance(command, BlockCommand):
        refusal_reason = (
            "does not change the music, moves a real hand, or is about files, history or blocks"
        )
    message = f"a block cannot hold {quote(line_content)}: the line {refusal_reason}"
    raise TextError(message, offset=content_offset, length=len(line_content))


def _scope_after(scope: Scope, command: Command) -> Scope:
    """The scope of the lines below a command: it also has the names that the command adds."""
    if isinstance(command, Define):
        return with_name(scope, "gestures", command.name)
    if isinstance(command, DefinePhrase):
        return with_name(scope, "phrases", command.name)
    if isinstance(command, DefineBlock):
        return with_name(scope, "blocks", command.name)
    if isinstance(command, StrikeModules):
        return _scope_after_strikes(scope, command)
    if isinstance(command, Build):
        return with_name(scope, "instruments", command.name)
    if isinstance(command, Use):
        for member in library().get(command.family, ()):
            if member.name not in scope.instruments:
                scope = with_name(scope, "available", member.name)
        return scope
    if isinstance(command, Takes):
        return with_name(with_name(scope, "keys", command.key), "players", command.player)
    return scope


def _scope_after_strikes(scope: Scope, strikes: StrikeModules) -> Scope:
    """The scope with the name of strikes, and with the instruments that they begin to play."""
    for name in {path.partition(".")[0] for path in strikes.struck} & scope.available.keys():
        scope = with_name(scope, "instruments", name)
    return with_name(scope, "strikes", strikes.name)


def _corrected_text(submitted_text: str, scope: Scope, error: TextError) -> str | None:
    """The text with every suggestion applied; None if that is not accepted either."""
    for _ in range(MAX_CORRECTIONS):
        if error.suggestion is None:
            return None
        submitted_text = (
            submitted_text[: error.offset]
            + error.suggestion
            + submitted_text[error.offset + error.length :]
        )
        next_error = first_error(submitted_text, scope)
        if next_error is None:
            return submitted_text
        error = next_error
    return None
