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
from ergon.notation.clock.tempo import BPM_MAX, BPM_MIN
from ergon.notation.text.errors import TextError
from ergon.scores.gesture import midi_bytes as m
from ergon.scores.gesture.file_meters import read_meters
from ergon.scores.gesture.midi_bytes import MidiEvent
from ergon.scores.gesture.midi_file import (
    ALL_OFF_CONTROLLERS,
    ENDING_CONTROLLERS,
    FileState,
    read_bytes,
    state_of,
)
from ergon.scores.gesture.midi_wheels import CONTROLLERS
from ergon.scores.gesture.take_file import TakeError

MAX_CHANGES = 100_000  # tempos, or meters, that a score takes over
DEFAULT_QUARTER_MICROSECONDS = (
    500_000  # [us] of a quarter note where a file says no tempo (RP-001, "Set Tempo")
)
_MICROSECONDS_PER_MINUTE = 60e6  # [us]
_METER_POWER_MAX = 6  # a power of two: 1/64
# What is counted, by the kind of event, in the order in which it is said: singular and plural.
NOUNS = {
    m.PITCH_BEND: ("pitch bend", "pitch bends"),
    m.CHANNEL_PRESSURE: ("channel pressure", "channel pressures"),
    m.KEY_PRESSURE: ("key pressure", "key pressures"),
    m.PROGRAM: ("program change", "program changes"),
    m.SYSEX: ("system exclusive message", "system exclusive messages"),
    m.CONTROLLER: ("controller value", "controller values"),
}
FOLLOWED_KINDS = (m.PITCH_BEND, m.CHANNEL_PRESSURE, m.KEY_PRESSURE, m.CONTROLLER)  # by automation
_NUMBERED_KINDS = (m.CONTROLLER, m.KEY_PRESSURE)


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
    counts_by_channel: dict[int, NoteCount] = field(default_factory=dict)


@dataclass(slots=True)
class MidiSurvey:
    """What a file holds. Times are in quarter notes, of `ticks_per_quarter` each, from the
    beginning.

    `tempos` are (quarter, microseconds of a quarter note), `meters` (quarter, number of beats,
    power of two of their note), in the order of time and only the last of those at one instant;
    `n_tempos` and `n_meters` count all. `moves` counts all other events but notes.
    `odd_counts` says what no score takes over: tempos and meters that are none, notes that never
    end. `n_bytes_after` counts bytes after the last track, `n_bytes_unread` those in tracks that
    follow the event that ends a track; `n_missing` counts tracks that the head states and the file
    lacks.
    """

    format: int
    ticks_per_quarter: int
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
    odd_counts: Counter[str] = field(default_factory=Counter)

    @property
    def notes(self) -> Mapping[int, int]:
        """How many notes each channel has."""
        counts: Counter[int] = Counter()
        for track in self.tracks:
            counts.update(
                {channel: notes.count for channel, notes in track.counts_by_channel.items()}
            )
        return counts

    def seconds(self, quarters: float) -> float:
        """The instant of a place of the file, by its own tempos [s]."""
        tempo_changes = [(0.0, DEFAULT_QUARTER_MICROSECONDS), *self.tempos]
        n_changes = bisect_right(tempo_changes, quarters, key=lambda change: change[0])
        end_quarters = [*(start for start, _ in tempo_changes[1:n_changes]), quarters]
        changes_and_ends = zip(tempo_changes[:n_changes], end_quarters, strict=True)
        return (
            sum((end - start) * microseconds for (start, microseconds), end in changes_and_ends)
            / 1e6
        )


def survey(path: Path) -> MidiSurvey:
    """What a file holds. Raises TakeError."""
    try:
        return _survey(path, state_of(path))
    except OSError as error:
        raise TakeError(f"cannot be read: {error.strerror or error}", path) from None


