"""What comes by MIDI into a session: notes that strike, controllers that move parameters."""

from __future__ import annotations

import threading
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Protocol

from ergon.live.midi_messages import Control, Note, message
from ergon.repl.session.midi_maps import Place, moved_line, number_of, struck

if TYPE_CHECKING:
    from ergon.repl.session.commits import Commits
    from ergon.repl.session.engine import EngineEvent
    from ergon.repl.session.fast_values import FastValues
    from ergon.repl.session.stops import Stops

_UNDER_WAY = 1024  # strikes whose events have not come: the engine keeps 4096 events


class Played(Protocol):
    """What notes and controllers act on."""

    commits: Commits
    fast_values: FastValues
    stops: Stops


class MidiInput:
    """Notes and controllers of a session. `receive` may be called by any thread."""

    def __init__(self, session: Played, tell: Callable[..., None]) -> None:
        """Take the session, and what writes an event to its journal."""
        self._session = session
        self._tell = tell
        self._lock = threading.Lock()
        self._under_way: dict[int, tuple[Place, float]] = {}
        self.lost = 0  # notes that could not strike because too many came at once

    def receive(self, data: bytes, at: float) -> None:
        """Act on a message that came at an instant [s]; malformed and unknown ones do nothing."""
        found = message(data)
        if isinstance(found, Note):
            self._strike(found)
        elif isinstance(found, Control):
            self._session.fast_values.move(f"cc {found.number}", partial(moved_line, found))

    def _strike(self, note: Note) -> None:
        """Strike what the note is mapped to in the version that plays; nothing in a panic."""
        session = self._session
        if session.stops.panicked:
            return
        for place, impulse in struck(session.commits.running.version, note.number, note.velocity):
            with self._lock:  # so that its event finds it
                ticket = None
                if len(self._under_way) < _UNDER_WAY:
                    ticket = session.commits.engine.strike(number_of(place), impulse)
                if ticket is None:
                    self.lost += 1
                else:
                    self._under_way[ticket] = place, impulse

    def struck(self, event: EngineEvent) -> None:
        """Write a strike that was done to the journal. One that was not done came before its map
        had taken effect."""
        assert event.strike is not None
        with self._lock:
            known = self._under_way.pop(event.strike, None)
        if known is None or event.is_late:
            return
        (part, module, member), impulse = known
        self._tell(
            "strike", frame=event.frame, part=part, module=module, member=member, impulse=impulse
        )
