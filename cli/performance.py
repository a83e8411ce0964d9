"""Shows a performance in the terminal, from its first frame to its last."""

from __future__ import annotations

import contextlib
import sys
import time
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from ergon.api.score import where
from ergon.common.terminal import clean

from .console import Console
from .outcome import Late, Refused

if TYPE_CHECKING:
    from ergon import _core
    from ergon.live.osc import OscServer
    from ergon.live.perform import PlaybackConfig
    from ergon.live.pointer_hands import PointerHands
    from ergon.scores.staging.stage import Stage

_REFRESH_SECONDS = 0.1  # [s] between two looks: a hand is shown ten times a second
_SAY_SECONDS = 2.0  # [s] between two lines under --plain
_DRAIN_SECONDS_MAX = 10.0  # [s] that the sound in the ring buffer may take to be heard


class ShownPerformance:
    """A performance that is shown in the terminal, from its first frame to its last."""

    def __init__(
        self,
        console: Console,
        stage: Stage,
        performance: _core.Performance,
        hands: PointerHands,
        *,
        strict: bool,
        plain: bool,
    ) -> None:
        """Show a stage that hands play."""
        from ergon.live.display import PerformanceViewer
        from ergon.live.repeated_notices import RepeatedNotices

        self._console, self._stage, self._performance = console, stage, performance
        self._viewer = PerformanceViewer(stage)
        self._players = [hand.player for hand in stage.live_hands]
        self._hands = hands
        self._board_names = [board.display_name for board in hands.boards]
        self._strict = strict
        self._redraws = not (plain or console.json or console.quiet) and sys.stderr.isatty()
        self._n_drawn_lines = 0
        self._last_report = 0.0
        self._was_recording_troubled = False
        self._n_sound_events = 0
        self._notices = RepeatedNotices(stage.rate)
        self._osc: OscServer | None = None

    def run(self, osc: OscServer | None, config: PlaybackConfig, begin: Callable[[], None]) -> None:
        """Play to the end. However it ends, forces are then zero and nothing sounds."""
        from ergon import _core

        performance = self._performance
        try:
            self._console.say(performance.output())
            if sentence := performance.sound_input().sentence:
                self._console.say(f"input: {sentence}")
            begin()
            if osc is not None:
                self._osc = osc
                osc.begin(performance, self._stage, config.gain, config.start_frame)
            if granted := self._granted_priority():
                self._console.detail(f"physics: {granted}")
            while not performance.wait(_REFRESH_SECONDS):
                self._show()
            self._show(last=True)
            status, sound_input = performance.status(), performance.sound_input()
            self._stop_osc()
        except BaseException:
            performance.panic()
            performance.stop()
            self._stop_osc()
            # The error that ended the performance is reported, not what it caused in a recording.
            with contextlib.suppress(_core.EngineError):
                performance.close(0.05)
            self._summarise()
            raise
        try:
            self._tell_events(performance.close(_DRAIN_SECONDS_MAX))
        except _core.EngineError as error:
            raise Refused(str(error)) from None
        self._finish(status, sound_input)

    def _stop_osc(self) -> None:
        if self._osc is not None:
            self._osc.stop_serving()
            self._warn_of_osc_remarks()

    def _warn_of_osc_remarks(self) -> None:
        for remark in self._osc.remarks() if self._osc is not None else ():
            self._clear()
            self._console.warn(remark)

    def _warn_of_recording_trouble(self, trouble_text: str | None) -> None:
        """Warn that the recording cannot be written, once for each time that this begins."""
        if trouble_text and not self._was_recording_troubled:
            self._clear()
            self._console.warn(f"the recording cannot be written: {trouble_text}")
        self._was_recording_troubled = trouble_text is not None

    def _granted_priority(self) -> str | None:
        self._performance.wait(0.02)
        return self._performance.granted()

    def _show(self, *, last: bool = False) -> None:
        from ergon.live.display import view_lines, view_record

        performance, console = self._performance, self._console
        self._tell_events(performance.events())
        sound_events = performance.sound_events()
        status = performance.status()
        for _, sentence in sound_events[self._n_sound_events :]:
            for _, line in self._notices.add_notice(status.frame, "sound", sentence):
                self._say(line)
        self._n_sound_events = len(sound_events)
        self._say_at(self._notices.due_lines(status.frame))
        self._warn_of_osc_remarks()
        recording_trouble = performance.recording_trouble()
        self._warn_of_recording_trouble(recording_trouble)
        view = self._viewer.view(status, recording_trouble)
        now = time.monotonic()
        if console.json:
            if last or now - self._last_report >= 1.0:
                self._last_report = now
                console.record("playing", **view_record(view, status.frame))
        elif self._redraws:
            import shutil

            self._draw(view_lines(view, shutil.get_terminal_size().columns - 1))
        elif last or now - self._last_report >= _SAY_SECONDS:
            self._last_report = now
            console.say(" | ".join(line.strip() for line in view_lines(view, 200)))

    def _draw(self, lines: Sequence[str]) -> None:
        move_up = f"\x1b[{self._n_drawn_lines}F" if self._n_drawn_lines else ""
        sys.stderr.write(move_up + "".join(f"\x1b[2K{clean(line)}\n" for line in lines))
        sys.stderr.flush()
        self._n_drawn_lines = len(lines)

    def _clear(self) -> None:
        """Leave the drawn lines where they are; the next text is written below them."""
        self._n_drawn_lines = 0

    def _tell_events(self, events: Sequence[_core.PerformanceEvent]) -> None:
        from ergon.live.display import event_sentence

        for event in events:
            event_frame, event_kind, lost_seconds = event
            if sentence := event_sentence(event, self._players, self._board_names):
                seconds = lost_seconds if event_kind == "lost" else 0.0
                self._say_at(self._notices.add_notice(event_frame, event_kind, sentence, seconds))

    def _say_at(self, lines: Sequence[tuple[int, str]]) -> None:
        """Say lines, each with the place in the piece of its frame."""
        for frame, line in lines:
            self._say(f"{where(self._stage.piece, frame / self._stage.rate)} {line}")

    def _say(self, sentence: str) -> None:
        self._clear()
        if self._console.json:
            self._console.record("event", message=sentence)
        else:
            self._console.say(sentence)

    def _summarise(self) -> None:
        """Say what was counted, and what came for keys without a device, also when the performance
        was ended.
        """
        self._clear()
        self._say_at(self._notices.last_lines())
        for sentence in self._hands.summaries():
            self._say(sentence)

    def _finish(self, status: _core.Status, sound_input: _core.SoundInput) -> None:
        from ergon.live.trouble import gap_count as gaps_of

        self._clear()
        late_ticks, played_seconds, n_gaps = (
            status.late,
            status.frame / self._stage.rate,
            gaps_of(status),
        )
        record_fields = {
            "frames": status.frame,
            "late_ticks": late_ticks,
            "ticks": status.ticks,
            "underruns": n_gaps,
            "dropped": status.dropped,
            "missed": status.missed,
        }
        if sound_input.live:
            record_fields["input_gaps"] = sound_input.gaps
        if self._osc is not None and (n_ignored := self._osc.n_malformed):
            self._console.warn(f"{n_ignored} datagrams were not valid OSC and were ignored")
        if self._console.json:
            self._console.record("played", **record_fields)
        else:
            gaps_text = f", {n_gaps} gaps" if n_gaps else ""
            self._console.say(
                f"played {played_seconds:.1f} s; {late_ticks} of {status.ticks} ticks "
                f"late{gaps_text}"
            )
        self._summarise()
        if sound_input.missing or sound_input.discarded:
            missing_seconds = sound_input.missing / self._stage.rate
            discarded_seconds = sound_input.discarded / self._stage.rate
            self._console.warn(
                f"{sound_input.gaps} gaps in the input: {missing_seconds:.3f} s of silence in "
                f"their place, {discarded_seconds:.3f} s left out"
            )
        if sound_input.error or sound_input.lost:
            end_reason = (
                sound_input.error
                or f"{sound_input.lost} frames were lost, for the disk was too slow"
            )
            self._console.warn(f"the recording of the input: {end_reason}")
        if status.dropped:
            dropped_seconds = status.dropped / self._stage.rate
            self._console.warn(
                f"{dropped_seconds:.3f} s of sound were computed but not heard, because the "
                "output took "
                "them too late; a larger --ahead helps, and a recording of the hands renders all"
            )
        if status.missed:
            missed_seconds = status.missed / self._stage.rate
            self._console.warn(
                f"{missed_seconds:.3f} s of frozen parts were read too late, and were silent"
            )
        is_short = status.dropped or status.missed or sound_input.gaps
        if self._strict and (late_ticks or n_gaps or is_short):
            raise Late(f"{late_ticks} late ticks, {n_gaps} gaps in the sound (--strict)")
