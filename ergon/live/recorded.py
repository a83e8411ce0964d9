"""A recording of live hands for a render: their positions, and the level at which it was heard."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ergon import _core
from ergon.common.errors import ErgonError
from ergon.rendering.level import Level
from ergon.scores.reading.digest import digest_of

from .perform import PlaybackConfig

_LEVEL_NUMBER_MAX = 1e12  # no gain, and no frequency, is larger

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from ergon.scores.reading.piece import Piece


class RecordingMismatchError(ErgonError):
    """A recording that cannot be played with this piece."""


@dataclass(frozen=True, slots=True)
class HandRecording:
    """Positions of hands by player: at every tick (n_ticks,) [m], NaN before the first tick.

    `level` is the level that was heard; `warnings` are sentences for the user.
    """

    positions: dict[str, NDArray[np.float64]]
    level: Level
    warnings: tuple[str, ...]


def read_hand_recording(path: Path, piece: Piece) -> HandRecording:
    """A recording of hands that played this piece. Raises RecordingMismatchError."""
    import numpy as np

    from ergon.exchange.recording import NotRecordingError, positions_from_start, read_description
    from ergon.scores.staging.live import TICK_HZ

    try:
        recording = _core.read_recording(path)
    except (_core.EngineError, OSError) as error:
        raise RecordingMismatchError(f"{path}: {error}") from None
    if recording.rate != piece.rate:
        rate_option = f"--rate {recording.rate:g}"
        raise RecordingMismatchError(
            f"{path}: recorded at {recording.rate:g} Hz, the score is at {piece.rate:g} Hz; "
            f"{rate_option} renders at the recorded rate"
        )
    try:
        tick_positions = positions_from_start(recording)
    except NotRecordingError as error:
        raise RecordingMismatchError(f"{path}: {error}") from None
    tick_positions[: int(recording.ticks()[0])] = np.nan
    positions_by_player = {}
    for axis_index, (player, key_name) in enumerate(recording.axes):
        if player not in piece.players or piece.players[player].key != key_name:
            raise RecordingMismatchError(
                f"{path}: it records {player} on {key_name}, which this score does not have"
            )
        tick_frames = round(piece.rate / (piece.players[player].tick or TICK_HZ))
        if tick_frames != recording.frames:
            raise RecordingMismatchError(
                f"{path}: its ticks last {recording.frames} frames, the score's {tick_frames}"
            )
        positions_by_player[player] = np.ascontiguousarray(tick_positions[:, axis_index])
    description = read_description(recording)
    return HandRecording(
        positions_by_player,
        _recorded_level(description),
        tuple(_warnings(recording, description, piece)),
    )


def _recorded_level(description: dict[str, Any]) -> Level:
    """The level that was heard; fields that the recording lacks have no effect."""
    level_fields = description.get("level")
    level_fields = level_fields if isinstance(level_fields, dict) else {}

    def level_number(name: str) -> float | None:
        level_value = level_fields.get(name)
        return (
            float(level_value)
            if isinstance(level_value, int | float) and 0.0 < level_value < _LEVEL_NUMBER_MAX
            else None
        )

    return Level(
        None,
        level_number("limit"),
        level_number("highpass"),
        level_number("gain") or 1.0,
        level_number("reference"),
    )


def _warnings(recording: _core.Recording, description: dict[str, Any], piece: Piece) -> list[str]:
    warnings = []
    score = description.get("score")
    digest = score.get("sha256") if isinstance(score, dict) else None
    if digest is not None and digest != digest_of(piece):
        warnings.append("the score has changed since the recording: it will sound differently")
    if description.get("seed", piece.seed) != piece.seed:
        warnings.append(
            f"it was made with seed {description['seed']}: add --seed {description['seed']} to "
            "hear the same"
        )
    if recording.damage:
        warnings.append(recording.damage)
    if any('"gain"' in line for _, line in recording.events):
        warnings.append("gains changed while it was recorded: those at its beginning are used")
    if recording.dropped:
        warnings.append(f"{recording.dropped} rows were lost while it was recorded")
    return warnings


def level_header(config: PlaybackConfig) -> dict[str, object]:
    """The level and filters to note in a recording."""
    return {
        "gain": config.gain,
        "limit": config.limit,
        "highpass": config.highpass,
        "reference": config.reference,
    }
