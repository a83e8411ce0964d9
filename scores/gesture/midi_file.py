"""Notes of a MIDI file (Standard MIDI Files 1.0, RP-001): time in beats, number and velocity."""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

from ergon._core import poll
from ergon.common.regular import read_bounded
from ergon.scores.gesture.take_file import TakeError

SUFFIXES = (".mid", ".midi")
MAX_BYTES = 4_000_000  # a million notes: two seconds to read
MAX_NOTES = 100_000  # of those that are played
MAX_TICK = 2**40
_DATA = {0x8: 2, 0x9: 2, 0xA: 2, 0xB: 2, 0xC: 1, 0xD: 1, 0xE: 2}  # bytes after each status
_META, _END_OF_TRACK = 0xFF, 0x2F


_OFF, _PEDAL, _ON, _OTHER = range(4)  # kinds of events, in the order in which those of a tick act
_KINDS = {0x8: _OFF, 0x9: _ON, 0xB: _PEDAL}
_SUSTAIN = 64  # the controller of the pedal


class _Event(NamedTuple):
    """An event of a track: its tick, its kind, its channel from 1, and its two numbers."""

    tick: int
    kind: int
    channel: int = 0
    number: int = 0
    value: int = 0


class MidiNote(NamedTuple):
    """A note: its beginning in beats, from 0; its number, 60 for C4; velocity, 1 to 127; and how
    long it is held, by its key or by the pedal, in beats. A note that nothing ends has no length.
    """

    at: float
    number: int
    velocity: int
    lasting: float | None = None


class MidiNotes(NamedTuple):
    """The notes of a file in the order of time, and how long it is, in beats."""

    notes: tuple[MidiNote, ...]
    length: float


def read_notes(path: Path, channel: str | None = None) -> MidiNotes:
    """The notes of a channel from 1 to 16, or of all. Raises TakeError."""
    try:
        found = path.stat()
        made_of = found.st_mtime_ns, found.st_size, found.st_ino
        return _read(path, channel, made_of)
    except OSError as error:
        raise TakeError(f"cannot be read: {error.strerror or error}", path) from None


@lru_cache(8)
def _read(path: Path, channel: str | None, _: tuple[int, ...]) -> MidiNotes:
    wanted = _channel(path, channel)
    data = read_bounded(path, MAX_BYTES)
    if len(data) > MAX_BYTES:
        raise TakeError(f"the file has more than {MAX_BYTES // 1_000_000} MB", path)
    file = _File(path, data)
    ticks, tracks = file.header()
    by_channel: dict[int, list[_Event]] = {}
    with_notes: set[int] = set()
    end, count = 0, 0
    for track in tracks:
        for event in file.track(track):
            end = max(end, event.tick)
            if event.kind == _OTHER:
                continue
            with_notes |= {event.channel} if event.kind == _ON else set()
            events = by_channel.setdefault(event.channel, [])
            if wanted is None or event.channel == wanted:
                count += event.kind == _ON
                if count > MAX_NOTES:
                    raise TakeError(f"more than {MAX_NOTES:,} notes are played", path)
                events.append(event)
    played = [note for events in by_channel.values() for note in _notes(events, end)]
    if not played:
        there = ", ".join(str(known) for known in sorted(with_notes))
        message = f"channel {channel} has no notes; those with notes are {there}"
        field = "channel"
        if not with_notes:
            message, field = "it has no notes", "file"
        raise TakeError(message, path, field=field)
    played.sort(key=lambda note: note[:2])
    notes = tuple(
        MidiNote(tick / ticks, number, hard, None if held is None else held / ticks)
        for tick, number, hard, held in played
    )
    last = notes[-1].at
    return MidiNotes(notes, end / ticks if end / ticks > last else int(last) + 1.0)


def _in_order(event: _Event) -> tuple[int, int]:
    """What ends at a tick comes before what begins."""
    return event.tick, event.kind


def _notes(events: list[_Event], end: int) -> Iterator[tuple[int, int, int, int | None]]:
    """The notes of a channel: tick, number, velocity, and for how many ticks each is held.

    A note ends with its key; while the pedal (controller 64) is down, where that comes up, or at
    the end of the file. A key that is struck again ends the note before.
    """
    open_notes: dict[int, tuple[int, int]] = {}  # by number: tick and velocity
    on_pedal: dict[int, tuple[int, int]] = {}  # those whose key is up already
    is_down = False

    def ended(notes: dict[int, tuple[int, int]], number: int, tick: int) -> Iterator[Any]:
        if number in notes:
            begin, velocity = notes.pop(number)
            yield begin, number, velocity, tick - begin

    for event in sorted(events, key=_in_order):
        if event.kind == _PEDAL:
            is_down = event.value >= 64
            for number in [] if is_down else [*on_pedal]:
                yield from ended(on_pedal, number, event.tick)
            continue
        number = event.number
        if event.kind == _OFF and is_down and number in open_notes:
            yield from ended(on_pedal, number, event.tick)
            on_pedal[number] = open_notes.pop(number)
        elif event.kind == _OFF:
            yield from ended(open_notes, number, event.tick)
        else:
            yield from ended(open_notes, number, event.tick)
            yield from ended(on_pedal, number, event.tick)
            open_notes[number] = event.tick, event.value
    for number, (begin, velocity) in on_pedal.items():
        yield begin, number, velocity, max(end - begin, 1)
    for number, (begin, velocity) in open_notes.items():
        yield begin, number, velocity, None


