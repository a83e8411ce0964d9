"""MIDI 1.0: parses untrusted bytes into the messages that a session needs, and writes song
positions.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

CLOCKS_PER_BEAT = 24  # MIDI clock messages in a beat
CLOCKS_PER_SONG_POSITION = 6  # clocks of one unit of a song position
_NOTE_OFF, _NOTE_ON, _KEY_PRESSURE, _CONTROL_CHANGE = 0x80, 0x90, 0xA0, 0xB0
_PROGRAM_CHANGE, _CHANNEL_PRESSURE, _PITCH_BEND = 0xC0, 0xD0, 0xE0
_SONG_POSITION = 0xF2


@dataclass(frozen=True, slots=True)
class NoteOn:
    """A note that begins: its number and velocity, 1 to 127."""

    number: int
    velocity: int


@dataclass(frozen=True, slots=True)
class NoteOff:
    """The end of a note, by its number."""

    number: int


@dataclass(frozen=True, slots=True)
class ControlChange:
    """A controller that has moved: its number and value, 0 to 127."""

    number: int
    value: int


@dataclass(frozen=True, slots=True)
class PitchWheel:
    """Where the pitch wheel is, 0 to 16383; 8192 is its middle."""

    value: int


@dataclass(frozen=True, slots=True)
class Pressure:
    """How strongly a key is pressed once it is down, 0 to 127; without a number, any of them."""

    value: int
    number: int | None = None


@dataclass(frozen=True, slots=True)
class ProgramChange:
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


PlayedMessage = NoteOn | NoteOff | ControlChange | PitchWheel | Pressure | ProgramChange
Message = PlayedMessage | SongPosition | Transport
_TRANSPORT_BY_BYTE = {message.value: message for message in Transport}


def parse_message(message_bytes: bytes) -> Message | None:
    """The message in the bytes of one packet; None for malformed and all other messages."""
    if len(message_bytes) == 1:
        return _TRANSPORT_BY_BYTE.get(message_bytes[0])
    if (
        len(message_bytes) == 2
        and message_bytes[1] <= 127
        and message_bytes[0] & 0xF0 in (_CHANNEL_PRESSURE, _PROGRAM_CHANGE)
    ):
        return (
            Pressure(message_bytes[1])
            if message_bytes[0] & 0xF0 == _CHANNEL_PRESSURE
            else ProgramChange(message_bytes[1])
        )
    if len(message_bytes) != 3 or message_bytes[1] > 127 or message_bytes[2] > 127:
        return None
    message_kind = message_bytes[0] & 0xF0
    if message_kind == _NOTE_ON and message_bytes[2]:  # velocity 0 ends a note
        return NoteOn(message_bytes[1], message_bytes[2])
    if message_kind in (_NOTE_ON, _NOTE_OFF):
        return NoteOff(message_bytes[1])
    if message_kind == _CONTROL_CHANGE:
        return ControlChange(message_bytes[1], message_bytes[2])
    if message_kind == _PITCH_BEND:
        return PitchWheel(message_bytes[1] | message_bytes[2] << 7)
    if message_kind == _KEY_PRESSURE:
        return Pressure(message_bytes[2], message_bytes[1])
    if message_bytes[0] == _SONG_POSITION:
        return SongPosition((message_bytes[1] | message_bytes[2] << 7) * CLOCKS_PER_SONG_POSITION)
    return None


def encode_song_position(beats: float) -> bytes:
    """The message for a position in beats, rounded down to a sixteenth; beyond its range, the
    greatest position that fits.
    """
    sixteenths = min(int(beats * CLOCKS_PER_BEAT) // CLOCKS_PER_SONG_POSITION, (1 << 14) - 1)
    return bytes([_SONG_POSITION, sixteenths & 0x7F, sixteenths >> 7])
