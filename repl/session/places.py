"""When lines act: the beats and frames of what is asked for."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from ergon.notation.clock.meter import SAME
from ergon.notation.clock.positions import Length, Position
from ergon.notation.text.errors import TextError
from ergon.repl.language.commands import NOW, When
from ergon.repl.session.clock import next_boundary
from ergon.repl.session.version import NotTakenError

if TYPE_CHECKING:
    from ergon.notation.clock.tempo import TempoMap
    from ergon.repl.session.clock import Clock, Timing

BAR_DURATION = Length(bars=1.0)


class PresentState(NamedTuple):
    """Where a piece is: its clock, its tempo with all waiting lines, and its beat now."""

    clock: Clock
    tempo_map: TempoMap
    beat_now: float
    timing: Timing


class LinePlace(NamedTuple):
    """The beat on which a line acts, and the frame at which it takes over; None: the piece is
    stopped, and has not reached that beat."""

    beat: float
    start_frame: int | None


def place_of(
    line_time: When,
    grid: Length | None,
    present_state: PresentState,
    soonest_frames: tuple[int, int],
    lead_seconds: float,
) -> LinePlace:
    """The place of a line that takes over `lead_seconds` [s] before its beat.

    `soonest_frames` are the first frame that a request can reach, and the soonest one for which a
    line is expected to be ready; a named beat may come before the latter. Raises NotTakenError
    where the beat is past.
    """
    earliest_frame, soonest_frame = soonest_frames
    clock, tempo_map, beat_now, timing = present_state
    if not clock.is_running:
        line_beat = clock.stopped_beat
        if isinstance(line_time, Position):
            line_beat = _resolved_position(tempo_map, line_time)
        elif isinstance(line_time, Length):
            line_beat = tempo_map.after(line_beat, line_time)
        if line_beat < clock.stopped_beat - SAME:
            raise _past_error(line_time, line_beat, present_state)
        return LinePlace(
            line_beat, None if line_beat > clock.stopped_beat + SAME else soonest_frame
        )
    first_beat = clock.beat(tempo_map, soonest_frame / timing.rate + lead_seconds)
    if isinstance(line_time, Position | Length):
        earliest_beat = clock.beat(tempo_map, earliest_frame / timing.rate + lead_seconds)
        if isinstance(line_time, Position):
            line_beat = _resolved_position(tempo_map, line_time)
            if line_beat < earliest_beat - SAME:
                raise _past_error(line_time, line_beat, present_state)
        else:
            line_beat = max(earliest_beat, tempo_map.after(beat_now, line_time))
        return LinePlace(
            line_beat,
            max(earliest_frame, timing.takeover_frame(clock, tempo_map, line_beat, lead_seconds)),
        )
    if line_time is NOW or grid is None:
        # Before its beginning the piece is at its first beat, for which a cut need not wait.
        is_cut = not lead_seconds
        takeover_frame = timing.takeover_frame(clock, tempo_map, first_beat, lead_seconds)
        return LinePlace(
            first_beat, soonest_frame if is_cut else max(soonest_frame, takeover_frame)
        )
    line_beat = next_boundary(tempo_map, first_beat, grid)
    return LinePlace(
        line_beat,
        max(soonest_frame, timing.takeover_frame(clock, tempo_map, line_beat, lead_seconds)),
    )


def frame_of(line_beat: float, present_state: PresentState, soonest_frame: int) -> int:
    """The first frame of the tick of a beat; the soonest frame while the piece is stopped."""
    clock, tempo_map, _, timing = present_state
    if not clock.is_running:
        return soonest_frame
    tick_frames = timing.tick_frames
    return int(clock.seconds(tempo_map, line_beat) * timing.rate) // tick_frames * tick_frames


def _resolved_position(tempo_map: TempoMap, position: Position) -> float:
    try:
        return tempo_map.resolve(position)
    except TextError as error:
        raise NotTakenError(error.message) from None


def _past_error(line_time: When, line_beat: float, present_state: PresentState) -> NotTakenError:
    asked_text = line_time.text if isinstance(line_time, Position) and line_time.text else ""
    verb = "is" if present_state.clock.is_running else "is stopped"
    present_place = present_state.tempo_map.written(present_state.beat_now)
    return NotTakenError(
        f"{asked_text or present_state.tempo_map.written(line_beat)} is past: the piece {verb} at "
        f"{present_place}"
    )
