"""The tempo map: bars and beats to seconds and back.

A ramp is linear in bpm over beats, so Δb beats from b0 to b1 bpm last 60·Δb·ln(b1/b0)/(b1−b0)
seconds. Before the beginning the first tempo holds, so times stay in order there. Without any entry
a piece is in 4/4 at 60 bpm.
"""

import re
from bisect import bisect_right
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ergon._core import exp, ln, poll
from ergon.notation.clock.meter import SAME, Bars, Meter
from ergon.notation.clock.positions import Length, Position
from ergon.notation.text.errors import TextError
from ergon.notation.text.numbers import MAX_TIME, NUMBER, stripped
from ergon.notation.text.spelling import nearest
from ergon.notation.text.values import Time

BPM_MIN, BPM_MAX = 0.1, 10_000.0  # bpm
MARK_CHAIN_MAX = 64  # marks placed by marks
SERIES_LIMIT = 0.01  # below it ln(1+u)/u and its inverse are summed, or they would lose digits
# How else a change is written: 72..40, 72-40, 72 to 40, 72 → 40.
_FOREIGN_RAMP = re.compile(rf"({NUMBER})\s*+(?:\.\.|-|–|to|→|=>|>)\s*+({NUMBER})")
_BPM = re.compile(rf"({NUMBER})(?:\s*+->\s*+({NUMBER}))?")


@dataclass(frozen=True, slots=True)
class Entry:
    """One line of `tempo:`. `bpm_end` and `over` make a ramp; without `bpm` the tempo goes on."""

    at: Position
    bpm: float | None = None
    bpm_end: float | None = None
    over: Length | None = None
    meter: Meter | None = None


@dataclass(frozen=True, slots=True)
class FileTimes:
    """Tempos in quarters a minute, and meters, that come from a file; each with its place, in
    quarter notes after the beginning. They hold up to the first entry of the score that says a
    tempo, or a meter.
    """

    tempos: tuple[tuple[float, float], ...] = ()
    meters: tuple[tuple[float, Meter], ...] = ()


NO_FILE = FileTimes()


class TempoError(TextError):
    """A tempo entry that does not fit the others: `field` of entry number `entry` (from 0)."""

    def __init__(self, message: str, entry: int, field: str) -> None:
        """Keep which entry and which of its fields."""
        super().__init__(message)
        self.entry = entry
        self.field = field


def parse_bpm(text: str) -> tuple[float, float | None]:
    """Read `60` or `60 -> 96`. Raises TextError."""
    trimmed, trimmed_offset = stripped(text)
    bpm_match = _BPM.fullmatch(trimmed)
    if bpm_match is None:
        noun = "a tempo, which is a number of beats a minute," if trimmed.isalpha() else "a tempo"
        raise TextError(
            f"'{trimmed[:40]}' is not {noun} such as 60 or 60 -> 96",
            offset=trimmed_offset,
            length=max(1, len(trimmed)),
            suggestion=f"{ramp[1]} -> {ramp[2]}"
            if (ramp := _FOREIGN_RAMP.fullmatch(trimmed))
            else None,
        )
    for group in (1, 2):
        if bpm_match[group] is not None and not BPM_MIN <= float(bpm_match[group]) <= BPM_MAX:
            raise TextError(
                f"a tempo lies between {BPM_MIN:g} and {BPM_MAX:,.0f} bpm",
                offset=trimmed_offset + bpm_match.start(group),
                length=len(bpm_match[group]),
            )
    return float(bpm_match[1]), None if bpm_match[2] is None else float(bpm_match[2])


@dataclass(frozen=True, slots=True)
class _Segment:
    """From beat `start` (`seconds` into the piece) the tempo goes from `bpm_start` to `bpm_end`
    over `span` beats.
    """

    start: float
    seconds: float
    bpm_start: float
    bpm_end: float
    span: float

    def duration(self, beats: float) -> float:
        """Duration of the first `beats` beats."""
        if self.bpm_end == self.bpm_start:
            return 60.0 * beats / self.bpm_start
        relative_change = (self.bpm_end - self.bpm_start) * beats / (self.span * self.bpm_start)
        return 60.0 * beats / self.bpm_start * _log_ratio(relative_change)

    def beats_after(self, seconds: float) -> float:
        """How many beats pass in the first `seconds` seconds."""
        log_change = seconds * (self.bpm_end - self.bpm_start) / (60.0 * self.span)
        return seconds * self.bpm_start / 60.0 * _exp_ratio(log_change)

    def bpm_after(self, beats: float) -> float:
        """Tempo after `beats` beats."""
        return self.bpm_start + (self.bpm_end - self.bpm_start) * beats / self.span


