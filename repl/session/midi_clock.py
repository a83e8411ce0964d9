"""MIDI clock of a session: sent to other programs, or followed.

`ergon/live/clock_follower.py` follows one.
"""

from __future__ import annotations

import contextlib
import math
import os
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Protocol

from ergon._core import EngineError
from ergon.live.clock_follower import BeatEstimate, ClockFollower
from ergon.live.midi_messages import (
    CLOCKS_PER_BEAT,
    CLOCKS_PER_SONG_POSITION,
    Transport,
    encode_song_position,
    parse_message,
)
from ergon.live.osc_out import HearingClock, frame_of
from ergon.notation.clock.meter import SAME
from ergon.notation.clock.positions import Length
from ergon.repl.session.played_versions import PlayedVersions

if TYPE_CHECKING:
    from ergon import _core
    from ergon.live.midi_ports import InputPort
    from ergon.repl.session.schedule import Schedule
    from ergon.repl.session.session import Session

_CHECK_PERIOD = 0.004  # [s] between two looks at the performance
_BEATS_PER_SIXTEENTH = 0.25  # beats of one unit of a song position
_THREAD_PRIORITY = 60  # below the process that sends
# A correction removes the whole error within this many beats; smaller errors than
# _ERROR_TOLERANCE [s] stay.
_CORRECTION_BEATS = 2.0
_ERROR_TOLERANCE = 0.0005
_TEMPO_RATIO_MAX = 1.4  # the greatest ratio of a corrected tempo to the one that is followed

ClockMessage = tuple[int, bytes]  # (frame, message)


class TimedOutput(Protocol):
    """A port whose messages wait until they are due."""

    def send_at(self, data: bytes, instant: float) -> None:
        """Send a message at an instant [s, time.monotonic]."""

    def close(self) -> None:
        """Send nothing any more."""


class ClockEvents:
    """The clock messages of a session's versions, in the order of their frames.

    Clocks are counted, so that a change of tempo neither skips one nor sends it twice.
    """

    def __init__(self, schedule: Schedule) -> None:
        """Begin at frame 0."""
        self._played_versions = PlayedVersions(schedule)
        self._begin_instant: float | None = (
            None  # the second of the engine at which the piece began
        )
        self._next_clock = 0  # the number of the next clock

    def pop_before(self, frame: int) -> Iterator[ClockMessage]:
        """The messages before a frame that were not returned yet."""
        for running, first_frame, stop_frame in self._played_versions.pop_before(frame):
            clock, stage = running.clock, running.stage
            if clock.begin_instant != self._begin_instant:
                if self._begin_instant is not None:
                    yield first_frame, bytes([Transport.STOP.value])
                if clock.begin_instant is not None:
                    # A song position counts sixteenths: it is that of the next sixteenth, where
                    # others can join in.
                    self._next_clock = (
                        math.ceil(clock.stopped_beat / _BEATS_PER_SIXTEENTH - SAME)
                        * CLOCKS_PER_SONG_POSITION
                    )
                    if self._next_clock:
                        yield first_frame, encode_song_position(self._next_clock / CLOCKS_PER_BEAT)
                    start_message = Transport.CONTINUE if self._next_clock else Transport.START
                    yield first_frame, bytes([start_message.value])
                self._begin_instant = clock.begin_instant
            if clock.begin_instant is not None:
                tempo_map, rate = stage.piece.tempo_map, stage.rate
                while (
                    clock_frame := frame_of(
                        tempo_map.seconds(self._next_clock / CLOCKS_PER_BEAT), rate
                    )
                ) < stop_frame:
                    yield max(clock_frame, first_frame), bytes([Transport.CLOCK.value])
                    self._next_clock += 1


class ClockOut:
    """Sends MIDI clock to other programs, each message at the instant at which its frame is heard.

    Computed frames wait in the ring buffer for some milliseconds, so that every clock is known
    before it is due.
    """

    def __init__(
        self, schedule: Schedule, performance: _core.Performance, port: TimedOutput
    ) -> None:
        """Begin to send to a port, which `close` closes."""
        self._events = ClockEvents(schedule)
        self._performance, self._port = performance, port
        self._hearing_clock = HearingClock(schedule.rate, 0)
        self._end_event = threading.Event()
        self._thread = threading.Thread(target=self._run, name="ergon MIDI clock", daemon=True)
        self._thread.start()

    def _run(self) -> None:
        with contextlib.suppress(AttributeError, OSError):  # not granted: like any other thread
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(_THREAD_PRIORITY))
        while not self._end_event.wait(_CHECK_PERIOD):
            with contextlib.suppress(EngineError):  # the performance is closed already
                self.send_computed(time.monotonic())

    def send_computed(self, instant_now: float) -> None:
        """Send the messages of frames that were computed by `instant_now` [s], each when it is
        due.
        """
        status = self._performance.status()
        self._hearing_clock.update(status, instant_now)
        if status.sounding is None and status.paced:
            return  # nobody knows yet when it is heard
        for frame, data in self._events.pop_before(status.frame):
            due_instant = self._hearing_clock.instant_of(frame)
            self._port.send_at(data, instant_now if due_instant is None else due_instant)

    def close(self) -> None:
        """End sending; the port tells other programs to stop."""
        self._end_event.set()
        self._thread.join()
        self._port.close()


