"""MIDI input of a session: notes strike modules, controllers move parameters."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from ergon.live.midi_messages import Control, Note, parse_message
from ergon.repl.session.midi_maps import controller_line, place_number, struck_places

if TYPE_CHECKING:
    from ergon.repl.session.acts import Acts
    from ergon.repl.session.fast_values import FastValues
    from ergon.repl.session.schedule import Schedule
    from ergon.repl.session.stops import Stops


class MidiInput:
    """Notes and controllers of a session. Any thread may call `receive`."""

    def __init__(
        self, schedule: Schedule, acts: Acts, fast_values: FastValues, stops: Stops
    ) -> None:
        """Act on what plays (`acts`), and on values of lines."""
        self._schedule, self._acts = schedule, acts
        self._fast_values, self._stops = fast_values, stops
        self.lost = 0  # notes that could not strike because too many came at once

    def receive(self, data: bytes, at: float) -> None:
        """Act on a message; malformed and unknown ones do nothing."""
        found = parse_message(data)
        if isinstance(found, Note):
            self._strike(found)
        elif isinstance(found, Control):
            self._fast_values.set_soon(f"cc {found.number}", partial(controller_line, found))

    def _strike(self, note: Note) -> None:
        """Strike what a note is mapped to in the running version; do nothing during a panic."""
        if self._stops.panicked:
            return
        for place, impulse in struck_places(
            self._schedule.running.version, note.number, note.velocity
        ):
            part, module, member = place
            strike = partial(self._schedule.engine.strike, place_number(place), impulse)
            said = {"part": part, "module": module, "member": member, "impulse": impulse}
            if not self._acts.begin(strike, "strike", **said):
                self.lost += 1
