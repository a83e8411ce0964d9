"""Positions of MIDI controllers: what a message moves, as a share of its range."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

from ergon.live.midi_messages import ControlChange, PitchWheel, Pressure
from ergon.scores.gesture.midi_source import pair_position, seven_bit_position, wheel_position

if TYPE_CHECKING:
    from ergon.repl.session.midi_maps import Map

_CONTROLLER_COUNT = 128
ControllerMessage = ControlChange | PitchWheel | Pressure


class Controllers:
    """The last value of each controller."""

    def __init__(self) -> None:
        """Begin with all of them at 0."""
        self._values = [0] * _CONTROLLER_COUNT

    def positions(
        self, message: ControllerMessage, maps: Mapping[str, Map]
    ) -> Iterator[tuple[str, float]]:
        """What a message moves, and its position now, from 0 to 1; of pairs of controllers
        those that are mapped.

        The upper bits put the lower ones at 0, until these come (MIDI 1.0, control change).
        """
        if isinstance(message, PitchWheel):
            yield "bend", wheel_position(message.value)
        elif isinstance(message, Pressure):
            key_text = "" if message.number is None else f" {message.number}"
            yield f"pressure{key_text}", seven_bit_position(message.value)
        else:
            self._values[message.number] = message.value
            yield f"cc {message.number}", seven_bit_position(message.value)
            yield from self._pair_positions(message.number, maps)

    def _pair_positions(self, number: int, maps: Mapping[str, Map]) -> Iterator[tuple[str, float]]:
        for map_source in maps:
            if not map_source.startswith("cc ") or "/" not in map_source:
                continue
            upper_number, lower_number = map(int, map_source.removeprefix("cc ").split("/"))
            if number == upper_number:
                self._values[lower_number] = 0
            if number in (upper_number, lower_number):
                yield (
                    map_source,
                    pair_position(self._values[upper_number], self._values[lower_number]),
                )
