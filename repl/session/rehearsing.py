"""A gesture alone on a key: whether the key can follow it, and how it does."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from ergon.scores.staging.recording_stages import solo
from ergon.scores.staging.refusals import StageError

if TYPE_CHECKING:
    from ergon.scores.gesture.transforms import Transform
    from ergon.scores.reading.piece import Piece
    from ergon.scores.staging.stage import Stage


def rehearsal_stage(piece: Piece, gesture_name: str) -> Stage | None:
    """A stage with a gesture alone on the first key that plays it; all other keys that play it are
    tried too.

    A gesture without a player needs one key that can follow it; None if there is no key. Raises
    StageError.
    """
    options_by_play = {
        (piece.players[play.player].key, _without_offsets(chain), play.options): (
            play.options,
            chain,
        )
        for play in piece.parts
        if gesture_name in play.names
        for chain in play.transform_chains
    }
    if not options_by_play:
        return _first_possible_stage(piece, gesture_name)
    keys_and_gestures = _keys_and_gestures(piece)
    first_stage, *_ = [
        solo(keys_and_gestures, gesture_name, key, transforms, manner)
        for (key, *_), (manner, transforms) in options_by_play.items()
    ]
    return first_stage


def keys_for(piece: Piece, gesture_name: str) -> list[str]:
    """The keys that can follow a gesture as it is written."""
    keys_and_gestures = _keys_and_gestures(piece)
    return [
        key
        for key in piece.keys
        if not isinstance(_try_key(keys_and_gestures, gesture_name, key), StageError)
    ]


def _first_possible_stage(piece: Piece, gesture_name: str) -> Stage | None:
    keys_and_gestures, refusal = _keys_and_gestures(piece), None
    for key in piece.keys:
        trial_stage = _try_key(keys_and_gestures, gesture_name, key)
        if not isinstance(trial_stage, StageError):
            return trial_stage
        refusal = refusal or trial_stage
    if refusal is not None:
        raise refusal
    return None


def _try_key(keys_and_gestures: Piece, gesture_name: str, key: str) -> Stage | StageError:
    try:
        return solo(keys_and_gestures, gesture_name, key)
    except StageError as error:
        return error


def _keys_and_gestures(piece: Piece) -> Piece:
    """The piece with nothing but keys, gestures and takes."""
    mix = replace(piece.mix, routes=(), channels=1)
    return replace(piece, instruments={}, duet=(), strikes=(), mix=mix)


def _without_offsets(transforms: tuple[Transform, ...]) -> tuple[Transform, ...]:
    return tuple(replace(transform, offset=0) for transform in transforms)