@lru_cache(16)
def _survey(path: Path, _: FileState) -> MidiSurvey:
    file_bytes = read_bytes(path)
    header = file_bytes.read_header()
    contents = MidiSurvey(
        header.format, header.ticks_per_quarter, header.n_other_chunks, header.n_bytes_after
    )
    tempos: list[tuple[int, int]] = []
    meters: list[tuple[int, tuple[int, int]]] = []
    last_tick = 0
    for span in header.track_spans:
        track = MidiTrack()
        contents.tracks.append(track)
        sounding_counts = Counter[tuple[int, int]]()
        for event in file_bytes.track_events(span):
            _count_sounding(event, sounding_counts)
            last_tick = max(last_tick, event.tick)
            if event.kind != m.META:
                _count_move(event, track, contents)
            elif event.number == m.TRACK_NAME and not track.name:
                track.name = _decoded_text(event.content)
            elif event.number == m.SET_TEMPO:
                _add_tempo(event, tempos, contents)
            elif event.number == m.METER:
                _add_meter(event, meters, contents)
        if n_hanging := sounding_counts.total():
            contents.odd_counts["note that nothing ends"] += n_hanging
    ticks_per_quarter = contents.ticks_per_quarter
    contents.length, contents.n_bytes_unread = last_tick / ticks_per_quarter, file_bytes.n_unread
    contents.n_missing = header.n_missing
    contents.n_tempos, contents.n_meters = len(tempos), len(meters)
    contents.tempos = [
        (tick / ticks_per_quarter, microseconds)
        for tick, microseconds in _last_change_at_each_tick(tempos)
    ]
    contents.meters = [
        (tick / ticks_per_quarter, *meter) for tick, meter in _last_change_at_each_tick(meters)
    ]
    return contents


def _count_sounding(event: MidiEvent, sounding_counts: Counter[tuple[int, int]]) -> None:
    """Count the notes that sound, by channel and number. One key may be down several times."""
    note = event.channel, event.number
    if event.kind == m.NOTE_ON and event.content[1]:
        sounding_counts[note] += 1
    elif event.kind in (m.NOTE_ON, m.NOTE_OFF) and sounding_counts[note]:
        sounding_counts[note] -= 1
    elif event.kind == m.CONTROLLER and event.number in ALL_OFF_CONTROLLERS:
        for other_note in [note for note in sounding_counts if note[0] == event.channel]:
            del sounding_counts[other_note]


def _add_tempo(event: MidiEvent, tempos: list[tuple[int, int]], contents: MidiSurvey) -> None:
    if len(event.content) != 3:
        contents.odd_counts["tempo without its three bytes"] += 1
        return
    microseconds = int.from_bytes(event.content, "big")
    if not microseconds:
        contents.odd_counts["tempo of 0 microseconds a quarter note"] += 1
    tempos.append((event.tick, microseconds))


def _add_meter(
    event: MidiEvent, meters: list[tuple[int, tuple[int, int]]], contents: MidiSurvey
) -> None:
    if len(event.content) < 2:
        contents.odd_counts["meter without its bytes"] += 1
        return
    count, power = event.content[:2]
    try:
        _meter((count, power))
    except TextError:
        contents.odd_counts[f"meter of {count}/2^{power}, which no score has"] += 1
    meters.append((event.tick, (count, power)))


def _count_move(event: MidiEvent, track: MidiTrack, contents: MidiSurvey) -> None:
    if event.kind == m.NOTE_ON and event.content[1]:
        track.counts_by_channel.setdefault(event.channel, NoteCount()).add(event.number)
    elif event.kind in NOUNS:
        number = event.number if event.kind in _NUMBERED_KINDS else 0
        contents.moves[MidiMove(event.kind, event.channel, number)] += 1


def _decoded_text(content: bytes) -> str:
    """A text of a file, which says no encoding."""
    try:
        return content.decode()
    except UnicodeDecodeError:
        return content.decode("latin-1")


_Value = TypeVar("_Value")


