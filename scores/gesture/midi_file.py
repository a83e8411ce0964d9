"""Notes of a MIDI file (Standard MIDI Files 1.0, RP-001): time in quarters, number and velocity."""

from __future__ import annotations

import heapq
from collections import Counter
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

from ergon.common.regular import read_bounded
from ergon.scores.gesture.midi_bytes import CONTROLLER, NOTE_OFF, NOTE_ON, MidiBytes, MidiEvent
from ergon.scores.gesture.take_file import TakeError

SUFFIXES = (".mid", ".midi", ".rmi")
SUSTAIN = 64  # the controller of the pedal
_ALL_SOUND_OFF, _RESET_CONTROLLERS = 120, 121
# All Notes Off, and the changes of mode that imply it (MIDI 1.0, channel mode messages).
ALL_OFF_CONTROLLERS = (_ALL_SOUND_OFF, *range(123, 128))
ENDING_CONTROLLERS = (SUSTAIN, _RESET_CONTROLLERS, *ALL_OFF_CONTROLLERS)
MAX_BYTES = 4_000_000  # a million notes: two seconds to read
MAX_NOTES = 100_000  # notes that are played
# Kinds of events, in the order in which those of several tracks act in a tick.
_OFF_KIND, _ALL_OFF_KIND, _PEDAL_KIND, _ON_KIND, _OTHER_KIND = range(5)


class _ChannelEvent(NamedTuple):
    """An event of a channel: its tick, its kind, and its two numbers."""

    tick: int
    kind: int
    number: int = 0
    value: int = 0


class MidiNote(NamedTuple):
    """A note: its beginning in quarter notes from 0, its number (60 for C4), its velocity from 1 to
    127, and how long its key or the pedal holds it, in quarters. A note that nothing ends has no
    length.
    """

    at: float
    number: int
    velocity: int
    length: float | None = None
    word: str | None = None  # its name, where the file says one
    strength: float | None = None  # strength from dynamics; None: from the velocity


class MidiNotes(NamedTuple):
    """The notes of a file in the order of time, and how long it is, in quarter notes."""

    notes: tuple[MidiNote, ...]
    length: float


FileState = tuple[int, ...]  # changes when the content of a file changes


def state_of(path: Path) -> FileState:
    """The state of a file. Raises OSError."""
    file_status = path.stat()
    return file_status.st_mtime_ns, file_status.st_size, file_status.st_ino


def read_bytes(path: Path) -> MidiBytes:
    """The content of a file. Raises TakeError and OSError."""
    file_bytes = read_bounded(path, MAX_BYTES)
    if len(file_bytes) > MAX_BYTES:
        raise TakeError(f"the file has more than {MAX_BYTES // 1_000_000} MB", path)
    return MidiBytes(path, file_bytes)


def read_notes(path: Path, channel: str | None = None) -> MidiNotes:
    """The notes of a channel from 1 to 16, or of all. Raises TakeError."""
    try:
        return _read_notes(path, channel, state_of(path))
    except OSError as error:
        raise TakeError(f"cannot be read: {error.strerror or error}", path) from None


@lru_cache(8)
def _read_notes(path: Path, channel_name: str | None, _: FileState) -> MidiNotes:
    channel = channel_number(path, channel_name)
    midi_bytes = read_bytes(path)
    header = midi_bytes.read_header()
    events_by_channel: dict[int, dict[int, list[_ChannelEvent]]] = {}  # of each track
    channels_with_notes: set[int] = set()
    end_tick, n_notes = 0, 0
    for track_number, track in enumerate(header.track_spans):
        for track_event in midi_bytes.track_events(track):
            end_tick = max(end_tick, track_event.tick)
            note_event = _channel_event(track_event)
            if note_event.kind == _OTHER_KIND:
                continue
            channels_with_notes |= {track_event.channel} if note_event.kind == _ON_KIND else set()
            events_by_track = events_by_channel.setdefault(track_event.channel, {})
            if channel is None or track_event.channel == channel:
                n_notes += note_event.kind == _ON_KIND
                if n_notes > MAX_NOTES:
                    raise TakeError(f"more than {MAX_NOTES:,} notes are played", path)
                events_by_track.setdefault(track_number, []).append(note_event)
    timed_notes = [
        note
        for events_by_track in events_by_channel.values()
        for note in _notes_of_events([*events_by_track.values()], end_tick)
    ]
    if not timed_notes:
        channel_list = ", ".join(
            str(channel_with_notes) for channel_with_notes in sorted(channels_with_notes)
        )
        message = f"channel {channel_name} has no notes; those with notes are {channel_list}"
        field = "channel"
        if not channels_with_notes:
            message, field = "it has no notes", "file"
        raise TakeError(message, path, field=field)
    timed_notes.sort(key=lambda note: note[:2])
    ticks_per_quarter = header.ticks_per_quarter
    notes = tuple(
        MidiNote(
            tick / ticks_per_quarter,
            number,
            velocity,
            None if n_ticks is None else n_ticks / ticks_per_quarter,
        )
        for tick, number, velocity, n_ticks in timed_notes
    )
    last_quarter = notes[-1].at
    return MidiNotes(
        notes,
        end_tick / ticks_per_quarter
        if end_tick / ticks_per_quarter > last_quarter
        else int(last_quarter) + 1.0,
    )


