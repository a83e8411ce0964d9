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
_CLOSING = {"[": "]", "<": ">", "{": "}"}
_OPENING = {close: opened for opened, close in _CLOSING.items()}


def parse(
    text: str, read: Callable[[str, int], V], start: int = 0, first_number: int = 0
) -> Cycles[V]:
    """Read a rhythm; `read` returns what a word at an offset stands for, and may raise TextError.

    `read` and TextError get offsets into the text plus `start`. Operators that draw chances are
    numbered in the order of writing from `first_number`. The values of all words, in the order of
    writing, are the `leaves` of the result.
    """
    if len(text) > MAX_TEXT:
        message = f"a rhythm has at most {MAX_TEXT:,} characters; divide it among several lines"
        raise TextError(message, offset=start + MAX_TEXT, length=len(text) - MAX_TEXT)
    if not text.strip():
        message = "this rhythm has no steps; write for instance kick ~ snare ~"
        raise TextError(message, offset=start, length=max(1, len(text)))
    return _Parser(text, read, start, first_number).text_in("")


def line_begins(text: str) -> list[int]:
    """Where the lines of a rhythm text begin that commas outside all brackets divide."""
    begins, depth = [0], 0
    for place, sign in enumerate(text):
        depth += (sign in "[<{(") - (sign in "]>})")
        if sign == "," and depth == 0:
            begins.append(place + 1)
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

    def __init__(self, text: str, read: Callable[[str, int], V], start: int, number: int) -> None:
        super().__init__(text, start)
        self.read = read
        self.number = number  # of the next operator that draws chances
        self.open: list[int] = []  # where brackets begin that are not closed yet

    # --- brackets -------------------------------------------------------------------------------

    def text_in(self, sign: str) -> Cycles[V]:
        """What is between brackets that begin with `sign`, or all of the text; its end is read."""
        begin = max(0, self.place - 1)
        lines = [self.line()]
        separator = ""
        while self.peek() in (",", "|"):
            self.check_separator(separator, sign)
            separator = self.text[self.place]
            self.place += 1
            lines.append(self.line())
        self.close()
        lengths = [sum((step.weight for step in line), Fraction(0)) for line in lines]
        parts = [_sequence(line) for line in lines]
        if sign == "<" and separator != "|":
            parts = [slow(length, part) for length, part in zip(lengths, parts, strict=True)]
        elif sign == "{":
            steps = lengths[0]
            if self.peek(skips=False) == "%":
                self.place += 1
                steps = self.amount("%")
            parts = [fast(steps / length, p) for length, p in zip(lengths, parts, strict=True)]
        if separator != "|":
            return self.checked(stack(parts), begin)
        self.number += 1
        draw = walk if sign == "<" else choose
        return self.checked(draw(self.number - 1, parts), begin)

    def check_separator(self, text_before: str, sign: str) -> None:
        """Refuse a separator that is not the one before it, or not of these brackets."""
        separator = self.text[self.place]
        if text_before not in ("", separator):
            message = "',' (together) and '|' (one in each cycle) are divided by brackets: "
            raise self.mistake(message + "kick, [snare | hat]", self.place)
        if separator == "|" and sign == "{":
            message = "'|' is written in square brackets: {[kick | snare] hat}"
            raise self.mistake(message, self.place)

    def close(self) -> None:
        """Read the end of the last bracket that is open, or of the text."""
        sign = self.peek()
        opened = self.text[self.open[-1]] if self.open else ""
        if not sign and not opened:
            return
        if not sign:
            message = f"this '{opened}' is not closed; write {opened} … {_CLOSING[opened]}"
            raise self.mistake(message, self.open[-1])
        if not opened:
            message = f"'{sign}' has no '{_OPENING[sign]}' before it; "
            raise self.mistake(f"{message}write {_OPENING[sign]} … {sign}", self.place)
        if sign != _CLOSING[opened]:
            message = f"'{sign}' does not close the '{opened}' before it; write {_CLOSING[opened]}"
            raise self.mistake(message, self.place, suggestion=_CLOSING[opened])
        self.open.pop()
        self.place += 1

    # --- steps ----------------------------------------------------------------------------------

    def line(self) -> list[_Step[V]]:
        """The steps up to a comma, a bar or the end of brackets; a group of dots is a step."""
        groups: list[list[_Step[V]]] = [[]]
        cost = 0
        while (sign := self.peek()) and sign not in ",|]>}":
            steps, place = groups[-1], self.place
            if sign == ".":
                self.dot(steps)
                groups.append([])
            elif sign == "_" and not WORD.match(self.text, place + 1):
                self.last(steps).weight += 1
                self.place += 1
            elif sign == "!":
                cost += self.repeat(steps, cost)
            else:
                steps.append(self.step())
                cost += steps[-1].base.cost
        if not groups[-1]:
            if not self.peek() and self.open:
                self.close()
            place = len(self.text[: self.place].rstrip())
            message = "there is no step here; a rest is written ~"
            raise self.mistake(message, max(0, place - 1))
        if len(groups) == 1:
            return groups[0]
        return [_grouped(steps) for steps in groups]

    def dot(self, steps: list[_Step[V]]) -> None:
        """Read a dot that groups steps."""
        around = self.text[max(0, self.place - 1) : self.place + 2]
        if not steps or len(around) < 3 or around.strip() != ".":
            message = "a dot that groups has steps and a space on each side: kick hat . snare hat"
            if _HITS_AND_DOTS.fullmatch(self.text):
                message = "a hit is the name of an instrument, and a rest is ~: kick ~ kick kick"
            raise self.mistake(message, self.place)
        self.place += 1

    def last(self, steps: list[_Step[V]]) -> _Step[V]:
        """The step that the next sign repeats or lengthens."""
        if not steps:
            message = "'_' lengthens the step before it, and there is none here: kick _ snare"
            if self.text[self.place] == "!":
                message = "'!' repeats the step before it, and there is none here: kick ! snare"
            raise self.mistake(message, self.place)
        return steps[-1]

    def repeat(self, steps: list[_Step[V]], cost: int) -> int:
        """Read `!` or `!3`, and return what the repetitions cost; `cost` is that of the line."""
        begin = self.place
        step = self.last(steps)
        self.place += 1
        count = Fraction(2)
        if NUMBER.match(self.text, self.place):
            if self.text[begin - 1].isspace():
                raise self.mistake("'!' follows its step without a space: kick!3", begin)
            count = self.amount("!")
        if count.denominator != 1:
            message = "'!' repeats a step as often as a number without a fraction says: kick!3"
            raise self.mistake(message, begin, self.place - begin)
        added_cost = (int(count) - 1) * step.base.cost
        if cost + added_cost > MAX_EVENTS:
            message = f"these steps would be more than {MAX_EVENTS:,} in a cycle; repeat less often"
            raise self.mistake(message, begin, self.place - begin)
        for _ in range(int(count) - 1):
            steps.append(replace(step, shift=self.number - step.first))
            self.number += step.stop - step.first
        return added_cost

    def step(self) -> _Step[V]:
        """Read a word, a rest or brackets, with what changes them."""
        first_number, begin = self.number, self.place
        sign = self.text[begin]
        word = WORD.match(self.text, begin)
        cycles: Cycles[V] = silence()
        if word:
            self.place = word.end()
            cycles = pure(self.read(word.group(), self.start + begin))
        elif sign == "~":
            self.place += 1
        elif sign in _CLOSING:
            if len(self.open) == MAX_BRACKETS:
                message = f"at most {MAX_BRACKETS} brackets are inside one another; remove some"
                raise self.mistake(message, begin)
            self.open.append(begin)
            self.place += 1
            cycles = self.text_in(sign)
        else:
            raise self.unknown(sign)
        step = _Step(cycles, first_number, first_number)
        while (change := self.peek(skips=False)) and change in "*/?@(":
            self.change(step, change)
        step.stop = self.number
        return step

    def change(self, step: _Step[V], sign: str) -> None:
        """Read one change of a step."""
        begin = self.place
        if sign == "(":
            rhythm = self.euclid()
            copy = self.number - step.first
            self.number += copy * (rhythm.pulses - 1)
            step.base = euclid(rhythm, step.base, copy)
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
        self.checked(step.base, begin)

    def checked(self, cycles: Cycles[V], begin: int) -> Cycles[V]:
        """The pattern that is written from `begin` to here, unless it is too large."""
        excess = cycles.excess()
        if excess is not None:
            message = f"{excess}; repeat less often, or remove brackets"
            raise self.mistake(message, begin, self.place - begin)
        return cycles


def _sequence(steps: Sequence[_Step[V]]) -> Cycles[V]:
    return sequence([(renumbered(step.shift, step.base), step.weight) for step in steps])


def _grouped(steps: Sequence[_Step[V]]) -> _Step[V]:
    first_step, last_step = steps[0], steps[-1]
    return _Step(
        _sequence(steps), first_step.first + first_step.shift, last_step.stop + last_step.shift
    )
