"""The path that a score gives a key, as the gesture that judges the key's model."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from . import options
from .console import Console
from .outcome import Refused

if TYPE_CHECKING:
    from ergon.scores.reading.piece import Piece
    from ergon.workshop.metrology.gesture import Floats

_GESTURE_SECONDS_MIN = 2.0  # s of a gesture
_MOVEMENT_MIN = 1e-6  # m: less is no movement yet

chosen = options.several(
    click.option(
        "--score",
        metavar="SCORE",
        help="Move the key along what this score plays on it, instead of knocks, for up to 8 s.",
    ),
    click.option("--key", metavar="KEY", help="Which key of the score; not needed for its only."),
)


def played_path(console: Console, score: str | None, key_name: str | None) -> Floats | None:
    """The path of the key in the score, by ticks (n,) [m], from its first movement on.

    None without a score. Raises Refused if the score plays nothing on the key.
    """
    if score is None:
        if key_name is not None:
            raise Refused("--key names a key of a score; write --score too")
        return None
    import numpy as np

    from ergon.api import score as scores
    from ergon.api.options import ReadOptions
    from ergon.notation.text.errors import Collector
    from ergon.scores.staging.live import standin_positions
    from ergon.workshop.metrology.ladder import TICK_RATE
    from ergon.workshop.metrology.takes import HELD_OUT_DURATION

    loaded = scores.read(score, ReadOptions(), console)
    piece = scores.piece_of(loaded)
    moved_key = _moved_key(piece, key_name)
    tick_frames = max(1, round(piece.rate / TICK_RATE))
    for player in piece.players.values():
        if player.key != moved_key:
            continue
        with scores.staging(lambda: loaded, console):
            positions = standin_positions(piece, player, tick_frames, Collector())
        moving_indices = np.flatnonzero(np.abs(positions - positions[0]) > _MOVEMENT_MIN)
        if moving_indices.size:
            positions = positions[max(0, int(moving_indices[0]) - 1) :]
            instants = np.arange(len(positions)) * (tick_frames / piece.rate)
            resampled_seconds = min(
                HELD_OUT_DURATION, max(float(instants[-1]), _GESTURE_SECONDS_MIN)
            )
            # Resampled to the ticks of a measurement; after its end the path keeps its last
            # position.
            return np.interp(
                np.arange(round(resampled_seconds * TICK_RATE)) / TICK_RATE, instants, positions
            )
    raise Refused(f"{score}: nothing moves the key {moved_key}")


def _moved_key(piece: Piece, key_name: str | None) -> str:
    played_keys = list(dict.fromkeys(player.key for player in piece.players.values()))
    if key_name is None and len(played_keys) == 1:
        return played_keys[0]
    played_keys_text = (
        f"its players have {', '.join(played_keys)}" if played_keys else "it has no players"
    )
    if key_name is None:
        raise Refused(f"choose a key of the score by --key: {played_keys_text}")
    if key_name not in played_keys:
        raise Refused(f"--key: no player of the score has the key '{key_name}'; {played_keys_text}")
    return key_name
