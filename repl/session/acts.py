"""Events from outside that act at the next tick: strikes by MIDI, values of inputs by OSC."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ergon.repl.session.engine import EngineEvent

_UNDER_WAY_MAX = 1024  # acts whose events have not come: the engine keeps 4096 events


class Acts:
    """Acts (strikes and input values) under way, each written to the journal once done.

    Any thread may begin one.
    """

    def __init__(self, append_event: Callable[..., None]) -> None:
        """Use `append_event` to write an event to the journal."""
        self._append_event = append_event
        self._lock = threading.Lock()
        self._pending_acts: dict[int, tuple[str, dict[str, object]]] = {}

    def request(
        self, request_act: Callable[[], int | None], event_name: str, **act_fields: object
    ) -> bool:
        """Ask the engine for an act, which becomes an `event_name` of the journal once it has
        acted; False if too many are under way.
        """
        with self._lock:  # the event of the act needs the entry
            ticket = request_act() if len(self._pending_acts) < _UNDER_WAY_MAX else None
            if ticket is not None:
                self._pending_acts[ticket] = event_name, act_fields
            return ticket is not None

    def note_ended(self, engine_event: EngineEvent) -> None:
        """Write an act to the journal if it was done. An act is not done if the version that plays
        does not have its place.
        """
        assert engine_event.act_ticket is not None
        with self._lock:
            pending_act = self._pending_acts.pop(engine_event.act_ticket, None)
        if pending_act is not None and not engine_event.is_late:
            event_name, act_fields = pending_act
            self._append_event(event_name, frame=engine_event.frame, **act_fields)
