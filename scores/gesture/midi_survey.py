"""What a MIDI file holds, whether it is played or not: tracks, tempos, meters, and counts of all
other events.
"""

from __future__ import annotations

from bisect import bisect_right
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple, TypeVar

from ergon.notation.clock.meter import MAX_BEATS, Meter
from ergon.notation.clock.tempo import FASTEST, SLOWEST
from ergon.notation.text.errors import TextError
from ergon.scores.gesture import midi_bytes as m
from ergon.scores.gesture.file_meters import on_bar_lines
from ergon.scores.gesture.midi_bytes import MidiEvent
from ergon.scores.gesture.midi_file import SUSTAIN, FileState, read_bytes, state_of
from ergon.scores.gesture.midi_wheels import CONTROLLERS
from ergon.scores.gesture.take_file import TakeError

MAX_CHANGES = 100_000  # tempos, or meters, that a score takes over
QUARTER = 500_000  # [us] of a quarter note where a file says no tempo (RP-001, "Set Tempo")
_MINUTE = 60e6  # [us]
_LARGEST_UNIT = 6  # a power of two: 1/64
# What is counted, by the kind of event, in the order in which it is said: singular and plural.
NOUNS = {
    m.PITCH_BEND: ("pitch bend", "pitch bends"),
    m.CHANNEL_PRESSURE: ("channel pressure", "channel pressures"),
    m.KEY_PRESSURE: ("key pressure", "key pressures"),
    m.PROGRAM: ("program change", "program changes"),
    m.SYSEX: ("system exclusive message", "system exclusive messages"),
    m.CONTROLLER: ("controller value", "controller values"),
}
FOLLOWED = (m.PITCH_BEND, m.CHANNEL_PRESSURE, m.KEY_PRESSURE, m.CONTROLLER)  # by automation
_NUMBERED = (m.CONTROLLER, m.KEY_PRESSURE)


class MidiMove(NamedTuple):
    """What events that are no notes have in common: their kind, their channel (0: none), and the
    number of a controller or key (else 0).
    """

    kind: int
    channel: int
    number: int


@dataclass(slots=True)
class NoteCount:
    """How many notes there are, and the lowest and highest."""

    count: int = 0
    low: int = 127
    high: int = 0

    def add(self, number: int) -> None:
        """Count a note."""
        self.count += 1
        self.low, self.high = min(self.low, number), max(self.high, number)


@dataclass(slots=True)
class MidiTrack:
    """A track: its name, and its notes by channel."""

    name: str = ""
    notes: dict[int, NoteCount] = field(default_factory=dict)


@dataclass(slots=True)
class MidiSurvey:
    """What a file holds. Times are in quarter notes, of `ticks` each, from the beginning.

    `tempos` are (quarter, microseconds of a quarter note), `meters` (quarter, number of beats,
    power of two of their note), in the order of time and only the last of those at one instant;
    `n_tempos` and `n_meters` count all. `moves` counts all other events but notes.
    `n_bytes_after` counts bytes after the last track, `n_bytes_unread` those in tracks that follow
    the event that ends a track; `n_missing` counts tracks that the head states and the file lacks.
    """

    format: int
    ticks: int
    n_other_chunks: int
    n_bytes_after: int
    length: float = 0.0
    n_bytes_unread: int = 0
    n_missing: int = 0
    tracks: list[MidiTrack] = field(default_factory=list)
    tempos: list[tuple[float, int]] = field(default_factory=list)
    meters: list[tuple[float, int, int]] = field(default_factory=list)
    n_tempos: int = 0
    n_meters: int = 0
    moves: Counter[MidiMove] = field(default_factory=Counter)

    @property
    def notes(self) -> Mapping[int, int]:
        """How many notes each channel has."""
        counts: Counter[int] = Counter()
        for track in self.tracks:
            counts.update({channel: notes.count for channel, notes in track.notes.items()})
        return counts

    def seconds(self, quarters: float) -> float:
        """The instant of a place of the file, by its own tempos [s]."""
        starts = [(0.0, QUARTER), *self.tempos]
        n_changes = bisect_right(starts, quarters, key=lambda change: change[0])
        ends = [*(start for start, _ in starts[1:n_changes]), quarters]
        pairs = zip(starts[:n_changes], ends, strict=True)
        return sum((end - start) * micros for (start, micros), end in pairs) / 1e6


def survey(path: Path) -> MidiSurvey:
    """What a file holds. Raises TakeError."""
    try:
        return _survey(path, state_of(path))
    except OSError as error:
        raise TakeError(f"cannot be read: {error.strerror or error}", path) from None


@lru_cache(16)
def _survey(path: Path, _: FileState) -> MidiSurvey:
    midi_bytes = read_bytes(path)
    header = midi_bytes.header()
    file_survey = MidiSurvey(
        header.format, header.ticks, header.n_other_chunks, header.n_bytes_after
    )
    tempos: list[tuple[int, int]] = []
    meters: list[tuple[int, tuple[int, int]]] = []
    last_tick = 0
    for span in header.tracks:
        track = MidiTrack()
        file_survey.tracks.append(track)
        for midi_event in midi_bytes.track(span):
            last_tick = max(last_tick, midi_event.tick)
            if midi_event.kind != m.META:
                _count(midi_event, track, file_survey)
            elif midi_event.number == m.TRACK_NAME and not track.name:
                track.name = _text(midi_event.content)
            elif midi_event.number == m.SET_TEMPO and len(midi_event.content) == 3:
                tempos.append((midi_event.tick, int.from_bytes(midi_event.content, "big")))
            elif midi_event.number == m.METER and len(midi_event.content) >= 2:
                meters.append((midi_event.tick, (midi_event.content[0], midi_event.content[1])))
    ticks = file_survey.ticks
    file_survey.length, file_survey.n_bytes_unread = last_tick / ticks, midi_bytes.n_unread
    file_survey.n_missing = header.n_missing
    file_survey.n_tempos, file_survey.n_meters = len(tempos), len(meters)
    file_survey.tempos = [(tick / ticks, micros) for tick, micros in _latest(tempos)]
    file_survey.meters = [(tick / ticks, *meter) for tick, meter in _latest(meters)]
    return file_survey


