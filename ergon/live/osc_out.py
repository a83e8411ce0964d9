"""OSC messages about a performance, each stamped with the instant at which it is heard."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Protocol

from .display import SILENT_PEAK
from .trouble import gap_count, troubles

if TYPE_CHECKING:
    from ergon import _core
    from ergon.notation.clock.tempo import TempoMap
    from ergon.scores.staging.stage import Stage

    # Sends arguments to an address; with an instant [s since 1970], in a bundle with that time tag.
    Send = Callable[..., None]

HAND_PERIOD = 0.01  # [s] between two messages about a hand
_LEVEL_PERIOD = 0.1  # [s] between two messages about the level
# Reports of a sound card come late, never early: the earliest of this many seconds counts [s].
_REPORTS_SECONDS = 1.0
_JUMP_MIN = 0.02  # [s]; a larger change is a new time line: server restarted, clock set


class HearingClock:
    """The instants at which frames are heard, from what the sound server reports."""

    def __init__(self, rate: float, start_frame: int) -> None:
        """Begin with frame `start_frame`, at `rate` frames a second."""
        self._rate, self._start_frame = rate, start_frame
        self._reports: deque[tuple[float, float]] = deque()
        self._n_dropped = 0
        self._stream_state: tuple[int, int, bool] | None = None

    def update(self, status: _core.Status, instant_now: float) -> None:
        """Use a status that was requested at `instant_now`."""
        if status.sounding is None or not status.paced:
            return
        zero_instant = instant_now - status.sounding + status.latency
        stream_state = (status.underruns, status.dropped, status.alive)
        if stream_state != self._stream_state or (
            self._reports and abs(zero_instant - self._reports[-1][1]) > _JUMP_MIN
        ):
            self._reports.clear()
        self._stream_state, self._n_dropped = stream_state, status.dropped
        self._reports.append((instant_now, zero_instant))
        while self._reports[0][0] < instant_now - _REPORTS_SECONDS:
            self._reports.popleft()

    def instant_of(self, frame: int) -> float | None:
        """The instant at which a frame is heard [s since 1970]; None as long as that is unknown."""
        if not self._reports:
            return None
        zero_instant = min(zero_instant for _, zero_instant in self._reports)
        return zero_instant + (frame - self._start_frame - self._n_dropped) / self._rate


class OscSender:
    """Sends messages about a performance by `send`."""

    def __init__(
        self,
        performance: _core.Performance,
        stage: Stage,
        start_frame: int,
        send: Send,
        events: SessionEventSource | None = None,
    ) -> None:
        """Begin at `start_frame`, the first frame that is played. `events` are those of a session,
        whose stages follow one another; without them, the events of `stage` are sent.
        """
        self._performance, self._stage, self._send = performance, stage, send
        self._hearing_clock = HearingClock(stage.rate, start_frame)
        self._hand_addresses = [f"/ergon/hand/{hand.player}" for hand in stage.live_hands]
        self._session_events = events
        piece_events = (
            _PieceEvents(_piece_beats(stage), start_frame),
            _PieceEvents(_gesture_events(stage), start_frame),
        )
        self._events: Sequence[_EventSource] = piece_events if events is None else (events,)
        self._late_and_gaps: tuple[int, int] | None = None
        self._sent_troubles: tuple[str, ...] = ()
        self._hands_due_instant = self._levels_due_instant = -math.inf

    def send_new(self, clock: Callable[[], float]) -> None:
        """Send what is new; `clock` gives the seconds since 1970. Raises EngineError once it has
        ended.
        """
        status = self._performance.status()
        instant_now = clock()
        self._hearing_clock.update(status, instant_now)
        # Sound is heard later than it is computed; how much later is unknown until the first block
        # has gone out.
        if status.sounding is not None or not status.paced:
            for event_source in self._events:
                for frame, address, arguments in event_source.pop_before(status.frame):
                    self._send(address, arguments, self._hearing_clock.instant_of(frame) or 0.0)
        self._send_status(status, instant_now)

    def _send_status(self, status: _core.Status, instant_now: float) -> None:
        # A clock that is set back must not stop the messages.
        if not self._hands_due_instant - HAND_PERIOD <= instant_now < self._hands_due_instant:
            self._hands_due_instant = instant_now + HAND_PERIOD
            for address, hand in zip(self._hand_addresses, status.hands, strict=False):
                self._send(address, (hand.position, hand.force))
        if not self._levels_due_instant - _LEVEL_PERIOD <= instant_now < self._levels_due_instant:
            self._levels_due_instant = instant_now + _LEVEL_PERIOD
            levels = [20.0 * math.log10(max(peak, SILENT_PEAK)) for peak in status.peaks]
            self._send("/ergon/level", levels)
        late_and_gaps = status.late, gap_count(status)
        if late_and_gaps != self._late_and_gaps:
            self._late_and_gaps = late_and_gaps
            self._send("/ergon/late", late_and_gaps)
        recording_trouble = self._performance.recording_trouble()
        players = [hand.player for hand in self._stage.live_hands]
        status_troubles = troubles(
            status, players, recording_trouble, is_endless=self._session_events is not None
        )
        if self._session_events is not None:
            status_troubles = (*self._session_events.troubles(), *status_troubles)
        status_troubles = ("PANIC", *status_troubles) if status.panicked else status_troubles
        if status_troubles != self._sent_troubles:
            self._sent_troubles = status_troubles
            self._send("/ergon/trouble", status_troubles)


OscEvent = tuple[int, str, tuple[object, ...]]  # (frame, address, arguments)


class _EventSource(Protocol):
    """Events in the order of their frames."""

    def pop_before(self, frame: int) -> Iterable[OscEvent]:
        """Events before a frame that were not returned yet."""


class SessionEventSource(_EventSource, Protocol):
    """Events of a session, and its troubles."""

    def troubles(self) -> Sequence[str]:
        """Troubles that the performance itself does not report."""


class _PieceEvents:
    """Events in the order of their frames, from `start_frame` on."""

    def __init__(self, events: Iterator[OscEvent], start_frame: int) -> None:
        self._events = (event for event in events if event[0] >= start_frame)
        self._next_event = next(self._events, None)

    def pop_before(self, frame: int) -> Iterator[OscEvent]:
        """Events before a frame that were not returned yet."""
        while self._next_event is not None and self._next_event[0] < frame:
            event, self._next_event = self._next_event, next(self._events, None)
            yield event


def _piece_beats(stage: Stage) -> Iterator[OscEvent]:
    """Every beat of every bar of a piece that ends."""
    for beat_event in beat_events(stage.piece.tempo_map, stage.rate, 1):
        if beat_event[0] >= stage.n_frames:
            return
        yield beat_event


def beat_events(tempo_map: TempoMap, rate: float, bar_number: int) -> Iterator[OscEvent]:
    """Every beat from a bar on, without end, with (bar, beat, bpm)."""
    while True:
        bar_start, bar_length = tempo_map.bars.bar(bar_number)
        for bar_beat in range(math.ceil(bar_length)):
            beat = bar_start + bar_beat
            frame = frame_of(tempo_map.seconds(beat), rate)
            yield frame, "/ergon/beat", (bar_number, bar_beat + 1, float(tempo_map.bpm(beat)))
        bar_number += 1


def _gesture_events(stage: Stage) -> Iterator[OscEvent]:
    """Every beginning of a gesture, with (player, key, gesture, seconds of the piece)."""
    for gesture in sorted(stage.gestures, key=lambda gesture: gesture.start):
        strike_arguments = (gesture.player, gesture.key, gesture.name, float(gesture.start))
        yield frame_of(gesture.start, stage.rate), "/ergon/strike", strike_arguments


def frame_of(seconds: float, rate: float) -> int:
    """The frame of an instant [s]."""
    return int(seconds * rate + 0.5)
