"""The bytes of a MIDI file (Standard MIDI Files 1.0, RP-001): chunks, and the events of a track."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from ergon._core import poll
from ergon.scores.gesture.take_file import TakeError

MAX_TICK = 2**40
NOTE_OFF, NOTE_ON, KEY_PRESSURE, CONTROLLER = 0x80, 0x90, 0xA0, 0xB0  # kinds of events
PROGRAM, CHANNEL_PRESSURE, PITCH_BEND = 0xC0, 0xD0, 0xE0
SYSEX, SYSEX_PART, META = 0xF0, 0xF7, 0xFF
TRACK_NAME, END_OF_TRACK, SET_TEMPO, METER = 0x03, 0x2F, 0x51, 0x58  # kinds of meta events
# Bytes after each status.
_DATA_BYTES_BY_STATUS = {0x8: 2, 0x9: 2, 0xA: 2, 0xB: 2, 0xC: 1, 0xD: 1, 0xE: 2}
_CHUNK_HEADER_BYTES = 8  # bytes of a chunk's name and length


class MidiEvent(NamedTuple):
    """An event of a track: its tick, its kind (a status without a channel), its channel from 1 (0:
    none), its number (of a meta event, its kind) and its content.
    """

    tick: int
    kind: int
    channel: int
    number: int
    content: bytes


class MidiHeader(NamedTuple):
    """What the chunks of a file say: its format, ticks in a quarter note, the first and last offset
    of each track, how many chunks are of other kinds, the bytes after the last track, and how many
    tracks are counted that are not there.
    """

    format: int
    ticks_per_quarter: int
    track_spans: tuple[tuple[int, int], ...]
    n_other_chunks: int
    n_bytes_after: int
    n_missing: int = 0


class MidiBytes:
    """The bytes of a MIDI file, parsed with checks."""

    def __init__(self, path: Path, data: bytes) -> None:
        """Take the content of a file; the path is for messages."""
        self.path = path
        self.data = _unwrapped_riff(data)
        self.n_unread = 0  # bytes of tracks that follow the events that end them

    def damage_error(self, offset: int, description: str) -> TakeError:
        """The error for damage at a byte."""
        return TakeError(f"the file is damaged at byte {offset:,}: {description}", self.path)

    def read_header(self) -> MidiHeader:
        """The chunks of the file. Raises TakeError."""
        file_bytes = self.data
        if file_bytes[:4] != b"MThd":
            raise TakeError("it is not a MIDI file: it does not begin with MThd", self.path)
        header_length = int.from_bytes(file_bytes[4:8], "big")
        if len(file_bytes) < 14 or header_length < 6:
            raise self.damage_error(4, "the header has fewer than 6 bytes")
        midi_format, n_tracks, division = (
            int.from_bytes(file_bytes[i : i + 2], "big") for i in (8, 10, 12)
        )
        if midi_format > 1:
            message = f"a MIDI file of type {midi_format} holds several pieces; save it as type 1"
            raise TakeError(message, self.path)
        if division & 0x8000:
            message = "its times are frames of film (SMPTE); save it with ticks in a beat"
            raise TakeError(message, self.path)
        if not division:
            raise self.damage_error(12, "a beat has no ticks")
        track_spans: list[tuple[int, int]] = []
        n_others, chunk_start = 0, _CHUNK_HEADER_BYTES + header_length
        while chunk_start < len(file_bytes):
            chunk_name, content_start = (
                file_bytes[chunk_start : chunk_start + 4],
                chunk_start + _CHUNK_HEADER_BYTES,
            )
            chunk_length = int.from_bytes(file_bytes[chunk_start + 4 : content_start], "big")
            chunk_stop = content_start + chunk_length
            is_chunk = (
                content_start <= len(file_bytes)
                and chunk_name.isascii()
                and chunk_name.decode("ascii").isprintable()
            )
            is_complete = is_chunk and chunk_stop <= len(file_bytes)
            if not is_complete and len(track_spans) >= n_tracks and chunk_name != b"MTrk":
                break  # no chunk, and all tracks that the header counts are there
            if content_start > len(file_bytes):
                raise self.damage_error(chunk_start, "a chunk ends in its name or length")
            if chunk_stop > len(file_bytes):
                raise self.damage_error(
                    chunk_start + 4, f"a chunk of {chunk_length:,} bytes goes beyond the end"
                )
            if chunk_name == b"MTrk":
                track_spans.append((content_start, chunk_stop))
            else:
                n_others += 1
            chunk_start = chunk_stop
        n_after, n_missing = (
            max(0, len(file_bytes) - chunk_start),
            max(0, n_tracks - len(track_spans)),
        )
        return MidiHeader(midi_format, division, tuple(track_spans), n_others, n_after, n_missing)

    def track_events(self, span: tuple[int, int]) -> Iterator[MidiEvent]:
        """The events of a track in order, up to the event that ends it. Raises TakeError."""
        byte_offset, track_stop = span
        tick, status, n_events = 0, 0, 0
        while byte_offset < track_stop:
            n_events += 1
            if not n_events % 4096:
                poll()
            step, byte_offset = self._variable_number(byte_offset, track_stop)
            tick += step
            if tick > MAX_TICK:
                raise self.damage_error(byte_offset, "a track is longer than any piece")
            if byte_offset >= track_stop:
                raise self.damage_error(byte_offset, "a track ends where an event is expected")
            byte = self.data[byte_offset]
            if byte >= SYSEX:
                event, byte_offset = self._read_message(tick, byte, byte_offset + 1, track_stop)
                yield event
                if event.kind == META and event.number == END_OF_TRACK:
                    self.n_unread += track_stop - byte_offset
                    return
                continue  # a running status goes on, though RP-001 ends it: writers count on that
            if byte & 0x80:
                status, byte_offset = byte, byte_offset + 1
            elif not status:
                raise self.damage_error(byte_offset, "data without a status before it")
            n_data_bytes = _DATA_BYTES_BY_STATUS[status >> 4]
            event_content = self.data[byte_offset : byte_offset + n_data_bytes]
            if byte_offset + n_data_bytes > track_stop or any(
                byte & 0x80 for byte in event_content
            ):
                raise self.damage_error(byte_offset, "an event lacks its data")
            byte_offset += n_data_bytes
            channel = (status & 0xF) + 1
            yield MidiEvent(tick, status & 0xF0, channel, event_content[0], event_content)

    def _read_message(
        self, tick: int, status: int, offset: int, stop: int
    ) -> tuple[MidiEvent, int]:
        """A meta event or a message of the system, and the offset of its end."""
        number = 0
        if status == META:
            if offset >= stop:
                raise self.damage_error(offset, "a track ends where an event is expected")
            number, offset = self.data[offset], offset + 1
        elif status not in (SYSEX, SYSEX_PART):
            raise self.damage_error(offset - 1, f"a message 0x{status:02X}, which no file has")
        length, offset = self._variable_number(offset, stop)
        if offset + length > stop:
            raise self.damage_error(offset, f"an event of {length:,} bytes goes beyond its track")
        content = self.data[offset : offset + length]
        return MidiEvent(tick, status, 0, number, content), offset + length

    def _variable_number(self, offset: int, stop: int) -> tuple[int, int]:
        """A number of variable length, and the offset of its end."""
        value = 0
        for byte_offset in range(offset, min(offset + 4, stop)):
            value = value << 7 | self.data[byte_offset] & 0x7F
            if not self.data[byte_offset] & 0x80:
                return value, byte_offset + 1
        raise self.damage_error(offset, "a number has no end")


def _unwrapped_riff(riff_bytes: bytes) -> bytes:
    """The file that a RIFF of kind RMID holds (RP-029); other bytes as they are."""
    if riff_bytes[:4] != b"RIFF" or riff_bytes[8:12] != b"RMID":
        return riff_bytes
    chunk_start = 12
    while chunk_start + _CHUNK_HEADER_BYTES <= len(riff_bytes):
        chunk_size = int.from_bytes(
            riff_bytes[chunk_start + 4 : chunk_start + _CHUNK_HEADER_BYTES], "little"
        )
        content = riff_bytes[chunk_start + _CHUNK_HEADER_BYTES :][:chunk_size]
        if riff_bytes[chunk_start : chunk_start + 4] == b"data":
            return content
        chunk_start += _CHUNK_HEADER_BYTES + chunk_size + chunk_size % 2
    return riff_bytes
