"""Version edits of blocks: named lines, run by hand or by a rule."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from ergon.notation.text.errors import TextError
from ergon.repl.language.block_values import with_values
from ergon.repl.language.blocks import DefineBlock, RunBlock, RunByRule, StopBlock
from ergon.repl.language.parse import parse_block_line
from ergon.repl.language.refusal import Refusal
from ergon.repl.language.scope import scope_of
from ergon.repl.session.block_rules import MAX_RULES, Rule
from ergon.repl.session.edit_table import VERSION_EDITS, edits_texts, makes_edit
from ergon.repl.session.version import NotTakenError, Version
from ergon.scores.edits import blocks
from ergon.scores.edits.texts import Texts

if TYPE_CHECKING:
    from ergon.repl.session.waiting_lines import VersionEdit


@edits_texts(DefineBlock)
def _define_block(command: DefineBlock, version: Version, beat: float) -> Texts:
    return blocks.define(version.texts, version.piece, command.name, command.lines)


@makes_edit(RunBlock)
def _run_block(command: RunBlock) -> VersionEdit:
    return lambda version, beat: run_block(version, beat, command.name, command.values)


@makes_edit(RunByRule)
def _run_block_by_rule(command: RunByRule) -> VersionEdit:
    """Run a block by a rule from here on; and at once, if the rule says so."""
    block_name, trigger = command.name, command.trigger

    def edit(version: Version, edit_beat: float) -> Version:
        if len(version.rules) >= MAX_RULES and block_name not in version.rules:
            raise NotTakenError(f"at most {MAX_RULES} blocks run by themselves; `stop` one first")
        block_lines(version, block_name)
        edited_version = replace(
            version, rules={**version.rules, block_name: Rule(edit_beat, trigger)}
        )
        if trigger.runs_at_start(version.piece.tempo_map, edit_beat):
            edited_version = run_block(edited_version, edit_beat, block_name)
        return edited_version

    return edit


@makes_edit(StopBlock)
def _stop_block(command: StopBlock) -> VersionEdit:
    block_name = command.name

    def edit(version: Version, beat: float) -> Version:
        if block_name not in version.rules:
            raise NotTakenError(
                f"{block_name} does not run by itself; `show` lists the blocks that do"
            )
        return replace(
            version,
            rules={name: rule for name, rule in version.rules.items() if name != block_name},
        )

    return edit


def block_lines(version: Version, block_name: str) -> list[str]:
    """The lines of a block. Raises NotTakenError if the score has no block of that name."""
    written_lines = version.piece.blocks.get(block_name)
    if written_lines is None:
        raise NotTakenError(f"the score has no block {block_name}")
    return list(written_lines)


def run_block(
    version: Version, run_beat: float, block_name: str, value_words: Sequence[str] = ()
) -> Version:
    """The version with the lines of a block done at a beat, with values. Raises NotTakenError."""
    edited_version = version
    try:
        filled_lines = with_values(block_lines(version, block_name), value_words)
    except TextError as error:
        raise NotTakenError(f"{block_name}: {error.message}") from None
    for run_number, line in enumerate(filled_lines, 1):
        try:
            command = parse_block_line(line, scope_of(edited_version.piece))
        except Refusal as refusal:
            raise NotTakenError(f"line {run_number} of {block_name}: {refusal.message}") from None
        edited_version = VERSION_EDITS[type(command)](command)(edited_version, run_beat)
    return replace(edited_version, rules=version.rules)
