"""Tempo map, meters, marks and notes as a MIDI file of type 1 (Standard MIDI Files 1.0, RP-001).

A ramp of tempo becomes steps of a sixteenth of a beat. MIDI counts microseconds per quarter note
in whole numbers, so a tempo is rounded in the direction that reduces the time error so far.
"""

from __future__ import annotations

import math
import struct
from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass

TICKS_PER_QUARTER = (
    960  # ticks per quarter note: a sixteenth of a beat is whole for beats of 1/1 to 1/16
)
STEPS_PER_BEAT = 16
_DRIFT_MICROSECONDS_MAX = 2.0  # [us] a tempo is kept while its time error is at most this
_TEMPO_MICROSECONDS_MAX = 2**24 - 1  # [us per quarter note] three bytes
_NOTE_OFF, _NOTE_ON = 0x80, 0x90
_TEXT, _TRACK_NAME, _MARKER, _END, _TEMPO, _METER = 0x01, 0x03, 0x06, 0x2F, 0x51, 0x58


@dataclass(frozen=True, slots=True)
class Meter:
    """From `beat` (counted from 0) a bar has `n_beats` beats of 1/`unit` note."""

    beat: float
    n_beats: int
    unit: int


@dataclass(frozen=True, slots=True)
class Marker:
    """A named place at `beat` (counted from 0)."""

    name: str
    beat: float


@dataclass(frozen=True, slots=True)
class Note:
    """A note from `begin_beat` to `end_beat` (beats from 0): a key from 0 to 127, a velocity from
    1.
    """

    begin_beat: float
    end_beat: float
    key: int
    velocity: int


@dataclass(frozen=True, slots=True)
class NoteTrack:
    """A track of notes on a channel from 0 to 15."""

    name: str
    channel: int
    notes: Sequence[Note]


def tempo_file(
    seconds_at: Callable[[float], float],
    length_beats: float,
    meters: Sequence[Meter],
    markers: Sequence[Marker],
    piece_title: str,
    tracks: Sequence[NoteTrack] = (),
) -> bytes:
    """A file whose ticks count the beats 0 … `length_beats` and whose tempo events give their
    seconds.

    The tempo map is its first track; `tracks` are those after it.

    `seconds_at(beat)` [s] is the piece's tempo map. Raises ValueError if a tempo or a meter
    cannot be written in MIDI.
    """
    ruler = Ruler(meters)
    timed_events: list[tuple[int, int, bytes]] = []  # tick, order within the tick, event

    def add(beat: float, order: int, kind: int, content: bytes) -> None:
        event = b"\xff" + bytes((kind,)) + _variable_length(len(content)) + content
        timed_events.append((ruler.tick(beat), order, event))

    add(0, 0, _TRACK_NAME, piece_title.encode())
    add(0, 1, _TEXT, b"tempo map, made by ergon")
    for meter in ruler.meters:
        add(meter.beat, 2, _METER, bytes((meter.n_beats, meter.unit.bit_length() - 1, 24, 8)))
    for beat, tempo in tempo_steps(seconds_at, length_beats, ruler):
        add(beat, 3, _TEMPO, tempo.to_bytes(3, "big"))
    for marker in markers:
        add(marker.beat, 4, _MARKER, marker.name.encode())
    add(max([length_beats, *(marker.beat for marker in markers)]), 5, _END, b"")
    track_chunks = [_track_chunk(timed_events), *(_note_track(track, ruler) for track in tracks)]
    return (
        b"MThd"
        + struct.pack(">IHHH", 6, 1, len(track_chunks), TICKS_PER_QUARTER)
        + b"".join(track_chunks)
    )


def _track_chunk(timed_events: list[tuple[int, int, bytes]]) -> bytes:
    """A track of events: tick, order within the tick, bytes."""
    track_content, tick_before = bytearray(), 0
    for tick, _, event in sorted(timed_events, key=lambda event: event[:2]):
        track_content += _variable_length(tick - tick_before) + event
        tick_before = tick
    return b"MTrk" + struct.pack(">I", len(track_content)) + bytes(track_content)


