"""How strongly the keys of a MIDI file are pressed while they are down."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterator, Sequence
from functools import lru_cache
from itertools import chain, pairwise
from pathlib import Path
from typing import NamedTuple

from ergon.scores.gesture.midi_bytes import CHANNEL_PRESSURE, KEY_PRESSURE, MidiEvent
from ergon.scores.gesture.midi_file import (
    FileState,
    channel_number,
    read_bytes,
    read_notes,
    state_of,
)
from ergon.scores.gesture.take_file import TakeError

MAX_PRESSURES = 100_000


class KeyPressure(NamedTuple):
    """From where [quarter notes] and for how long a key is pressed, its number, and how strongly,
    from 1 to 127.
    """

    start: float
    number: int
    value: int
    length: float


def read_pressures(path: Path, channel: str | None) -> tuple[KeyPressure, ...]:
    """How the keys of a channel from 1 to 16, or of all, are pressed.

    A key is pressed by the last value of its channel or of itself since it went down, to the end
    of its note. Raises TakeError.
    """
    try:
        return _read_pressures(path, channel, state_of(path))
    except OSError as error:
        raise TakeError(f"cannot be read: {error.strerror or error}", path) from None


@lru_cache(8)
def _read_pressures(path: Path, channel: str | None, _: FileState) -> tuple[KeyPressure, ...]:
    wanted_channel = channel_number(path, channel)
    midi_bytes = read_bytes(path)
    header = midi_bytes.read_header()
    events_by_channel: dict[int, list[MidiEvent]] = {}
    for midi_event in chain.from_iterable(map(midi_bytes.track_events, header.track_spans)):
        if midi_event.kind in (CHANNEL_PRESSURE, KEY_PRESSURE) and wanted_channel in (
            None,
            midi_event.channel,
        ):
            events_by_channel.setdefault(midi_event.channel, []).append(midi_event)
    pressures: list[KeyPressure] = []
    for midi_channel, events in events_by_channel.items():
        events.sort(key=lambda event: event.tick)
        for pressure in _channel_pressures(
            path, str(midi_channel), events, header.ticks_per_quarter
        ):
            pressures.append(pressure)
            if len(pressures) > MAX_PRESSURES:
                raise TakeError(f"its keys are pressed more than {MAX_PRESSURES:,} times", path)
    return tuple(sorted(pressures))


def _channel_pressures(
    path: Path, channel: str, midi_events: Sequence[MidiEvent], ticks_per_quarter: int
) -> Iterator[KeyPressure]:
    try:
        note_list, piece_length = read_notes(path, channel)
    except TakeError:  # the channel has no notes
        return
    start_quarters = [event.tick / ticks_per_quarter for event in midi_events]
    for note in note_list:
        note_end = piece_length if note.length is None else note.at + note.length
        first_event, stop_event = (
            bisect_left(start_quarters, note.at),
            bisect_left(start_quarters, note_end),
        )
        value_by_quarter = {
            start_quarter: event.content[-1]  # the last of several at one instant
            for start_quarter, event in zip(
                start_quarters[first_event:stop_event],
                midi_events[first_event:stop_event],
                strict=True,
            )
            if event.kind == CHANNEL_PRESSURE or event.number == note.number
        }
        for (start_quarter, value), (next_quarter, _) in pairwise(
            [*value_by_quarter.items(), (note_end, 0)]
        ):
            if value:
                yield KeyPressure(start_quarter, note.number, value, next_quarter - start_quarter)
