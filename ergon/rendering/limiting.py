"""The limiter of a mix, and stems that follow its gain so that they still add up to the mix."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

# The limiter multiplies this constant, in a channel of its own, by its gain. It is too small to be
# limited, and a power of two, so that no bit is lost.
_PROBE_AMPLITUDE = 2.0**-100


class FrameLimiter(Protocol):
    """Changes the level of frames, which come out `latency` frames late."""

    latency: int

    def limit(self, frames: NDArray[np.float64]) -> NDArray[np.float64]:
        """The next frames (n_frames, n_channels)."""


class MixLimiter:
    """The limiter of a mix; `gains` (n_frames) are those of the frames that came out last."""

    def __init__(self, rate: float, n_channels: int, ceiling: float) -> None:
        """Keep `n_channels` at `rate` [Hz] under `ceiling` (a ratio). Raises EngineError."""
        import numpy as np

        from ergon import _core

        self._limiter = _core.Limiter(rate, n_channels + 1, ceiling)
        self.latency = self._limiter.latency
        self.gains: NDArray[np.float64] = np.zeros(0)

    def limit(self, frames: NDArray[np.float64]) -> NDArray[np.float64]:
        """The next frames (n_frames, n_channels), limited."""
        import numpy as np

        frames_with_probe = np.concatenate(
            [frames, np.full((len(frames), 1), _PROBE_AMPLITUDE)], axis=1
        )
        self._limiter.process(frames_with_probe)
        self.gains = frames_with_probe[:, -1] / _PROBE_AMPLITUDE
        return np.ascontiguousarray(frames_with_probe[:, :-1])


class StemLimiter:
    """Gives a stem the gains of the mix; `limit` is called after that of the mix, with as many
    frames.
    """

    def __init__(self, mix: MixLimiter, n_channels: int) -> None:
        """Follow `mix`, with stems of `n_channels`."""
        import numpy as np

        self._mix = mix
        self.latency = mix.latency
        self._delayed_frames = np.zeros((mix.latency, n_channels))

    def limit(self, frames: NDArray[np.float64]) -> NDArray[np.float64]:
        """The next frames (n_frames, n_channels), as loud as in the mix."""
        import numpy as np

        delayed_and_new = np.concatenate([self._delayed_frames, frames])
        self._delayed_frames = delayed_and_new[len(frames) :]
        return delayed_and_new[: len(frames)] * self._mix.gains[:, None]
