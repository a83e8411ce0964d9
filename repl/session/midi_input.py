"""MIDI input of a session: notes strike modules, controllers move parameters."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Protocol

from ergon.live.midi_messages import Control, Note, parse_message
from ergon.repl.session.midi_maps import controller_line, place_number, struck_places

if TYPE_CHECKING:
    from ergon.repl.session.acts import Acts
    from ergon.repl.session.commits import Commits
    from ergon.repl.session.fast_values import FastValues
    from ergon.repl.session.stops import Stops


class MidiSession(Protocol):
    """The session on which notes and controllers act."""

    acts: Acts
    commits: Commits
    fast_values: FastValues
    stops: Stops


class MidiInput:
    """Notes and controllers of a session. Any thread may call `receive`."""

    def __init__(self, session: MidiSession) -> None:
        """Act on a session."""
        self._session = session
        self.lost = 0  # notes that could not strike because too many came at once

    def receive(self, data: bytes, at: float) -> None:
        """Act on a message; malformed and unknown ones do nothing."""
        found = parse_message(data)
        if isinstance(found, Note):
            self._strike(found)
        elif isinstance(found, Control):
            self._session.fast_values.set_soon(
                f"cc {found.number}", partial(controller_line, found)
            )

    def _strike(self, note: Note) -> None:
        """Strike what a note is mapped to in the running version; do nothing during a panic."""
        session = self._session
        if session.stops.panicked:
            return
        for place, impulse in struck_places(
            session.commits.running.version, note.number, note.velocity
        ):
            part, module, member = place
            strike = partial(session.commits.engine.strike, place_number(place), impulse)
            said = {"part": part, "module": module, "member": member, "impulse": impulse}
            if not session.acts.begin(strike, "strike", **said):
                self.lost += 1
