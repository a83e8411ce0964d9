"""What the stage before knew of automation: entries in order, and the points of modules on which
nothing acts any more. A new line changes little of both.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import chain
from typing import NamedTuple

from ergon.notation.clock.positions import Length, Position
from ergon.notation.clock.tempo import TempoMap
from ergon.scores.reading.automation import Automation
from ergon.scores.reading.piece import Piece, Strikes
from ergon.scores.staging.parameter_curves import Entry
from ergon.scores.staging.parameter_values import Led, Points, Where


@dataclass(frozen=True, slots=True)
class Tracks:
    """The entries of each parameter of a module, in order; `moves_from` is the beat on which the
    first one begins that is no swing.
    """

    entries: Mapping[str, list[Entry]]
    moves_from: float


class _Settled(NamedTuple):
    """The points of a module with these entries, on which nothing acts from beat `since` on."""

    tracks: Tracks
    led: Led
    since: float
    points: Points


@dataclass(slots=True)
class KnownAutomation:
    """The memory of a chain of stages, in which each piece has nearly the automation of the line
    before.
    """

    _tempo: TempoMap | None = None
    _lines: tuple[Automation, ...] = ()
    _strikes: tuple[Strikes, ...] = ()
    _tracks: dict[Where, Tracks] = field(default_factory=dict)
    # By the id of what they are made of, which is kept with them so that no other has its id.
    _spans: dict[int, tuple[Automation, float, float]] = field(default_factory=dict)
    _notes: dict[int, tuple[Strikes, list[Automation]]] = field(default_factory=dict)
    _leds: dict[Where, tuple[object, Led]] = field(default_factory=dict)
    _settled: dict[Where, _Settled] = field(default_factory=dict)

    def tracks(self, piece: Piece) -> Mapping[Where, Tracks]:
        """The entries of a piece by module; those of a module that did not change are the same
        object as before.
        """
        strikes = tuple([line for line in piece.strikes if line.notes and line.pattern is not None])
        is_same_tempo = self._tempo is not None and self._tempo.is_same(piece.tempo_map)
        if is_same_tempo and (self._lines, self._strikes) == (piece.automation, strikes):
            return self._tracks
        if not is_same_tempo:
            self._spans, self._notes = {}, {}
        self._notes = {id(line): self._notes_of(piece, line) for line in strikes}
        notes = chain.from_iterable(lines for _, lines in self._notes.values())
        lines: dict[Where, dict[str, list[Automation]]] = {}
        spans = {}
        for line in (*piece.automation, *notes):
            where = line.target.part, line.target.module
            lines.setdefault(where, {}).setdefault(line.parameter, []).append(line)
            spans[id(line)] = self._spans.get(id(line)) or _span(piece.tempo_map, line)
        before, self._tracks, self._spans = self._tracks, {}, spans
        for where, parameters in lines.items():
            track = self._track(parameters)
            known = before.get(where)
            self._tracks[where] = known if known is not None and known == track else track
        self._tempo, self._lines, self._strikes = piece.tempo_map, piece.automation, strikes
        return self._tracks

    def _notes_of(self, piece: Piece, strikes: Strikes) -> tuple[Strikes, list[Automation]]:
        return self._notes.get(id(strikes)) or (strikes, list(_notes(piece.tempo_map, strikes)))

    def _track(self, parameters: Mapping[str, list[Automation]]) -> Tracks:
        """The entries of a module: of each parameter one lasts until the next one begins."""
        by_name: dict[str, list[Entry]] = {}
        moves_from = math.inf
        for name, lines in parameters.items():
            spans = sorted([self._spans[id(line)] for line in lines], key=lambda span: span[1])
            entries = by_name[name] = []
            for place, (line, begin, until) in enumerate(spans):
                is_last = place + 1 == len(spans)
                stop = until if is_last else min(until, spans[place + 1][1])
                entries.append(Entry(line, begin, stop))
                if line.swing is None:
                    moves_from = min(moves_from, begin)
        return Tracks(by_name, moves_from)

    def led(self, piece: Piece, where: Where) -> Led | None:
        """A module of a piece; None if it does not exist."""
        part = piece.keys.get(where[0]) or piece.instruments.get(where[0])
        known = self._leds.get(where)
        if known is not None and known[0] is part:
            return known[1]
        led = Led.of(piece, where)
        if led is None:
            self._leds.pop(where, None)
        else:
            if known is not None and known[1].is_same(led):
                led = known[1]
            self._leds[where] = part, led
        return led

    def settled(self, where: Where, tracks: Tracks, led: Led, beat: float) -> Points | None:
        """The constant points of a module on which nothing acts from a beat on; None if that is not
        known.
        """
        known = self._settled.get(where)
        if known is None or known.tracks is not tracks or known.led is not led:
            return None
        return known.points if known.since <= beat else None

    def settle(self, where: Where, tracks: Tracks, led: Led, since: float, points: Points) -> None:
        """Keep the constant points of a module on which nothing acts from beat `since` on."""
        self._settled[where] = _Settled(tracks, led, since, points)


def _span(tempo: TempoMap, line: Automation) -> tuple[Automation, float, float]:
    """An entry with the beats on which it begins and ends."""
    return (
        line,
        tempo.resolve(line.at),
        math.inf if line.until is None else tempo.resolve(line.until),
    )


def _notes(tempo: TempoMap, line: Strikes) -> Iterator[Automation]:
    """Automation of the pitches of strikes that have notes."""
    assert line.pattern is not None
    until = line.until
    if line.span is not None:
        until = Position(plus=Length(beats=tempo.after(tempo.resolve(line.at), line.span)))
    pattern = replace(line.pattern, chance=None)
    for target in line.to:
        said = (target, "f", line.at, until, line.every, line.times, pattern, line.notes)
        yield Automation(*said, None, line.place, line.place, line.who)