def _last_change_at_each_tick(changes: Iterable[tuple[int, _Value]]) -> list[tuple[int, _Value]]:
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
    contents, tempos = _survey(path, state), []
    _check_count(len(contents.tempos), "tempos", path)
    first_tempo = (
        ()
        if contents.tempos and contents.tempos[0][0] == 0.0
        else ((0.0, DEFAULT_QUARTER_MICROSECONDS),)
    )
    for quarter, microseconds in (*first_tempo, *contents.tempos):
        if not microseconds or not BPM_MIN <= _MICROSECONDS_PER_MINUTE / microseconds <= BPM_MAX:
            message = (
                f"its tempo {quarter:g} quarters after the beginning is {microseconds} "
                f"microseconds a quarter; a tempo lies between {BPM_MIN:g} and {BPM_MAX:,.0f} bpm"
            )
            raise TakeError(message, path)
        tempos.append((quarter, _MICROSECONDS_PER_MINUTE / microseconds))
    return tuple(tempos)


def meters_of(path: Path) -> tuple[tuple[float, Meter], ...]:
    """The meters of a file: quarter notes from the beginning, and a meter. Raises TakeError for a
    meter that no score has, and for one that does not begin on a bar line.
    """
    survey(path)  # reports a file that cannot be read
    return _meters(path, state_of(path))


@lru_cache(8)
def _meters(path: Path, state: FileState) -> tuple[tuple[float, Meter], ...]:
    contents = _survey(path, state)
    _check_count(len(contents.meters), "meters", path)
    file_meters = ((quarter, (count, power)) for quarter, count, power in contents.meters)
    return read_meters(path, file_meters, _meter)


def _meter(count_and_power: tuple[int, int]) -> Meter:
    """A meter by its beats and the power of two of their note. Raises TextError."""
    count, power = count_and_power
    if not 1 <= count <= MAX_BEATS or power > _METER_POWER_MAX:
        raise TextError(f"no score has a meter {count}/2^{power}")
    return Meter(count, 2**power, (count,))


def _check_count(count: int, noun: str, path: Path) -> None:
    if count > MAX_CHANGES:
        raise TakeError(f"it has more than {MAX_CHANGES:,} {noun}", path)


def unused_contents(
    contents: MidiSurvey,
    *,
    has_pedal: bool,
    has_tempo: bool,
    has_meter: bool,
    has_wheel: bool,
    has_pressure: bool = False,
    is_followed: Callable[[MidiMove], bool] = lambda move: False,
) -> Iterator[str]:
    """What is in a file beside notes and what is used of it, in words; `is_followed` tells of an
    event whether automation does.
    """
    if contents.n_tempos and not has_tempo:
        yield plural(contents.n_tempos, ("tempo", "tempos"))
    if contents.n_meters and not has_meter:
        yield plural(contents.n_meters, ("meter", "meters"))
    played_controllers = {
        *(ENDING_CONTROLLERS if has_pedal else ()),
        *(CONTROLLERS if has_wheel else ()),
    }
    counts: Counter[int] = Counter()
    controllers: set[int] = set()
    for move, count in contents.moves.items():
        is_controller = move.kind == m.CONTROLLER
        is_wheel = has_wheel and move.kind == m.PITCH_BEND
        is_pressure = has_pressure and move.kind in (m.CHANNEL_PRESSURE, m.KEY_PRESSURE)
        is_played = is_wheel or is_pressure or (is_controller and move.number in played_controllers)
        if is_followed(move) or is_played:
            continue
        counts[move.kind] += count
        controllers |= {move.number} if is_controller else set()
    for kind, noun in NOUNS.items():
        if counts[kind]:
            is_controller = kind == m.CONTROLLER
            numbers = f" ({', '.join(map(str, sorted(controllers)))})" if is_controller else ""
            yield plural(counts[kind], noun) + numbers
    if contents.n_other_chunks:
        yield plural(contents.n_other_chunks, ("chunk of another kind", "chunks of other kinds"))


def plural(count: int, noun_forms: tuple[str, str]) -> str:
    """A count of something, by its singular and plural."""
    return f"{count:,} {noun_forms[count != 1]}"