def _count(midi_event: MidiEvent, track: MidiTrack, file_survey: MidiSurvey) -> None:
    if midi_event.kind == m.NOTE_ON and midi_event.content[1]:
        track.notes.setdefault(midi_event.channel, NoteCount()).add(midi_event.number)
    elif midi_event.kind in NOUNS:
        number = midi_event.number if midi_event.kind in _NUMBERED else 0
        file_survey.moves[MidiMove(midi_event.kind, midi_event.channel, number)] += 1


def _text(event_content: bytes) -> str:
    """A text of a file, which says no encoding."""
    try:
        return event_content.decode()
    except UnicodeDecodeError:
        return event_content.decode("latin-1")


_Value = TypeVar("_Value")


def _latest(changes: Iterable[tuple[int, _Value]]) -> list[tuple[int, _Value]]:
    """Changes in the order of time; of several at one tick the last, which all others follow."""
    return [*dict(sorted(changes, key=lambda change: change[0])).items()]


def tempos_of(path: Path) -> tuple[tuple[float, float], ...]:
    """The tempos of a file: quarter notes from the beginning, and quarters a minute. Raises
    TakeError.
    """
    survey(path)  # reports a file that cannot be read
    return _tempos(path, state_of(path))


@lru_cache(8)
def _tempos(path: Path, state: FileState) -> tuple[tuple[float, float], ...]:
    file_survey, tempo_changes = _survey(path, state), []
    _check_count(len(file_survey.tempos), "tempos", path)
    first_tempo = (
        () if file_survey.tempos and file_survey.tempos[0][0] == 0.0 else ((0.0, QUARTER),)
    )
    for quarter, micros in (*first_tempo, *file_survey.tempos):
        if not micros or not SLOWEST <= _MINUTE / micros <= FASTEST:
            message = (
                f"its tempo {quarter:g} quarters after the beginning is {micros} microseconds a "
                f"quarter; a tempo lies between {SLOWEST:g} and {FASTEST:,.0f} bpm"
            )
            raise TakeError(message, path)
        tempo_changes.append((quarter, _MINUTE / micros))
    return tuple(tempo_changes)


def meters_of(path: Path) -> tuple[tuple[float, Meter], ...]:
    """The meters of a file: quarter notes from the beginning, and a meter. Raises TakeError for a
    meter that no score has, and for one that does not begin on a bar line.
    """
    survey(path)  # reports a file that cannot be read
    return _meters(path, state_of(path))


@lru_cache(8)
def _meters(path: Path, state: FileState) -> tuple[tuple[float, Meter], ...]:
    file = _survey(path, state)
    _check_count(len(file.meters), "meters", path)
    file_meters = ((quarter, (count, power)) for quarter, count, power in file.meters)
    return on_bar_lines(path, file_meters, _meter)


def _meter(count_and_power: tuple[int, int]) -> Meter:
    """A meter by its beats and the power of two of their note. Raises TextError."""
    beat_count, power = count_and_power
    if not 1 <= beat_count <= MAX_BEATS or power > _LARGEST_UNIT:
        raise TextError(f"no score has a meter {beat_count}/2^{power}")
    return Meter(beat_count, 2**power, (beat_count,))


def _check_count(count: int, noun: str, path: Path) -> None:
    if count > MAX_CHANGES:
        raise TakeError(f"it has more than {MAX_CHANGES:,} {noun}", path)


def passed_over(
    midi_survey: MidiSurvey,
    *,
    has_pedal: bool,
    has_tempo: bool,
    has_meter: bool,
    has_wheel: bool,
    has_pressure: bool = False,
    follows: Callable[[MidiMove], bool] = lambda move: False,
) -> Iterator[str]:
    """What is in a file beside notes and what is used of it, in words; `follows` tells of an event
    whether automation does.
    """
    if midi_survey.n_tempos and not has_tempo:
        yield plural(midi_survey.n_tempos, ("tempo", "tempos"))
    if midi_survey.n_meters and not has_meter:
        yield plural(midi_survey.n_meters, ("meter", "meters"))
    played = {*((SUSTAIN,) if has_pedal else ()), *(CONTROLLERS if has_wheel else ())}
    event_counts: Counter[int] = Counter()
    controllers: set[int] = set()
    for move, event_count in midi_survey.moves.items():
        is_controller = move.kind == m.CONTROLLER
        is_wheel = has_wheel and move.kind == m.PITCH_BEND
        is_pressure = has_pressure and move.kind in (m.CHANNEL_PRESSURE, m.KEY_PRESSURE)
        is_played = is_wheel or is_pressure or (is_controller and move.number in played)
        if follows(move) or is_played:
            continue
        event_counts[move.kind] += event_count
        controllers |= {move.number} if is_controller else set()
    for event_kind, noun in NOUNS.items():
        if event_counts[event_kind]:
            is_controller = event_kind == m.CONTROLLER
            numbers = f" ({', '.join(map(str, sorted(controllers)))})" if is_controller else ""
            yield plural(event_counts[event_kind], noun) + numbers
    if midi_survey.n_other_chunks:
        yield plural(midi_survey.n_other_chunks, ("chunk of another kind", "chunks of other kinds"))


def plural(count: int, noun: tuple[str, str]) -> str:
    """A count of something, by its singular and plural."""
    return f"{count:,} {noun[count != 1]}"
