"""Finds gestures that cut others: a key plays one at a time, unless it is a layer."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

from ergon.notation.text.errors import Collector, quote
from ergon.notation.text.values import Place
from ergon.scores.reading.piece import Piece
from ergon.scores.staging.hands import StagedGesture

# Overlaps up to this time, which jitter makes between repetitions, are not reported [s].
_JOIN_SECONDS = 0.02


def check_overlaps(piece: Piece, gestures: Sequence[StagedGesture], collector: Collector) -> None:
    """Report gestures that begin before the previous one has ended (W310), and layers over a
    tracked gesture (W313), once for each line.
    """
    gestures_by_key: dict[str, list[StagedGesture]] = {}
    for gesture in gestures:
        gestures_by_key.setdefault(gesture.key, []).append(gesture)
    reported_places: set[Place] = set()
    for key_gestures in gestures_by_key.values():
        sorted_gestures = sorted(
            (gesture_on_key for gesture_on_key in key_gestures if not gesture_on_key.is_layer),
            key=lambda gesture: gesture.start,
        )
        for earlier_gesture, gesture in pairwise(sorted_gestures):
            if (
                gesture.start < earlier_gesture.stop - _JOIN_SECONDS
                and gesture.place not in reported_places
            ):
                reported_places.add(gesture.place)
                _report_cut(piece, earlier_gesture, gesture, collector)
        tracked_gestures = [gesture for gesture in sorted_gestures if gesture.is_tracked]
        for layer in (gesture for gesture in key_gestures if gesture.is_layer and tracked_gestures):
            gestures_below = (
                gesture_on_key
                for gesture_on_key in tracked_gestures
                if gesture_on_key.start < layer.stop and layer.start < gesture_on_key.stop
            )
            tracked_gesture = next(gestures_below, None)
            if tracked_gesture is not None and layer.place not in reported_places:
                reported_places.add(layer.place)
                message = (
                    f"{quote(layer.name)} is a layer over {quote(tracked_gesture.name)}, which is "
                    "tracked: the key stays on the tracked path, so the layer has no effect"
                )
                collector.error("W313", message, layer.place)


def _report_cut(
    piece: Piece, earlier_gesture: StagedGesture, gesture: StagedGesture, collector: Collector
) -> None:
    tempo = piece.tempo_map
    subject = "itself" if earlier_gesture.place == gesture.place else quote(earlier_gesture.name)
    start_text, stop_text = (
        tempo.written(tempo.beats(instant)) for instant in (gesture.start, earlier_gesture.stop)
    )
    help_text = "write `layer: true` to play both"
    if gesture.player != earlier_gesture.player:
        subject += f" of {quote(earlier_gesture.player)} on key {quote(gesture.key)}"
        help_text += ", or give each player a key"
    message = f"{quote(gesture.name)} at {start_text} cuts {subject}, which lasts until {stop_text}"
    collector.error("W310", message, gesture.place, help=help_text)
