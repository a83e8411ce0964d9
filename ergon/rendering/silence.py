"""The silence of a panic as the sound card played it: a fade-out, zeros, and a fade-in."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

_FADE_OUT_SECONDS, _FADE_IN_SECONDS = 0.005, 0.002  # [s], as `audio/output_fades` of the live core


@dataclass(frozen=True, slots=True)
class FadedSilence:
    """From frame `start`, where the sound fades out, to frame `stop`, where it fades in; None: no
    end.
    """

    start: int
    stop: int | None = None


def apply_silences(
    silenced_frames: NDArray[np.float64],
    first_frame: int,
    silences: Sequence[FadedSilence],
    rate: float,
) -> NDArray[np.float64]:
    """Frames (n_frames, n_channels), of which the first is number `first_frame`, with the silences
    applied.

    Fades are computed in single precision, as they were heard.
    """
    import numpy as np

    fade_out_frames, fade_in_frames = (
        max(1, int(rate * seconds + 0.5)) for seconds in (_FADE_OUT_SECONDS, _FADE_IN_SECONDS)
    )
    end_frame = first_frame + len(silenced_frames)
    for silence in silences:
        stop_frame = end_frame if silence.stop is None else silence.stop
        if silence.start >= end_frame or stop_frame + fade_in_frames <= first_frame:
            continue
        frame_numbers = np.arange(first_frame, end_frame)
        frame_gains = np.ones(len(frame_numbers), np.float32)
        frames_until_silent = np.clip(
            silence.start + fade_out_frames - 1 - frame_numbers, 0, fade_out_frames
        ).astype(np.float32)
        frames_since_stop = np.clip(frame_numbers - stop_frame + 1, 0, fade_in_frames).astype(
            np.float32
        )
        frame_gains[frame_numbers >= silence.start] = (
            frames_until_silent / np.float32(fade_out_frames)
        )[frame_numbers >= silence.start]
        frame_gains[frame_numbers >= stop_frame] = (frames_since_stop / np.float32(fade_in_frames))[
            frame_numbers >= stop_frame
        ]
        is_shaped = frame_gains != 1.0
        silenced_frames = silenced_frames.copy()
        faded_frames = silenced_frames[is_shaped].astype(np.float32) * frame_gains[is_shaped, None]
        silenced_frames[is_shaped] = faded_frames.astype(np.float64)
    return silenced_frames
