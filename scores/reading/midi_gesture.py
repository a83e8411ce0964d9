"""Notes of a MIDI file as a gesture: each note presses the key, deeper for a higher velocity."""

from __future__ import annotations

from collections.abc import Sequence

from ergon.notation.tables.fields import Values
from ergon.notation.tables.velocities import EVEN, Curve
from ergon.notation.text.files import Files
from ergon.notation.text.values import Point, Time
from ergon.scores.gesture.midi_file import MidiNote
from ergon.scores.reading.melodies import notes_of_take, value_of_velocity
from ergon.scores.reading.playing import NO_OPTIONS, Gesture

_APPROACH_QUARTERS = 0.125  # [quarters] from rest to the depth of a note, and back
_APPROACH_SHARE_MAX = 0.45  # largest share of the time to the next note


def gesture_of_take(
    take: Values, files: Files, n_points_max: int, has_quarters: bool
) -> Gesture | None:
    """The gesture of a MIDI take with at most `n_points_max` points; None if an error was reported.

    Its times are in quarter notes. They count as beats if the piece `has_quarters` in all meters.
    """
    error_label = take.context.label("")
    if take["depth"] is None:
        take.error(
            "E103", f"{error_label} has no 'depth': how far notes press a key, such as 2mm..8mm"
        )
        return None
    take_notes = notes_of_take(take, files)
    if take_notes is None:
        return None
    gesture_points = _key_points(
        take_notes.notes, take["depth"], take["curve"] or EVEN, take_notes.length
    )
    if len(gesture_points) > n_points_max:
        take.error(
            "E105", f"{error_label}: the gestures have more points than a piece may have", "file"
        )
        return None
    name, place = take.context.name, take.place
    return Gesture(name, gesture_points, (), (), NO_OPTIONS, place, in_quarters=not has_quarters)


def _key_points(
    notes: Sequence[MidiNote], depth: tuple[float, float], curve: Curve, take_length: float
) -> tuple[Point, ...]:
    """The key is at rest except within `_APPROACH_QUARTERS` of each note; of simultaneous notes the
    hardest counts.
    """
    hardest_by_quarter: dict[float, int] = {}
    for note in notes:
        hardest_by_quarter[note.at] = max(note.velocity, hardest_by_quarter.get(note.at, 0))
    note_quarters = [*hardest_by_quarter]
    key_points: list[Point] = []

    def add(quarter: float, x: float, curve: str) -> None:
        key_points.append(Point(Time(quarter), x, curve, 0, 1))

    for note_index, note_quarter in enumerate(note_quarters):
        quarter_before = (
            note_quarters[note_index - 1] if note_index else -note_quarter
        )  # half the way from the beginning
        quarter_after = (
            note_quarters[note_index + 1]
            if note_index + 1 < len(note_quarters)
            else note_quarter + 1.0
        )
        if note_quarter > 0.0:
            if not key_points:
                add(0.0, 0.0, "smooth")
            add(
                note_quarter
                - min(_APPROACH_QUARTERS, _APPROACH_SHARE_MAX * (note_quarter - quarter_before)),
                0.0,
                "hold",
            )
        add(
            note_quarter,
            value_of_velocity(hardest_by_quarter[note_quarter], depth, curve),
            "smooth",
        )
        add(
            note_quarter
            + min(_APPROACH_QUARTERS, _APPROACH_SHARE_MAX * (quarter_after - note_quarter)),
            0.0,
            "smooth",
        )
    if take_length > key_points[-1].at.beats:
        add(take_length, 0.0, "hold")
    return tuple(key_points)