def _note_track(track: NoteTrack, ruler: Ruler) -> bytes:
    name = track.name.encode()
    name_event = b"\xff" + bytes((_TRACK_NAME,)) + _variable_length(len(name)) + name
    timed_events: list[tuple[int, int, bytes]] = [(0, 0, name_event)]
    last_tick = 0
    for track_note in track.notes:
        begin_tick = ruler.tick(track_note.begin_beat)
        end_tick = max(
            begin_tick + 1, ruler.tick(track_note.end_beat)
        )  # a note of no length would be none
        timed_events.append(
            (begin_tick, 2, bytes((_NOTE_ON | track.channel, track_note.key, track_note.velocity)))
        )
        timed_events.append((end_tick, 1, bytes((_NOTE_OFF | track.channel, track_note.key, 0))))
        last_tick = max(last_tick, end_tick)
    return _track_chunk([*timed_events, (last_tick, 3, b"\xff" + bytes((_END, 0)))])


class Ruler:
    """Converts beats to ticks; the unit of the meter says how many ticks a beat has."""

    def __init__(self, meters: Sequence[Meter]) -> None:
        """Before the first meter is 4/4. Raises ValueError for one that MIDI lacks."""
        self.meters = sorted(meters, key=lambda meter: meter.beat) or [Meter(0, 4, 4)]
        if self.meters[0].beat > 0:
            self.meters.insert(0, Meter(0, 4, 4))
        for meter in self.meters:
            n_beats, unit = meter.n_beats, meter.unit
            if not 1 <= n_beats <= 255 or unit not in (1, 2, 4, 8, 16, 32, 64):
                raise ValueError(f"MIDI has no meter {n_beats}/{unit}")
        self._beats = [meter.beat for meter in self.meters]
        self._start_quarters = [0.0]
        for meter, next_meter in zip(self.meters, self.meters[1:], strict=False):
            n_quarters = (next_meter.beat - meter.beat) * 4 / meter.unit
            self._start_quarters.append(self._start_quarters[-1] + n_quarters)

    def quarters(self, beat: float) -> float:
        """Quarter notes from beat 0."""
        index = max(bisect_right(self._beats, beat) - 1, 0)
        meter = self.meters[index]
        return self._start_quarters[index] + (beat - meter.beat) * 4 / meter.unit

    def tick(self, beat: float) -> int:
        """The nearest tick."""
        return round(self.quarters(beat) * TICKS_PER_QUARTER)


def tempo_steps(
    seconds_at: Callable[[float], float], length_beats: float, ruler: Ruler
) -> list[tuple[float, int]]:
    """Tempo changes (beat, microseconds per quarter note).

    Times stay within `_DRIFT_MICROSECONDS_MAX` of the exact ones.
    """
    tempo_changes: list[tuple[float, int]] = []
    tempo, drift_microseconds = 0, 0.0  # error [us]: how late MIDI is
    for step in range(max(1, math.ceil(length_beats * STEPS_PER_BEAT))):
        step_beat, end_beat = step / STEPS_PER_BEAT, (step + 1) / STEPS_PER_BEAT
        n_quarters = (ruler.tick(end_beat) - ruler.tick(step_beat)) / TICKS_PER_QUARTER
        microseconds = (seconds_at(end_beat) - seconds_at(step_beat)) * 1e6
        if abs(drift_microseconds + tempo * n_quarters - microseconds) > _DRIFT_MICROSECONDS_MAX:
            exact_tempo = microseconds / n_quarters
            rounded_tempo = (
                math.floor(exact_tempo) if drift_microseconds > 0 else math.ceil(exact_tempo)
            )
            if not 1 <= rounded_tempo <= _TEMPO_MICROSECONDS_MAX:
                raise ValueError(
                    f"MIDI cannot represent the tempo at beat {step_beat:g}: a quarter note lasts "
                    f"{exact_tempo / 1e6:.6g} s there, and in a MIDI file from 1 µs to "
                    f"{_TEMPO_MICROSECONDS_MAX / 1e6:.5g} s "
                    f"({60e6 / _TEMPO_MICROSECONDS_MAX:.3g} quarters a minute)"
                )
            if rounded_tempo != tempo:
                tempo = rounded_tempo
                tempo_changes.append((step_beat, tempo))
        drift_microseconds += tempo * n_quarters - microseconds
    return tempo_changes


def _variable_length(variable_number: int) -> bytes:
    """A variable-length number: seven bits a byte, the highest first, bit 7 set on all but the last
    byte (RP-001, 4.3).
    """
    octets = [variable_number & 0x7F]
    while variable_number := variable_number >> 7:
        octets.append(variable_number & 0x7F | 0x80)
    return bytes(reversed(octets))
