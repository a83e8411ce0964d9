"""How a controller, the wheel or a pressure of a MIDI file moves, over time."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import lru_cache
from itertools import chain
from pathlib import Path

from ergon.scores.gesture.midi_bytes import CONTROLLER, PITCH_BEND, MidiEvent
from ergon.scores.gesture.midi_file import FileState, read_bytes, state_of
from ergon.scores.gesture.midi_source import MidiSource, pair_share, seven_bit_share, wheel_share
from ergon.scores.gesture.take_file import TakeError

MAX_VALUES = 100_000

# Quarter notes from the beginning of the file, and where it stands from then on, from 0 to 1.
Course = tuple[tuple[float, float], ...]


def read_course(path: Path, channel: int | None, source: MidiSource) -> Course:
    """How something moves on a channel from 1 to 16, or on all. Raises TakeError."""
    try:
        return _read(path, channel, source, state_of(path))
    except OSError as error:
        raise TakeError(f"cannot be read: {error.strerror or error}", path) from None


@lru_cache(32)
def _read(path: Path, channel: int | None, source: MidiSource, _: FileState) -> Course:
    file = read_bytes(path)
    header = file.header()
    events = [
        event
        for event in chain.from_iterable(map(file.track, header.tracks))
        if event.kind == source.kind and (not source.numbers or event.number in source.numbers)
    ]
    moving = [event for event in events if channel in (None, event.channel)]
    if not moving:
        raise TakeError(_nothing(source, events, channel), path, field="by")
    moving.sort(key=lambda event: event.tick)
    by_tick = dict(_shares(moving, source))  # of several values in a tick the last
    course, share_before = [], None
    for tick, share in by_tick.items():
        if share != share_before:
            course.append((tick / header.ticks, share))
        share_before = share
    if len(course) > MAX_VALUES:
        raise TakeError(f"{source} has more than {MAX_VALUES:,} values", path, field="by")
    return tuple(course)


def _shares(events: Iterable[MidiEvent], source: MidiSource) -> Iterator[tuple[int, float]]:
    """The tick of each event, and where things stand then.

    The upper bits of a pair put the lower ones at 0, until these come (MIDI 1.0, control change).
    """
    upper, lower = 0, 0
    for event in events:
        value = event.content[-1]
        if source.kind == PITCH_BEND:
            share = wheel_share(event.content[0] | value << 7)
        elif source.kind == CONTROLLER and len(source.numbers) == 2:
            upper, lower = (value, 0) if event.number == source.numbers[0] else (upper, value)
            share = pair_share(upper, lower)
        else:
            share = seven_bit_share(value)
        yield event.tick, share


def _nothing(source: MidiSource, events: Iterable[MidiEvent], channel: int | None) -> str:
    """Why there is nothing on a channel."""
    channels = sorted({event.channel for event in events})
    if not channels:
        return f"it has no values of `{source}`"
    channel_list = ", ".join(map(str, channels))
    return f"channel {channel} has no values of `{source}`; they are on channel {channel_list}"
