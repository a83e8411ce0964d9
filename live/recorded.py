"""What live hands did once: positions for a render, and the level that was heard."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ergon import _core
from ergon.common.errors import ErgonError
from ergon.common.regular import open_regular
from ergon.rendering.level import Level

from .perform import PlaybackConfig

_LOUDEST = 1e12  # no gain, and no frequency, is larger

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from ergon.scores.reading.piece import Piece


class NotThisError(ErgonError):
    """A recording that cannot be played with this piece."""


@dataclass(frozen=True, slots=True)
class Recorded:
    """Hands by player: where each was at every tick (n_ticks,) [m]; NaN before the first tick.

    `level` is what was heard; `doubts` are sentences.
    """

    hands: dict[str, NDArray[np.float64]]
    level: Level
    doubts: tuple[str, ...]


def read(path: Path, piece: Piece) -> Recorded:
    """A recording of hands that played this piece. Raises NotThisError."""
    import numpy as np

    from ergon.exchange.recording import NotRecordingError, about, from_start
    from ergon.scores.staging.live import TICK

    try:
        open_regular(path).close()  # the core would wait for a pipe's other end
        recording = _core.read_recording(path)
    except (_core.EngineError, OSError) as error:
        raise NotThisError(f"{path}: {error}") from None
    if recording.rate != piece.rate:
        asked = f"--rate {recording.rate:g}"
        raise NotThisError(f"{path}: made at {recording.rate:g} Hz; {asked} renders as it was")
    try:
        positions = from_start(recording)
    except NotRecordingError as error:
        raise NotThisError(f"{path}: {error}") from None
    positions[: int(recording.ticks()[0])] = np.nan
    hands = {}
    for index, (player, key) in enumerate(recording.axes):
        if player not in piece.players or piece.players[player].key != key:
            raise NotThisError(f"{path}: it is of {player} on {key}, whom this score does not have")
        ticks = round(piece.rate / (piece.players[player].tick or TICK))
        if ticks != recording.frames:
            raise NotThisError(
                f"{path}: its ticks are of {recording.frames} frames, the score's of {ticks}"
            )
        hands[player] = np.ascontiguousarray(positions[:, index])
    said = about(recording)
    return Recorded(hands, _level(said), tuple(_doubts(recording, said, piece)))


def _level(said: dict[str, Any]) -> Level:
    """As it was heard; what is not said is as it is."""
    level = said.get("level")
    level = level if isinstance(level, dict) else {}

    def number(name: str) -> float | None:
        value = level.get(name)
        return float(value) if isinstance(value, int | float) and 0.0 < value < _LOUDEST else None

    return Level(None, number("limit"), number("highpass"), number("gain") or 1.0)


def _doubts(recording: _core.Recording, said: dict[str, Any], piece: Piece) -> list[str]:
    doubts = []
    score = said.get("score")
    digest = score.get("sha256") if isinstance(score, dict) else None
    if digest is not None and digest != piece.digest():
        doubts.append("the score has changed since: it will not sound as it did")
    if said.get("seed", piece.seed) != piece.seed:
        doubts.append(f"its chance was drawn from seed {said['seed']}: add --seed {said['seed']}")
    if recording.damage:
        doubts.append(recording.damage)
    if any('"gain"' in line for _, line in recording.events):
        doubts.append("gains were moved while it was made: those it began with are used")
    if recording.dropped:
        doubts.append(f"{recording.dropped} rows found no room while it was made")
    return doubts


def about(config: PlaybackConfig) -> dict[str, object]:
    """What a recording keeps of how it was heard."""
    return {"gain": config.gain, "limit": config.limit, "highpass": config.highpass}
