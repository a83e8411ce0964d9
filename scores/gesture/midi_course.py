"""How a controller, the wheel or a pressure of a MIDI file moves, over time."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import lru_cache
from itertools import chain
from pathlib import Path

from ergon.scores.gesture.midi_bytes import CONTROLLER, PITCH_BEND, MidiEvent
from ergon.scores.gesture.midi_file import FileState, read_bytes, state_of
from ergon.scores.gesture.midi_source import (
    MidiSource,
    pair_position,
    seven_bit_position,
    wheel_position,
)
from ergon.scores.gesture.take_file import TakeError

MAX_VALUES = 100_000

# Quarter notes from the beginning of the file, and where it stands from then on, from 0 to 1.
Course = tuple[tuple[float, float], ...]


def read_course(path: Path, channel: int | None, midi_source: MidiSource) -> Course:
    """How something moves on a channel from 1 to 16, or on all. Raises TakeError."""
    try:
        return _read_course(path, channel, midi_source, state_of(path))
    except OSError as error:
        raise TakeError(f"cannot be read: {error.strerror or error}", path) from None


@lru_cache(32)
def _read_course(path: Path, channel: int | None, midi_source: MidiSource, _: FileState) -> Course:
    midi_bytes = read_bytes(path)
    header = midi_bytes.read_header()
    events = [
        event
        for event in chain.from_iterable(map(midi_bytes.track_events, header.track_spans))
        if event.kind == midi_source.kind
        and (not midi_source.numbers or event.number in midi_source.numbers)
    ]
    moving_events = [event for event in events if channel in (None, event.channel)]
    if not moving_events:
        raise TakeError(_empty_message(midi_source, events, channel), path, field="by")
    moving_events.sort(key=lambda event: event.tick)
    # Of several values in a tick the last one counts.
    position_by_tick = dict(_ticks_and_positions(moving_events, midi_source))
    course, last_position = [], None
    for tick, position in position_by_tick.items():
        if position != last_position:
            course.append((tick / header.ticks_per_quarter, position))
        last_position = position
    if len(course) > MAX_VALUES:
        raise TakeError(f"{midi_source} has more than {MAX_VALUES:,} values", path, field="by")
    return tuple(course)


def _ticks_and_positions(
    midi_events: Iterable[MidiEvent], midi_source: MidiSource
) -> Iterator[tuple[int, float]]:
    """The tick of each event, and the position of the source then.

    The upper bits of a pair put the lower ones at 0, until these come (MIDI 1.0, control change).
    """
    upper_bits, lower_bits = 0, 0
    for event in midi_events:
        value = event.content[-1]
        if midi_source.kind == PITCH_BEND:
            position = wheel_position(event.content[0] | value << 7)
        elif midi_source.kind == CONTROLLER and len(midi_source.numbers) == 2:
            upper_bits, lower_bits = (
                (value, 0) if event.number == midi_source.numbers[0] else (upper_bits, value)
            )
            position = pair_position(upper_bits, lower_bits)
        else:
            position = seven_bit_position(value)
        yield event.tick, position


def _empty_message(
    midi_source: MidiSource, events: Iterable[MidiEvent], channel: int | None
) -> str:
    """Why there is nothing on a channel."""
    channels = sorted({event.channel for event in events})
    if not channels:
        return f"it has no values of `{midi_source}`"
    channel_list = ", ".join(map(str, channels))
    return f"channel {channel} has no values of `{midi_source}`; they are on channel {channel_list}"
