"""Which automation entries can still be heard at an instant: all others are not expanded.

Most entries of a long session have ended. What is expanded from the first entry that is needed has
the same points from the instant on, bit by bit, as what is expanded from the beginning.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Iterable, Sequence
from typing import NamedTuple

from ergon.notation.clock.meter import SAME
from ergon.notation.clock.tempo import TempoMap
from ergon.notation.text.errors import TextError
from ergon.scores.reading.piece import Piece
from ergon.scores.staging.parameter_curves import (
    GLIDE_POINTS_MAX,
    GLIDE_SECONDS,
    GRID_FRAMES,
    SWING_SEGMENTS,
    Curve,
    Entry,
    Extent,
    glide_path,
    held_places,
    swing_beats,
    swing_points_before,
)


class NeededEntries(NamedTuple):
    """The first entry that is needed, and the curve that the ones before it leave."""

    first: int
    curve: Curve


def point_slack_seconds(piece: Piece, orders: Iterable[Sequence[Entry]], begins: float) -> float:
    """How long before the instant `begins` [s] points of modules are needed [s].

    Within a glide a point is corrected by its neighbours, so that of the last point at or before
    the instant must be there too.
    """
    grid_seconds = GRID_FRAMES / piece.rate
    longest = 0.0
    for entry_order in orders:
        entry_index = _begun_count(piece.tempo_map, entry_order, begins) - 1
        if entry_index >= 0 and entry_order[entry_index].automation.points:
            try:
                path = glide_path(piece, entry_order[entry_index], 1.0)
            except TextError:
                continue  # the expansion reports the mistake
            if path.last >= begins:
                span = path.last - min(
                    begins, piece.tempo_map.seconds(entry_order[entry_index].begin)
                )
                longest = max(longest, span / GLIDE_POINTS_MAX + 2.0 * grid_seconds)
    return 2.0 * longest + grid_seconds


def needed_entries(
    piece: Piece, entry_order: Sequence[Entry], initial_value: float, extent: Extent
) -> NeededEntries:
    """The entries of one parameter, in order, that its curve needs within an extent."""
    tempo, begins = piece.tempo_map, extent.begins
    if begins == -math.inf:
        return NeededEntries(0, Curve(initial_value))
    entry_index = _begun_count(tempo, entry_order, begins) - 1
    while entry_index >= 0:
        needed_entry = entry_order[entry_index]
        following = entry_order[entry_index + 1] if entry_index + 1 < len(entry_order) else None
        try:
            release = _release_instant(piece, needed_entry, following, extent.until)
            if release <= begins:  # the parameter has its own value again
                return NeededEntries(
                    entry_index + 1, Curve(initial_value, [release], [initial_value])
                )
            if _stands_alone(piece, needed_entry, initial_value, extent.since, begins):
                break
        except TextError:
            pass  # the expansion reports the mistake
        begins = tempo.seconds(needed_entry.begin)
        entry_index -= 1
    return NeededEntries(max(0, entry_index), Curve(initial_value))


def _begun_count(tempo: TempoMap, order: Sequence[Entry], instant: float) -> int:
    """How many entries have begun at an instant [s]."""
    return bisect_right(order, instant, key=lambda entry: tempo.seconds(entry.begin))


def _release_instant(
    piece: Piece, automation_entry: Entry, following: Entry | None, until_beat: float
) -> float:
    """The instant from which a parameter has its own value after an entry [s]; infinite if the next
    entry begins before. Raises TextError.
    """
    tempo, automation_line, end_beat = (
        piece.tempo_map,
        automation_entry.automation,
        automation_entry.stop,
    )
    if automation_line.pattern is not None:
        places = automation_line.steps(tempo, piece.seed)
        end_beat = min(end_beat, places.beat(len(places)))
        if automation_line.struck and following is None:
            return math.inf  # the pitch of the last note stays
    if end_beat > until_beat or (following is not None and following.begin <= end_beat + SAME):
        return math.inf
    release = tempo.seconds(end_beat) + GLIDE_SECONDS
    return (
        math.inf if following is not None and tempo.seconds(following.begin) < release else release
    )


def _stands_alone(
    piece: Piece, automation_entry: Entry, start_value: float, since: float, begins: float
) -> bool:
    """Whether the points of an entry, from the last one at or before an instant [s] on, depend on
    no entry before it.

    What entries before it have left lasts until GLIDE after its beginning at most.
    """
    tempo, automation_line = piece.tempo_map, automation_entry.automation
    glide_end = tempo.seconds(automation_entry.begin) + GLIDE_SECONDS
    if automation_line.points:
        path = glide_path(piece, automation_entry, start_value)
        is_over = glide_end < path.last <= begins
        return is_over and (path.is_complete or automation_line.over is None)
    if automation_line.swing is not None:
        beat_of = swing_beats(tempo, automation_entry, automation_line.swing)
        point_number = swing_points_before(beat_of, tempo.beats(glide_end)) + 1
        if automation_line.swing.shape == "square":  # a square has points only at its changes
            point_number += SWING_SEGMENTS // 2
        beat = beat_of(point_number)
        return beat <= automation_entry.stop and tempo.seconds(beat) <= begins
    return _has_values_of_its_own(piece, automation_entry, since, begins)


def _has_values_of_its_own(
    piece: Piece, automation_entry: Entry, since: float, begins: float
) -> bool:
    """Whether a pattern has set a value before an instant [s], so that no earlier one holds."""
    tempo, automation_line = piece.tempo_map, automation_entry.automation
    glide_end = tempo.seconds(automation_entry.begin) + GLIDE_SECONDS
    pattern_steps = automation_line.steps(tempo, piece.seed)
    grid_step = GRID_FRAMES / piece.rate
    for place_index in range(*held_places(pattern_steps, since, automation_entry.stop)):
        if pattern_steps.course.played(place_index) is None:
            continue
        place_instant = tempo.seconds(pattern_steps[place_index])
        if place_instant > begins:
            break
        if automation_line.struck:
            if place_instant - 2 * grid_step > glide_end:
                return True
        else:
            following = tempo.seconds(pattern_steps.beat(place_index + 1))
            is_first_over = place_instant + GLIDE_SECONDS <= min(begins, following)
            if is_first_over or (place_instant > glide_end and following <= begins):
                return True
    return False