def _channel(path: Path, channel: str | None) -> int | None:
    if channel is None:
        return None
    if not channel.isascii() or not channel.isdigit() or not 1 <= int(channel[:9]) <= 16:
        raise TakeError("a channel of a MIDI file is a number from 1 to 16", path, field="channel")
    return int(channel[:9])


class _File:
    """The bytes of a MIDI file, parsed with checks."""

    def __init__(self, path: Path, data: bytes) -> None:
        self.path = path
        self.data = data

    def damaged(self, at: int, what: str) -> TakeError:
        """The error for damage at a byte."""
        return TakeError(f"the file is damaged at byte {at:,}: {what}", self.path)

    def header(self) -> tuple[int, list[tuple[int, int]]]:
        """Ticks in a beat, and the first and last offset of each track."""
        data = self.data
        if data[:4] != b"MThd":
            raise TakeError("it is not a MIDI file: it does not begin with MThd", self.path)
        size = int.from_bytes(data[4:8], "big")
        if len(data) < 14 or size < 6:
            raise self.damaged(4, "the header has fewer than 6 bytes")
        kind, division = (int.from_bytes(data[i : i + 2], "big") for i in (8, 12))
        if kind > 1:
            message = f"a MIDI file of type {kind} holds several pieces; save it as type 1"
            raise TakeError(message, self.path)
        if division & 0x8000:
            message = "its times are frames of film (SMPTE); save it with ticks in a beat"
            raise TakeError(message, self.path)
        if not division:
            raise self.damaged(12, "a beat has no ticks")
        tracks, at = [], 8 + size
        while at < len(data):
            if at + 8 > len(data):
                raise self.damaged(at, "a chunk ends in its name or length")
            size = int.from_bytes(data[at + 4 : at + 8], "big")
            stop = at + 8 + size
            if stop > len(data):
                raise self.damaged(at + 4, f"a chunk of {size:,} bytes goes beyond the end")
            if data[at : at + 4] == b"MTrk":  # other chunks are skipped
                tracks.append((at + 8, stop))
            at = stop
        return division, tracks

    def track(self, span: tuple[int, int]) -> Iterator[_Event]:
        """The events of a track, in order."""
        at, stop = span
        tick, status, count = 0, 0, 0
        while at < stop:
            count += 1
            if not count % 4096:
                poll()
            step, at = self.variable(at, stop)
            tick += step
            if tick > MAX_TICK:
                raise self.damaged(at, "a track is longer than any piece")
            if at >= stop:
                raise self.damaged(at, "a track ends where an event is expected")
            if self.data[at] & 0x80:
                status, at = self.data[at], at + 1
            elif not status:
                raise self.damaged(at, "data without a status before it")
            if status >= 0xF0:
                kind, at = self.message(status, at, stop)
                if kind == _END_OF_TRACK:
                    yield _Event(tick, _OTHER)
                    return
                status = 0  # no running status after these
                continue
            size = _DATA[status >> 4]
            content = self.data[at : at + size]
            if at + size > stop or any(byte & 0x80 for byte in content):
                raise self.damaged(at, "an event lacks its data")
            at += size
            kind = _KINDS.get(status >> 4, _OTHER)
            if kind == _ON and content[1] == 0:
                kind = _OFF
            elif kind == _PEDAL and content[0] != _SUSTAIN:
                kind = _OTHER
            yield _Event(tick, kind, (status & 0xF) + 1, content[0], content[-1])

    def message(self, status: int, at: int, stop: int) -> tuple[int, int]:
        """The kind of a meta event (-1 for other messages), and the offset of its end."""
        kind = -1
        if status == _META:
            if at >= stop:
                raise self.damaged(at, "a track ends where an event is expected")
            kind, at = self.data[at], at + 1
        elif status not in (0xF0, 0xF7):
            raise self.damaged(at - 1, f"a message 0x{status:02X}, which no file has")
        size, at = self.variable(at, stop)
        if at + size > stop:
            raise self.damaged(at, f"an event of {size:,} bytes goes beyond its track")
        return kind, at + size

    def variable(self, at: int, stop: int) -> tuple[int, int]:
        """A number of variable length, and the offset of its end."""
        value = 0
        for place in range(at, min(at + 4, stop)):
            value = value << 7 | self.data[place] & 0x7F
            if not self.data[place] & 0x80:
                return value, place + 1
        raise self.damaged(at, "a number has no end")
