"""The values of lines about blocks: a name, lines, a rule."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from ergon.notation.tables.shapes import NAME
from ergon.notation.text.errors import TextError, quote
from ergon.repl.language import commands as c
from ergon.repl.language import values as v
from ergon.repl.language.forms import Words
from ergon.repl.language.lines import lines
from ergon.repl.language.scope import Scope
from ergon.repl.language.triggers import Condition, Every, parse_condition, parse_every
from ergon.repl.language.values import Completion, CompletionContext, Value
from ergon.scores.reading.sections import MAX_BLOCK

_CONDITION_WORDS = ("bar", "beat", "and")


def _name(text: str, scope: Scope, _: Mapping[str, Any]) -> str:
    """A block's name, with the colon after it."""
    if not text.endswith(":"):
        message = f"a ':' is missing: def {text}: and then its lines"
        raise TextError(message, length=len(text), suggestion=f"{text}:")
    name = v.check_new_name(text[:-1])
    if name in _CONDITION_WORDS:
        message = f"{quote(name)} is a word of conditions: give the block another name"
        raise TextError(message, length=len(name))
    for what in ("player", "gesture", "take", "key", "instrument", "mark"):
        if name in getattr(scope, f"{what}s"):
            message = f"{quote(name)} is the name of a {what}: give the block another name"
            raise TextError(message, length=len(name))
    return name


def _lines(text: str, *_: Any) -> tuple[str, ...]:
    found = tuple(line.text.strip() for line in lines(text))
    if len(found) > MAX_BLOCK:
        message = f"this block has {len(found)} lines; {MAX_BLOCK} are the most"
        raise TextError(message, length=len(text))
    return found


def _rule(text: str, scope: Scope, _: Mapping[str, Any]) -> tuple[Condition, str]:
    """The condition of a rule, and the name of the block after it."""
    words = text.split()
    if words[-1] in _CONDITION_WORDS or not NAME.fullmatch(words[-1]):
        raise TextError(f"a block is missing: when {text} NAME", offset=len(text))
    start = text.rindex(words[-1])
    try:
        name = BLOCK.read(words[-1], scope, {})
    except TextError as error:
        error.offset += start
        raise
    return parse_condition(text[:start].rstrip()), name


def _rule_completions(context: CompletionContext) -> Iterator[Completion]:
    if not context.before:
        yield from (Completion(text, "a condition") for text in ("bar", "beat"))
    elif context.before[-2:-1] == ("%",):
        yield Completion("==", "as in when bar % 4 == 3 fill")
    elif context.before[-1].isdigit():
        yield Completion("and", "a further condition")
        yield from v.name_completions(context.scope.blocks)
    else:
        last = context.before[-1]
        follows = {"bar": ("%", "=="), "beat": ("==", "%"), "and": ("bar", "beat")}.get(last, ())
        yield from (Completion(text, "as in when bar % 4 == 3 fill") for text in follows)


BLOCK = v.name_value("a block", "blocks")
NEW_BLOCK = Value("a name and ':'", _name, lambda context: v.name_completions(context.scope.blocks))
LINES = Value("a line, or several below it", _lines, lambda _: ())
EVERY = Value("a length in bars or beats", lambda text, *_: parse_every(text), v.LENGTH.completions)
RULE = Value("a condition and a block", _rule, _rule_completions)


def define(name: str, lines: tuple[str, ...], *, when: c.When, words: Words) -> c.DefineBlock:
    """Define a block."""
    return c.DefineBlock(name, lines, when=when, words=words)


def run_every(name: str, trigger: Every, *, when: c.When, words: Words) -> c.RunByRule:
    """Run a block at regular intervals."""
    return c.RunByRule(name, trigger, when=when, words=words)


def run_when(rule: tuple[Condition, str], *, when: c.When, words: Words) -> c.RunByRule:
    """Run a block when a condition holds."""
    return c.RunByRule(rule[1], rule[0], when=when, words=words)
