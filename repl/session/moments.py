"""When lines can take effect: the first frames at which the engine can still make a change."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from ergon.repl.language.commands import NOW, When
from ergon.repl.session.clock import next_boundary
from ergon.repl.session.line_kinds import RULE_BY_KIND, LineKind
from ergon.repl.session.places import BAR_DURATION, LinePlace, PresentState, frame_of, place_of

if TYPE_CHECKING:
    from ergon.notation.clock.positions import Length
    from ergon.notation.clock.tempo import TempoMap
    from ergon.repl.session.changes import Changes
    from ergon.repl.session.clock import Timing
    from ergon.repl.session.engine import Engine
    from ergon.repl.session.making_time import MakingTime
    from ergon.repl.session.waiting_lines import WaitingLine


class Moments:
    """The frames of changes that are to come; a change reaches the engine within `margin` frames.

    `tempo_map` is everywhere the tempo with all waiting lines.
    """

    def __init__(
        self, engine: Engine, changes: Changes, timing: Timing, making_time: MakingTime, margin: int
    ) -> None:
        """Begin with an engine, the changes that are under way to it, and the time of a making."""
        self.margin = margin
        self._engine, self._changes, self._timing = engine, changes, timing
        self._making_time = making_time

    def frame_after(self, seconds: float) -> int:
        """The frame that comes so long after the first that a request can reach."""
        return self._engine.frame + self.margin + int(seconds * self._timing.rate)

    def tick_after(self, seconds: float) -> int:
        """That frame, or the first of the next tick."""
        return self._tick_frame(self.frame_after(seconds))

    def soonest_frame(self, kind: LineKind = LineKind.STRUCTURE) -> int:
        """The first frame at which a new line of a kind can take effect: a multiple of the tick."""
        return self.first_frame(
            0.0 if RULE_BY_KIND[kind].is_quick else self._making_time.expected_seconds, kind
        )

    def first_frame(self, making_seconds: float, line_kind: LineKind = LineKind.STRUCTURE) -> int:
        """The first frame for a change that takes `making_seconds` [s] to compute."""
        if line_kind is LineKind.FADERS:
            frame_min = 0
        elif line_kind is LineKind.STOPS:  # such a line withdraws pending changes
            frame_min = self._changes.running_at(self.tick_after(0.0) - 1).start_frame + 1
        else:
            frame_min = self._changes.running.start_frame + 1
        return self._tick_frame(max(self.frame_after(making_seconds), frame_min))

    def beat_now(self) -> float:
        """The beat of the piece that the engine computes now."""
        return self._changes.running.beat(self._engine.frame)

    def place(
        self,
        tempo_map: TempoMap,
        when: When,
        grid: Length | None,
        kind: LineKind = LineKind.STRUCTURE,
    ) -> LinePlace:
        """The place of a line that is typed now. Raises NotTakenError where its beat is past."""
        lead_seconds = self._timing.change_lead(kind is LineKind.STOPS)
        soonest_frames = self.first_frame(0.0, kind), self.soonest_frame(kind)
        line_beat, start_frame = place_of(
            when, grid, self._present_state(tempo_map), soonest_frames, lead_seconds
        )
        is_now = when is NOW or (when is None and grid is None)
        if kind is LineKind.FADERS and is_now and start_frame is not None:
            start_frame = soonest_frames[
                1
            ]  # these lines need not wait for the beginning of the piece
        return LinePlace(line_beat, start_frame)

    def place_from(
        self, first_frame: int, tempo_map: TempoMap, line_time: When, grid: Length | None
    ) -> LinePlace:
        """The place of a line that needs a stage and is ready at a frame.

        Raises NotTakenError where its beat is past.
        """
        lead_seconds = self._timing.change_lead(False)
        return place_of(
            line_time,
            grid,
            self._present_state(tempo_map),
            (first_frame, first_frame),
            lead_seconds,
        )

    def place_after_slip(self, slipped_lines: Sequence[WaitingLine]) -> tuple[float, int]:
        """The next beat and frame of lines that were late: the next bar, or the soonest frame."""
        first_line, n_slips = slipped_lines[0], max(line.n_slips for line in slipped_lines)
        making_seconds = self._making_time.after_slips(n_slips)
        start_frame = self.first_frame(
            0.0 if not n_slips and first_line.rule.is_quick else making_seconds, first_line.kind
        )
        running, timing = self._changes.running, self._timing
        clock, tempo_map = running.clock, running.version.piece.tempo_map
        lead = first_line.lead(timing)
        start_beat = clock.beat(tempo_map, start_frame / timing.rate + lead)
        if clock.is_running and not all(line.is_now for line in slipped_lines):
            start_beat = next_boundary(tempo_map, start_beat, BAR_DURATION)
            start_frame = max(
                start_frame, timing.takeover_frame(clock, tempo_map, start_beat, lead)
            )
        return start_beat, start_frame

    def frame_of(self, tempo_map: TempoMap, beat: float) -> int:
        """The first frame of the tick of a beat; the soonest frame while the piece is stopped."""
        return frame_of(beat, self._present_state(tempo_map), self.soonest_frame())

    def _present_state(self, tempo_map: TempoMap) -> PresentState:
        return PresentState(self._changes.running.clock, tempo_map, self.beat_now(), self._timing)

    def _tick_frame(self, frame: int) -> int:
        """The first frame of a tick that is not before a frame."""
        tick_frames = self._timing.tick_frames
        return -(-frame // tick_frames) * tick_frames
