"""The words after `hear`: what is struck once, at which notes, and how strongly."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

from ergon.notation.tables.notes import check_note, word_of
from ergon.notation.tables.strengths import DYNAMICS, MEZZO_FORTE, Level, is_level, level
from ergon.notation.text.errors import TextError, quote
from ergon.repl.language import values as v
from ergon.repl.language.commands import Command, When
from ergon.repl.language.forms import Slot, Words, form
from ergon.repl.language.scope import Scope, playable
from ergon.repl.language.values import Completion, CompletionContext, Value
from ergon.scores.pattern.words import Word


@dataclass(frozen=True, slots=True)
class Hear(Command):
    """`hear kick`, `hear vib C4 E4 f`, `hear bell.m 2mNs`: strike once, at the next tick.

    `notes` are the words of pitches; none: the note in the middle, if the instrument has notes.
    """

    target: str
    notes: tuple[str, ...]
    level: Level

    @property
    def name(self) -> str:
        """The name of what was struck, among the maps of a version."""
        return " ".join(("hear", self.target, *self.notes))


class Stroke(NamedTuple):
    """What is struck, at which notes (by their words), and how strongly."""

    target: str
    notes: tuple[str, ...]
    level: Level


def hear(stroke: Stroke, *, when: When, words: Words) -> Hear:
    """Strike once."""
    return Hear(*stroke, when=when, words=words)


def _read(text: str, scope: Scope, _: Mapping[str, Any]) -> Stroke:
    words = (Word(match.group(), match.start()) for match in re.finditer(r"\S+", text))
    first, *rest = words
    if rest and rest[-1].text == "now":  # it acts at once anyway
        rest.pop()
    target = _target(first.text, scope)
    notes: list[str] = []
    strength = None
    for word in rest:
        try:
            if word.text in ("at", "in", "now"):
                message = f"'hear' acts at once: leave out '{word.text}'"
                raise TextError(message, length=len(word.text))
            if strength is not None:
                message = "a stroke has one level, behind its notes"
                raise TextError(f"{message}: hear {target} f", length=len(word.text))
            note = _note(word.text)
            if note is not None:
                notes.append(note)
            elif is_level(word.text):
                strength = level(word.text)
                _check_level(strength, word.text, target, scope)
            else:
                check_note(word.text)
        except TextError as error:
            error.offset += word.offset
            raise
    if strength is None:
        strength = MEZZO_FORTE
        _check_level(strength, "", target, scope)
    return Stroke(target, tuple(notes), strength)


def is_stroke_word(text: str) -> bool:
    """Whether a word is one of those behind what is struck: a note or a level."""
    return _note(text) is not None or is_level(text)


def _note(text: str) -> str | None:
    return word_of(text[:1].upper() + text[1:])


def _target(text: str, scope: Scope) -> str:
    """The path of what is struck, as a line may play it. Raises TextError."""
    family, slash, path = text.rpartition("/")
    name = path.partition(".")[0]
    if name in playable(scope) and (not slash or name in scope.families.get(family, ())):
        return path
    families = [family] if slash else [*scope.families]
    known = [group for group in families if name in scope.families.get(group, ())]
    if known:
        error = v.family_missing(name, known[0], f"hear {path}")
        error.length = len(text)
        raise error
    if family in scope.families:
        raise v.unknown_name(name, f"an instrument of {family}", scope.families[family])
    if slash:
        raise v.unknown_name(family, "a family of instruments", scope.families)
    raise v.unknown_name(text, "an instrument", playable(scope))


def _check_level(strength: Level, text: str, target: str, scope: Scope) -> None:
    """Refuse a range, and a strength of what does not say how it is played."""
    if strength.low != strength.high:
        message = f"one stroke has one level, and {quote(text)} is a range: write one of its ends"
        raise TextError(message, length=len(text))
    part, _, rest = target.partition(".")
    acts = scope.acts.get(part, ())
    if not strength.is_strength or (acts and (not rest or rest in acts)):
        return
    why = f"{quote(part)} does not say how it is played"
    if acts:
        why = f"{quote(rest)} is not a way to play {part}, which are {', '.join(acts)}"
    raise TextError(f"the impulse is missing: {why}; write hear {target} 2mNs", length=len(text))


def _offers(context: CompletionContext) -> Iterator[Completion]:
    if not context.before:
        yield from v.struck_completions(context)
    elif not is_level(context.before[-1]):
        yield from (Completion(word, "how strongly") for word in DYNAMICS)


STROKE = Value("what is struck, such as kick, vib C4 f or bell.m 2mNs", _read, _offers)


# fmt: off
HEAR_FORM = form("hear", "hea", "strikes once, now: an instrument, an act or a module",
    "hear gong f", hear,
    Slot("stroke", "INSTRUMENT[.ACT]|MODULE [NOTE …] [LEVEL]", STROKE, many=True),
    timed=False)
# fmt: on
