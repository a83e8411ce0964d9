"""Takes: the movement of a real hand between `record` and `record off`, for written players."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ergon import _core
from ergon.exchange.safe import FileRefusedError, open_for_writing
from ergon.notation.text.files import is_below
from ergon.repl.session.version import NotTakenError

if TYPE_CHECKING:
    from ergon.repl.session.schedule import Schedule

# The recording is written five times a second; a take is read this long after its end [s].
_WRITE_DELAY = 0.6


@dataclass(slots=True)
class Capture:
    """A take from frame `start_frame` to `stop_frame`, which is None while it is being recorded."""

    player: str
    name: str
    start_frame: int
    stop_frame: int | None = None
    n_missing: int = 0  # ticks that were not recorded, once it is written

    def seconds(self, frame: int, rate: float) -> float | None:
        """Its length so far [s]; None before it begins."""
        return None if frame < self.start_frame else (frame - self.start_frame) / rate


@dataclass(slots=True)
class Captures:
    """Takes, one at a time, cut out of the recording of all hands that a session writes.

    `hands_recording` is its file; None if no hand is real.
    """

    hands_recording: Path | None
    current: Capture | None = None

    def begin(self, player: str, name: str, start_frame: int) -> None:
        """Begin a take at a frame. Raises NotTakenError."""
        if self.current is not None:
            raise NotTakenError(
                f"the take {self.current.name} is still being recorded", "record off"
            )
        self.current = Capture(player, name, start_frame)

    def end(self, stop_frame: int) -> Capture:
        """End the take at a frame. Raises NotTakenError."""
        if self.current is None:
            raise NotTakenError("no take is being recorded; `record PLAYER as NAME` begins one")
        if stop_frame <= self.current.start_frame:
            self.current = None
            raise NotTakenError("the take ended before it began: nothing was recorded")
        self.current.stop_frame = stop_frame
        return self.current

    def pop_ready(self, schedule: Schedule) -> Capture | None:
        """The take that has ended and whose recording is on the disk, once; else None."""
        capture = self.current
        if capture is None or capture.stop_frame is None:
            return None
        if schedule.engine.frame < capture.stop_frame + _WRITE_DELAY * schedule.rate:
            return None
        self.current = None
        return capture

    def write(self, capture: Capture, folder: Path, tick_frames: int) -> Path:
        """Write a take beside the score. Raises NotTakenError."""
        assert self.hands_recording is not None
        assert capture.stop_frame is not None
        take_path = folder / "takes" / f"{capture.name}.take"
        try:
            tick_span = capture.start_frame // tick_frames, capture.stop_frame // tick_frames
            recording = _core.read_recording(self.hands_recording, tick_span)
            if not len(recording.ticks()):
                raise NotTakenError(
                    f"the take {capture.name} was not written: nothing of it was recorded"
                )
            capture.n_missing = tick_span[1] - tick_span[0] - len(recording.ticks())
            if not is_below(take_path, folder):
                raise FileRefusedError(f"{take_path} is outside the folder of the score")
            if take_path.exists():
                raise FileRefusedError(f"{take_path} exists already")
            with open_for_writing(take_path, binary=True, replaceable=False) as file:
                file.write(recording.to_bytes())
        except (FileRefusedError, _core.EngineError, OSError) as error:
            raise NotTakenError(f"the take {capture.name} was not written: {error}") from None
        return take_path
