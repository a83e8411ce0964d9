"""Where a sound has faded: the end of a file whose score says `tail: auto`."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

_FADED = 1e-4  # of the highest peak: -80 dB
_WINDOW = 0.1  # [s]
_WINDOWS = 10  # so many in a row: what beats comes back sooner


class FadeFinder:
    """Looks for the first tenth of a second, after frame `start`, that begins a quiet second.

    Quiet is 80 dB below the highest peak before. The place does not depend on the size of blocks.
    """

    def __init__(self, rate: float, start: int) -> None:
        """Of frames at `rate` [Hz], counted from 0."""
        self._window = max(1, int(_WINDOW * rate + 0.5))
        self._start = start
        self._at, self._quiet = 0, 0
        self._peak = self._loudest = 0.0

    def take(self, block: NDArray[np.float64]) -> int | None:
        """Take (n_frames, n_channels); the frame at which it has faded, once that is known."""
        import numpy as np

        done = 0
        while done < len(block):
            count = min(self._window - self._at % self._window, len(block) - done)
            part = block[done : done + count]
            self._loudest = max(self._loudest, float(np.max(np.abs(part), initial=0.0)))
            self._at += count
            done += count
            if self._at % self._window:
                continue
            self._peak = max(self._peak, self._loudest)
            is_after = self._at - self._window >= self._start
            is_quiet = is_after and self._loudest <= _FADED * self._peak
            self._quiet = self._quiet + 1 if is_quiet else 0
            self._loudest = 0.0
            if self._quiet == _WINDOWS:
                return self._at - (_WINDOWS - 1) * self._window
        return None
