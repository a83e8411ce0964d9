"""Phrasing: how long strokes last, how they are repeated and ornamented, how chords are spread.

Chords are what begins and ends together, as in TidalCycles; their notes are taken from the lowest
to the highest.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from functools import lru_cache
from itertools import chain
from math import ceil
from typing import Any

from ergon import _core
from ergon.scores.pattern.cycle_operations import ply
from ergon.scores.pattern.cycles import Chance, Cycles, Fragment, combined, mapped, stack
from ergon.scores.pattern.struck import Repeats, Struck, single_notes, sorted_by_pitch

Pattern = Cycles[Struck]

NEXT_STROKE_CYCLES_MAX = 8  # cycles in which the next stroke of a line is looked for
_CYCLES_SEARCHED = 4  # cycles: where strokes are near, those around an instant say what follows it
_CYCLES_CACHED = 32  # cycles whose beginnings are: each is asked for by the cycles before it
_CHORD_NOTES_MAX = 100  # notes
_INSTANT_CYCLES = Fraction(1, 64)  # of a cycle: which strokes begin at an instant is seen in less


# --- length -------------------------------------------------------------------------------------


def legato(ratio: Fraction, pattern: Pattern) -> Pattern:
    """Each stroke sounds for a share of the time until the next stroke of its line.

    Of a note that is repeated at a rate each stroke does until the next one of the note.
    """

    @lru_cache(_CYCLES_CACHED)
    def onsets(cycle: int, chance: Chance) -> Mapping[int, Sequence[Fraction]]:
        return _onsets(pattern, cycle, chance)

    def query(begin: Fraction, end: Fraction, chance: Chance) -> list[Fragment[Struck]]:
        fragments = []
        for fragment in pattern.query(begin, end, chance):
            stroke_begin, stroke_end, line = fragment.begin, fragment.end, fragment.value.line
            next_begin = stroke_begin + NEXT_STROKE_CYCLES_MAX
            for cycle in range(stroke_begin // 1, stroke_begin // 1 + NEXT_STROKE_CYCLES_MAX + 1):
                instants = onsets(cycle, chance).get(line, ())
                index = bisect_right(instants, stroke_begin)
                if index < len(instants):
                    next_begin = min(next_begin, instants[index])
                    break
            length = ratio * (next_begin - stroke_begin) / (stroke_end - stroke_begin)
            if fragment.value.repeats is not None:
                length = ratio
            fragments.append(fragment._replace(value=replace(fragment.value, length=length)))
        return fragments

    return combined(query, (pattern,), pattern.cost * _CYCLES_SEARCHED)


def _onsets(pattern: Pattern, cycle: int, chance: Chance) -> Mapping[int, Sequence[Fraction]]:
    """The instants at which strokes begin in a cycle, in order, by line."""
    begins_by_line: dict[int, list[Fraction]] = {}
    for event in pattern.onsets(cycle, chance):
        begins_by_line.setdefault(event.value.line, []).append(event.begin)
    return begins_by_line


# --- strokes that are repeated ------------------------------------------------------------------


def tremolo(
    n_strokes: int, pattern: Pattern, first_factor: float = 1.0, last_factor: float = 1.0
) -> Pattern:
    """Each stroke `n_strokes` times within its span, from one factor of its impulse to another.

    Factors are geometric: even steps of strength.
    """

    def change(struck: Struck, turn: int) -> Struck:
        share = turn / (n_strokes - 1) if n_strokes > 1 else 1.0
        factor = struck.factor * swell(first_factor, last_factor, share)
        return replace(struck, factor=factor, part_of="before" if turn else struck.part_of)

    return ply(n_strokes, pattern, change)


def repeated(repeats: Repeats, pattern: Pattern) -> Pattern:
    """Each stroke again and again within its span, which is done where its seconds are known."""
    return mapped(lambda struck: replace(struck, repeats=repeats), pattern)


def swell(first: float, last: float, share: float) -> float:
    """The factor at a share of the way from one factor to another, in geometric steps."""
    return first if first == last else first * _core.pow(last / first, share)


def grace(duration: Fraction, semitones: float, factor: float, pattern: Pattern) -> Pattern:
    """The pattern, with a short stroke before each stroke, which ends where that begins."""

    def grace_note(struck_note: Struck) -> Struck:
        semitone, scale = struck_note.semitones + semitones, struck_note.factor * factor
        return replace(
            struck_note,
            semitones=semitone,
            factor=scale,
            length=Fraction(1),
            repeats=None,
            part_of="after",
        )

    def query(query_begin: Fraction, query_end: Fraction, chance: Chance) -> list[Fragment[Struck]]:
        fragments = []
        for fragment in pattern.query(query_begin, query_end + duration, chance):
            main_begin = fragment.begin
            if (
                main_begin > query_begin
                and fragment.part_start == main_begin
                and fragment.value.part_of is None
            ):
                start, stop = max(main_begin - duration, query_begin), min(main_begin, query_end)
                fragments.append(
                    Fragment(
                        main_begin - duration, main_begin, start, stop, grace_note(fragment.value)
                    )
                )
        return fragments

    leaves = tuple(dict.fromkeys(map(grace_note, pattern.leaves)))
    return stack([pattern, Cycles(query, 2 * pattern.cost, 1 + pattern.depth, leaves)])


# --- chords -------------------------------------------------------------------------------------

Spread = Callable[
    [Sequence[Struck], Fraction, Fraction, Fraction, Fraction],
    Iterable[tuple[Fraction, Fraction, Struck]],
]
"""The strokes of a chord, each from one instant to another: its notes from the lowest, its begin
and end, and the begin and end of what is seen of it."""


def _with_chords_spread(
    spread: Spread, pattern: Pattern, cost: int, leaves: Iterable[Struck]
) -> Pattern:
    """The pattern with each chord spread; a single note is a chord too."""

    def query(query_begin: Fraction, end: Fraction, chance: Chance) -> list[Fragment[Struck]]:
        chords: dict[tuple[Fraction, Fraction], list[Fragment[Struck]]] = {}
        for fragment in pattern.query(query_begin, end, chance):
            chords.setdefault((fragment.begin, fragment.end), []).append(fragment)
        fragments = []
        for (first_instant, last_instant), chord_fragments in chords.items():
            # Of a chord that another pattern cuts only this much is seen.
            chord_start, chord_stop = (
                min(f.part_start for f in chord_fragments),
                max(f.part_stop for f in chord_fragments),
            )
            if first_instant < query_begin:
                chord_fragments = pattern.query(
                    first_instant, min(last_instant, first_instant + _INSTANT_CYCLES), chance
                )
            chord_notes = [
                f.value
                for f in chord_fragments
                if f.part_start == f.begin == first_instant and f.end == last_instant
            ]
            for low_instant, high_instant, struck_note in spread(
                sorted_by_pitch(chord_notes), first_instant, last_instant, chord_start, chord_stop
            ):
                if low_instant < chord_stop and high_instant > chord_start:
                    fragments.append(
                        Fragment(
                            low_instant,
                            high_instant,
                            max(low_instant, chord_start),
                            min(high_instant, chord_stop),
                            struck_note,
                        )
                    )
        return fragments

    return Cycles(query, cost, 1 + pattern.depth, tuple(dict.fromkeys(leaves)))


def _single_notes(part: Pattern) -> Iterator[Struck]:
    return chain.from_iterable(map(single_notes, part.leaves))


def _largest_chord(part: Pattern) -> int:
    """The number of notes of the largest chord that is one word."""
    return max((len(single_notes(leaf)) for leaf in part.leaves), default=1)


def arp(note_order: str, step: Fraction | None, pattern: Pattern) -> Pattern:
    """The notes of each chord one after another, in an order, within its span.

    They share it evenly, or last a `step` each and begin again until it ends.
    """

    def spread(
        chord: Sequence[Struck],
        first_instant: Fraction,
        last_instant: Fraction,
        chord_begin: Fraction,
        chord_end: Fraction,
    ) -> Iterator[tuple[Fraction, Fraction, Struck]]:
        ordered_notes = ORDERS[note_order](chord) if len(chord) > 1 else chord
        if not ordered_notes:
            return
        width = (last_instant - first_instant) / len(ordered_notes) if step is None else step
        turn = max(0, (chord_begin - first_instant) // width)
        low_instant = first_instant + turn * width
        while low_instant < chord_end:
            high = min(low_instant + width, last_instant)
            yield low_instant, high, ordered_notes[turn % len(ordered_notes)]
            turn, low_instant = turn + 1, low_instant + width

    # So many turns of the chord that the order has each note.
    n_passes = ceil(len(ORDERS[note_order](range(_CHORD_NOTES_MAX))) / _CHORD_NOTES_MAX)
    n_steps = n_passes * _largest_chord(pattern) if step is None else ceil(1 / step)
    return _with_chords_spread(
        spread, pattern, pattern.cost * (1 + n_steps), _single_notes(pattern)
    )


def rolled(span_ratio: Fraction, pattern: Pattern) -> Pattern:
    """The notes of each chord one after another in the first share of its span, all until its end.

    A share below zero begins with the highest note.
    """

    def spread(
        chord: Sequence[Struck], first_instant: Fraction, last_instant: Fraction, *_: Fraction
    ) -> Iterator[tuple[Fraction, Fraction, Struck]]:
        notes = chord if span_ratio > 0 else chord[::-1]
        for turn, note in enumerate(notes):
            low = first_instant + turn * abs(span_ratio) * (last_instant - first_instant) / len(
                notes
            )
            yield low, last_instant, _attached_note(note, turn)

    return _with_chords_spread(
        spread, pattern, pattern.cost * (1 + _largest_chord(pattern)), _single_notes(pattern)
    )


def strum(step: float, pattern: Pattern) -> Pattern:
    """The notes of each chord, `step` [s] apart; below zero from the highest note down."""

    def spread(
        chord: Sequence[Struck], first_instant: Fraction, last_instant: Fraction, *_: Fraction
    ) -> Iterator[tuple[Fraction, Fraction, Struck]]:
        for turn, note in enumerate(chord if step > 0 else chord[::-1]):
            onset_delay = note.delay + turn * abs(step)
            yield (
                first_instant,
                last_instant,
                _attached_note(replace(note, delay=onset_delay), turn),
            )

    leaves = [*_single_notes(pattern)]
    delay_max = max((leaf.delay for leaf in leaves), default=0.0) + abs(step) * (len(leaves) - 1)
    delayed_leaves = [
        replace(leaf, delay=delay_max) for leaf in leaves
    ]  # a bound of what chords will have
    return _with_chords_spread(
        spread, pattern, pattern.cost * (1 + _largest_chord(pattern)), delayed_leaves
    )


def _attached_note(note: Struck, turn: int) -> Struck:
    return replace(note, part_of="before") if turn and note.part_of is None else note


def _converging(notes: Sequence[Any]) -> list[Any]:
    """The lowest, the highest, the second lowest, and so on to the middle."""
    pairs = zip(notes, reversed(notes), strict=True)
    return [note for pair in pairs for note in pair][: len(notes)]


def _with_top_note(notes: Sequence[Any]) -> list[Any]:
    """Each note but the highest, and the highest after it."""
    return [played_note for note in notes[:-1] for played_note in (note, notes[-1])]


def _with_lowest_note(notes: Sequence[Any]) -> list[Any]:
    """The lowest before each other note."""
    return [played_note for note in notes[1:] for played_note in (notes[0], note)]


def _forward_and_back(notes: Sequence[Any]) -> list[Any]:
    """Notes forward and backward, without the last and the first again."""
    return [*notes[:-1], *notes[:0:-1]]


ORDERS: Mapping[str, Callable[[Sequence[Any]], Sequence[Any]]] = {
    "up": lambda n: n,
    "down": lambda n: n[::-1],
    "updown": _forward_and_back,
    "downup": lambda n: _forward_and_back(n[::-1]),
    "up&down": lambda n: [*n, *n[::-1]],
    "down&up": lambda n: [*n[::-1], *n],
    "converge": _converging,
    "diverge": lambda n: _converging(n)[::-1],
    "disconverge": lambda n: [*_converging(n), *_converging(n)[-2::-1]],
    "pinkyup": _with_top_note,
    "pinkyupdown": lambda n: _forward_and_back(_with_top_note(n)),
    "thumbup": _with_lowest_note,
    "thumbupdown": lambda n: _forward_and_back(_with_lowest_note(n)),
}
