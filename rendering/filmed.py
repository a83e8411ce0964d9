"""A simulation whose motion is written down while it sounds, for `ergon render --motion`.

It is looked at once a video frame. The blocks in which it is asked for samples are cut where it is
looked at, which changes no sample; and it is looked at up to a frame that is known beforehand, so
that the bytes depend neither on the size of blocks nor on the number of threads.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


class _Mixer(Protocol):
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
