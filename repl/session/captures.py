"""What a real hand does between two lines becomes a take, which written hands can play."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ergon import _core
from ergon.exchange.safe import FileRefusedError, writing
from ergon.notation.text.files import is_below
from ergon.repl.session.version import NotTakenError

if TYPE_CHECKING:
    from ergon.repl.session.commits import Commits

# What was done is read so long after it: the recording is written five times a second [s].
_SETTLED = 0.6


@dataclass(slots=True)
class Capture:
    """From frame `start` to `stop`; until then it goes on."""

    player: str
    name: str
    start: int
    stop: int | None = None

    def seconds(self, frame: int, rate: float) -> float | None:
        """How long it has lasted; None before it begins."""
        return None if frame < self.start else (frame - self.start) / rate


@dataclass(slots=True)
class Captures:
    """One take at a time, from the recording of all hands that a session writes.

    `path` is that recording, None where no hand is real.
    """

    path: Path | None
    now: Capture | None = None

    def begin(self, player: str, name: str, start: int) -> None:
        """A take begins at a frame. Raises NotTakenError."""
        if self.now is not None:
            raise NotTakenError(f"{self.now.name} is being recorded", "record off")
        self.now = Capture(player, name, start)

    def end(self, stop: int) -> Capture:
        """It ends at a frame. Raises NotTakenError."""
        if self.now is None:
            raise NotTakenError("nothing is being recorded")
        if stop <= self.now.start:
            self.now = None
            raise NotTakenError("it had not begun: nothing is kept")
        self.now.stop = stop
        return self.now

    def ready(self, commits: Commits) -> Capture | None:
        """A take that has ended and can be read."""
        own = self.now
        if own is None or own.stop is None:
            return None
        if commits.engine.frame < own.stop + _SETTLED * commits.rate:
            return None
        self.now = None
        return own

    def write(self, own: Capture, folder: Path, every: int) -> Path:
        """Write a take beside the score. Raises NotTakenError."""
        assert self.path is not None
        assert own.stop is not None
        target = folder / "takes" / f"{own.name}.take"
        try:
            found = _core.read_recording(self.path, (own.start // every, own.stop // every))
            if not is_below(target, folder):
                raise FileRefusedError(f"{target} leads out of the folder of the score")
            with writing(target, binary=True) as file:
                file.write(found.to_bytes())
        except (FileRefusedError, _core.EngineError, OSError) as error:
            raise NotTakenError(f"{own.name} is not kept: {error}") from None
        return target
