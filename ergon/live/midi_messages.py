"""MIDI 1.0: parses untrusted bytes into the messages that a session needs, and writes song
positions.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

CLOCKS_PER_BEAT = 24  # MIDI clock messages in a beat
CLOCKS_PER_SONG_POSITION = 6  # clocks of one unit of a song position
_OFF, _ON, _KEY_PRESSURE, _CONTROL = 0x80, 0x90, 0xA0, 0xB0
_PROGRAM, _PRESSURE, _WHEEL = 0xC0, 0xD0, 0xE0
_SONG_POSITION = 0xF2


@dataclass(frozen=True, slots=True)
class Note:
    """A note that begins: its number and velocity, 1 to 127."""

    number: int
    velocity: int


@dataclass(frozen=True, slots=True)
class NoteEnd:
    """The end of a note, by its number."""

    number: int


@dataclass(frozen=True, slots=True)
class Control:
    """A controller that has moved: its number and value, 0 to 127."""

    number: int
    value: int


@dataclass(frozen=True, slots=True)
class Wheel:
    """Where the pitch wheel is, 0 to 16383; 8192 is its middle."""

    value: int


@dataclass(frozen=True, slots=True)
class Pressure:
    """How strongly a key is pressed once it is down, 0 to 127; without a number, any of them."""

    value: int
    number: int | None = None


@dataclass(frozen=True, slots=True)
class Program:
    """A program that was chosen, 0 to 127."""

    number: int


@dataclass(frozen=True, slots=True)
class SongPosition:
    """Where the next `CONTINUE` begins, in clocks from the beginning."""

    clocks: int


class Transport(Enum):
    """Messages of one byte about time."""

    CLOCK = 0xF8
    START = 0xFA
    CONTINUE = 0xFB
    STOP = 0xFC


Played = Note | NoteEnd | Control | Wheel | Pressure | Program
Message = Played | SongPosition | Transport
_TRANSPORT = {message.value: message for message in Transport}


def parse_message(message_bytes: bytes) -> Message | None:
    """The message in the bytes of one packet; None for malformed and all other messages."""
    if len(message_bytes) == 1:
        return _TRANSPORT.get(message_bytes[0])
    if (
        len(message_bytes) == 2
        and message_bytes[1] <= 127
        and message_bytes[0] & 0xF0 in (_PRESSURE, _PROGRAM)
    ):
        return (
            Pressure(message_bytes[1])
            if message_bytes[0] & 0xF0 == _PRESSURE
            else Program(message_bytes[1])
        )
    if len(message_bytes) != 3 or message_bytes[1] > 127 or message_bytes[2] > 127:
        return None
    message_kind = message_bytes[0] & 0xF0
    if message_kind == _ON and message_bytes[2]:  # velocity 0 ends a note
        return Note(message_bytes[1], message_bytes[2])
    if message_kind in (_ON, _OFF):
        return NoteEnd(message_bytes[1])
    if message_kind == _CONTROL:
        return Control(message_bytes[1], message_bytes[2])
    if message_kind == _WHEEL:
        return Wheel(message_bytes[1] | message_bytes[2] << 7)
    if message_kind == _KEY_PRESSURE:
        return Pressure(message_bytes[2], message_bytes[1])
    if message_bytes[0] == _SONG_POSITION:
        return SongPosition((message_bytes[1] | message_bytes[2] << 7) * CLOCKS_PER_SONG_POSITION)
    return None


def encode_song_position(beats: float) -> bytes:
    """The message for a position in beats, rounded down to a sixteenth; beyond its range, the
    greatest position that fits.
    """
    units = min(int(beats * CLOCKS_PER_BEAT) // CLOCKS_PER_SONG_POSITION, (1 << 14) - 1)
    return bytes([_SONG_POSITION, units & 0x7F, units >> 7])
