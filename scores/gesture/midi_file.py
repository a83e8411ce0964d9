"""Notes of a MIDI file (Standard MIDI Files 1.0, RP-001): time in quarters, number and velocity."""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

from ergon.common.regular import read_bounded
from ergon.scores.gesture.midi_bytes import CONTROLLER, NOTE_OFF, NOTE_ON, MidiBytes, MidiEvent
from ergon.scores.gesture.take_file import TakeError

SUFFIXES = (".mid", ".midi", ".rmi")
SUSTAIN = 64  # the controller of the pedal
MAX_BYTES = 4_000_000  # a million notes: two seconds to read
MAX_NOTES = 100_000  # notes that are played
# Kinds of events, in the order in which those of a tick act.
_OFF_KIND, _PEDAL_KIND, _ON_KIND, _OTHER_KIND = range(4)


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
    events_by_channel: dict[int, list[_ChannelEvent]] = {}
    channels_with_notes: set[int] = set()
    end_tick, n_notes = 0, 0
    for track in header.track_spans:
        for track_event in midi_bytes.track_events(track):
            end_tick = max(end_tick, track_event.tick)
            note_event = _channel_event(track_event)
            if note_event.kind == _OTHER_KIND:
                continue
            channels_with_notes |= {track_event.channel} if note_event.kind == _ON_KIND else set()
            channel_events = events_by_channel.setdefault(track_event.channel, [])
            if channel is None or track_event.channel == channel:
                n_notes += note_event.kind == _ON_KIND
                if n_notes > MAX_NOTES:
                    raise TakeError(f"more than {MAX_NOTES:,} notes are played", path)
                channel_events.append(note_event)
    timed_notes = [
        note for events in events_by_channel.values() for note in _notes_of_events(events, end_tick)
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


def _channel_event(message: MidiEvent) -> _ChannelEvent:
    """What a message does to notes."""
    message_number, message_value = message.number, message.content[-1] if message.content else 0
    if message.kind == NOTE_ON:
        return _ChannelEvent(
            message.tick, _ON_KIND if message_value else _OFF_KIND, message_number, message_value
        )
    if message.kind == NOTE_OFF:
        return _ChannelEvent(message.tick, _OFF_KIND, message_number, message_value)
    is_pedal = message.kind == CONTROLLER and message_number == SUSTAIN
    return _ChannelEvent(
        message.tick, _PEDAL_KIND if is_pedal else _OTHER_KIND, message_number, message_value
    )


def _tick_order(event: _ChannelEvent) -> tuple[int, int]:
    """What ends at a tick comes before what begins."""
    return event.tick, event.kind


def _notes_of_events(
    midi_events: list[_ChannelEvent], end_tick: int
) -> Iterator[tuple[int, int, int, int | None]]:
    """The notes of a channel: tick, number, velocity, and for how many ticks each is held.

    A note ends with its key; while the pedal (controller 64) is down, where that comes up, or at
    the end of the file. A key that is struck again ends the note before.
    """
    open_notes: dict[int, tuple[int, int]] = {}  # by number: tick and velocity
    pedal_notes: dict[int, tuple[int, int]] = {}  # those whose key is up already
    is_pedal_down = False

    def end_note(notes: dict[int, tuple[int, int]], number: int, tick: int) -> Iterator[Any]:
        if number in notes:
            begin, velocity = notes.pop(number)
            yield begin, number, velocity, tick - begin

    for note_event in sorted(midi_events, key=_tick_order):
        if note_event.kind == _PEDAL_KIND:
            is_pedal_down = note_event.value >= 64
            for note_number in [] if is_pedal_down else [*pedal_notes]:
                yield from end_note(pedal_notes, note_number, note_event.tick)
            continue
        note_number = note_event.number
        if note_event.kind == _OFF_KIND and is_pedal_down and note_number in open_notes:
            yield from end_note(pedal_notes, note_number, note_event.tick)
            pedal_notes[note_number] = open_notes.pop(note_number)
        elif note_event.kind == _OFF_KIND:
            yield from end_note(open_notes, note_number, note_event.tick)
        else:
            yield from end_note(open_notes, note_number, note_event.tick)
            yield from end_note(pedal_notes, note_number, note_event.tick)
            open_notes[note_number] = note_event.tick, note_event.value
    for note_number, (begin_tick, velocity) in pedal_notes.items():
        yield begin_tick, note_number, velocity, max(end_tick - begin_tick, 1)
    for note_number, (begin_tick, velocity) in open_notes.items():
        yield begin_tick, note_number, velocity, None


def channel_number(path: Path, channel: str | None) -> int | None:
    """The number of a channel as written; None for all. Raises TakeError."""
    if channel is None:
        return None
    if not channel.isascii() or not channel.isdigit() or not 1 <= int(channel[:9]) <= 16:
        raise TakeError("a channel of a MIDI file is a number from 1 to 16", path, field="channel")
    return int(channel[:9])
