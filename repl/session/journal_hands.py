"""Real hands in a journal: which device plays which key, and the recording of the hands."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ergon import _core
from ergon.exchange.recording import NotRecordingError, positions_from_start
from ergon.repl.session.engine import RecordedHand
from ergon.repl.session.journal import FRAME_MAX, JournalError, JournalEvent

if TYPE_CHECKING:
    from ergon.scores.staging.stage import Stage

_AXIS_MAX = 1 << 10
_HANDS_MAX = 64  # axes of a recording
_RECORDING_SUFFIX = ".take"


@dataclass(frozen=True, slots=True)
class JournalHand:
    """A real hand: its player and key, and the device and axis that play it from frame
    `start_frame` on.
    """

    player: str
    key: str
    device: str
    axis: int
    start_frame: int = 0


@dataclass(frozen=True, slots=True)
class JournalTake:
    """The recording of a session's real hands, a file beside the journal."""

    path: Path
    hands: tuple[JournalHand, ...]

    def fields(self) -> dict[str, object]:
        """The fields of the journal's first event."""
        hand_rows = [
            {
                "player": hand.player,
                "key": hand.key,
                "device": hand.device,
                "axis": hand.axis,
                "start": hand.start_frame,
            }
            for hand in self.hands
        ]
        return {"take": self.path.name, "hands": hand_rows}


@dataclass(frozen=True, slots=True)
class RecordedHands:
    """The movement of real hands: their positions, the number of recorded frames, and warnings."""

    hands: tuple[RecordedHand, ...]
    n_frames: int
    warnings: tuple[str, ...]


def read_take(first_event: JournalEvent, journal: Path) -> JournalTake | None:
    """The recording named by a journal's first event; None without real hands.

    Raises JournalError.
    """
    if "take" not in first_event.fields:
        return None
    take_name = first_event.get("take", str)
    if (
        Path(take_name).name != take_name
        or Path(take_name).suffix != _RECORDING_SUFFIX
        or "\\" in take_name
        or "\0" in take_name
    ):
        first_event.refuse(
            f"the field 'take' is not the name of a {_RECORDING_SUFFIX} file beside the journal"
        )
    hand_rows = first_event.get("hands", list)
    if not 1 <= len(hand_rows) <= _HANDS_MAX or not all(
        isinstance(hand_data, dict) for hand_data in hand_rows
    ):
        first_event.refuse("the field 'hands' has the wrong type or value")
    hand_events = [
        JournalEvent(first_event.file, first_event.number, first_event.name, hand_data)
        for hand_data in hand_rows
    ]
    hands = tuple(
        JournalHand(
            hand_event.get("player", str),
            hand_event.get("key", str),
            hand_event.get("device", str),
            hand_event.number_of("axis", int, 0, _AXIS_MAX),
            hand_event.number_of("start", int, 0, FRAME_MAX, 0),
        )
        for hand_event in hand_events
    )
    return JournalTake(journal.parent / take_name, hands)


def recorded_hands(take: JournalTake, stage: Stage, tick_frames: int) -> RecordedHands:
    """The movement of a stage's real hands, in ticks of `tick_frames`. Raises JournalError."""
    import numpy as np

    recording = _read_recording(take)
    player_names = ", ".join(hand.player for hand in take.hands)
    axes = [(hand.player, hand.key) for hand in stage.live_hands]
    if recording.rate != stage.rate or recording.frames != tick_frames or recording.axes != axes:
        raise JournalError(f"{take.path} does not record {player_names} of this session")
    try:
        tick_positions = positions_from_start(recording)
    except NotRecordingError as error:
        raise JournalError(f"{take.path}: {error}") from None
    hands = tuple(
        RecordedHand(hand.index, hand.reach, np.ascontiguousarray(tick_positions[:, hand_index]))
        for hand_index, hand in enumerate(stage.live_hands)
    )
    return RecordedHands(
        hands, len(tick_positions) * tick_frames, tuple(_recording_warnings(take, recording))
    )


def _read_recording(take: JournalTake) -> _core.Recording:
    try:
        return _core.read_recording(take.path)
    except FileNotFoundError:
        player_names = ", ".join(hand.player for hand in take.hands)
        raise JournalError(
            f"{take.path} is missing: it records what {player_names} did, and the session cannot "
            "be computed without it"
        ) from None
    except (_core.EngineError, OSError) as error:
        raise JournalError(f"{take.path}: {error}") from None


def _recording_warnings(take: JournalTake, recording: _core.Recording) -> Sequence[str]:
    warnings = []
    if recording.damage:
        warnings.append(f"{take.path}: {recording.damage}")
    if recording.dropped:
        warnings.append(f"{take.path}: {recording.dropped} rows were lost while it was recorded")
    return warnings
