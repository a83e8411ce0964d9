"""Puts `strikes:` on the timeline as ergons."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

from ergon import _core
from ergon.instruments.assemble import Assembly
from ergon.instruments.model import Hold, Target
from ergon.notation.clock.positions import Length
from ergon.notation.clock.tempo import TempoMap
from ergon.notation.tables.strengths import MEZZO_FORTE, ImpulseRange, Level
from ergon.notation.text.errors import Collector, TextError
from ergon.scores.pattern.draws import Draws
from ergon.scores.pattern.search import first_index_from
from ergon.scores.pattern.steps import PlaceBeats
from ergon.scores.reading.piece import Piece, Strikes
from ergon.scores.reading.rhythms import LONGEST_CYCLES
from ergon.scores.reading.sweep_fields import Passing
from ergon.scores.staging.drawn_notes import DrawnNote, DrawnNotes, ModuleKey
from ergon.scores.staging.sweep_members import member_visits

ALL_INSTANTS = (-math.inf, math.inf)
_low_end, _high_end = (lambda low, high: low), (lambda low, high: high)
_STRIKE_STEPS = 2_000  # steps of work for a strike
_OPEN_NOTE_SECONDS = 1.0  # [s] for which a bow is drawn where nothing says how long a note is

# When a note begins and ends [s]; None where nothing says when it ends.
NoteSpan = tuple[float, float | None]


def _beat_of_instant(tempo: TempoMap, instant: float) -> float:
    """The beat of an instant [s], which may be infinite."""
    return tempo.beats(instant) if math.isfinite(instant) else instant


class NoteHolds(NamedTuple):
    """What lasts as long as the note of a MAT: other MATs, and the MAT itself if it `is_drawn`."""

    mats_and_holds: Sequence[tuple[int, Hold]]
    impulse_range: ImpulseRange
    is_drawn: bool

    def strength(self, impulse: float) -> float:
        """The strength of a note that strikes with an impulse [N·s]."""
        return self.impulse_range.strength(impulse)


@dataclass(frozen=True)
class Striking:
    """Strikes with their targets as MATs; their ergons carry `source`."""

    piece: Piece
    timeline: _core.Timeline
    strikes: Strikes
    mats: Sequence[int]
    source: int
    interval: tuple[float, float] = ALL_INSTANTS  # interval of instants [s]
    assembly: Assembly | None = None  # for targets of melodies, sweeps, paths and strengths
    drawn_notes: DrawnNotes | None = None  # where drawn notes are played, with an assembly

    def play(self, collector: Collector) -> float:
        """Put the strikes on the timeline; returns when they end [s]."""
        piece, strikes, tempo = self.piece, self.strikes, self.piece.tempo_map
        if strikes.along:
            return max(axis.play(collector) for axis in self._strikes_by_axis())
        begin_beat, stop_beat = tempo.resolve(strikes.at), strikes.stop_beat(tempo)
        try:
            if strikes.is_melody:
                return self._strike_melody()
            if strikes.passing is not None:
                return self._strike_along_path(strikes.passing)
            if strikes.pattern is not None:
                return self._strike_by_pattern(strikes.place_beats(piece))
            if strikes.rate is not None and strikes.levels is not None and stop_beat is not None:
                end = tempo.seconds(stop_beat)
                if self._gain == 0.0:
                    return end
                first_level, impulse_range = (
                    strikes.levels.steps[0],
                    next(iter(strikes.impulse_ranges.values()), None),
                )
                self.timeline.rain(
                    self.mats,
                    start=tempo.seconds(begin_beat),
                    stop=end,
                    rate=strikes.rate,
                    impulse=(
                        self._gain * first_level.impulse(impulse_range, _low_end),
                        self._gain * first_level.impulse(impulse_range, _high_end),
                    ),
                    seed=piece.seed,
                    name=strikes.name,
                    lasts=self._contact_seconds(*self.mats[:1]),
                    source=self.source,
                    within=self.interval,
                )
                return end
            return self._strike_each()
        except _core.EngineError as error:
            collector.error("E308", str(error), strikes.place)
        except TextError as error:
            collector.error("E305", error.message, strikes.place)
        return 0.0

    @property
    def _gain(self) -> float:
        """The ratio by which impulses are scaled."""
        return 1.0 if self.strikes.session_gain is None else self.strikes.session_gain

    def _is_within_interval(self, instant: float) -> bool:
        return self.interval[0] <= instant < self.interval[1]

    def _strikes_by_axis(self) -> Iterator[Striking]:
        """The strikes of each axis, with its share of the impulse; random draws are the same on all
        axes.
        """
        strikes = self.strikes
        n_mats = len(self.mats) // len(strikes.along)
        for axis, share in enumerate(strikes.along):
            axis_strikes = replace(
                strikes, along=(), levels=strikes.levels and strikes.levels.scaled(share)
            )
            yield replace(
                self, strikes=axis_strikes, mats=self.mats[axis * n_mats : (axis + 1) * n_mats]
            )

    def _strike_by_pattern(self, place_beats: PlaceBeats) -> float:
        """Strike in the places of a pattern; chance is drawn for each member separately."""
        places, tempo = place_beats.places, self.piece.tempo_map
        pattern = places.pattern

        def place_instant(place: int) -> float:
            return tempo.seconds(place_beats[place])

        first_place, stop_place = (
            first_index_from(place_instant, len(place_beats), instant) for instant in self.interval
        )
        for place_index in range(
            max(0, first_place - 1), stop_place
        ):  # the note before ends in this one
            note_name = places.name_in_place(place_index)
            if note_name is None:
                continue
            strike_instant, strike_number = place_instant(place_index), place_index + pattern.skip
            strike_end = (
                place_instant(place_index + 1) if place_index + 1 < len(place_beats) else None
            )
            for member, mat in enumerate(self._voice_mats(note_name)):
                if pattern.chance is None or places.draws.happens(
                    pattern.chance, strike_number, member
                ):
                    self._strike(
                        mat, (strike_instant, strike_end), member, strike_number, len(place_beats)
                    )
        return self._strikes_end(tempo.seconds(place_beats[-1])) if place_beats else 0.0

    def _voice_mats(self, name: str) -> Sequence[int]:
        """The MATs that a name of the pattern strikes: all, unless it is a note of an
        instrument.
        """
        if not self.strikes.voices:
            return self.mats
        return [mat for target in self.strikes.voices[name] for mat in self._members(target)]

    def _strike_melody(self) -> float:
        """The strikes of a melody, one by one."""
        tempo, end = self.piece.tempo_map, 0.0
        since_beat, before_beat = (_beat_of_instant(tempo, instant) for instant in self.interval)
        if self.strikes.rhythm is not None:  # notes that began before may end here
            begin = tempo.resolve(self.strikes.at)
            since_beat -= self.strikes.rhythm.cycle_begin(tempo, begin, int(LONGEST_CYCLES)) - begin
        for hit_beat, hit_index, melody_hit in self.strikes.played_hits(
            self.piece, since_beat, before_beat
        ):
            start = tempo.seconds(hit_beat)
            if melody_hit.jitter != Length():
                chance = _core.Chance(self.piece.seed, "jitter", self.strikes.name, 0, hit_index)
                jitter_seconds = tempo.seconds(tempo.after(hit_beat, melody_hit.jitter)) - start
                start = max(0.0, start + chance.uniform(-jitter_seconds, jitter_seconds))
            end = max(end, start)
            mats = [mat for target in melody_hit.to for mat in self._members(target)]
            note_length = melody_hit.duration
            stop = (
                None if note_length is None else tempo.seconds(tempo.after(hit_beat, note_length))
            )
            if stop is not None and any(map(self._is_drawn, mats)):
                end = max(end, stop)
            for member, mat in enumerate(mats):
                self._strike_at_level(
                    mat,
                    (start, stop),
                    melody_hit.level,
                    melody_hit.impulse_range,
                    member,
                    hit_index,
                )
        return end

    def _strike_along_path(self, passing: Passing) -> float:
        """Strike the members that a sweep or a path passes, in every round."""
        strikes, tempo, end = self.strikes, self.piece.tempo_map, 0.0
        draws = Draws(self.piece.seed, strikes.draw_key)
        assert self.assembly is not None
        assert strikes.length is not None
        parts = list(dict.fromkeys(target.part for target in strikes.to))
        visits = member_visits(passing, self.assembly.network, parts, self.mats)
        rounds = strikes.rounds(tempo)
        for round_index, round_start in enumerate(rounds):
            passing_beats = tempo.after(round_start, strikes.length) - round_start
            end = max(end, tempo.seconds(round_start + passing_beats))
            _core.poll(_STRIKE_STEPS * len(visits))
            for strike_number, (fraction, struck_member) in enumerate(
                visits, round_index * len(visits)
            ):
                instant = tempo.seconds(round_start + fraction * passing_beats)
                if not self._is_within_interval(instant):
                    continue
                if draws.happens(passing.chance, strike_number, struck_member):
                    n_strikes = len(visits) * len(rounds)
                    self._strike(
                        self.mats[struck_member],
                        (instant, None),
                        struck_member,
                        strike_number,
                        n_strikes,
                    )
        return end

    def _members(self, target: Target) -> Sequence[int]:
        """The MATs of a target; none if it is not in the network."""
        assembly = self.assembly
        if assembly is None or (target.part, target.module) not in assembly.mats:
            return ()
        return assembly.members(target)

    def _strike_each(self) -> float:
        """Strike all members at written instants: once, or once per `every`."""
        tempo = self.piece.tempo_map
        strike_instants = [tempo.seconds(beat) for beat in self.strikes.beats(tempo)]
        for strike_number, instant in enumerate(strike_instants):
            is_last = strike_number + 1 == len(strike_instants)
            span = instant, None if is_last else strike_instants[strike_number + 1]
            for member, mat in enumerate(self.mats):
                self._strike(mat, span, member, strike_number, len(strike_instants))
        return self._strikes_end(strike_instants[-1]) if strike_instants else 0.0

    def _strikes_end(self, instant: float) -> float:
        """When strikes end whose last begins at an instant, both in s."""
        is_drawn = any(note_holds.is_drawn for note_holds in self._note_holds.values())
        return instant + _OPEN_NOTE_SECONDS if is_drawn else instant

    def _strike(self, mat: int, span: NoteSpan, member: int, number: int, count: int) -> None:
        """Strike a MAT with the impulse of stroke `number` of `count`."""
        strikes, strike_gain = self.strikes, self._gain
        if strikes.levels is not None:
            level = strikes.levels.step(number, count)
            self._strike_at_level(mat, span, level, self._impulse_ranges.get(mat), member, number)
            return
        self._hold_mats(mat, span, MEZZO_FORTE.low)
        if strike_gain > 0.0 and self._is_within_interval(span[0]):
            speed = None if strikes.speed is None else strikes.speed * strike_gain
            self.timeline.strike(mat, span[0], mass=strikes.mass, speed=speed, source=self.source)

    def _strike_at_level(
        self,
        mat: int,
        stroke_span: NoteSpan,
        stroke_level: Level,
        impulse_range: ImpulseRange | None,
        member: int,
        strike_number: int,
    ) -> None:
        """Strike a MAT at a level; from a range by chance."""

        def draw(low: float, high: float) -> float:
            name = self.strikes.name
            chance = _core.Chance(self.piece.seed, "strikes", name, member, strike_number)
            return chance.uniform(low, high)

        note_holds = self._note_holds.get(mat)
        if note_holds is None and not self._is_within_interval(stroke_span[0]):
            return  # most notes of a version that plays from its middle
        impulse = stroke_level.impulse(impulse_range, draw)
        if impulse_range is not None and impulse_range.turns and strike_number % 2:
            impulse = -impulse
        if note_holds is not None:
            self._hold_mats(mat, stroke_span, note_holds.strength(impulse))
        if self._is_drawn(mat):
            self._play_drawn(mat, stroke_span, self._gain * impulse)
        elif self._gain > 0.0:
            self._push(mat, stroke_span[0], self._gain * impulse)

    def _play_drawn(self, mat: int, span: NoteSpan, impulse: float) -> None:
        """Strike a MAT, and by the opposite impulse where the note ends."""
        begin, end = span[0], span[0] + _OPEN_NOTE_SECONDS if span[1] is None else span[1]
        assert self.drawn_notes is not None
        note = DrawnNote(self.strikes.name, self._module_keys[mat], begin, end, impulse)
        self.drawn_notes.play(note, mat, self.source, self.interval)

    def _push(self, mat: int, instant: float, impulse: float) -> None:
        if self._is_within_interval(instant):
            contact_seconds = self._contact_seconds(mat)
            self.timeline.strike(
                mat, instant, impulse=impulse, lasts=contact_seconds, source=self.source
            )

    def _hold_mats(self, mat: int, stroke_span: NoteSpan, strength: float) -> None:
        """Let what lasts as long as a note begin and end with it."""
        note_holds = self._note_holds.get(mat)
        for other_mat, hold in () if note_holds is None else note_holds.mats_and_holds:
            impulse = hold.impulse(strength)
            if not hold.is_lifted:
                self._play_drawn(other_mat, stroke_span, impulse if self._gain > 0.0 else 0.0)
            elif self.strikes.passing is None:  # a sweep or path has no end of its own
                self._push(other_mat, stroke_span[0], impulse)
                if stroke_span[1] is not None:
                    self._push(other_mat, stroke_span[1], -impulse)

    def _is_drawn(self, mat: int) -> bool:
        """Whether what strikes a MAT lasts as long as the note."""
        return mat in self._note_holds and self._note_holds[mat].is_drawn

    def _contact_seconds(self, mat: int | None = None) -> float | None:
        """How long a strike lasts [s]: as the strikes say, or else what is struck."""
        written_lasts = self.strikes.lasts
        return self._contact_times.get(mat) if written_lasts is None else written_lasts

    @cached_property
    def _contact_times(self) -> Mapping[int | None, float]:
        """How long a strike on each MAT lasts whose instrument says so [s]."""
        instruments = map(self.piece.instruments.get, self.strikes.parts)
        acts = [
            act for instrument in instruments if instrument is not None for act in instrument.acts
        ]
        return {
            mat: act.lasts
            for act in acts
            if act.lasts is not None
            for target in act.targets
            for mat in self._members(target)
        }

    @cached_property
    def _note_holds(self) -> Mapping[int, NoteHolds]:
        """What lasts as long as the note of each MAT."""
        holds_by_mat: dict[int, NoteHolds] = {}
        for part in self.strikes.parts:
            instrument = self.piece.instruments.get(part)
            for act in () if instrument is None else instrument.acts:
                mats_and_holds = [
                    (mat, hold)
                    for hold in act.holds
                    for target in hold.targets
                    for mat in self._members(target)
                ]
                for target in act.targets if mats_and_holds or act.is_drawn else ():
                    for mat in self._members(target):
                        old_holds = holds_by_mat.get(mat, NoteHolds((), act.reach, is_drawn=False))
                        is_drawn = old_holds.is_drawn or act.is_drawn
                        holds_by_mat[mat] = NoteHolds(
                            (*old_holds.mats_and_holds, *mats_and_holds),
                            act.reach,
                            is_drawn=is_drawn,
                        )
        return holds_by_mat

    @cached_property
    def _module_keys(self) -> Mapping[int, ModuleKey]:
        """The place of each MAT that is drawn or pressed."""
        acts = [
            act
            for part in self.strikes.parts
            if part in self.piece.instruments
            for act in self.piece.instruments[part].acts
        ]
        targets = [target for act in acts for target in act.targets]
        targets += [target for act in acts for hold in act.holds for target in hold.targets]
        return {
            mat: (target.part, target.module) for target in targets for mat in self._members(target)
        }

    @cached_property
    def _impulse_ranges(self) -> Mapping[int, ImpulseRange]:
        """The reach of each MAT that is struck."""
        range_by_part = self.strikes.impulse_ranges
        return {
            mat: range_by_part[target.part]
            for target in self.strikes.to
            if target.part in range_by_part
            for mat in self._members(target)
        }
