"""The silence of a panic as the sound card played it: a fade-out, zeros, and a fade-in."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

_FALL, _RISE = 0.005, 0.002  # [s], as `audio/output_fades` of the live core


@dataclass(frozen=True, slots=True)
class Silence:
    """From frame `start`, where the sound fades out, to frame `stop`, where it fades in; None: no
    end.
    """

    start: int
    stop: int | None = None


def apply_silences(
    frames: NDArray[np.float64], first_frame: int, silences: Sequence[Silence], rate: float
) -> NDArray[np.float64]:
    """Frames (n_frames, n_channels), of which the first is number `first_frame`, with the silences
    applied.

    Fades are computed in single precision, as they were heard.
    """
    import numpy as np

    fall, rise = (max(1, int(rate * seconds + 0.5)) for seconds in (_FALL, _RISE))
    end = first_frame + len(frames)
    for silence in silences:
        stop = end if silence.stop is None else silence.stop
        if silence.start >= end or stop + rise <= first_frame:
            continue
        frame_numbers = np.arange(first_frame, end)
        gains = np.ones(len(frame_numbers), np.float32)
        frames_until_silent = np.clip(silence.start + fall - 1 - frame_numbers, 0, fall).astype(
            np.float32
        )
        frames_since_stop = np.clip(frame_numbers - stop + 1, 0, rise).astype(np.float32)
        gains[frame_numbers >= silence.start] = (frames_until_silent / np.float32(fall))[
            frame_numbers >= silence.start
        ]
        gains[frame_numbers >= stop] = (frames_since_stop / np.float32(rise))[frame_numbers >= stop]
        is_shaped = gains != 1.0
        frames = frames.copy()
        single = frames[is_shaped].astype(np.float32) * gains[is_shaped, None]
        frames[is_shaped] = single.astype(np.float64)
    return frames
