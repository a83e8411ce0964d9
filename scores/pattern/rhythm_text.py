"""A rhythm as a text: `kick ~ [snare snare] hat*2`; a text is one cycle.

    text     := steps (',' steps)* | steps ('|' steps)*    together; one of them in each cycle
    steps    := step+ ('.' step+)*                         a dot groups; spaces are around it
    step     := (word | '~' | brackets) change*
              | '_' | '!'                                  the step before: longer, once more
    brackets := '[' text ']'
              | '<' steps (',' steps)* '>'                 one step in each cycle
              | '<' steps ('|' steps)+ '>'                 a random walk from cycle to cycle
              | '{' steps (',' steps)* '}' ['%' number]    so many steps in each cycle
    change   := ('*' | '/' | '@' | '!' | '?') number | '?'
              | '(' pulses ',' steps [',' turn] ')'

Steps share a cycle evenly, or by the weights after `@`. What a word stands for is asked of the
caller, once for each word that is written.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Generic

from ergon.notation.text.errors import TextError
from ergon.scores.pattern.cycle_operations import degrade, euclid, renumbered, walk
from ergon.scores.pattern.cycles import (
    MAX_EVENTS,
    Cycles,
    V,
    choose,
    fast,
    pure,
    sequence,
    silence,
    slow,
    stack,
)
from ergon.scores.pattern.rhythm_signs import NUMBER, Scanner

MAX_TEXT = 4_000  # characters
MAX_BRACKETS = 32  # inside one another

_HITS_AND_DOTS = re.compile(r"[xX.\s-]+")
WORD = re.compile(r"[^\W_][\w#'+:-]*(?:\.[\w#'+:-]+)*")
_CLOSING_BY_OPENING = {"[": "]", "<": ">", "{": "}"}
_OPENING_BY_CLOSING = {close: opened for opened, close in _CLOSING_BY_OPENING.items()}


def parse(
    rhythm_text: str, read_word: Callable[[str, int], V], text_start: int = 0, first_number: int = 0
) -> Cycles[V]:
    """Read a rhythm; `read_word` returns what a word at an offset stands for, and may raise
    TextError.

    `read_word` and TextError get offsets into the text plus `text_start`. Operators that draw
    chances are numbered in the order of writing from `first_number`. The values of all words, in
    the order of writing, are the `leaves` of the result.
    """
    if len(rhythm_text) > MAX_TEXT:
        message = f"a rhythm has at most {MAX_TEXT:,} characters; divide it among several lines"
        raise TextError(message, offset=text_start + MAX_TEXT, length=len(rhythm_text) - MAX_TEXT)
    if not rhythm_text.strip():
        message = "this rhythm has no steps; write for instance kick ~ snare ~"
        raise TextError(message, offset=text_start, length=max(1, len(rhythm_text)))
    return _Parser(rhythm_text, read_word, text_start, first_number).read_text("")


def line_offsets(rhythm_text: str) -> list[int]:
    """Where the lines of a rhythm text begin that commas outside all brackets divide."""
    offsets, depth = [0], 0
    for sign_place, sign in enumerate(rhythm_text):
        depth += (sign in "[<{(") - (sign in "]>})")
        if sign == "," and depth == 0:
            offsets.append(sign_place + 1)
    return offsets


@dataclass(slots=True)
class _Step(Generic[V]):
    """A step of a sequence: a pattern whose operators are numbered from `first_operator` to
    `stop_operator`.

    A repetition has them `operator_shift` higher, so that it draws its own chances.
    """

    pattern: Cycles[V]
    first_operator: int
    stop_operator: int
    weight: Fraction = Fraction(1)
    operator_shift: int = 0


class _Parser(Scanner, Generic[V]):
    """Reads steps and brackets."""

    def __init__(
        self, text: str, read: Callable[[str, int], V], start: int, first_operator: int
    ) -> None:
        super().__init__(text, start)
        self.read_word = read
        self.operator_number = first_operator  # number of the next operator that draws chances
        self.open_places: list[int] = []  # where brackets begin that are not closed yet

    # --- brackets -------------------------------------------------------------------------------

    def read_text(self, open_sign: str) -> Cycles[V]:
        """Read the text in brackets that begin with `open_sign`, or all of it, and its end."""
        bracket_begin = max(0, self.cursor - 1)
        step_lines = [self.read_line()]
        separator = ""
        while self.peek() in (",", "|"):
            self.check_separator(separator, open_sign)
            separator = self.text[self.cursor]
            self.cursor += 1
            step_lines.append(self.read_line())
        self.read_end()
        line_lengths = [sum((step.weight for step in line), Fraction(0)) for line in step_lines]
        line_patterns = [_sequence_of_steps(line) for line in step_lines]
        if open_sign == "<" and separator != "|":
            line_patterns = [
                slow(length, part) for length, part in zip(line_lengths, line_patterns, strict=True)
            ]
        elif open_sign == "{":
            steps = line_lengths[0]
            if self.peek(skips=False) == "%":
                self.cursor += 1
                steps = self.read_amount("%")
            line_patterns = [
                fast(steps / length, line_pattern)
                for length, line_pattern in zip(line_lengths, line_patterns, strict=True)
            ]
        if separator != "|":
            return self.check_size(stack(line_patterns), bracket_begin)
        self.operator_number += 1
        draw = walk if open_sign == "<" else choose
        return self.check_size(draw(self.operator_number - 1, line_patterns), bracket_begin)

    def check_separator(self, previous_separator: str, open_sign: str) -> None:
        """Refuse a separator that is not the one before it, or not of these brackets."""
        separator = self.text[self.cursor]
        if previous_separator not in ("", separator):
            message = "',' (together) and '|' (one in each cycle) are divided by brackets: "
            raise self.mistake(message + "kick, [snare | hat]", self.cursor)
        if separator == "|" and open_sign == "{":
            message = "'|' is written in square brackets: {[kick | snare] hat}"
            raise self.mistake(message, self.cursor)

    def read_end(self) -> None:
        """Read the end of the last bracket that is open, or of the text."""
        end_sign = self.peek()
        open_sign = self.text[self.open_places[-1]] if self.open_places else ""
        if not end_sign and not open_sign:
            return
        if not end_sign:
            message = (
                f"this '{open_sign}' is not closed; write {open_sign} … "
                f"{_CLOSING_BY_OPENING[open_sign]}"
            )
            raise self.mistake(message, self.open_places[-1])
        if not open_sign:
            message = f"'{end_sign}' has no '{_OPENING_BY_CLOSING[end_sign]}' before it; "
            raise self.mistake(
                f"{message}write {_OPENING_BY_CLOSING[end_sign]} … {end_sign}", self.cursor
            )
        if end_sign != _CLOSING_BY_OPENING[open_sign]:
            closing_sign = _CLOSING_BY_OPENING[open_sign]
            message = (
                f"'{end_sign}' does not close the '{open_sign}' before it; write {closing_sign}"
            )
            raise self.mistake(message, self.cursor, suggestion=closing_sign)
        self.open_places.pop()
        self.cursor += 1

    # --- steps ----------------------------------------------------------------------------------

    def read_line(self) -> list[_Step[V]]:
        """The steps up to a comma, a bar or the end of brackets; a group of dots is a step."""
        step_groups: list[list[_Step[V]]] = [[]]
        line_cost = 0
        while (next_sign := self.peek()) and next_sign not in ",|]>}":
            line_steps, end_place = step_groups[-1], self.cursor
            if next_sign == ".":
                self.read_dot(line_steps)
                step_groups.append([])
            elif next_sign == "_" and not WORD.match(self.text, end_place + 1):
                self.require_step(line_steps).weight += 1
                self.cursor += 1
            elif next_sign == "!":
                line_cost += self.read_repetition(line_steps, line_cost)
            else:
                line_steps.append(self.read_step())
                line_cost += line_steps[-1].pattern.cost
        if not step_groups[-1]:
            if not self.peek() and self.open_places:
                self.read_end()
            end_place = len(self.text[: self.cursor].rstrip())
            message = "there is no step here; a rest is written ~"
            raise self.mistake(message, max(0, end_place - 1))
        if len(step_groups) == 1:
            return step_groups[0]
        return [_step_of_group(steps) for steps in step_groups]

    def read_dot(self, steps: list[_Step[V]]) -> None:
        """Read a dot that groups steps."""
        characters_around = self.text[max(0, self.cursor - 1) : self.cursor + 2]
        if not steps or len(characters_around) < 3 or characters_around.strip() != ".":
            message = "a dot that groups has steps and a space on each side: kick hat . snare hat"
            if _HITS_AND_DOTS.fullmatch(self.text):
                message = "a hit is the name of an instrument, and a rest is ~: kick ~ kick kick"
            raise self.mistake(message, self.cursor)
        self.cursor += 1

    def require_step(self, line_steps: list[_Step[V]]) -> _Step[V]:
        """The step that the next sign repeats or lengthens."""
        if not line_steps:
            message = "'_' lengthens the step before it, and there is none here: kick _ snare"
            if self.text[self.cursor] == "!":
                message = "'!' repeats the step before it, and there is none here: kick ! snare"
            raise self.mistake(message, self.cursor)
        return line_steps[-1]

    def read_repetition(self, steps: list[_Step[V]], cost: int) -> int:
        """Read `!` or `!3`, and return what the repetitions cost; `cost` is that of the line."""
        sign_begin = self.cursor
        last_step = self.require_step(steps)
        self.cursor += 1
        repeat_count = Fraction(2)
        if NUMBER.match(self.text, self.cursor):
            if self.text[sign_begin - 1].isspace():
                raise self.mistake("'!' follows its step without a space: kick!3", sign_begin)
            repeat_count = self.read_amount("!")
        if repeat_count.denominator != 1:
            message = "'!' repeats a step as often as a number without a fraction says: kick!3"
            raise self.mistake(message, sign_begin, self.cursor - sign_begin)
        added_cost = (int(repeat_count) - 1) * last_step.pattern.cost
        if cost + added_cost > MAX_EVENTS:
            message = f"these steps would be more than {MAX_EVENTS:,} in a cycle; repeat less often"
            raise self.mistake(message, sign_begin, self.cursor - sign_begin)
        for _ in range(int(repeat_count) - 1):
            steps.append(
                replace(last_step, operator_shift=self.operator_number - last_step.first_operator)
            )
            self.operator_number += last_step.stop_operator - last_step.first_operator
        return added_cost

    def read_step(self) -> _Step[V]:
        """Read a word, a rest or brackets, with what changes them."""
        first_number, step_begin = self.operator_number, self.cursor
        first_sign = self.text[step_begin]
        word_match = WORD.match(self.text, step_begin)
        cycles: Cycles[V] = silence()
        if word_match:
            self.cursor = word_match.end()
            cycles = pure(self.read_word(word_match.group(), self.start + step_begin))
        elif first_sign == "~":
            self.cursor += 1
        elif first_sign in _CLOSING_BY_OPENING:
            if len(self.open_places) == MAX_BRACKETS:
                message = f"at most {MAX_BRACKETS} brackets are inside one another; remove some"
                raise self.mistake(message, step_begin)
            self.open_places.append(step_begin)
            self.cursor += 1
            cycles = self.read_text(first_sign)
        else:
            raise self.unknown_sign_error(first_sign)
        step = _Step(cycles, first_number, first_number)
        while (change := self.peek(skips=False)) and change in "*/?@(":
            self.read_change(step, change)
        step.stop_operator = self.operator_number
        return step

    def read_change(self, step: _Step[V], sign: str) -> None:
        """Read one change of a step."""
        change_begin = self.cursor
        if sign == "(":
            rhythm = self.read_euclid()
            operator_count = self.operator_number - step.first_operator
            self.operator_number += operator_count * (rhythm.pulses - 1)
            step.pattern = euclid(rhythm, step.pattern, operator_count)
        else:
            self.cursor += 1
            has_number = sign != "?" or NUMBER.match(self.text, self.cursor)
            amount = self.read_amount(sign) if has_number else Fraction(1, 2)
            if sign == "@":
                step.weight = amount
            elif sign == "?":
                step.pattern = degrade(self.operator_number, float(amount), step.pattern)
                self.operator_number += 1
            else:
                step.pattern = fast(amount if sign == "*" else 1 / amount, step.pattern)
        self.check_size(step.pattern, change_begin)

    def check_size(self, cycles: Cycles[V], begin: int) -> Cycles[V]:
        """The pattern that is written from `begin` to here, unless it is too large."""
        excess = cycles.excess()
        if excess is not None:
            message = f"{excess}; repeat less often, or remove brackets"
            raise self.mistake(message, begin, self.cursor - begin)
        return cycles


def _sequence_of_steps(steps: Sequence[_Step[V]]) -> Cycles[V]:
    return sequence(
        [(renumbered(step.operator_shift, step.pattern), step.weight) for step in steps]
    )


def _step_of_group(steps: Sequence[_Step[V]]) -> _Step[V]:
    first_step, last_step = steps[0], steps[-1]
    return _Step(
        _sequence_of_steps(steps),
        first_step.first_operator + first_step.operator_shift,
        last_step.stop_operator + last_step.operator_shift,
    )