class TempoMap:
    """The instant of each beat of the piece; beats count from 0."""

    def __init__(
        self,
        entries: Sequence[Entry] = (),
        marks: Mapping[str, Position] | None = None,
        file: FileTimes = NO_FILE,
    ) -> None:
        """Place the entries, which must be in order of time. Raises TempoError or TextError."""
        self.bars = Bars()
        self._marks = dict(marks or {})
        self._segments = [_Segment(0.0, 0.0, 60.0, 60.0, MAX_TIME)]
        self._starts = [0.0]
        self._instants = [0.0]
        self._ramp_end = 0.0
        self._last_tempo_beat = -1.0  # beat of the last entry that says a tempo
        self._is_ramp_in_bars = False  # whether the ramp's end would move with the meter
        self._ramp_entry = 0
        self._quarters_per_minute: float | None = (
            None  # quarters a minute, while a file says the tempo
        )
        self.entries_by_beat: list[tuple[float, Entry]] = []  # all changes, each with its beat
        last_beat = 0.0
        self._meter_quarter, self._meter_beat = 0.0, 0.0  # the beginning of the file's last meter
        tempos, meters = [*reversed(file.tempos)], [*reversed(file.meters)]
        for entry_index, tempo_entry in enumerate(entries):
            self._add_file_changes(tempos, meters, tempo_entry.at)
            entry_start = self.resolve(tempo_entry.at)
            if entry_start < last_beat - SAME:
                raise TempoError(
                    "this entry is earlier than the entry above it; write entries in order of time",
                    entry_index,
                    "at",
                )
            last_beat = max(entry_start, last_beat)
            self._place_entry(entry_index, tempo_entry, last_beat)
            if tempo_entry.bpm is not None:
                tempos.clear()
                self._quarters_per_minute = None
            if tempo_entry.meter is not None:
                meters.clear()
                self._follow_file_tempo(last_beat)
        self._add_file_changes(tempos, meters, None)

    def _add_file_changes(
        self,
        tempos: list[tuple[float, float]],
        meters: list[tuple[float, Meter]],
        until: Position | None,
    ) -> None:
        """Place what a file says up to a position; the last items of the lists come first."""
        while tempos or meters:
            poll()
            quarter = min(changes[-1][0] for changes in (tempos, meters) if changes)
            beat = self.bars.after_quarters(self._meter_beat, quarter - self._meter_quarter)
            if until is not None and beat > self._resolve(until, (), is_lenient=True) + SAME:
                return
            if meters and meters[-1][0] == quarter:
                _, meter = meters.pop()
                if self._is_ramp_in_bars and beat < self._ramp_end - SAME:
                    message = "the meter changes during this ramp, whose length is in bars; "
                    raise TempoError(
                        f"{message}write the length in beats", self._ramp_entry, "over"
                    )
                self.bars.change(beat, meter)
                self._meter_quarter, self._meter_beat = quarter, beat
                self.entries_by_beat.append((beat, Entry(Position(), meter=meter)))
            if tempos and tempos[-1][0] == quarter:
                _, self._quarters_per_minute = tempos.pop()
            self._follow_file_tempo(beat)

    def _follow_file_tempo(self, beat: float) -> None:
        """Let a tempo that a file says in quarters go on in beats of the meter here."""
        if self._quarters_per_minute is None:
            return
        bpm = self._quarters_per_minute * self.bars.unit(beat) / 4.0
        if bpm != self.bpm(beat):
            self._append(beat, bpm, bpm, MAX_TIME)
            self.entries_by_beat.append((beat, Entry(Position(), bpm)))

    def is_same(self, second_map: "TempoMap") -> bool:
        """Whether another map has every beat and bar at the same instant."""
        if self is second_map:
            return True
        return type(self) is type(second_map) and self._state() == second_map._state()

    def _state(self) -> tuple[object, ...]:
        return self._segments, self.bars.changes(), self._marks

    def resolve(self, position: Position) -> float:
        """Beats from the start. Raises TextError (offsets in the position's text)."""
        piece_beats = self._resolve(position, ())
        if piece_beats < -SAME:
            raise TextError(
                "this position is before the beginning of the piece",
                length=max(1, len(position.text)),
            )
        return max(0.0, piece_beats)

    def after(self, beats: float, length: Length) -> float:
        """The beat that lies `length` after `beats`: bars first, then beats, quarters, seconds."""
        if length.bars:
            bar, beat = self.bars.bar_beat(beats)
            beats = self.bars.start(bar + length.bars) + (beat - 1.0)
        beats += length.beats
        if length.quarters:
            beats = self.bars.after_quarters(beats, length.quarters)
        return self.beats(self.seconds(beats) + length.seconds) if length.seconds else beats

    def seconds(self, beats: float) -> float:
        """Seconds from the start to a beat of the piece."""
        if beats < 0.0:
            return 60.0 * beats / self._segments[0].bpm_start
        segment = self._segments[bisect_right(self._starts, beats) - 1]
        return segment.seconds + segment.duration(beats - segment.start)

    def beats(self, seconds: float) -> float:
        """The beat of the piece at an instant."""
        if seconds < 0.0:
            return seconds * self._segments[0].bpm_start / 60.0
        segment = self._segments[bisect_right(self._instants, seconds) - 1]
        return segment.start + segment.beats_after(seconds - segment.seconds)

    def bpm(self, beats: float) -> float:
        """The tempo at a beat of the piece."""
        segment = self._segments[max(0, bisect_right(self._starts, beats) - 1)]
        return segment.bpm_after(beats - segment.start)

    def instant(self, start_beats: float, time: Time) -> float:
        """Seconds from the piece's start of a time counted from beat `start_beats`.

        Negative when it lies before the beginning.
        """
        return self.seconds(start_beats + time.beats) + time.seconds

    def bar_beat(self, beats: float) -> tuple[int, float]:
        """(bar, beat) of a beat of the piece."""
        return self.bars.bar_beat(beats)

    def written(self, beats: float) -> str:
        """A beat of the piece as `bar|beat`, with the beat rounded to 3 decimals."""
        bar, beat = self.bars.bar_beat(beats)
        _, beats_per_bar = self.bars.bar(bar)
        rounded_beat = round(beat, 3)
        return f"{bar + 1}|1" if rounded_beat >= beats_per_bar + 1 else f"{bar}|{rounded_beat:g}"

    def _place_entry(self, entry_index: int, entry: Entry, start: float) -> None:
        self.entries_by_beat.append((start, entry))
        is_in_ramp = start < self._ramp_end - SAME
        if entry.meter is not None:
            if is_in_ramp and self._is_ramp_in_bars:
                raise TempoError(
                    "the meter changes during a ramp whose length "
                    "is in bars; write the length in beats",
                    entry_index,
                    "meter",
                )
            try:
                self.bars.change(start, entry.meter)
            except TextError as error:
                raise TempoError(error.message, entry_index, "at") from None
        if entry.bpm is None:
            if entry.bpm_end is not None or entry.over is not None:
                raise TempoError(
                    "the ramp has no tempi; write both, such as bpm: 60 -> 96", entry_index, "over"
                )
            return
        if is_in_ramp:
            raise TempoError("this entry begins before the ramp above it ends", entry_index, "at")
        if (entry.bpm_end is None) != (entry.over is None):
            raise TempoError(
                "`over` needs a ramp, such as bpm: 60 -> 96"
                if entry.bpm_end is None
                else "a ramp needs a length, such as over: 4bar",
                entry_index,
                "over" if entry.bpm_end is None else "bpm",
            )
        if start <= self._last_tempo_beat + SAME:
            raise TempoError(
                "an entry above sets the tempo at this position already", entry_index, "at"
            )
        self._last_tempo_beat = start
        self._append(start, entry.bpm, entry.bpm, MAX_TIME)
        if entry.bpm_end is not None and entry.over is not None:
            ramp_span = self._span(start, entry.bpm, entry.bpm_end, entry.over)
            if not 0.0 < ramp_span <= MAX_TIME:
                raise TempoError("the length of a ramp must be above 0", entry_index, "over")
            self._ramp_end, self._is_ramp_in_bars = start + ramp_span, entry.over.bars != 0.0
            self._ramp_entry = entry_index
            self._append(start, entry.bpm, entry.bpm_end, ramp_span)
            self._append(start + ramp_span, entry.bpm_end, entry.bpm_end, MAX_TIME)

    def _span(self, start: float, bpm_start: float, bpm_end: float, length: Length) -> float:
        beats = self.after(start, Length(length.bars, length.beats)) - start
        # `over: 8s`: the mean tempo of a ramp is the logarithmic mean of its ends
        return beats + length.seconds * bpm_start / (
            60.0 * _log_ratio((bpm_end - bpm_start) / bpm_start)
        )

    def _append(self, start: float, bpm_start: float, bpm_end: float, span: float) -> None:
        segment = _Segment(start, self.seconds(start), bpm_start, bpm_end, span)
        if start <= self._starts[-1] + SAME:  # nothing has passed since the last one began
            segment = _Segment(self._starts[-1], self._instants[-1], bpm_start, bpm_end, span)
            del self._segments[-1], self._starts[-1], self._instants[-1]
        self._segments.append(segment)
        self._starts.append(segment.start)
        self._instants.append(segment.seconds)

    def _resolve(
        self, position: Position, mark_chain: tuple[str, ...], *, is_lenient: bool = False
    ) -> float:
        # With `is_lenient` a bar may have more beats than its meter: a later one may hold there.
        # A name such as `verse-2` reads like a mark minus two beats; a mark of that name wins.
        mark_name = position.text if position.text in self._marks else position.mark
        if mark_name is None:
            base_beat = 0.0
            if position.bar is not None:
                start, beats_per_bar = self.bars.bar(position.bar)
                base_beat = start + (position.beat - 1.0)
                if position.beat >= beats_per_bar + 1 and not is_lenient:
                    raise TextError(
                        f"beat {position.beat:g} does not exist; bar "
                        f"{position.bar} has {beats_per_bar} beats",
                        length=max(1, len(position.text)),
                    )
            return self.after(base_beat, position.plus)
        if mark_name not in self._marks:
            raise TextError(
                f"unknown mark '{mark_name[:40]}'",
                length=len(mark_name),
                suggestion=nearest(mark_name, self._marks),
            )
        if len(mark_chain) == MARK_CHAIN_MAX:
            raise TextError(
                f"a chain of more than {MARK_CHAIN_MAX} marks refer to one another",
                length=len(mark_name),
            )
        if mark_name in mark_chain:
            circular_marks = " -> ".join((*mark_chain[mark_chain.index(mark_name) :], mark_name))
            raise TextError(
                f"marks refer to one another in a circle: {circular_marks}", length=len(mark_name)
            )
        base_beat = self._resolve(
            self._marks[mark_name], (*mark_chain, mark_name), is_lenient=is_lenient
        )
        return base_beat if mark_name == position.text else self.after(base_beat, position.plus)


def _log_ratio(u: float) -> float:
    """ln(1+u)/u."""
    if abs(u) > SERIES_LIMIT:
        return ln(1.0 + u) / u
    y = u / (2.0 + u)  # ln(1+u) = 2·artanh(y), and u = 2y/(1-y)
    y2 = y * y
    return (1.0 - y) * (1.0 + y2 * (1 / 3 + y2 * (1 / 5 + y2 * (1 / 7 + y2 * (1 / 9)))))


def _exp_ratio(w: float) -> float:
    """(exp(w)-1)/w."""
    if abs(w) > SERIES_LIMIT:
        return (exp(w) - 1.0) / w
    return 1.0 + w / 2 * (1 + w / 3 * (1 + w / 4 * (1 + w / 5 * (1 + w / 6 * (1 + w / 7)))))
