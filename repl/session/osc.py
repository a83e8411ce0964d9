"""OSC for a session: requests become lines of its journal, and events of the versions are sent."""

from __future__ import annotations

import re
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING

from ergon.live.osc_in import (
    SILENT_DB,
    OscRequestError,
    button_handler,
    level_handler,
    text_handler,
)
from ergon.live.osc_out import OscSender, beat_events, frame_of
from ergon.live.osc_values import InputValues
from ergon.repl.language.looking import Py, Quit
from ergon.repl.language.recording import Record, RecordAudio, RecordOff
from ergon.repl.language.versions import KeepAsScore, Load, Reload, Save
from ergon.repl.line_queue import LineQueue
from ergon.repl.session.played_versions import PlayedVersions
from ergon.scores.staging.drives import input_id

if TYPE_CHECKING:
    from ergon import _core
    from ergon.live.osc import OscServer
    from ergon.live.osc_in import Handler
    from ergon.live.osc_out import OscEvent
    from ergon.repl.session.journal import Journal
    from ergon.repl.session.running import RunningVersion
    from ergon.repl.session.schedule import Schedule
    from ergon.repl.session.session import Session

    Answer = Callable[[str, str], None]

_GAIN_PATTERN = re.compile(r"/ergon/(?:(instrument|player)/([^/]+)/)?gain")
_INPUT_PREFIX = "/ergon/input/"
_WAITING_MAX = 64  # lines that may wait to be done
# OSC has no passwords: lines that read or write files, run Python or end the session must be typed.
# A scene lies beside the score and is called in the midst of a performance, so it may come by OSC.
_TYPED_ONLY = dict.fromkeys(
    (Py, Save, KeepAsScore, Load, Reload, Record, RecordOff, RecordAudio, Quit),
    "this line has to be typed at a prompt: OSC has no passwords",
)


class SessionOsc:
    """OSC of a session until it is closed; a thread does its lines one after the other."""

    def __init__(self, session: Session, osc: OscServer, performance: _core.Performance) -> None:
        """Begin to serve, at the sockets that `osc` has opened."""
        self._session, self._osc = session, osc
        self._line_queue: LineQueue[Answer | None] = LineQueue(session)
        self._n_waiting = 0
        self._input_values = InputValues(self._set_input)
        self._handlers: dict[str, Handler] = {
            "/ergon/cmd": text_handler(lambda line: self._enter_line(line, osc.answerer())),
            "/ergon/panic": button_handler(self._line_queue.panic),
            "/ergon/release": button_handler(lambda: self._enter_line("release", None)),
            "/ergon/stop": button_handler(lambda: self._enter_line("stop", None)),
        }
        self._worker = threading.Thread(target=self._do_lines, name="ergon osc lines", daemon=True)
        self._worker.start()
        stage = session.schedule.running.stage
        session_events = SessionEvents(session.schedule, session.journal)
        osc.serve(
            self,
            lambda send: OscSender(performance, stage, 0, send, session_events),
            self._input_values,
            lambda: bool(performance.status().hands),
        )

    def get(self, address: str, /) -> Handler | None:
        """The handler of an address; None if the address is unknown."""
        handler = self._handlers.get(address)
        if handler is not None:
            return handler
        if address.startswith(_INPUT_PREFIX):
            input_name = address.removeprefix(_INPUT_PREFIX)
            input_take = self._session.schedule.head.piece.takes.get(input_name)
            return (
                None
                if input_take is None or not input_take.is_from_osc
                else self._input_values.handler_of(input_name)
            )
        address_match = _GAIN_PATTERN.fullmatch(address)
        if address_match is None:
            return None
        part_kind, part_name = address_match.groups()
        if part_kind is not None and part_name not in self._part_names(part_kind):
            return None
        return level_handler(lambda level: self._set_level(address, part_name, level))

    def _set_input(self, name: str, value: float) -> bool:
        session = self._session
        set_engine_input = partial(session.schedule.engine.set_input, input_id(name), value)
        return session.acts.request(set_engine_input, "value", input=name, value=value)

    def _part_names(self, part_kind: str) -> Mapping[str, str]:
        scope = self._session.scope
        return scope.instruments if part_kind == "instrument" else scope.players

    def _set_level(self, address: str, part_name: str | None, level: float) -> None:
        """Set a level: of many values, the latest becomes a line."""
        level_text = f"{level:.6g}dB" if level > SILENT_DB else "x0"
        line = " ".join(filter(None, ("gain", part_name, level_text, "now")))
        self._session.fast_values.set_soon(address, lambda version: line)

    def _enter_line(self, line: str, answer: Answer | None) -> None:
        if self._n_waiting >= _WAITING_MAX:
            raise OscRequestError(f"{_WAITING_MAX} lines are waiting already; this one was dropped")
        self._n_waiting += 1
        self._line_queue.enter(line, answer)

    def _do_lines(self) -> None:
        while (queued_line := self._line_queue.next()) is not None:
            self._n_waiting -= 1
            address, arguments = self._do_line(queued_line.text, queued_line.releases)
            if queued_line.sender is not None:
                queued_line.sender(address, arguments)

    def _do_line(self, line: str, releases: bool) -> tuple[str, str]:
        reply = self._session.submit(line, releases=releases, refusal_by_command=_TYPED_ONLY)
        if reply.taken:
            return "/ergon/reply", "\n".join([reply.text, *reply.lines])
        return "/ergon/error", reply.text + (f"; try: {reply.try_}" if reply.try_ else "")

    def close(self) -> None:
        """End serving, and close the sockets."""
        self._osc.close()
        self._line_queue.end()
        self._worker.join()
        if self._osc.n_malformed:
            malformed_text = (
                f"{self._osc.n_malformed} datagrams were not valid OSC and were ignored"
            )
            self._session.say(malformed_text)


class SessionEvents:
    """Beats and gestures of a session's versions, in the order of their frames."""

    def __init__(self, schedule: Schedule, journal: Journal | None = None) -> None:
        """Begin at frame 0."""
        self._played_versions = PlayedVersions(schedule)
        self._journal = journal

    def troubles(self) -> Sequence[str]:
        """Troubles that the performance itself does not report."""
        has_failed = self._journal is not None and self._journal.has_failed
        return ("JOURNAL NOT WRITTEN",) if has_failed else ()

    def pop_before(self, frame: int) -> Iterator[OscEvent]:
        """The events before a frame that were not returned yet."""
        for running, first_frame, stop_frame in self._played_versions.pop_before(frame):
            yield from sorted(
                _version_events(running, first_frame, stop_frame), key=lambda event: event[0]
            )


def _version_events(
    running: RunningVersion, first_frame: int, stop_frame: int
) -> Iterator[OscEvent]:
    """The events of one version, from frame `first_frame` to before `stop_frame`."""
    stage, clock = running.stage, running.clock
    if clock.begin_instant is None:
        return
    version = running.version
    shown_key = partial(version.sounds_as.shown_name, part_names=version.piece.keys)
    tempo_map = stage.piece.tempo_map
    bar, _ = tempo_map.bar_beat(running.beat(first_frame))
    for beat_event in beat_events(tempo_map, stage.rate, bar):
        if beat_event[0] >= stop_frame:
            break
        if beat_event[0] >= first_frame:
            yield beat_event
    for gesture in stage.gestures:
        gesture_frame = frame_of(gesture.start, stage.rate)
        if first_frame <= gesture_frame < stop_frame:
            event_arguments = (
                gesture.player,
                shown_key(gesture.key),
                gesture.name,
                float(gesture.start - clock.begin_instant),
            )
            yield gesture_frame, "/ergon/strike", event_arguments
