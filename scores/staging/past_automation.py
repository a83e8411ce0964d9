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
    GLIDE_DURATION,
    GLIDE_POINTS_MAX,
    GRID_FRAMES,
    SWING_SEGMENTS,
    Curve,
    Entry,
    Extent,
    glide_path,
    n_swing_points_before,
    needed_places,
    swing_beats,
)


class NeededEntries(NamedTuple):
    """The first entry that is needed, and the curve that the ones before it leave."""

    first_index: int
    curve: Curve


def point_margin(
    piece: Piece, entries_by_parameter: Iterable[Sequence[Entry]], begin_instant: float
) -> float:
    """How long before the instant `begin_instant` [s] points of modules are needed [s].

    Within a glide a point is corrected by its neighbours, so that of the last point at or before
    the instant must be there too.
    """
    grid_step = GRID_FRAMES / piece.rate
    margin_max = 0.0
    for entries in entries_by_parameter:
        index = _begun_count(piece.tempo_map, entries, begin_instant) - 1
        if index >= 0 and entries[index].automation.points:
            try:
                path = glide_path(piece, entries[index], 1.0)
            except TextError:
                continue  # the expansion reports the mistake
            if path.last_instant >= begin_instant:
                span = path.last_instant - min(
                    begin_instant, piece.tempo_map.seconds(entries[index].begin_beat)
                )
                margin_max = max(margin_max, span / GLIDE_POINTS_MAX + 2.0 * grid_step)
    return 2.0 * margin_max + grid_step


def needed_entries(
    piece: Piece, entries: Sequence[Entry], initial_value: float, extent: Extent
) -> NeededEntries:
    """The entries of one parameter, in order, that its curve needs within an extent."""
    tempo, begin_instant = piece.tempo_map, extent.begin_instant
    if begin_instant == -math.inf:
        return NeededEntries(0, Curve(initial_value))
    index = _begun_count(tempo, entries, begin_instant) - 1
    while index >= 0:
        entry = entries[index]
        next_entry = entries[index + 1] if index + 1 < len(entries) else None
        try:
            release_instant = _release_instant(piece, entry, next_entry, extent.until_beat)
            if release_instant <= begin_instant:  # the parameter has its own value again
                return NeededEntries(
                    index + 1, Curve(initial_value, [release_instant], [initial_value])
                )
            if _is_independent(piece, entry, initial_value, extent.since_beat, begin_instant):
                break
        except TextError:
            pass  # the expansion reports the mistake
        begin_instant = tempo.seconds(entry.begin_beat)
        index -= 1
    return NeededEntries(max(0, index), Curve(initial_value))


def _begun_count(tempo: TempoMap, entries: Sequence[Entry], instant: float) -> int:
    """How many entries have begun at an instant [s]."""
    return bisect_right(entries, instant, key=lambda entry: tempo.seconds(entry.begin_beat))


def _release_instant(
    piece: Piece, automation_entry: Entry, next_entry: Entry | None, until_beat: float
) -> float:
    """The instant from which a parameter has its own value after an entry [s]; infinite if the next
    entry begins before. Raises TextError.
    """
    tempo, automation_line, end_beat = (
        piece.tempo_map,
        automation_entry.automation,
        automation_entry.stop_beat,
    )
    if automation_line.pattern is not None:
        place_beats = automation_line.place_beats(tempo, piece.seed)
        end_beat = min(end_beat, place_beats.beat(len(place_beats)))
        if automation_line.strikes_name and next_entry is None:
            return math.inf  # the pitch of the last note stays
    if end_beat > until_beat or (
        next_entry is not None and next_entry.begin_beat <= end_beat + SAME
    ):
        return math.inf
    release_instant = tempo.seconds(end_beat) + GLIDE_DURATION
    return (
        math.inf
        if next_entry is not None and tempo.seconds(next_entry.begin_beat) < release_instant
        else release_instant
    )


def _is_independent(
    piece: Piece, entry: Entry, initial_value: float, since_beat: float, begin_instant: float
) -> bool:
    """Whether the points of an entry, from the last one at or before an instant [s] on, depend on
    no entry before it.

    What entries before it have left lasts for `GLIDE_DURATION` after its beginning at most.
    """
    tempo, automation = piece.tempo_map, entry.automation
    glide_end = tempo.seconds(entry.begin_beat) + GLIDE_DURATION
    if automation.points:
        path = glide_path(piece, entry, initial_value)
        is_over = glide_end < path.last_instant <= begin_instant
        return is_over and (path.is_complete or automation.over is None)
    if automation.swing is not None:
        beat_of = swing_beats(tempo, entry, automation.swing)
        n_points = n_swing_points_before(beat_of, tempo.beats(glide_end)) + 1
        if automation.swing.shape == "square":  # a square has points only at its changes
            n_points += SWING_SEGMENTS // 2
        beat = beat_of(n_points)
        return beat <= entry.stop_beat and tempo.seconds(beat) <= begin_instant
    return _has_set_value(piece, entry, since_beat, begin_instant)


def _has_set_value(
    piece: Piece, automation_entry: Entry, since_beat: float, begin_instant: float
) -> bool:
    """Whether a pattern has set a value before an instant [s], so that no earlier one holds."""
    tempo, automation_line = piece.tempo_map, automation_entry.automation
    glide_end = tempo.seconds(automation_entry.begin_beat) + GLIDE_DURATION
    place_beats = automation_line.place_beats(tempo, piece.seed)
    grid_step = GRID_FRAMES / piece.rate
    for place_index in range(*needed_places(place_beats, since_beat, automation_entry.stop_beat)):
        if place_beats.places.played_name(place_index) is None:
            continue
        place_instant = tempo.seconds(place_beats[place_index])
        if place_instant > begin_instant:
            break
        if automation_line.strikes_name:
            if place_instant - 2 * grid_step > glide_end:
                return True
        else:
            next_instant = tempo.seconds(place_beats.beat(place_index + 1))
            is_reached = place_instant + GLIDE_DURATION <= min(begin_instant, next_instant)
            if is_reached or (place_instant > glide_end and next_instant <= begin_instant):
                return True
    return False
