"""What comes by MIDI into a session: notes that strike, controllers that move parameters."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import TYPE_CHECKING, Protocol

from ergon.live.midi_messages import Control, Note, message
from ergon.notation.text.errors import TextError
from ergon.repl.language.commands import NOW, MapControl, When
from ergon.repl.language.parse import parse
from ergon.repl.language.refusal import Refusal
from ergon.repl.session import version_edits
from ergon.repl.session.commits import REFUSALS
from ergon.repl.session.midi_maps import Place, line_of, number_of, struck

if TYPE_CHECKING:
    from ergon.repl.language.scope import Scope
    from ergon.repl.session.commits import Commits, VersionEdit
    from ergon.repl.session.engine import EngineEvent
    from ergon.repl.session.history import History
    from ergon.repl.session.stops import Stops

_UNDER_WAY = 1024  # strikes whose events have not come: the engine keeps 4096 events


class Played(Protocol):
    """What MIDI acts on: a session's versions, and the lines that controllers stand for."""

    commits: Commits
    history: History
    stops: Stops
    number: int

    @property
    def scope(self) -> Scope:
        """The names that a line may use now."""

    def say(self, message: str) -> None:
        """Add a message."""

    def queue(
        self, line: str, edit: VersionEdit, when: When = None, *, replaces: int | None = None
    ) -> object:
        """Queue a line for its boundary."""


class MidiInput:
    """Notes and controllers of a session. `receive` may be called by any thread."""

    def __init__(self, session: Played, tell: Callable[..., None]) -> None:
        """Take the session, and what writes an event to its journal."""
        self._session = session
        self._tell = tell
        self._lock = threading.Lock()
        self._under_way: dict[int, tuple[Place, float]] = {}
        # The latest value of each controller that has moved, and what was last set by it.
        self._moved: dict[int, int] = {}
        self._line = 0  # the number of the last line that controllers stood for
        self._names: tuple[str, ...] = ()  # and what they were
        self._refused: tuple[str, ...] = ()
        self.lost = 0  # notes that could not strike because too many came at once

    def receive(self, data: bytes, at: float) -> None:
        """Act on a message that came at an instant [s]; malformed and unknown ones do nothing."""
        found = message(data)
        if isinstance(found, Note):
            self._strike(found)
        elif isinstance(found, Control):
            self._moved[found.number] = found.value

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

    def turn(self) -> None:
        """Set what controllers have moved, as one line; not while the last such line still waits.

        Lines of the same controllers are one line of the history, so that `undo` takes back a
        movement as a whole.
        """
        session = self._session
        if not self._moved or any(one.number == self._line for one in session.commits.waiting):
            return
        maps = session.commits.head.maps
        moved, self._moved = self._moved, {}
        controls = [
            (own, moved[own.number])
            for own in maps.values()
            if isinstance(own, MapControl) and own.number in moved
        ]
        if not controls:
            return
        text = "\n".join(line_of(own, value) for own, value in controls)
        names = tuple(own.name for own, _ in controls)
        replaces = (
            self._line if names == self._names and session.history.now == self._line else None
        )
        try:
            edit = version_edits.combined(parse(text, session.scope))
            session.queue(text, edit, NOW, replaces=replaces)
        except (Refusal, TextError, *REFUSALS) as error:
            if names != self._refused:  # once, and not for each value on the way
                self._refused = names
                session.say(f"{', '.join(names)}: {getattr(error, 'message', None) or error}")
            return
        self._refused = ()
        self._line, self._names = session.number, names
