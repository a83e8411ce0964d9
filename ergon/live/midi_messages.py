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


def parse_message(data: bytes) -> Message | None:
    """The message in the bytes of one packet; None for malformed and all other messages."""
    if len(data) == 1:
        return _TRANSPORT.get(data[0])
    if len(data) == 2 and data[1] <= 127 and data[0] & 0xF0 in (_PRESSURE, _PROGRAM):
        return Pressure(data[1]) if data[0] & 0xF0 == _PRESSURE else Program(data[1])
    if len(data) != 3 or data[1] > 127 or data[2] > 127:
        return None
    kind = data[0] & 0xF0
    if kind == _ON and data[2]:  # velocity 0 ends a note
        return Note(data[1], data[2])
    if kind in (_ON, _OFF):
        return NoteEnd(data[1])
    if kind == _CONTROL:
        return Control(data[1], data[2])
    if kind == _WHEEL:
        return Wheel(data[1] | data[2] << 7)
    if kind == _KEY_PRESSURE:
        return Pressure(data[2], data[1])
    if data[0] == _SONG_POSITION:
        return SongPosition((data[1] | data[2] << 7) * CLOCKS_PER_SONG_POSITION)
    return None


def encode_song_position(beats: float) -> bytes:
    """The message for a position in beats, rounded down to a sixteenth; beyond its range, the
    greatest position that fits.
    """
    units = min(int(beats * CLOCKS_PER_BEAT) // CLOCKS_PER_SONG_POSITION, (1 << 14) - 1)
    return bytes([_SONG_POSITION, units & 0x7F, units >> 7])
