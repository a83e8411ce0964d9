"""Edges of a file that begins or ends while something sounds: short fades instead of clicks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

_FADE_SECONDS = 0.005  # length of a fade


@dataclass(frozen=True, slots=True)
class Edges:
    """Which edges of a file are faded: the first frame, the last one."""

    is_first_faded: bool = False
    is_last_faded: bool = False

    def fade(
        self, frames: NDArray[np.float64], first_frame: int, start: int, stop: int, rate: float
    ) -> NDArray[np.float64]:
        """Frames (n_frames, n_channels) of a file from frame `start` to `stop` of the piece, with a
        raised cosine of 5 ms at its edges; the first of them is frame `first_frame`.
        """
        import numpy as np

        from ergon import _core

        fade_frames = min(int(rate * _FADE_SECONDS + 0.5), (stop - start) // 2)
        is_inside = (
            first_frame >= start + fade_frames and first_frame + len(frames) <= stop - fade_frames
        )
        if is_inside or not (self.is_first_faded or self.is_last_faded):
            return frames
        frame_numbers = np.arange(first_frame, first_frame + len(frames))
        distances = np.full(len(frames), fade_frames)
        if self.is_first_faded:
            distances = np.minimum(distances, frame_numbers - start)
        if self.is_last_faded:
            distances = np.minimum(distances, stop - 1 - frame_numbers)
        gains = np.ones(len(frames))
        is_faded = distances < fade_frames
        # The sine of numpy differs by its last bit from one processor to another.
        phases = 0.5 * np.pi * (distances[is_faded] + 0.5) / fade_frames
        gains[is_faded] = np.array([_core.sin(phase) for phase in phases]) ** 2
        return gains[:, None] * frames


NO_EDGES_FADED = Edges()
