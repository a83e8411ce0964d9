"""`hear`: one stroke at the next tick, on what may have to be got ready for it first."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

from ergon.repl.language.commands import NOW
from ergon.repl.language.hearing import Hear
from ergon.repl.session import version_edits
from ergon.repl.session.entry import Entry
from ergon.repl.session.line_kinds import LineKind
from ergon.repl.session.struck_places import Place, place_number, strokes_of_line

if TYPE_CHECKING:
    from ergon.repl.session.acts import Acts
    from ergon.repl.session.running import RunningVersion
    from ergon.repl.session.schedule import Schedule
    from ergon.repl.session.stops import Stops

_SOON_SECONDS = 0.5  # [s] until a stroke, of which nothing is said
_NOTE_SECONDS = 1.0  # [s] from a stroke to the end of its note


class _AwaitedStrokes(NamedTuple):
    """Strokes that wait for a line by its number, or for a frame; `end_strokes` come when their
    note ends, unless there were more than `n_panics` panics by then.
    """

    strokes: Sequence[tuple[Place, float]]
    end_strokes: Sequence[tuple[Place, float]] = ()
    line_number: int | None = None
    frame: int = 0
    n_panics: int | None = None


class Hearing:
    """Strokes of `hear`. What was never struck from outside needs a version in which it can be."""

    def __init__(
        self,
        schedule: Schedule,
        acts: Acts,
        stops: Stops,
        queue_line: Callable[[Entry], tuple[str, RunningVersion]],
    ) -> None:
        """Begin without strokes; `queue_line` lets a line wait for its frame."""
        self._schedule = schedule
        self._acts = acts
        self._stops = stops
        self._queue_line = queue_line
        self._awaited_strokes: list[_AwaitedStrokes] = []

    def strike(self, command: Hear) -> str:
        """Strike as soon as it can be done; returns what is struck. Raises one of `REFUSALS`."""
        schedule = self._schedule
        playing_version = schedule.changes.running_at(schedule.engine.frame).version
        # a version that is due may yet be late
        line_number = playing_version.number
        beat_prefix = ""
        if command.name not in playing_version.maps:
            edit, head_version = version_edits.combine_edits([command]), schedule.head
            brings_instrument = edit(head_version, 0.0).texts is not head_version.texts
            line_kind = LineKind.STRUCTURE if brings_instrument else LineKind.VALUES
            # What brings an instrument in is a line like any other, so that `undo` takes it away.
            line = f"hear {command.words['stroke'].text}"
            beat_text, ready_version = self._queue_line(
                Entry(line, edit, line_kind, NOW, is_typed=brings_instrument)
            )
            playing_version, line_number = ready_version.version, ready_version.version.number
            waiting_line = schedule.line(line_number)
            if (
                waiting_line is not None
                and waiting_line.frame > schedule.engine.frame + _SOON_SECONDS * schedule.rate
            ):
                beat_prefix = f"{beat_text} "  # the beat of the line that brings the modules
        strokes = [*strokes_of_line(playing_version, command)]
        begun_strokes = [(stroke.place, stroke.impulse) for stroke in strokes]
        end_strokes = [
            (stroke.place, -stroke.impulse) for stroke in strokes if stroke.lasts_as_note
        ]
        with schedule.lock:
            self._awaited_strokes.append(_AwaitedStrokes(begun_strokes, end_strokes, line_number))
            self.strike_ready()
        shown_impulses = [stroke.impulse for stroke in strokes if not stroke.lasts_as_note] or [
            stroke.impulse for stroke in strokes
        ]
        impulses = ", ".join(
            dict.fromkeys(f"{1e3 * impulse:.3g} mN·s" for impulse in shown_impulses)
        )
        return f"{beat_prefix}{command.words['stroke'].text}: {impulses}"

    def strike_ready(self) -> None:
        """Strike what can be struck now; the schedule's lock is held."""
        all_awaited, self._awaited_strokes = self._awaited_strokes, []
        frame_now = self._schedule.engine.frame
        note_frames = int(_NOTE_SECONDS * self._schedule.rate)
        for awaited in all_awaited:
            is_ready = (
                awaited.line_number is None or self._schedule.line(awaited.line_number) is None
            )
            if not is_ready or awaited.frame > frame_now:
                self._awaited_strokes.append(awaited)
            elif awaited.n_panics not in (None, self._stops.n_panics):
                continue  # a panic has put at its start what this stroke would bring back
            elif not self._stops.panicked:
                missed_strokes = [
                    place_and_impulse
                    for place_and_impulse in awaited.strokes
                    if not self._strike(*place_and_impulse)
                ]
                if missed_strokes:  # too many acts are under way
                    self._awaited_strokes.append(awaited._replace(strokes=missed_strokes))
                elif awaited.end_strokes:
                    end_frame, n_panics = frame_now + note_frames, self._stops.n_panics
                    self._awaited_strokes.append(
                        _AwaitedStrokes(awaited.end_strokes, frame=end_frame, n_panics=n_panics)
                    )

    def _strike(self, place: Place, impulse: float) -> bool:
        part, module, member = place
        strike_place = partial(self._schedule.engine.strike, place_number(place), impulse)
        strike_fields = {"part": part, "module": module, "member": member, "impulse": impulse}
        return self._acts.request(strike_place, "strike", **strike_fields)