class ClockIn:
    """Follows the MIDI clock of another program: its start and stop, its tempo and its phase.

    Tempos become lines of the session (`tempo 120.4 at 5|2`), so that a render of the journal
    has them.
    """

    def __init__(
        self,
        session: Session,
        instant_of_frame: Callable[[int], float | None],
        port: InputPort | None = None,
    ) -> None:
        """Begin to follow; `instant_of_frame` gives the instant at which a frame is heard [s,
        time.monotonic].
        """
        self._session, self._instant_of_frame, self._port = session, instant_of_frame, port
        self._follower = ClockFollower()
        self._transport: deque[tuple[Transport, float]] = deque(maxlen=16)
        self._lock = threading.Lock()
        self._corrected_beat = -math.inf  # the beat of the last correction
        if port is not None:
            port.listen(self.receive)

    def receive(self, data: bytes, instant: float) -> None:
        """Process a message that came at an instant [s]; any thread may call it."""
        message = parse_message(data)
        if message is None:
            return
        with self._lock:
            self._follower.receive(message, instant)
            if isinstance(message, Transport) and message is not Transport.CLOCK:
                self._transport.append((message, self._follower.position))

    def follow(self, instant_now: float) -> None:
        """Start, stop or correct the tempo where that is due; `instant_now` is the instant [s]."""
        with self._lock:
            messages = list(self._transport)
            self._transport.clear()
            beat_estimate = (
                self._follower.estimate() if self._follower.is_receiving(instant_now) else None
            )
            has_position = self._follower.has_position
        for transport, position in messages:
            self._start_or_stop(transport, position)
        if beat_estimate is not None and self._session.schedule.running.clock.is_running:
            self._correct(beat_estimate, has_position)

    def _start_or_stop(self, transport: Transport, clock_position: float) -> None:
        session = self._session
        if transport is Transport.STOP:
            transport_line = "stop" if session.schedule.running.clock.is_running else ""
        else:
            transport_line = f"play from {session.position_text(clock_position)}"
        self._corrected_beat = -math.inf
        reply = session.submit(transport_line) if transport_line else None
        if reply is not None and not reply.taken:
            session.say(f"MIDI clock: {reply.text}")

    def _correct(self, beat_estimate: BeatEstimate, has_position: bool) -> None:
        """Set the tempo from the next beat that a line can reach, so that the error is gone
        `_CORRECTION_BEATS` beats later; at most one correction per beat.
        """
        session = self._session
        with session.lock:
            schedule = session.schedule
            latest_tempo_map = schedule.head.piece.tempo_map
            correction_beat, _ = schedule.place(Length(beats=1.0), None)
            correction_beat = math.ceil(correction_beat - SAME)
            clock = schedule.running.clock
            if (
                correction_beat <= self._corrected_beat
                or schedule.waiting
                or clock.begin_instant is None
            ):
                return
            rate = schedule.rate
            correction_instant, end_instant = (
                self._instant_of_frame(frame_of(clock.seconds(latest_tempo_map, beat), rate))
                for beat in (correction_beat, correction_beat + _CORRECTION_BEATS)
            )
            if correction_instant is None or end_instant is None:
                return
            if has_position:
                beat_length = (
                    beat_estimate.instant_of(correction_beat + _CORRECTION_BEATS)
                    - correction_instant
                ) / _CORRECTION_BEATS
                instant_error = end_instant - beat_estimate.instant_of(
                    correction_beat + _CORRECTION_BEATS
                )
            else:
                beat_length = beat_estimate.beat_length
                instant_error = end_instant - correction_instant - _CORRECTION_BEATS * beat_length
            if abs(instant_error) <= _ERROR_TOLERANCE:
                return
            beat_length = min(
                max(beat_length, beat_estimate.beat_length / _TEMPO_RATIO_MAX),
                beat_estimate.beat_length * _TEMPO_RATIO_MAX,
            )
            bpm = 60.0 / beat_length
            line = f"tempo {bpm:.8g} at {session.position_text(correction_beat)}"
            self._corrected_beat = correction_beat
            session.fast_values.set_now("MIDI clock", line)

    def close(self) -> None:
        """End following."""
        if self._port is not None:
            self._port.close()
