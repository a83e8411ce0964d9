"""How waiting lines become the running version: one stage for all lines of a frame."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from ergon.notation.clock.meter import SAME
from ergon.repl.session.clock import JOIN_SECONDS, Timing
from ergon.repl.session.frozen_parts import place_samples, still_frozen
from ergon.repl.session.running import RunningVersion, horizon, staged
from ergon.repl.session.waiting_lines import WaitingLine, entry
from ergon.scores.staging.cutting import cut_stage
from ergon.scores.staging.hands import Window
from ergon.scores.staging.preparing import Span
from ergon.scores.staging.version_glides import glides, leaving_links

if TYPE_CHECKING:
    from ergon.scores.staging.live import Real
    from ergon.scores.staging.stage import Stage


@dataclass(frozen=True, slots=True)
class Takeovers:
    """Makes running versions; `real` are the players whose hands are real."""

    timing: Timing
    real: Real

    def stage(
        self, on: RunningVersion, lines: Sequence[WaitingLine], latest: float = math.inf
    ) -> RunningVersion:
        """The version after lines that take over together from `on`.

        Nothing begins on beat `latest` or later. Raises StageError, NotTakenError.
        """
        after = self._after(on, lines, latest)
        return replace(after, stage=self._staged(after, on), serial=on.serial + 1)

    def cut(self, on: RunningVersion, lines: Sequence[WaitingLine]) -> RunningVersion:
        """The version after lines that only end what plays, without making a stage.

        Raises EngineError.
        """
        after = self._after(on, lines, on.timeline_end)
        stage = cut_stage(
            on.stage,
            after.start,
            ends_gestures=any(one.result().ends_gestures for one in lines),
            stops=not after.clock.is_running,
            resets=any(one.resets for one in lines),
        )
        stage.placed = place_samples(after.frozen, stage.listening, after.clock, stage.rate)
        return replace(after, stage=stage, serial=on.serial + 1)

    def extended(self, on: RunningVersion, start: int, latest: float = math.inf) -> RunningVersion:
        """A version whose timeline goes on from frame `start`; it is inaudible at any frame.

        Nothing begins on beat `latest` or later. Raises StageError, NotTakenError.
        """
        tempo = on.version.piece.tempo_map
        enter = on.clock.beat(tempo, start / self.timing.rate + self.timing.lead)
        spans, until, skipped_from = self._spans(on, on, start, enter, enter, latest)
        after = replace(on, spans=spans, start=start, timeline_end=until, skipped_from=skipped_from)
        return replace(after, stage=self._staged(after, on))

    def _staged(self, after: RunningVersion, on: RunningVersion) -> Stage:
        """The stage of a version that takes over from `on`."""
        return staged(
            after.version,
            after.clock,
            after.spans,
            on.stage,
            after.start,
            self.real,
            None,
            after.glides,
            after.leaving,
            frozen=after.frozen,
            is_seen=on.is_seen,
        )

    def _after(
        self, on: RunningVersion, lines: Sequence[WaitingLine], latest: float
    ) -> RunningVersion:
        """What the lines make of a running version, with the stage of before."""
        after = replace(on, damp=None, skipped_from=None)
        for line in lines:
            after = self._followed(after, line, latest)
        return after

    def _followed(self, on: RunningVersion, line: WaitingLine, latest: float) -> RunningVersion:
        """The running version after one line, with the stage of before."""
        assert line.start is not None
        before, version, start = on.version, line.result(), line.start
        clock, leave, enter = entry(on.clock, before, version, line, self.timing)
        after = replace(on, version=version, clock=clock)
        spans, until, skipped_from = self._spans(on, after, start, leave, enter, latest)
        seconds = start / self.timing.rate
        pieces = before.sounding, version.sounding
        moving = glides(*pieces, on.glides, seconds, version.glide)
        links = leaving_links(*pieces, on.glides, on.leaving, seconds)
        return replace(
            after,
            spans=spans,
            start=start,
            timeline_end=until,
            skipped_from=on.skipped_from if skipped_from is None else skipped_from,
            glides=(*moving, *(link.glide for link in links)),
            leaving=links,
            frozen=still_frozen(on.frozen, before, version, self.real),
            damp=on.damp if version.damp is None else version.damp,
        )

    def _spans(
        self,
        on: RunningVersion,
        after: RunningVersion,
        start: int,
        leave: float,
        enter: float,
        latest: float,
    ) -> tuple[tuple[Span, ...], float, float | None]:
        """What plays of the versions up to `on`, which ends on beat `leave`, and of that `after`
        it, which goes on from beat `enter`; up to which beat; and from which beat on nothing
        began.
        """
        seconds = start / self.timing.rate
        version, clock = after.version, after.clock
        old: Sequence[Span] = ()
        if after is on or not version.ends_gestures:
            old = continuing_spans(on, leave, seconds, on.stage)
        until = min(horizon(version.piece.tempo_map, enter)[0], latest)
        piece = replace(version.sounding, tempo_map=clock.tempo(version.piece.tempo_map, seconds))
        new = (Span(piece, Window(enter, until, seconds)),) if clock.is_running else ()
        is_skipped = on.clock.is_running and leave > on.timeline_end + SAME
        return (*old, *new), until, on.timeline_end if is_skipped else None


def continuing_spans(
    before: RunningVersion, leave: float, after: float, stage: Stage
) -> Sequence[Span]:
    """The spans of earlier versions, the last one cut at a beat, of which something goes on after
    `after` [s].
    """
    on = [(gesture.begins, gesture.stop) for gesture in stage.gestures]
    spans = []
    for index, (piece, window) in enumerate(before.spans):
        is_last = index == len(before.spans) - 1 and before.clock.is_running
        until = min(window.until, leave) if is_last else window.until
        first, last = (piece.tempo_map.seconds(beat) for beat in (window.since, until))
        if last > after or any(
            first - JOIN_SECONDS <= start <= last and stop > after for start, stop in on
        ):
            spans.append(Span(piece, Window(window.since, until, after)))
    return spans
