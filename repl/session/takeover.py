"""How waiting lines become the running version: one stage for all lines of a frame."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from ergon.notation.clock.meter import SAME
from ergon.repl.session.clock import JOIN_DURATION, Timing
from ergon.repl.session.frozen_parts import place_samples, unchanged_parts
from ergon.repl.session.running import RunningVersion, stage_spans, timeline_horizon
from ergon.repl.session.waiting_lines import WaitingLine, takeover_beats_of
from ergon.scores.staging.cutting import cut_stage
from ergon.scores.staging.hands import Window
from ergon.scores.staging.preparing import Span
from ergon.scores.staging.version_glides import fading_links, version_glides

if TYPE_CHECKING:
    from ergon.scores.staging.live import RealHands
    from ergon.scores.staging.planning import TrialStore
    from ergon.scores.staging.stage import Stage


@dataclass(frozen=True, slots=True)
class Takeovers:
    """Makes running versions; `real_hands` are the players whose hands are real, and `store` keeps
    results of trials.
    """

    timing: Timing
    real_hands: RealHands
    store: TrialStore | None = None

    def staged(
        self, running: RunningVersion, lines: Sequence[WaitingLine], latest_beat: float = math.inf
    ) -> RunningVersion:
        """The version after lines that take over together from `running`.

        Nothing begins on beat `latest_beat` or later. Raises StageError, NotTakenError.
        """
        running_after = self._next_version(running, lines, latest_beat)
        return replace(
            running_after, stage=self._staged(running_after, running), serial=running.serial + 1
        )

    def cut_version(self, running: RunningVersion, lines: Sequence[WaitingLine]) -> RunningVersion:
        """The version after lines that only end what plays, without making a stage.

        Raises EngineError.
        """
        running_after = self._next_version(running, lines, running.timeline_end)
        stage = cut_stage(
            running.stage,
            running_after.start_frame,
            ends_gestures=any(waiting_line.result().ends_gestures for waiting_line in lines),
            is_stopped=not running_after.clock.is_running,
            resets_masses=any(waiting_line.resets for waiting_line in lines),
        )
        stage.recalled_outputs = place_samples(
            running_after.frozen, stage.listening, running_after.clock, stage.rate
        )
        return replace(running_after, stage=stage, serial=running.serial + 1)

    def extended(
        self, running: RunningVersion, start_frame: int, latest_beat: float = math.inf
    ) -> RunningVersion:
        """A version whose timeline goes on from frame `start_frame`; it is inaudible at any frame.

        Nothing begins on beat `latest_beat` or later. Raises StageError, NotTakenError.
        """
        tempo_map = running.version.piece.tempo_map
        enter_beat = running.clock.beat(
            tempo_map, start_frame / self.timing.rate + self.timing.takeover_lead
        )
        spans, timeline_end, skipped_from = self._spans_after(
            running, running, start_frame, enter_beat, enter_beat, latest_beat
        )
        running_after = replace(
            running,
            spans=spans,
            start_frame=start_frame,
            timeline_end=timeline_end,
            skipped_from=skipped_from,
        )
        return replace(running_after, stage=self._staged(running_after, running))

    def _staged(self, new_running: RunningVersion, running: RunningVersion) -> Stage:
        """The stage of a version that takes over from `running`."""
        return stage_spans(
            new_running.version,
            new_running.clock,
            new_running.spans,
            running.stage,
            new_running.start_frame,
            self.real_hands,
            self.store,
            new_running.glides,
            new_running.fading_links,
            frozen=new_running.frozen,
            is_seen=running.is_seen,
        )

    def _next_version(
        self, running: RunningVersion, lines: Sequence[WaitingLine], latest_beat: float
    ) -> RunningVersion:
        """What the lines make of a running version, with the stage of before."""
        running_after = replace(running, damping_t60=None, skipped_from=None)
        for line in lines:
            running_after = self._following_version(running_after, line, latest_beat)
        return running_after

    def _following_version(
        self, running: RunningVersion, line: WaitingLine, latest_beat: float
    ) -> RunningVersion:
        """The running version after one line, with the stage of before."""
        assert line.start_frame is not None
        old_version, version, start_frame = running.version, line.result(), line.start_frame
        clock, leave_beat, enter_beat = takeover_beats_of(
            running.clock, old_version, version, line, self.timing
        )
        running_after = replace(running, version=version, clock=clock)
        spans, timeline_end, skipped_from = self._spans_after(
            running, running_after, start_frame, leave_beat, enter_beat, latest_beat
        )
        start_instant = start_frame / self.timing.rate
        old_and_new = old_version.sounding, version.sounding
        moving_glides = version_glides(
            *old_and_new, running.glides, start_instant, version.glide_duration
        )
        links_fading = fading_links(
            *old_and_new, running.glides, running.fading_links, start_instant
        )
        return replace(
            running_after,
            spans=spans,
            start_frame=start_frame,
            timeline_end=timeline_end,
            skipped_from=running.skipped_from if skipped_from is None else skipped_from,
            glides=(*moving_glides, *(link.glide for link in links_fading)),
            fading_links=links_fading,
            frozen=unchanged_parts(running.frozen, old_version, version, self.real_hands),
            damping_t60=running.damping_t60 if version.damping_t60 is None else version.damping_t60,
        )

    def _spans_after(
        self,
        running: RunningVersion,
        running_after: RunningVersion,
        start_frame: int,
        leave_beat: float,
        enter_beat: float,
        latest_beat: float,
    ) -> tuple[tuple[Span, ...], float, float | None]:
        """What plays of the versions up to `running`, which ends on beat `leave_beat`, and of
        `running_after`, which goes on from beat `enter_beat`; up to which beat; and from which
        beat on nothing began.
        """
        start_instant = start_frame / self.timing.rate
        version, clock = running_after.version, running_after.clock
        old_spans: Sequence[Span] = ()
        if running_after is running or not version.ends_gestures:
            old_spans = continuing_spans(running, leave_beat, start_instant, running.stage)
        timeline_end = min(timeline_horizon(version.piece.tempo_map, enter_beat)[0], latest_beat)
        piece = replace(
            version.sounding,
            tempo_map=clock.engine_tempo_map(version.piece.tempo_map, start_instant),
        )
        new_spans = (
            (Span(piece, Window(enter_beat, timeline_end, start_instant)),)
            if clock.is_running
            else ()
        )
        is_skipped = running.clock.is_running and leave_beat > running.timeline_end + SAME
        return (*old_spans, *new_spans), timeline_end, running.timeline_end if is_skipped else None


def continuing_spans(
    old_running: RunningVersion, leave_beat: float, after_instant: float, stage: Stage
) -> Sequence[Span]:
    """The spans of earlier versions, the last one cut at a beat, of which something goes on after
    `after_instant` [s].
    """
    tracked_spans = [(gesture.written_start, gesture.stop) for gesture in stage.gestures]
    running_spans = []
    for span_index, (piece, window) in enumerate(old_running.spans):
        is_last = span_index == len(old_running.spans) - 1 and old_running.clock.is_running
        span_end = min(window.until_beat, leave_beat) if is_last else window.until_beat
        first_instant, last_instant = (
            piece.tempo_map.seconds(beat) for beat in (window.since_beat, span_end)
        )
        if last_instant > after_instant or any(
            first_instant - JOIN_DURATION <= start <= last_instant and stop > after_instant
            for start, stop in tracked_spans
        ):
            running_spans.append(Span(piece, Window(window.since_beat, span_end, after_instant)))
    return running_spans
