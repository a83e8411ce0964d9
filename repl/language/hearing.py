"""The words after `hear`: what is struck once, at which notes, and how strongly."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

from ergon.notation.tables.notes import check_note, word_of
from ergon.notation.tables.strengths import DYNAMICS, MEZZO_FORTE, Level, is_level, level
from ergon.notation.text.errors import TextError, quote
from ergon.repl.language import values
from ergon.repl.language.commands import Command, When
from ergon.repl.language.forms import Slot, Words, form
from ergon.repl.language.scope import Scope, playable_instruments
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


def _read_stroke(text: str, scope: Scope, _: Mapping[str, Any]) -> Stroke:
    words = (Word(match.group(), match.start()) for match in re.finditer(r"\S+", text))
    first_word, *later_words = words
    if later_words and later_words[-1].text == "now":  # `hear` acts at once without `now`
        later_words.pop()
    target_path = _target_path(first_word.text, scope)
    note_words: list[str] = []
    stroke_level = None
    for later_word in later_words:
        try:
            if later_word.text in ("at", "in", "now"):
                message = f"'hear' acts at once: leave out '{later_word.text}'"
                raise TextError(message, length=len(later_word.text))
            if stroke_level is not None:
                message = "a stroke has one level, behind its notes"
                raise TextError(f"{message}: hear {target_path} f", length=len(later_word.text))
            note_word = _note_word(later_word.text)
            if note_word is not None:
                note_words.append(note_word)
            elif is_level(later_word.text):
                stroke_level = level(later_word.text)
                _check_level(stroke_level, later_word.text, target_path, scope)
            else:
                check_note(later_word.text)
        except TextError as error:
            error.offset += later_word.offset
            raise
    if stroke_level is None:
        stroke_level = MEZZO_FORTE
        _check_level(stroke_level, "", target_path, scope)
    return Stroke(target_path, tuple(note_words), stroke_level)


def is_stroke_word(text: str) -> bool:
    """Whether a word is one of those behind what is struck: a note or a level."""
    return _note_word(text) is not None or is_level(text)


def _note_word(text: str) -> str | None:
    return word_of(text[:1].upper() + text[1:])


def _target_path(target_text: str, scope: Scope) -> str:
    """The path of what is struck, as a line may play it. Raises TextError."""
    family, slash, path = target_text.rpartition("/")
    part_name = path.partition(".")[0]
    if part_name in playable_instruments(scope) and (
        not slash or part_name in scope.families.get(family, ())
    ):
        return path
    families = [family] if slash else [*scope.families]
    families_of_part = [
        family_name for family_name in families if part_name in scope.families.get(family_name, ())
    ]
    if families_of_part:
        error = values.missing_family_error(part_name, families_of_part[0], f"hear {path}")
        error.length = len(target_text)
        raise error
    if family in scope.families:
        raise values.unknown_name_error(
            part_name, f"an instrument of {family}", scope.families[family]
        )
    if slash:
        raise values.unknown_name_error(family, "a family of instruments", scope.families)
    raise values.unknown_name_error(target_text, "an instrument", playable_instruments(scope))


def _check_level(level: Level, level_text: str, target_path: str, scope: Scope) -> None:
    """Refuse a range, and a strength of what does not say how it is played."""
    if level.low != level.high:
        message = (
            f"one stroke has one level, and {quote(level_text)} is a range: write one of its ends"
        )
        raise TextError(message, length=len(level_text))
    part_name, _, module_path = target_path.partition(".")
    acts = scope.acts.get(part_name, ())
    if not level.is_strength or (acts and (not module_path or module_path in acts)):
        return
    refusal_reason = f"{quote(part_name)} does not say how it is played"
    if acts:
        refusal_reason = (
            f"{quote(module_path)} is not a way to play {part_name}, which are {', '.join(acts)}"
        )
    raise TextError(
        f"the impulse is missing: {refusal_reason}; write hear {target_path} 2mNs",
        length=len(level_text),
    )


def _completions(context: CompletionContext) -> Iterator[Completion]:
    if not context.earlier_words:
        yield from values.struck_completions(context)
    elif not is_level(context.earlier_words[-1]):
        yield from (Completion(word, "how strongly") for word in DYNAMICS)


STROKE_VALUE = Value(
    "what is struck, such as kick, vib C4 f or bell.m 2mNs", _read_stroke, _completions
)


# fmt: off
HEAR_FORM = form("hear", "hea", "strikes once, now: an instrument, an act or a module",
    "hear gong f", hear,
    Slot("stroke", "INSTRUMENT[.ACT]|MODULE [NOTE …] [LEVEL]", STROKE_VALUE, takes_many=True),
    takes_time=False)
# fmt: on
