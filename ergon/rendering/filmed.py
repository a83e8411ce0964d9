"""A simulation whose motion is written to a file while it sounds, for `ergon render --motion`.

Motion is sampled once per video frame. Requests for samples are split at these frames, which
changes no sample. The last sampled frame is known beforehand, so the bytes depend neither on the
size of blocks nor on the number of threads.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from ergon._core import MotionRecorder, Simulation

    from .staged import Mixer


@dataclass(frozen=True, slots=True)
class MotionRecording:
    """A motion file that is to be written: the last frame at which motion is sampled, and the
    function that starts its recorder.
    """

    path: Path
    last_sample_frame: int
    n_channels: int
    start_recorder: Callable[[Simulation], MotionRecorder]


class FilmedSimulation:
    """A simulation at frame 0, whose motion goes into a file; `mixer` gives the levels stored
    there.
    """

    def __init__(
        self, simulation: Simulation, film: MotionRecording, mixer: Mixer, file: BinaryIO
    ) -> None:
        """Begin the recording; nothing is written yet."""
        self._simulation, self._film, self._mixer, self._file = simulation, film, mixer, file
        self._recorder = film.start_recorder(simulation)

    @property
    def n_out(self) -> int:
        """How many outputs a frame has."""
        return self._simulation.n_out

    def process(self, out: NDArray[np.float64]) -> None:
        """Fill (n_frames, n_out) with the next frames. Raises DivergedError."""
        import numpy as np

        while len(out):
            frame, last_sample_frame = self._simulation.frame, self._film.last_sample_frame
            self._sample_if_due()
            if frame >= last_sample_frame:
                self._simulation.process(out)
                return
            frame_count = min(len(out), min(self._recorder.next, last_sample_frame) - frame)
            self._simulation.process(out[:frame_count])
            mixed = np.zeros((frame_count, self._film.n_channels))
            self._mixer.process(out[:frame_count], mixed)
            self._recorder.hear(mixed)
            out = out[frame_count:]

    def finish(self) -> None:
        """Run to the last frame at which motion is sampled, and end the file."""
        import numpy as np

        while (frames_left := self._film.last_sample_frame - self._simulation.frame) > 0:
            self.process(np.zeros((min(frames_left, 4096), self.n_out)))
        self._sample_if_due()
        self._file.write(self._recorder.finish())

    def _sample_if_due(self) -> None:
        """Sample the motion if this frame is due."""
        frame = self._simulation.frame
        if frame == self._recorder.next and frame <= self._film.last_sample_frame:
            self._recorder.look(self._simulation)
            self._file.write(self._recorder.take())