def _channel_event(midi_event: MidiEvent) -> _ChannelEvent:
    """What a message does to notes."""
    event_number, event_value = (
        midi_event.number,
        midi_event.content[-1] if midi_event.content else 0,
    )
    if midi_event.kind == NOTE_ON:
        return _ChannelEvent(
            midi_event.tick, _ON_KIND if event_value else _OFF_KIND, event_number, event_value
        )
    if midi_event.kind == NOTE_OFF:
        return _ChannelEvent(midi_event.tick, _OFF_KIND, event_number, event_value)
    kind = _OTHER_KIND
    if midi_event.kind == CONTROLLER and event_number in (SUSTAIN, _RESET_CONTROLLERS):
        kind = _PEDAL_KIND
        event_value *= event_number == SUSTAIN  # a reset lets the pedal up (RP-015)
    elif midi_event.kind == CONTROLLER and event_number in ALL_OFF_CONTROLLERS:
        kind = _ALL_OFF_KIND
    return _ChannelEvent(midi_event.tick, kind, event_number, event_value)


def _event_sort_key(event: _ChannelEvent) -> tuple[int, int]:
    """What ends at a tick on one track comes before what begins on another."""
    return event.tick, event.kind


class _HeldNotes:
    """The notes of a channel that sound, by number: tick and velocity.

    A note ends with its key; while the pedal is down, where that comes up. A key that is struck
    again ends the note before.
    """

    def __init__(self) -> None:
        self.open_notes: dict[int, tuple[int, int]] = {}
        self.pedal_notes: dict[int, tuple[int, int]] = {}  # those whose key is up already
        self._restrike_ticks: dict[int, int] = {}  # by number
        self._is_pedal_down = False

    def follow(self, event: _ChannelEvent) -> Iterator[tuple[int, int, int, int]]:
        """Follow an event; yields the notes that it ends: tick, number, velocity, ticks."""
        if event.kind == _PEDAL_KIND:
            self._is_pedal_down = event.value >= 64
            for number in [] if self._is_pedal_down else [*self.pedal_notes]:
                yield from _ended(self.pedal_notes, number, event.tick)
        elif event.kind == _ALL_OFF_KIND:
            if event.number == _ALL_SOUND_OFF:
                for number in [*self.pedal_notes]:
                    yield from _ended(self.pedal_notes, number, event.tick)
            is_held = self._is_pedal_down and event.number != _ALL_SOUND_OFF
            for number in [*self.open_notes]:
                yield from self._release(number, event.tick, is_held=is_held)
        elif event.kind == _OFF_KIND:
            # Behind a key that was struck again in this tick, the end of the note before.
            if self._restrike_ticks.pop(event.number, None) != event.tick:
                yield from self._release(event.number, event.tick, is_held=self._is_pedal_down)
        else:
            begin_tick, _ = self.open_notes.get(event.number, (event.tick, 0))
            if begin_tick < event.tick:
                self._restrike_ticks[event.number] = event.tick
            yield from _ended(self.open_notes, event.number, event.tick)
            yield from _ended(self.pedal_notes, event.number, event.tick)
            self.open_notes[event.number] = event.tick, event.value

    def _release(
        self, number: int, tick: int, *, is_held: bool
    ) -> Iterator[tuple[int, int, int, int]]:
        """A key comes up; the pedal may hold its note."""
        if is_held and number in self.open_notes:
            yield from _ended(self.pedal_notes, number, tick)
            self.pedal_notes[number] = self.open_notes.pop(number)
        elif not is_held:
            yield from _ended(self.open_notes, number, tick)


def _ended(
    notes: dict[int, tuple[int, int]], number: int, tick: int
) -> Iterator[tuple[int, int, int, int]]:
    """The note of a number that ends at a tick, if there is one, taken out of the others."""
    if number in notes:
        begin_tick, velocity = notes.pop(number)
        yield begin_tick, number, velocity, tick - begin_tick


def _notes_of_events(
    events_by_track: list[list[_ChannelEvent]], end_tick: int
) -> Iterator[tuple[int, int, int, int | None]]:
    """The notes of a channel: tick, number, velocity, and for how many ticks each is held, at most
    to the end of the file.

    The order of a track decides what comes first in a tick. A note that ends where it begins lasts
    a tick, unless its key is struck again there.
    """
    held_notes = _HeldNotes()
    merged_events = heapq.merge(*events_by_track, key=_event_sort_key)
    ended_notes = [note for event in merged_events for note in held_notes.follow(event)]
    strike_counts = Counter((tick, number) for tick, number, *_ in ended_notes)
    for tick, number, velocity, n_ticks in ended_notes:
        has_no_length = not n_ticks and strike_counts[tick, number] == 1
        yield tick, number, velocity, 1 if has_no_length else n_ticks
    for note_number, (begin_tick, velocity) in held_notes.pedal_notes.items():
        yield begin_tick, note_number, velocity, max(end_tick - begin_tick, 1)
    for note_number, (begin_tick, velocity) in held_notes.open_notes.items():
        yield begin_tick, note_number, velocity, None


def channel_number(path: Path, channel: str | None) -> int | None:
    """The number of a channel as written; None for all. Raises TakeError."""
    if channel is None:
        return None
    if not channel.isascii() or not channel.isdigit() or not 1 <= int(channel[:9]) <= 16:
        raise TakeError("a channel of a MIDI file is a number from 1 to 16", path, field="channel")
    return int(channel[:9])
