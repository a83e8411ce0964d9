"""The values of lines about blocks: a name, lines, a rule."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ergon.notation.tables.shapes import NAME
from ergon.notation.text.errors import TextError, quote
from ergon.repl.language import amounts, values
from ergon.repl.language.block_values import check_setting
from ergon.repl.language.commands import Command, When
from ergon.repl.language.forms import Slot, Words, form
from ergon.repl.language.lines import submitted_lines
from ergon.repl.language.scope import Scope
from ergon.repl.language.triggers import Condition, Every, Trigger, parse_condition, parse_every
from ergon.repl.language.values import Completion, CompletionContext, Value
from ergon.scores.reading.sections import BLOCK_LINES_MAX


@dataclass(frozen=True, slots=True)
class DefineBlock(Command):
    """`def fill: …`: define a block of lines; it replaces a block of the same name."""

    name: str
    lines: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class RunBlock(Command):
    """`fill`, `fill 16`, `fill n=16`: do the lines of a block, as one version; with values."""

    name: str
    values: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class RunByRule(Command):
    """`fill every 4bar`, `when bar % 4 == 3 fill`: run a block by a rule."""

    name: str
    trigger: Trigger


@dataclass(frozen=True, slots=True)
class StopBlock(Command):
    """`stop fill`: end the rule of a block."""

    name: str


_CONDITION_WORDS = ("bar", "beat", "and")


def _read_block_name(
    slot_text: str, scope: Scope, _: Mapping[str, Any]
) -> tuple[str, tuple[str, ...]]:
    """A block's name and the lines that set its values, with the colon after them."""
    if not slot_text.endswith(":"):
        message = f"a ':' is missing: def {slot_text}: and then its lines"
        raise TextError(message, length=len(slot_text), suggestion=f"{slot_text}:")
    block_word, *setting_words = slot_text[:-1].split()
    block_name = values.check_new_name(block_word)
    if block_name in _CONDITION_WORDS:
        message = f"{quote(block_name)} is a word of conditions: give the block another name"
        raise TextError(message, length=len(block_name))
    for name_kind in ("player", "gesture", "take", "key", "instrument", "mark"):
        if block_name in getattr(scope, f"{name_kind}s"):
            message = (
                f"{quote(block_name)} is the name of a {name_kind}: give the block another name"
            )
            raise TextError(message, length=len(block_name))
    return block_name, tuple(_setting_line(value) for value in setting_words)


def _setting_line(slot_text: str) -> str:
    """The line of a block that sets a value, from `n=8`."""
    value_name, equals_sign, value_text = slot_text.partition("=")
    if not equals_sign:
        raise TextError(
            f"{quote(slot_text)} has no value: write {slot_text}=8", length=len(slot_text)
        )
    return "${} = {}".format(*check_setting(value_name, value_text))


def _count_to_colon(words: Sequence[str]) -> int:
    """How many words there are up to the colon."""
    return next((number for number, word in enumerate(words, 1) if word.endswith(":")), 1)


def _read_block_lines(slot_text: str, *_: Any) -> tuple[str, ...]:
    block_lines = tuple(line.text.strip() for line in submitted_lines(slot_text))
    if len(block_lines) > BLOCK_LINES_MAX:
        message = f"this block has {len(block_lines)} lines; {BLOCK_LINES_MAX} are the most"
        raise TextError(message, length=len(slot_text))
    return block_lines


def _parse_rule(rule_text: str, scope: Scope, _: Mapping[str, Any]) -> tuple[Condition, str]:
    """The condition of a rule, and the name of the block after it."""
    rule_words = rule_text.split()
    if rule_words[-1] in _CONDITION_WORDS or not NAME.fullmatch(rule_words[-1]):
        raise TextError(f"a block is missing: when {rule_text} NAME", offset=len(rule_text))
    name_start = rule_text.rindex(rule_words[-1])
    try:
        block_name = BLOCK_VALUE.read(rule_words[-1], scope, {})
    except TextError as error:
        error.offset += name_start
        raise
    return parse_condition(rule_text[:name_start].rstrip()), block_name


def _rule_completions(context: CompletionContext) -> Iterator[Completion]:
    if not context.earlier_words:
        yield from (Completion(text, "a condition") for text in ("bar", "beat"))
    elif context.earlier_words[-2:-1] == ("%",):
        yield Completion("==", "as in when bar % 4 == 3 fill")
    elif context.earlier_words[-1].isdigit():
        yield Completion("and", "a further condition")
        yield from values.name_completions(context.scope.blocks)
    else:
        last_word = context.earlier_words[-1]
        next_words = {"bar": ("%", "=="), "beat": ("==", "%"), "and": ("bar", "beat")}.get(
            last_word, ()
        )
        yield from (Completion(text, "as in when bar % 4 == 3 fill") for text in next_words)


BLOCK_VALUE = values.name_value("a block", "blocks")
NEW_BLOCK = Value(
    "a name and ':'",
    _read_block_name,
    lambda context: values.name_completions(context.scope.blocks),
    word_count=_count_to_colon,
)
VALUES_VALUE = Value(
    "values, such as 16 or n=16", lambda text, *_: tuple(text.split()), lambda _: ()
)
LINES_VALUE = Value("a line, or several below it", _read_block_lines, lambda _: ())
EVERY_VALUE = Value(
    "a length in bars or beats",
    lambda text, *_: parse_every(text),
    amounts.LENGTH_VALUE.completions,
)
RULE_VALUE = Value("a condition and a block", _parse_rule, _rule_completions)


def define_block(
    name: tuple[str, tuple[str, ...]], lines: tuple[str, ...], *, when: When, words: Words
) -> DefineBlock:
    """Define a block; the lines that set its values come first."""
    return DefineBlock(name[0], (*name[1], *lines), when=when, words=words)


def run_block(name: str, values: tuple[str, ...] | None, *, when: When, words: Words) -> RunBlock:
    """Run a block with values."""
    return RunBlock(name, values or (), when=when, words=words)


def run_every(name: str, trigger: Every, *, when: When, words: Words) -> RunByRule:
    """Run a block at regular intervals."""
    return RunByRule(name, trigger, when=when, words=words)


def run_when(rule: tuple[Condition, str], *, when: When, words: Words) -> RunByRule:
    """Run a block when a condition holds."""
    return RunByRule(rule[1], rule[0], when=when, words=words)


# fmt: off
DEF_FORM = form("def", "de", "gives one line a name, or those below it up to `end`",
    "def fill: ada plays lean times 2", define_block,
    Slot("name", "NAME [NAME=VALUE …]:", NEW_BLOCK),
    Slot("lines", "LINE …", LINES_VALUE, takes_many=True), takes_time=False)
RUN_FORM = form("run", "ru", "does all lines of a block; its name alone does the same",
    "run fill", run_block, Slot("name", "NAME", BLOCK_VALUE),
    Slot("values", "VALUE|NAME=VALUE …", VALUES_VALUE, optional=True, takes_many=True))
EVERY_FORM = form("every", "ev", "runs a block again and again, the first time from here on",
    "fill every 4bar", run_every, Slot("name", "NAME", BLOCK_VALUE),
    Slot("trigger", "LENGTH", EVERY_VALUE), begins_with_subject=True)
WHEN_FORM = form("when", "w", "runs a block where a condition on bar or beat is true",
    "when bar % 4 == 3 fill", run_when,
    Slot("rule", "CONDITION NAME", RULE_VALUE, takes_many=True))
STOP_BLOCK_FORM = form("stop", "st", "stops a block that runs by itself", "stop fill", StopBlock,
    Slot("name", "NAME", BLOCK_VALUE))
# fmt: on
