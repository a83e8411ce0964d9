"""Which gestures cut others: one at a time per key, unless it is a layer."""

from __future__ import annotations

from collections.abc import Sequence

from ergon.scores.reading.piece import Piece
from ergon.scores.staging.hands import StagedGesture
from ergon.scores.text.errors import Collector, quote
from ergon.scores.text.values import Place

# What jitter moves at the seam of two repetitions is no cut that anyone wrote [s].
_SEAM = 0.02


def check_overlaps(piece: Piece, gestures: Sequence[StagedGesture], collector: Collector) -> None:
    """Report gestures that begin before the one before has ended (W310), once for each line."""
    tempo = piece.tempo_map
    keys: dict[str, list[StagedGesture]] = {}
    for gesture in gestures:
        if not gesture.layer:
            keys.setdefault(gesture.key, []).append(gesture)
    told: set[Place] = set()
    for line in keys.values():
        line.sort(key=lambda gesture: gesture.start)
        latest = line[0]
        for gesture in line[1:]:
            if gesture.start < latest.stop - _SEAM and gesture.place not in told:
                told.add(gesture.place)
                what = "itself" if latest.place == gesture.place else quote(latest.name)
                at, until = (tempo.written(tempo.beats(t)) for t in (gesture.start, latest.stop))
                message = f"{quote(gesture.name)} at {at} cuts {what}, which lasts until {until}"
                help = "`layer: true` lets both sound"
                collector.error("W310", message, gesture.place, help=help)
            latest = gesture
