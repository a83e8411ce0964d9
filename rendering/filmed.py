"""A simulation whose motion is written down while it sounds, for `ergon render --motion`.

It is looked at once a video frame. The blocks in which it is asked for samples are cut where it is
looked at, which changes no sample; and it is looked at up to a frame that is known beforehand, so
that the bytes depend neither on the size of blocks nor on the number of threads.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO, Protocol

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from ergon._core import MotionRecorder, Simulation


class _Mixer(Protocol):
    def process(self, frames: NDArray[np.float64], mixed: NDArray[np.float64]) -> None:
        """(n_frames, n_out) to (n_frames, n_channels)."""


@dataclass(frozen=True, slots=True)
class Film:
    """The file of what moves, the last frame that is looked at, and what begins the recording."""

    path: Path
    stop: int
    n_channels: int
    begin: Callable[[Simulation], MotionRecorder]


class FilmedSimulation:
    """A simulation at frame 0, whose motion goes into a file; `mixer` is for the levels in it."""

    def __init__(self, simulation: Simulation, film: Film, mixer: _Mixer, file: BinaryIO) -> None:
        """Write manifest and tables."""
        self._simulation, self._film, self._mixer, self._file = simulation, film, mixer, file
        self._recorder = film.begin(simulation)

    @property
    def n_out(self) -> int:
        """How many outputs a frame has."""
        return self._simulation.n_out

    def process(self, out: NDArray[np.float64]) -> None:
        """Fill (n_frames, n_out) with the next frames. Raises DivergedError."""
        import numpy as np

        while len(out):
            frame, stop = self._simulation.frame, self._film.stop
            self._look()
            if frame >= stop:
                self._simulation.process(out)
                return
            count = min(len(out), min(self._recorder.next, stop) - frame)
            self._simulation.process(out[:count])
            mixed = np.zeros((count, self._film.n_channels))
            self._mixer.process(out[:count], mixed)
            self._recorder.hear(mixed)
            out = out[count:]

    def finish(self) -> None:
        """Go on to the last frame that is looked at, and end the file."""
        import numpy as np

        while (left := self._film.stop - self._simulation.frame) > 0:
            self.process(np.zeros((min(left, 4096), self.n_out)))
        self._look()
        self._file.write(self._recorder.finish())

    def _look(self) -> None:
        """Look at the simulation where that is due."""
        frame = self._simulation.frame
        if frame == self._recorder.next and frame <= self._film.stop:
            self._recorder.look(self._simulation)
            self._file.write(self._recorder.take())
