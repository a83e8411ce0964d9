"""Finds gestures that cut others: a key plays one at a time, unless it is a layer."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

from ergon.notation.text.errors import Collector, quote
from ergon.notation.text.values import Place
from ergon.scores.reading.piece import Piece
from ergon.scores.staging.hands import StagedGesture

# Overlaps up to this time, which jitter makes between repetitions, are not reported [s].
_SEAM_SECONDS = 0.02


def check_overlaps(piece: Piece, gestures: Sequence[StagedGesture], collector: Collector) -> None:
    """Report gestures that begin before the previous one has ended (W310), and layers over a
    tracked gesture (W313), once for each line.
    """
    keys: dict[str, list[StagedGesture]] = {}
    for gesture in gestures:
        keys.setdefault(gesture.key, []).append(gesture)
    reported: set[Place] = set()
    for on_key in keys.values():
        sorted_gestures = sorted(
            (g for g in on_key if not g.layer), key=lambda gesture: gesture.start
        )
        for latest, gesture in pairwise(sorted_gestures):
            if gesture.start < latest.stop - _SEAM_SECONDS and gesture.place not in reported:
                reported.add(gesture.place)
                _tell_cut(piece, latest, gesture, collector)
        tracked = [gesture for gesture in sorted_gestures if gesture.tracked]
        for layer in (gesture for gesture in on_key if gesture.layer and tracked):
            gestures_below = (g for g in tracked if g.start < layer.stop and layer.start < g.stop)
            path = next(gestures_below, None)
            if path is not None and layer.place not in reported:
                reported.add(layer.place)
                message = (
                    f"{quote(layer.name)} is a layer over {quote(path.name)}, which is tracked: "
                    "the key stays on the tracked path, so the layer has no effect"
                )
                collector.error("W313", message, layer.place)


def _tell_cut(
    piece: Piece, latest: StagedGesture, gesture: StagedGesture, collector: Collector
) -> None:
    tempo = piece.tempo_map
    subject = "itself" if latest.place == gesture.place else quote(latest.name)
    start_text, stop_text = (tempo.written(tempo.beats(t)) for t in (gesture.start, latest.stop))
    help = "write `layer: true` to play both"
    if gesture.player != latest.player:
        subject += f" of {quote(latest.player)} on key {quote(gesture.key)}"
        help += ", or give each player a key"
    message = f"{quote(gesture.name)} at {start_text} cuts {subject}, which lasts until {stop_text}"
    collector.error("W310", message, gesture.place, help=help)
