"""How far the pitch wheel of a MIDI file moves each note.

Standard MIDI Files 1.0 (RP-001); registered parameters 0 (range of the wheel) and 6 (zones of MIDI
Polyphonic Expression, M1-100-UM 2018, sections 2.1 and 2.4).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import chain
from pathlib import Path

from ergon.scores.gesture.midi_bytes import CONTROLLER, NOTE_ON, PITCH_BEND, MidiEvent
from ergon.scores.gesture.midi_file import FileState, channel_number, read_bytes, state_of
from ergon.scores.gesture.take_file import TakeError

MAX_POINTS = 100_000  # movements of notes
_WHEEL_CENTRE = 8192  # middle of the wheel, which has 14 bits
# The controllers that say the range of a wheel, and zones.
_DATA_COARSE, _DATA_FINE, _RPN_FINE, _RPN_COARSE = 6, 38, 100, 101
CONTROLLERS = _DATA_COARSE, _DATA_FINE, _RPN_FINE, _RPN_COARSE
_RANGE_PARAMETER, _ZONE_PARAMETER = 0, 6  # registered parameters
# The master channels of zones, each with the channels that it takes.
_ZONE_CHANNELS_BY_MASTER = {1: range(2, 17), 16: range(15, 0, -1)}
_MEMBER_RANGE_CENTS = 4800.0  # [cents] range of the wheel of a channel in a zone (MPE, section 2.4)
_MASTER_RANGE_CENTS = 200.0  # [cents]
# Of the events at one tick the wheel and controllers come first: a note begins at its pitch.
_KIND_ORDER = {CONTROLLER: 0, PITCH_BEND: 1, NOTE_ON: 2}

# By the number of a note: quarter notes from the beginning, and cents from then on.
NoteCurves = Mapping[int, tuple[tuple[float, float], ...]]


def read_wheels(path: Path, channel: str | None, default_range: float) -> NoteCurves:
    """How the notes of a channel, or of all, glide; `default_range` [cents] is the range of a wheel
    of which the file does not say it. Raises TakeError.
    """
    try:
        return _read_wheels(path, channel, default_range, state_of(path))
    except OSError as error:
        raise TakeError(f"cannot be read: {error.strerror or error}", path) from None


@lru_cache(8)
def _read_wheels(path: Path, channel: str | None, default_range: float, _: FileState) -> NoteCurves:
    wanted_channel = channel_number(path, channel)
    midi_bytes = read_bytes(path)
    header = midi_bytes.read_header()
    file_events = [*chain.from_iterable(map(midi_bytes.track_events, header.track_spans))]
    file_events = [event for event in file_events if event.kind in _KIND_ORDER]
    file_events.sort(key=lambda event: (event.tick, _KIND_ORDER[event.kind]))
    wheels, curve_points = Wheels(default_range), dict[int, dict[float, float]]()
    n_points = 0
    for wheel_event in file_events:
        for note_number, sounding_channel in wheels.follow(wheel_event):
            if wanted_channel in (None, sounding_channel):
                n_points += 1
                if n_points > MAX_POINTS:
                    raise TakeError(f"the wheel moves notes more than {MAX_POINTS:,} times", path)
                quarter = wheel_event.tick / header.ticks_per_quarter
                curve_points.setdefault(note_number, {})[quarter] = wheels.cents(sounding_channel)
    return {
        number: tuple(cents_by_quarter.items())
        for number, cents_by_quarter in sorted(curve_points.items())
        if any(cents_by_quarter.values())
    }


@dataclass(slots=True)
class _Wheel:
    """The wheel of a channel, from -1 to 1; its range [cents]; the registered parameter that is
    chosen.
    """

    range_cents: float
    position: float = 0.0
    parameter: list[int] = field(default_factory=lambda: [127, 127])  # none


class Wheels:
    """The wheels of all channels, and the channel on which each note was played last."""

    def __init__(self, default_range: float) -> None:
        """Begin without zones; `default_range` is the range of a wheel that says none."""
        self._wheels = {channel: _Wheel(default_range) for channel in range(1, 17)}
        self._master_by_channel: dict[int, int] = {}  # master of each channel in a zone
        self._channel_by_note: dict[int, int] = {}  # by the number of a note

    def cents(self, channel: int) -> float:
        """How far the notes of a channel are from their pitch."""
        master = self._master_by_channel.get(channel)
        channels = (channel,) if master is None else (channel, master)
        return sum(
            self._wheels[moving_channel].position * self._wheels[moving_channel].range_cents
            for moving_channel in channels
        )

    def is_in_zone(self, channel: int) -> bool:
        """Whether a channel belongs to a zone, as its master or not."""
        return channel in self._master_by_channel or channel in self._master_by_channel.values()

    def notes_of_channel(self, channel: int) -> list[int]:
        """The notes that were played last on a channel, or on those of which it is the master."""
        return [
            number
            for number, sounding_channel in self._channel_by_note.items()
            if channel in (sounding_channel, self._master_by_channel.get(sounding_channel))
        ]

    def note_cents(self, number: int) -> float:
        """How far a note is from its pitch."""
        return self.cents(self._channel_by_note[number])

    def follow(self, event: MidiEvent) -> Iterator[tuple[int, int]]:
        """Follow an event; yields the notes whose pitch it may have moved, with their channels."""
        channel, event_content = event.channel, event.content
        if event.kind == NOTE_ON:
            if not event_content[1]:
                return
            if channel in self._master_by_channel:  # a channel of a zone has one note at a time
                self._channel_by_note = {
                    n: c for n, c in self._channel_by_note.items() if c != channel
                }
            self._channel_by_note[event_content[0]] = channel
            yield event_content[0], channel
            return
        if event.kind == PITCH_BEND:
            self._wheels[channel].position = (
                event_content[0] + 128 * event_content[1] - _WHEEL_CENTRE
            ) / _WHEEL_CENTRE
        elif not self._follow_controller(channel, *event_content):
            return
        for number in self.notes_of_channel(channel):
            yield number, self._channel_by_note[number]

    def _follow_controller(
        self, channel: int, controller_number: int, controller_value: int
    ) -> bool:
        """Follow a controller; whether it has set the range of a wheel."""
        wheel = self._wheels[channel]
        if controller_number in (_RPN_COARSE, _RPN_FINE):
            wheel.parameter[controller_number == _RPN_FINE] = controller_value
            return False
        if (
            wheel.parameter == [0, _ZONE_PARAMETER]
            and controller_number == _DATA_COARSE
            and channel in _ZONE_CHANNELS_BY_MASTER
        ):
            self._set_zone(channel, controller_value)
            return False
        if wheel.parameter != [0, _RANGE_PARAMETER] or controller_number not in (
            _DATA_COARSE,
            _DATA_FINE,
        ):
            return False
        semitones, cents = divmod(wheel.range_cents, 100.0)
        wheel.range_cents = (
            controller_value * 100.0 + cents
            if controller_number == _DATA_COARSE
            else semitones * 100.0 + controller_value
        )
        if channel in self._master_by_channel:  # the range of one channel of a zone is that of all
            for other_channel, master in self._master_by_channel.items():
                if master == self._master_by_channel[channel]:
                    self._wheels[other_channel].range_cents = wheel.range_cents
        return True

    def _set_zone(self, master: int, n_channels: int) -> None:
        """Give a master a number of channels, from its own on; 0 ends the zone."""
        self._master_by_channel = {
            zone_channel: master_channel
            for zone_channel, master_channel in self._master_by_channel.items()
            if master_channel != master
        }
        channels = list(_ZONE_CHANNELS_BY_MASTER[master])[: min(n_channels, 15)]
        self._master_by_channel |= dict.fromkeys(channels, master)
        if channels:
            self._wheels[master].range_cents = _MASTER_RANGE_CENTS
        for channel in channels:
            self._wheels[channel].range_cents = _MEMBER_RANGE_CENTS
