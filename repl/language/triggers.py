"""Rules that run a block automatically: at intervals, or when a condition on bar and beat
holds.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass, field

from ergon.notation.clock.meter import SAME
from ergon.notation.clock.positions import Length, parse_length
from ergon.notation.clock.tempo import TempoMap
from ergon.notation.text.errors import TextError, quote

_NUMBER_MAX = 10_000  # bars of a length, and numbers of a condition
_CLAUSE_PATTERN = re.compile(
    r"(?P<what>bar|beat)(?:\s*%\s*(?P<modulus>[0-9]{1,5}))?"
    r"\s*(?P<compares>==|!=|<=|>=|<|>)\s*(?P<number>[0-9]{1,5})"
)
_AND_PATTERN = re.compile(r"\s+and\s+")
_COMPARISON_BY_SIGN: dict[str, Callable[[int, int], bool]] = {
    "==": lambda a, b: a == b,
    "!=": lambda a, b: a != b,
    "<": lambda a, b: a < b,
    "<=": lambda a, b: a <= b,
    ">": lambda a, b: a > b,
    ">=": lambda a, b: a >= b,
}
CONDITION_FORM = (
    "bar or beat, perhaps % a number, then == != < <= > or >= and a number; `and` joins several"
)


@dataclass(frozen=True, slots=True)
class Every:
    """`every 4bar`: an interval in whole bars, or in beats, from the beat on which the rule
    began.
    """

    length: Length
    text: str = field(compare=False)

    def runs_at_start(self, tempo_map: TempoMap, beat: float) -> bool:
        """Whether the block runs on the beat on which the rule takes effect: it always does."""
        return True

    def next_beat(
        self, tempo_map: TempoMap, begin_beat: float, after_beat: float, last_beat: float
    ) -> float | None:
        """The first beat after `after_beat` and not after `last_beat` on which the block runs."""
        if self.length.bars:
            n_bars = round(self.length.bars)
            first_bar, beat_in_bar = tempo_map.bar_beat(begin_beat)
            bar, _ = tempo_map.bar_beat(after_beat)
            bar += (first_bar - bar) % n_bars
            run_beat = tempo_map.bars.start(bar) + beat_in_bar - 1.0
            if run_beat <= after_beat + SAME:
                run_beat = tempo_map.bars.start(bar + n_bars) + beat_in_bar - 1.0
        else:
            interval_beats = self.length.beats
            run_number = math.floor((after_beat - begin_beat) / interval_beats + SAME) + 1
            run_beat = begin_beat + run_number * interval_beats
        return run_beat if run_beat <= last_beat + SAME else None

    def run_count(self, tempo_map: TempoMap, begin_beat: float, before_beat: float) -> int:
        """How often the block runs from the beginning of the rule until before a beat."""
        if self.length.bars:
            first_bar, _ = tempo_map.bar_beat(begin_beat + SAME)
            bar, _ = tempo_map.bar_beat(before_beat + SAME)
            return max(0, -(-(bar - first_bar) // round(self.length.bars)))
        return max(0, math.ceil((before_beat - begin_beat) / self.length.beats - SAME))


@dataclass(frozen=True, slots=True)
class Clause:
    """`bar % 4 == 3`: one comparison of the bar or beat, or with a modulus, of its remainder."""

    quantity: str
    modulus: int | None
    comparison: str
    number: int

    def holds(self, bar: int, beat: int) -> bool:
        """Whether it holds on a beat of a bar; both count from 1."""
        counted_number = bar if self.quantity == "bar" else beat
        return _COMPARISON_BY_SIGN[self.comparison](
            counted_number % self.modulus if self.modulus else counted_number, self.number
        )


@dataclass(frozen=True, slots=True)
class Condition:
    """`when bar % 4 == 3 and beat == 1`: clauses that hold on a bar, or if one has `beat`, on a
    beat.
    """

    clauses: tuple[Clause, ...]
    text: str = field(compare=False)

    def holds(self, bar: int, beat: int) -> bool:
        """Whether all clauses hold on a beat of a bar; both count from 1."""
        return all(clause.holds(bar, beat) for clause in self.clauses)

    def runs_at_start(self, tempo_map: TempoMap, beat: float) -> bool:
        """Whether the block runs on the beat on which the rule takes effect."""
        return self.next_beat(tempo_map, beat, beat - 2.0 * SAME, beat) is not None

    def next_beat(
        self, tempo_map: TempoMap, begin_beat: float, after_beat: float, last_beat: float
    ) -> float | None:
        """The first beat after `after_beat` and not after `last_beat` on which the block runs."""
        bar_number, _ = tempo_map.bar_beat(max(0.0, after_beat))
        last_bar, _ = tempo_map.bar_beat(last_beat)
        has_beat_clause = any(clause.quantity == "beat" for clause in self.clauses)
        while bar_number <= last_bar:
            bar_start, n_beats = tempo_map.bars.bar(bar_number)
            for beat in range(1, n_beats + 1 if has_beat_clause else 2):
                run_beat = bar_start + beat - 1.0
                if after_beat + SAME < run_beat <= last_beat + SAME and self.holds(
                    bar_number, beat
                ):
                    return run_beat
            bar_number += 1
        return None

    def run_count(self, tempo_map: TempoMap, begin_beat: float, before_beat: float) -> int:
        """How often the block runs from the beginning of the rule until before a beat."""
        n_runs, run_beat = 0, begin_beat - 2.0 * SAME
        last_beat = before_beat - 2.0 * SAME
        while (next_beat := self.next_beat(tempo_map, begin_beat, run_beat, last_beat)) is not None:
            n_runs, run_beat = n_runs + 1, next_beat
        return n_runs


Trigger = Every | Condition


def parse_every(condition_text: str) -> Every:
    """Read `4bar` or `2`. Raises TextError."""
    parsed_length = parse_length(condition_text)
    bars = parsed_length.bars
    if (
        parsed_length.seconds
        or not 1.0 <= bars + parsed_length.beats <= _NUMBER_MAX
        or bars != round(bars)
    ):
        message = f"a block runs every so many beats or whole bars, from 1 to {_NUMBER_MAX:,}"
        raise TextError(f"{message}: every 4bar", length=len(condition_text))
    return Every(parsed_length, f"every {condition_text.strip()}")


def parse_condition(condition_text: str) -> Condition:
    """Read `bar % 4 == 3 and beat == 1`. Raises TextError."""
    clauses, word_offset = [], 0
    for clause_text in _AND_PATTERN.split(condition_text.strip()):
        clause_offset = condition_text.index(clause_text, word_offset)
        clauses.append(_parse_clause(clause_text, clause_offset))
        word_offset = clause_offset + len(clause_text)
    return Condition(tuple(clauses), f"when {' '.join(condition_text.split())}")


def parse_trigger(slot_text: str) -> Trigger:
    """Read `every 4bar` or `when bar % 4 == 3`. Raises TextError."""
    trigger_word, _, trigger_rest = slot_text.partition(" ")
    if trigger_word not in ("every", "when"):
        raise TextError(f"{quote(slot_text)} does not say when a block runs", length=len(slot_text))
    return parse_every(trigger_rest) if trigger_word == "every" else parse_condition(trigger_rest)


def _parse_clause(clause_text: str, clause_offset: int) -> Clause:
    clause_match = _CLAUSE_PATTERN.fullmatch(clause_text)
    if clause_match is None:
        nearest_clause = re.sub(r"(?<![=!<>])=(?!=)", "==", clause_text)
        nearest_clause = re.sub(r"\s+(?:is|equals)\s+", " == ", nearest_clause)
        raise TextError(
            f"{quote(clause_text)} is not a condition: {CONDITION_FORM}",
            offset=clause_offset,
            length=max(1, len(clause_text)),
            suggestion=nearest_clause
            if nearest_clause != clause_text and _CLAUSE_PATTERN.fullmatch(nearest_clause)
            else None,
        )
    modulus = None if clause_match["modulus"] is None else int(clause_match["modulus"])
    clause = Clause(
        clause_match["what"], modulus, clause_match["compares"], int(clause_match["number"])
    )
    values = range(1, _NUMBER_MAX + 1) if modulus is None else range(modulus)
    if not any(_COMPARISON_BY_SIGN[clause.comparison](value, clause.number) for value in values):
        limit_text = f"{clause.quantity}s count from 1 to {_NUMBER_MAX:,}"
        if modulus is not None:
            limit_text = (
                f"a remainder of % {modulus} is from 0 to {modulus - 1}" if modulus else "% 0"
            )
        message = f"{quote(clause_text)} is never true: {limit_text}"
        raise TextError(message, offset=clause_offset, length=len(clause_text))
    return clause
