"""MIDI input of a session: notes strike modules, controllers move parameters."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from ergon.live.midi_messages import Control, Note, NoteEnd, parse_message
from ergon.repl.session.midi_maps import controller_line, run_lines
from ergon.repl.session.struck_places import (
    Place,
    place_number,
    released_places,
    struck_places,
)

if TYPE_CHECKING:
    from ergon.repl.session.acts import Acts
    from ergon.repl.session.fast_values import FastValues
    from ergon.repl.session.schedule import Schedule
    from ergon.repl.session.stops import Stops
    from ergon.repl.session.version import Version


_SUSTAIN, _PEDAL_DOWN = 64, 64  # the controller of the pedal, and its least value when down


class MidiInput:
    """Notes and controllers of a session. Any thread may call `receive`."""

    def __init__(
        self, schedule: Schedule, acts: Acts, fast_values: FastValues, stops: Stops
    ) -> None:
        """Act on what plays (`acts`), and on values of lines."""
        self._schedule, self._acts = schedule, acts
        self._fast_values, self._stops = fast_values, stops
        self._sounding: set[int] = set()  # notes whose end does something
        self._on_pedal: set[int] = set()  # those whose key is up
        self._is_pedal_down = False
        self._n_runs = 0  # blocks that notes have run
        self.lost = 0  # notes that could not strike because too many came at once

    def receive(self, data: bytes, at: float) -> None:
        """Act on a message; malformed and unknown ones do nothing."""
        found = parse_message(data)
        if isinstance(found, Note):
            self._begin(found)
            self._run(found)
        elif isinstance(found, NoteEnd):
            self._end(found.number)
        elif isinstance(found, Control):
            if found.number == _SUSTAIN:
                self._move_pedal(is_down=found.value >= _PEDAL_DOWN)
            self._fast_values.set_soon(f"cc {found.number}", partial(controller_line, found))

    def _run(self, note: Note) -> None:
        """Run the blocks to which a note is mapped, each by a line of its own."""
        for line in run_lines(self._schedule.running.version, note.number):
            self._n_runs += 1
            self._fast_values.set_soon(
                f"note {note.number}, run {self._n_runs}", partial(_line, line)
            )

    def _begin(self, note: Note) -> None:
        """Strike what a note is mapped to in the running version; do nothing during a panic."""
        if self._stops.panicked:
            return
        version = self._schedule.running.version
        if note.number in self._sounding:
            self._let_down(note.number)
        for place, impulse in released_places(version, note.number):
            self._sounding.add(note.number)
            self._strike(place, -impulse)
        for place, impulse in struck_places(version, note.number, note.velocity):
            self._strike(place, impulse)

    def _end(self, number: int) -> None:
        """End a note, or hold it while the pedal is down."""
        if number in self._sounding and self._is_pedal_down:
            self._on_pedal.add(number)
        elif number in self._sounding:
            self._let_down(number)

    def _move_pedal(self, *, is_down: bool) -> None:
        """Move the pedal; where it comes up, notes whose keys are up end."""
        self._is_pedal_down = is_down
        for number in [] if is_down else sorted(self._on_pedal):
            self._let_down(number)

    def _let_down(self, number: int) -> None:
        self._sounding.discard(number)
        self._on_pedal.discard(number)
        for place, impulse in released_places(self._schedule.running.version, number):
            self._strike(place, impulse)

    def _strike(self, place: Place, impulse: float) -> None:
        part, module, member = place
        strike = partial(self._schedule.engine.strike, place_number(place), impulse)
        said = {"part": part, "module": module, "member": member, "impulse": impulse}
        if not self._acts.begin(strike, "strike", **said):
            self.lost += 1


def _line(line: str, _: Version) -> str:
    """A line that is the same in every version."""
    return line
