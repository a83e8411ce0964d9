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


def line_begins(rhythm_text: str) -> list[int]:
    """Where the lines of a rhythm text begin that commas outside all brackets divide."""
    begins, depth = [0], 0
    for sign_place, sign in enumerate(rhythm_text):
        depth += (sign in "[<{(") - (sign in "]>})")
        if sign == "," and depth == 0:
            begins.append(sign_place + 1)
    return begins


@dataclass(slots=True)
class _Step(Generic[V]):
    """A step of a sequence: a pattern whose operators are numbered from `first` to `stop`.

    A repetition has them `shift` higher, so that it draws its own chances.
    """

    base: Cycles[V]
    first: int
    stop: int
    weight: Fraction = Fraction(1)
    shift: int = 0


class _Parser(Scanner, Generic[V]):
    """Reads steps and brackets."""

    def __init__(
        self, text: str, read: Callable[[str, int], V], start: int, first_operator: int
    ) -> None:
        super().__init__(text, start)
        self.read = read
        self.number = first_operator  # number of the next operator that draws chances
        self.open: list[int] = []  # where brackets begin that are not closed yet

    # --- brackets -------------------------------------------------------------------------------

    def read_text(self, open_sign: str) -> Cycles[V]:
        """Read the text in brackets that begin with `open_sign`, or all of it, and its end."""
        bracket_begin = max(0, self.place - 1)
        step_lines = [self.read_line()]
        separator = ""
        while self.peek() in (",", "|"):
            self.check_separator(separator, open_sign)
            separator = self.text[self.place]
            self.place += 1
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
                self.place += 1
                steps = self.amount("%")
            line_patterns = [
                fast(steps / length, line_pattern)
                for length, line_pattern in zip(line_lengths, line_patterns, strict=True)
            ]
        if separator != "|":
            return self.checked_size(stack(line_patterns), bracket_begin)
        self.number += 1
        draw = walk if open_sign == "<" else choose
        return self.checked_size(draw(self.number - 1, line_patterns), bracket_begin)

    def check_separator(self, text_before: str, separator_sign: str) -> None:
        """Refuse a separator that is not the one before it, or not of these brackets."""
        separator = self.text[self.place]
        if text_before not in ("", separator):
            message = "',' (together) and '|' (one in each cycle) are divided by brackets: "
            raise self.mistake(message + "kick, [snare | hat]", self.place)
        if separator == "|" and separator_sign == "{":
            message = "'|' is written in square brackets: {[kick | snare] hat}"
            raise self.mistake(message, self.place)

    def read_end(self) -> None:
        """Read the end of the last bracket that is open, or of the text."""
        end_sign = self.peek()
        open_sign = self.text[self.open[-1]] if self.open else ""
        if not end_sign and not open_sign:
            return
        if not end_sign:
            message = (
                f"this '{open_sign}' is not closed; write {open_sign} … "
                f"{_CLOSING_BY_OPENING[open_sign]}"
            )
            raise self.mistake(message, self.open[-1])
        if not open_sign:
            message = f"'{end_sign}' has no '{_OPENING_BY_CLOSING[end_sign]}' before it; "
            raise self.mistake(
                f"{message}write {_OPENING_BY_CLOSING[end_sign]} … {end_sign}", self.place
            )
        if end_sign != _CLOSING_BY_OPENING[open_sign]:
            closing_sign = _CLOSING_BY_OPENING[open_sign]
            message = (
                f"'{end_sign}' does not close the '{open_sign}' before it; write {closing_sign}"
            )
            raise self.mistake(message, self.place, suggestion=closing_sign)
        self.open.pop()
        self.place += 1

    # --- steps ----------------------------------------------------------------------------------

    def read_line(self) -> list[_Step[V]]:
        """The steps up to a comma, a bar or the end of brackets; a group of dots is a step."""
        step_groups: list[list[_Step[V]]] = [[]]
        line_cost = 0
        while (next_sign := self.peek()) and next_sign not in ",|]>}":
            line_steps, end_place = step_groups[-1], self.place
            if next_sign == ".":
                self.read_dot(line_steps)
                step_groups.append([])
            elif next_sign == "_" and not WORD.match(self.text, end_place + 1):
                self.last_step(line_steps).weight += 1
                self.place += 1
            elif next_sign == "!":
                line_cost += self.read_repetition(line_steps, line_cost)
            else:
                line_steps.append(self.read_step())
                line_cost += line_steps[-1].base.cost
        if not step_groups[-1]:
            if not self.peek() and self.open:
                self.read_end()
            end_place = len(self.text[: self.place].rstrip())
            message = "there is no step here; a rest is written ~"
            raise self.mistake(message, max(0, end_place - 1))
        if len(step_groups) == 1:
            return step_groups[0]
        return [_step_of_group(steps) for steps in step_groups]

    def read_dot(self, steps: list[_Step[V]]) -> None:
        """Read a dot that groups steps."""
        characters_around = self.text[max(0, self.place - 1) : self.place + 2]
        if not steps or len(characters_around) < 3 or characters_around.strip() != ".":
            message = "a dot that groups has steps and a space on each side: kick hat . snare hat"
            if _HITS_AND_DOTS.fullmatch(self.text):
                message = "a hit is the name of an instrument, and a rest is ~: kick ~ kick kick"
            raise self.mistake(message, self.place)
        self.place += 1

    def last_step(self, line_steps: list[_Step[V]]) -> _Step[V]:
        """The step that the next sign repeats or lengthens."""
        if not line_steps:
            message = "'_' lengthens the step before it, and there is none here: kick _ snare"
            if self.text[self.place] == "!":
                message = "'!' repeats the step before it, and there is none here: kick ! snare"
            raise self.mistake(message, self.place)
        return line_steps[-1]

    def read_repetition(self, steps: list[_Step[V]], cost: int) -> int:
        """Read `!` or `!3`, and return what the repetitions cost; `cost` is that of the line."""
        sign_begin = self.place
        last_step = self.last_step(steps)
        self.place += 1
        repeat_count = Fraction(2)
        if NUMBER.match(self.text, self.place):
            if self.text[sign_begin - 1].isspace():
                raise self.mistake("'!' follows its step without a space: kick!3", sign_begin)
            repeat_count = self.amount("!")
        if repeat_count.denominator != 1:
            message = "'!' repeats a step as often as a number without a fraction says: kick!3"
            raise self.mistake(message, sign_begin, self.place - sign_begin)
        added_cost = (int(repeat_count) - 1) * last_step.base.cost
        if cost + added_cost > MAX_EVENTS:
            message = f"these steps would be more than {MAX_EVENTS:,} in a cycle; repeat less often"
            raise self.mistake(message, sign_begin, self.place - sign_begin)
        for _ in range(int(repeat_count) - 1):
            steps.append(replace(last_step, shift=self.number - last_step.first))
            self.number += last_step.stop - last_step.first
        return added_cost

    def read_step(self) -> _Step[V]:
        """Read a word, a rest or brackets, with what changes them."""
        first_number, step_begin = self.number, self.place
        first_sign = self.text[step_begin]
        word_match = WORD.match(self.text, step_begin)
        cycles: Cycles[V] = silence()
        if word_match:
            self.place = word_match.end()
            cycles = pure(self.read(word_match.group(), self.start + step_begin))
        elif first_sign == "~":
            self.place += 1
        elif first_sign in _CLOSING_BY_OPENING:
            if len(self.open) == MAX_BRACKETS:
                message = f"at most {MAX_BRACKETS} brackets are inside one another; remove some"
                raise self.mistake(message, step_begin)
            self.open.append(step_begin)
            self.place += 1
            cycles = self.read_text(first_sign)
        else:
            raise self.unknown(first_sign)
        read_step = _Step(cycles, first_number, first_number)
        while (change := self.peek(skips=False)) and change in "*/?@(":
            self.read_change(read_step, change)
        read_step.stop = self.number
        return read_step

    def read_change(self, step: _Step[V], sign: str) -> None:
        """Read one change of a step."""
        change_begin = self.place
        if sign == "(":
            rhythm = self.euclid()
            operator_count = self.number - step.first
            self.number += operator_count * (rhythm.pulses - 1)
            step.base = euclid(rhythm, step.base, operator_count)
        else:
            self.place += 1
            has_number = sign != "?" or NUMBER.match(self.text, self.place)
            amount = self.amount(sign) if has_number else Fraction(1, 2)
            if sign == "@":
                step.weight = amount
            elif sign == "?":
                step.base = degrade(self.number, float(amount), step.base)
                self.number += 1
            else:
                step.base = fast(amount if sign == "*" else 1 / amount, step.base)
        self.checked_size(step.base, change_begin)

    def checked_size(self, cycles: Cycles[V], begin: int) -> Cycles[V]:
        """The pattern that is written from `begin` to here, unless it is too large."""
        excess = cycles.excess()
        if excess is not None:
            message = f"{excess}; repeat less often, or remove brackets"
            raise self.mistake(message, begin, self.place - begin)
        return cycles


def _sequence_of_steps(steps: Sequence[_Step[V]]) -> Cycles[V]:
    return sequence([(renumbered(step.shift, step.base), step.weight) for step in steps])


def _step_of_group(steps: Sequence[_Step[V]]) -> _Step[V]:
    first_step, last_step = steps[0], steps[-1]
    return _Step(
        _sequence_of_steps(steps),
        first_step.first + first_step.shift,
        last_step.stop + last_step.shift,
    )
