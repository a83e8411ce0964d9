"""The live engine: one performance, whose simulation is replaced while it runs."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import TYPE_CHECKING

from ergon._core import has_let_go, let_go
from ergon.live.display import event_sentence, stiffness_refusal
from ergon.live.force_bounds import ForceBoundsFinder
from ergon.live.perform import PlaybackConfig, bar_frames, perform, tick_frames
from ergon.live.repeated_notices import RepeatedNotices
from ergon.live.trouble import troubles
from ergon.repl.session.engine import Change, EngineEvent, EngineStatus, GuidedPath, SoundFileStatus
from ergon.repl.session.version import NotTakenError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from ergon import _core
    from ergon.live.force_bounds import HandForceBounds
    from ergon.scores.staging.stage import Stage
    from ergon.scores.staging.version_glides import Glide

_BARS_AHEAD = 120.0  # [s] of bars sent ahead: a hand that reconnects waits for the next bar
_CLOSE_TIMEOUT = 2.0  # [s] to play out the ring buffer, and to end a sound file
_POLL_SECONDS = 0.005  # [s] between two looks at a file that ends


class LiveEngine:
    """A performance of stages on a sound card and keys."""

    def __init__(self, stage: Stage, config: PlaybackConfig) -> None:
        """Begin to play a stage. Raises EngineError."""
        self.tick_frames = tick_frames(stage)
        self._highpass, self._reference = config.highpass, config.reference
        self._pages = config.pages
        self.n_channels = stage.n_channels
        self._performance: _core.Performance = perform(
            stage, replace(config, is_endless=True, has_loose_guides=True)
        )
        self._players = [hand.player for hand in stage.live_hands]
        self._real_players = {player for board in config.boards for _, player in board.axes}
        hand_indices = [
            hand.index for hand in stage.live_hands if hand.player in self._real_players
        ]
        lever_ratios = [hand.reach for hand in stage.live_hands]
        self.bounds_finder = ForceBoundsFinder(
            self._performance.hand_limit, lever_ratios, hand_indices
        )
        self._boards = [board.display_name for board in config.boards]
        self._players_by_board = [[player for _, player in board.axes] for board in config.boards]
        self._n_sound_events = 0
        self._n_silences = 0
        # Set by `close`: the last status, and the events that were not reported yet.
        self._final_status: _core.Status | None = None
        self._final_sound: SoundFileStatus | None = None
        self._unreported_events: list[_core.PerformanceEvent] = []
        self._notices = RepeatedNotices(stage.rate)

    @property
    def performance(self) -> _core.Performance:
        """The performance, for OSC and tests."""
        return self._performance

    @property
    def frame(self) -> int:
        """Frames computed so far."""
        return self._status().frame

    def force_bounds(
        self,
        stage: Stage,
        start: int,
        glides: Sequence[Glide],
        bounds_before: Sequence[HandForceBounds],
    ) -> Sequence[HandForceBounds]:
        """The forces that real hands may get from a stage that takes over at frame `start`.

        Raises NotTakenError where a key cannot bear the stage.
        """
        bounds = self.bounds_finder.force_bounds(stage, start, glides, bounds_before)
        for bound in bounds:
            if not bound.least_scale.is_enough:
                raise NotTakenError(stiffness_refusal(bound))
        return bounds

    def change(self, change: Change) -> int:
        """Send a change to the physics thread; returns its ticket."""
        if change.is_gain_change:
            return self._performance.change(change.frame, gains=list(change.gains.items()))
        stage, old_stage = change.stage, change.old_stage
        ticket = self._performance.change(
            change.frame,
            simulation=stage.simulation,
            old=None if change.resets else old_stage.simulation,
            mixer=stage.mixer(highpass=self._highpass, reference=self._reference)
            if change.needs_new_mixer
            else None,
            gains=list(change.gains.items()),
            damp=change.damping_t60 or 0.0,
            bounds=self._bounds_by_hand(change.force_bounds),
            bars=bar_frames(stage, change.frame, change.frame + int(_BARS_AHEAD * stage.rate)),
        )
        if self._pages is not None:
            self._pages.follow(stage, self._performance)
        return ticket

    def revoke(self, frame: int) -> None:
        """Withdraw the changes of the stage that are due at `frame` or later; each is reported as
        late. Raises EngineError.
        """
        if self._final_status is None:
            self._performance.revoke(frame)

    def _bounds_by_hand(
        self, force_bounds: Sequence[HandForceBounds]
    ) -> list[list[tuple[int, float]]]:
        bounds_by_player = {hand_bounds.player: hand_bounds.bounds for hand_bounds in force_bounds}
        return [list(bounds_by_player.get(player, ())) for player in self._players]

    def guide(self, frame: int, paths: Mapping[str, GuidedPath]) -> int:
        """Guide players' hands along new paths from `frame` on; returns the ticket."""
        import numpy as np

        guided_paths = [paths.get(player, GuidedPath(np.zeros(0), ())) for player in self._players]
        return self._performance.change(
            frame,
            standins=[guided_path.positions for guided_path in guided_paths],
            forces=[np.asarray(guided_path.forces, dtype=float) for guided_path in guided_paths],
            guidance=[guided_path.strength_steps for guided_path in guided_paths],
        )

    def strike(self, point: int, impulse: float) -> int | None:
        """Strike a point of the running stage by an impulse [N·s], at the next tick; any thread may
        call it.
        """
        return None if self._final_status else self._performance.strike(point, impulse)

    def set_input(self, number: int, value: float) -> int | None:
        """Set an input whose values are sent, full scale 1, at the next tick."""
        return None if self._final_status else self._performance.tell(number, value)

    def record_sound(self, path: Path) -> None:
        """Write the sound that is heard to a new file, from the next tick on. Raises
        EngineError.
        """
        self._performance.record_audio(path)

    def end_sound(self) -> None:
        """End the file of `record_sound`."""
        self._performance.end_audio()

    def sound_file_status(self) -> SoundFileStatus | None:
        """The state of the file of `record_sound`; None where there was none."""
        if self._final_status is not None:
            return self._final_sound
        recorded_status = self._performance.audio_recorded()
        if recorded_status is None:
            return None
        return SoundFileStatus(
            recorded_status.first,
            recorded_status.frames,
            recorded_status.missing,
            recorded_status.ended,
            recorded_status.error,
        )

    def set_faders(self, gains: Mapping[int, float]) -> None:
        """Set the faders of groups of routes at the beginning, as ratios."""
        for group, gain in gains.items():
            self._performance.part_gain(group, gain)

    def status(self) -> EngineStatus:
        """Load, late ticks, peaks, disconnected keys, and troubles."""
        status = self._status()
        hands = zip(self._players, status.hands, strict=False)
        disconnected = frozenset(
            name
            for name, hand in hands
            if status.ticks and name in self._real_players and not hand.real
        )
        recording_trouble = None if self._final_status else self._performance.recording_trouble()
        current_troubles = troubles(
            status, self._players, recording_trouble, is_endless=self._final_status is None
        )
        return EngineStatus(
            status.load,
            status.late,
            status.peaks,
            disconnected,
            bool(self._real_players) and has_let_go(),
            current_troubles,
        )

    def events(self) -> Sequence[EngineEvent]:
        """Events since the last call."""
        engine_events = []
        for raw_event in (
            self._unreported_events if self._final_status else self._performance.events()
        ):
            frame, event_kind, value = raw_event
            if event_kind in ("changed", "late"):
                engine_events.append(EngineEvent(frame, int(value), is_late=event_kind == "late"))
            elif event_kind in ("acted", "missed"):
                engine_events.append(
                    EngineEvent(frame, act_ticket=int(value), is_late=event_kind == "missed")
                )
            elif event_text := event_sentence(raw_event, self._players, self._boards):
                real_players = self._real_by_player(raw_event)
                lost_duration = value if event_kind == "lost" else 0.0
                engine_events += [
                    EngineEvent(event_frame, sentence=line, is_real_by_player=real_players)
                    for event_frame, line in self._notices.add_notice(
                        frame, event_kind, event_text, lost_duration
                    )
                ]
        self._unreported_events = []
        notice_lines = (
            self._notices.last_lines()
            if self._final_status
            else self._notices.due_lines(self.frame)
        )
        if self._final_status is None:
            sound_events = self._performance.sound_events()
            for _, event_text in sound_events[self._n_sound_events :]:
                notice_lines += self._notices.add_notice(self.frame, "sound", event_text)
            self._n_sound_events = len(sound_events)
        engine_events += [
            EngineEvent(event_frame, sentence=line) for event_frame, line in notice_lines
        ]
        while self._pages is not None and self._pages.remarks:
            engine_events.append(EngineEvent(self.frame, sentence=self._pages.remarks.popleft()))
        return engine_events

    def _real_by_player(self, event: _core.PerformanceEvent) -> dict[str, bool]:
        _, event_kind, value = event
        if event_kind == "gone":
            return dict.fromkeys(self._players_by_board[int(value)], False)
        return {self._players[int(value)]: True} if event_kind == "took over" else {}

    def silences(self) -> Sequence[tuple[int, bool]]:
        """Begins and ends of the silence of panics since the last call: (frame, whether it
        begins).
        """
        if self._final_status is not None:
            return ()
        silences = self._performance.silences(self._n_silences)
        self._n_silences += len(silences)
        return silences

    def _status(self) -> _core.Status:
        return self._final_status or self._performance.status()

    def panic(self) -> None:
        """Silence sound within 5 ms, and end every force."""
        self._performance.panic()

    def let_go(self) -> None:
        """End every force; the sound goes on."""
        let_go()

    def release(self) -> None:
        """Switch sound and force on again."""
        self._performance.release()

    def _ended_sound(self) -> SoundFileStatus | None:
        """The state of the file of `record_sound` once it has been ended, if that takes no longer
        than `_CLOSE_TIMEOUT`.
        """
        if self.sound_file_status() is not None:
            self.end_sound()
        deadline = time.monotonic() + _CLOSE_TIMEOUT
        while (status := self.sound_file_status()) and not (status.has_ended or status.error):
            if time.monotonic() > deadline:
                break
            time.sleep(_POLL_SECONDS)
        return status

    def close(self) -> None:
        """Play out the ring buffer, and end."""
        self._final_sound = self._ended_sound()
        self._final_status = self._performance.status()
        self._performance.stop()
        self._unreported_events = self._performance.close(_CLOSE_TIMEOUT)
        if self._pages is not None:
            self._pages.close()
