"""Puts `strikes:` on the timeline as ergons."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

from ergon import _core
from ergon.instruments.assemble import Assembly
from ergon.instruments.model import Target
from ergon.notation.clock.positions import Length
from ergon.notation.clock.tempo import TempoMap
from ergon.notation.tables.strengths import Level, Reach
from ergon.notation.text.errors import Collector, TextError
from ergon.scores.pattern.draws import Draws
from ergon.scores.pattern.search import first_from
from ergon.scores.pattern.steps import Steps
from ergon.scores.reading.piece import Piece, Strikes
from ergon.scores.reading.rhythms import LONGEST_CYCLES
from ergon.scores.reading.sweep_fields import Passing
from ergon.scores.staging.sweep_members import visits

ALL_TIME = (-math.inf, math.inf)
_first, _last = (lambda low, high: low), (lambda low, high: high)
_STRIKE_STEPS = 2_000  # of work, for a strike


def _beat(tempo: TempoMap, instant: float) -> float:
    """The beat of an instant [s], which may be infinite."""
    return tempo.beats(instant) if math.isfinite(instant) else instant


@dataclass(frozen=True)
class Striking:
    """Strikes with their targets as MATs; their ergons carry `source`."""

    piece: Piece
    timeline: _core.Timeline
    strikes: Strikes
    mats: Sequence[int]
    source: int
    within: tuple[float, float] = ALL_TIME  # interval of instants [s]
    assembly: Assembly | None = None  # for targets of melodies, sweeps, paths and strengths

    def play(self, collector: Collector) -> float:
        """Put the strikes on the timeline; returns when they end [s]."""
        piece, strikes, tempo = self.piece, self.strikes, self.piece.tempo_map
        if strikes.along:
            return max(axis.play(collector) for axis in self._axes())
        at, stop = tempo.resolve(strikes.at), strikes.stop(tempo)
        try:
            if strikes.is_melody:
                return self._melody()
            if strikes.passing is not None:
                return self._passed(strikes.passing)
            if strikes.pattern is not None:
                return self._by_pattern(strikes.steps(piece))
            if strikes.rate is not None and strikes.levels is not None and stop is not None:
                end = tempo.seconds(stop)
                if self._gain == 0.0:
                    return end
                level, reach = strikes.levels.steps[0], next(iter(strikes.reaches.values()), None)
                self.timeline.rain(
                    self.mats,
                    start=tempo.seconds(at),
                    stop=end,
                    rate=strikes.rate,
                    impulse=(
                        self._gain * level.impulse(reach, _first),
                        self._gain * level.impulse(reach, _last),
                    ),
                    seed=piece.seed,
                    name=strikes.name,
                    source=self.source,
                    within=self.within,
                )
                return end
            return self._each()
        except _core.EngineError as error:
            collector.error("E308", str(error), strikes.place)
        except TextError as error:
            collector.error("E305", error.message, strikes.place)
        return 0.0

    @property
    def _gain(self) -> float:
        """The ratio by which impulses are scaled."""
        return 1.0 if self.strikes.session_gain is None else self.strikes.session_gain

    def _is_inside(self, instant: float) -> bool:
        return self.within[0] <= instant < self.within[1]

    def _axes(self) -> Iterator[Striking]:
        """The strikes of each axis, with its share of the impulse; random draws are the same on all
        axes.
        """
        strikes = self.strikes
        n = len(self.mats) // len(strikes.along)
        for axis, share in enumerate(strikes.along):
            own = replace(strikes, along=(), levels=strikes.levels and strikes.levels.scaled(share))
            yield replace(self, strikes=own, mats=self.mats[axis * n : (axis + 1) * n])

    def _by_pattern(self, places: Steps) -> float:
        """Strike in the places of a pattern; chance is drawn for each member separately."""
        course, tempo = places.course, self.piece.tempo_map
        pattern = course.pattern

        def seconds(place: int) -> float:
            return tempo.seconds(places[place])

        first, last = (first_from(seconds, len(places), instant) for instant in self.within)
        for place in range(max(0, first - 1), last):  # the note before ends in this one
            name = course.named(place)
            if name is None:
                continue
            instant, number = seconds(place), place + pattern.skip
            end = seconds(place + 1) if place + 1 < len(places) else None
            for member, mat in enumerate(self._voice(name)):
                if pattern.chance is None or course.draws.happens(pattern.chance, number, member):
                    self._hold(mat, instant, end)
                    if place >= first:
                        self._strike(mat, instant, member, number, len(places))
        return tempo.seconds(places[-1]) if places else 0.0

    def _voice(self, name: str) -> Sequence[int]:
        """The MATs that a name of the pattern strikes: all, unless it is a note of an
        instrument.
        """
        if not self.strikes.voices:
            return self.mats
        return [mat for one in self.strikes.voices[name] for mat in self._members(one)]

    def _melody(self) -> float:
        """The strikes of a melody, one by one."""
        tempo, end = self.piece.tempo_map, 0.0
        since, before = (_beat(tempo, instant) for instant in self.within)
        if self.strikes.rhythm is not None:  # notes that began before may end here
            at = tempo.resolve(self.strikes.at)
            since -= self.strikes.rhythm.begin(tempo, at, int(LONGEST_CYCLES)) - at
        for beat, number, hit in self.strikes.falls(self.piece, since, before):
            instant = tempo.seconds(beat)
            if hit.jitter != Length():
                chance = _core.Chance(self.piece.seed, "jitter", self.strikes.name, 0, number)
                reach = tempo.seconds(tempo.after(beat, hit.jitter)) - instant
                instant = max(0.0, instant + chance.uniform(-reach, reach))
            end = max(end, instant)
            mats = [mat for target in hit.to for mat in self._members(target)]
            for mat in mats:
                lasting = hit.lasting
                stop = None if lasting is None else tempo.seconds(tempo.after(beat, lasting))
                self._hold(mat, instant, stop)
            if not self._is_inside(instant):
                continue
            for member, mat in enumerate(mats):
                self._impel(mat, instant, hit.level, hit.reach, member, number)
        return end

    def _passed(self, passing: Passing) -> float:
        """Strike the members that a sweep or a path passes, in every round."""
        strikes, tempo, end = self.strikes, self.piece.tempo_map, 0.0
        draws = Draws(self.piece.seed, strikes.who)
        assert self.assembly is not None
        assert strikes.length is not None
        parts = list(dict.fromkeys(target.part for target in strikes.to))
        way = visits(passing, self.assembly.network, parts, self.mats)
        rounds = strikes.rounds(tempo)
        for turn, start in enumerate(rounds):
            lasting = tempo.after(start, strikes.length) - start
            end = max(end, tempo.seconds(start + lasting))
            _core.poll(_STRIKE_STEPS * len(way))
            for number, (share, member) in enumerate(way, turn * len(way)):
                instant = tempo.seconds(start + share * lasting)
                if not self._is_inside(instant):
                    continue
                if draws.happens(passing.chance, number, member):
                    count = len(way) * len(rounds)
                    self._strike(self.mats[member], instant, member, number, count)
        return end

    def _members(self, target: Target) -> Sequence[int]:
        """The MATs of a target; none if it is not in the network."""
        made = self.assembly
        if made is None or (target.part, target.module) not in made.mats:
            return ()
        return made.members(target)

    def _each(self) -> float:
        """Strike all members at written instants: once, or once per `every`."""
        tempo = self.piece.tempo_map
        instants = [tempo.seconds(beat) for beat in self.strikes.beats(tempo)]
        for occurrence, instant in enumerate(instants):
            is_last = occurrence + 1 == len(instants)
            for mat in self.mats:
                self._hold(mat, instant, None if is_last else instants[occurrence + 1])
            if not self._is_inside(instant):
                continue
            for member, mat in enumerate(self.mats):
                self._strike(mat, instant, member, occurrence, len(instants))
        return instants[-1] if instants else 0.0

    def _strike(self, mat: int, instant: float, member: int, number: int, count: int) -> None:
        """Strike a MAT as hard as the strikes say for one number of so many."""
        strikes, gain = self.strikes, self._gain
        if strikes.levels is None and gain > 0.0:
            speed = None if strikes.speed is None else strikes.speed * gain
            self.timeline.strike(mat, instant, mass=strikes.mass, speed=speed, source=self.source)
        if strikes.levels is None:
            return
        level = strikes.levels.step(number, count)
        self._impel(mat, instant, level, self._reaches.get(mat), member, number)

    def _impel(
        self,
        mat: int,
        instant: float,
        level: Level,
        reach: Reach | None,
        member: int,
        number: int,
    ) -> None:
        """Strike a MAT at a level; from a range by chance."""

        def draw(low: float, high: float) -> float:
            name = self.strikes.name
            chance = _core.Chance(self.piece.seed, "strikes", name, member, number)
            return chance.uniform(low, high)

        if self._gain > 0.0:
            impulse = self._gain * level.impulse(reach, draw)
            if reach is not None and reach.turns and number % 2:
                impulse = -impulse
            self.timeline.strike(mat, instant, impulse=impulse, source=self.source)

    def _hold(self, mat: int, begin: float, end: float | None) -> None:
        """Let a note ring from its beginning to its end, where its instrument has a release."""
        for damper, impulse in self._releases.get(mat, ()):
            for instant, signed in ((begin, -impulse), (end, impulse)):
                if instant is not None and self._is_inside(instant):
                    self.timeline.strike(damper, instant, impulse=signed, source=self.source)

    @cached_property
    def _releases(self) -> Mapping[int, Sequence[tuple[int, float]]]:
        """What lets the note of each MAT ring: other MATs, and their impulses [N·s]."""
        releases: dict[int, list[tuple[int, float]]] = {}
        for part in self.strikes.parts:
            instrument = self.piece.instruments.get(part)
            for act in () if instrument is None else instrument.acts:
                if act.release is None:
                    continue
                dampers = [
                    (mat, act.release.impulse)
                    for target in act.release.targets
                    for mat in self._members(target)
                ]
                for target in act.targets if dampers else ():
                    for mat in self._members(target):
                        releases.setdefault(mat, []).extend(dampers)
        return releases

    @cached_property
    def _reaches(self) -> Mapping[int, Reach]:
        """The reach of each MAT that is struck."""
        reaches = self.strikes.reaches
        return {
            mat: reaches[target.part]
            for target in self.strikes.to
            if target.part in reaches
            for mat in self._members(target)
        }
