"""From mixed frames to finished samples: spool until the peak is known, gain, limiter, cut."""

from __future__ import annotations

import hashlib
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Protocol, Self

from ergon.exchange.wave_header import WaveFormat

from .edges import NO_EDGES_FADED, Edges
from .limiting import FrameLimiter
from .silence import FadedSilence, apply_silences

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

# Below what loudspeakers can play: the constant offset of a leaning hand would only displace their
# cones.
HIGHPASS_HZ = 8.0  # [Hz]
_SPOOL_BYTES = 1 << 28  # frames in memory: 95 s of 8 channels at 44.1 kHz


@dataclass(frozen=True, slots=True)
class Level:
    """Highest peak of the piece and ceiling of the limiter, as ratios; default high-pass [Hz].

    `gain` (a ratio) applies if neither a peak nor a `loudness` [LUFS] is asked for. `reference`
    is the ratio of full scale at which reference quantities are heard; None if samples are in SI
    units.
    """

    normalise: float | None = None
    limit: float | None = None
    highpass: float | None = None
    gain: float = 1.0
    reference: float | None = None
    loudness: float | None = None

    @property
    def is_levelled(self) -> bool:
        """Whether the gain follows from what the whole piece measures."""
        return self.normalise is not None or self.loudness is not None


def ceiling_gain(peak: float, ceiling: float) -> float:
    """The largest gain that keeps `peak` under `ceiling`; infinite for silence."""
    return ceiling / peak if peak > 0 else float("inf")


class FrameSpool:
    """Frames in memory, and what is too much for it in an unnamed raw file, so that nothing stays
    on the disk however the run ends.
    """

    def __init__(
        self, folder: Path | None, n_channels: int, n_bytes_in_memory: int = _SPOOL_BYTES
    ) -> None:
        """Hold frames; `peak` and `n_frames` are those of all."""
        self._blocks: list[NDArray[np.float64]] = []
        self._n_bytes_left = n_bytes_in_memory
        self._file = tempfile.TemporaryFile(dir=folder)  # noqa: SIM115 - closed by __exit__
        self._n_channels = n_channels
        self.peak = 0.0
        self.n_frames = 0

    def __enter__(self) -> Self:
        """Begin."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Free the disk space."""
        self._file.close()

    def take(self, block: NDArray[np.float64]) -> None:
        """Append (n_frames, n_channels), which must not change any more."""
        import numpy as np

        self.peak = max(self.peak, float(block.max(initial=0.0)), -float(block.min(initial=0.0)))
        self.n_frames += len(block)
        self._n_bytes_left -= block.nbytes
        if self._n_bytes_left >= 0:
            self._blocks.append(block)
        else:
            self._file.write(np.ascontiguousarray(block).data)

    def blocks(self, n_frames: int) -> Iterator[NDArray[np.float64]]:
        """All of it from the beginning, in the blocks that came, and then `n_frames` at a time."""
        import numpy as np

        yield from self._blocks
        self._file.seek(0)
        frame_bytes = 8 * self._n_channels
        while data := self._file.read(n_frames * frame_bytes):
            yield np.frombuffer(data).reshape(-1, self._n_channels)


class Writer(Protocol):
    """Takes finished samples in the order of the piece: `WaveWriter`, `ArrayWriter`."""

    @property
    def format(self) -> WaveFormat:
        """Rate, channels and form of the samples."""

    @property
    def sha256(self) -> str:
        """Hash of the samples."""

    def write(self, samples: NDArray[Any]) -> None:
        """Append (n_frames, n_channels) in the form of the format."""

    def close(self) -> None:
        """End; nothing more comes."""


class ArrayWriter:
    """Samples into an array (n_frames, n_channels) of doubles."""

    def __init__(self, format: WaveFormat, frames: NDArray[np.float64]) -> None:
        """Fill `frames` from its beginning."""
        self.format = format
        self._frames, self._n_written = frames, 0

    @property
    def sha256(self) -> str:
        """Hash of the samples."""
        return hashlib.sha256(self._frames.data).hexdigest()

    def write(self, samples: NDArray[np.float64]) -> None:
        """Append (n_frames, n_channels)."""
        self._frames[self._n_written : self._n_written + len(samples)] = samples
        self._n_written += len(samples)

    def close(self) -> None:
        """End; nothing more comes."""


class MasterChain:
    """Gain, limiter, cut and meter before one writer; the meter measures the written samples."""

    def __init__(
        self,
        writer: Writer,
        rate: float,
        start: int,
        stop: int,
        limiter: FrameLimiter | None,
        silences: Sequence[FadedSilence] = (),
        first_frame: int = 0,
        edges: Edges = NO_EDGES_FADED,
    ) -> None:
        """Write frames `start` to `stop` of the piece; `take` begins at `first_frame`."""
        import numpy as np

        from ergon import _core

        n_channels = writer.format.n_channels
        self.gain = 1.0
        self._writer = writer
        self._meter = _core.Meter(rate, n_channels)
        self._true_peak = _core.TruePeak(n_channels)
        self._limiter = limiter
        self.latency = limiter.latency if limiter is not None else 0
        # The index in the piece of the next frame that leaves the limiter.
        self._output_frame = first_frame - self.latency
        self._start, self._stop = start, stop
        self._rate, self._silences, self._edges = rate, silences, edges
        self._scaled_buffer: NDArray[np.float64] = np.empty((0, n_channels))

    @property
    def peak(self) -> float:
        """Largest sample written, 1 at full scale."""
        return self._meter.peak

    @property
    def true_peak(self) -> float:
        """Largest value between the samples written, 1 at full scale."""
        return self._true_peak.peak

    @property
    def loudness(self) -> float:
        """Integrated loudness of the written samples [LUFS]."""
        return self._meter.loudness

    @property
    def sha256(self) -> str:
        """Hash of the samples."""
        return self._writer.sha256

    def take(self, block: NDArray[np.float64]) -> None:
        """Process the next frames (n_frames, n_channels) of the piece."""
        import numpy as np

        from ergon import _core

        if len(self._scaled_buffer) < len(block):
            self._scaled_buffer = np.empty(block.shape)
        block_frames = np.multiply(block, self.gain, out=self._scaled_buffer[: len(block)])
        if self._limiter is not None:
            block_frames = self._limiter.limit(block_frames)
        played_frames = np.ascontiguousarray(
            block_frames[
                max(self._start - self._output_frame, 0) : max(self._stop - self._output_frame, 0)
            ]
        )
        played_start = max(self._start, self._output_frame)
        self._output_frame += len(block_frames)
        if not len(played_frames):
            return
        played_frames = np.ascontiguousarray(
            apply_silences(played_frames, played_start, self._silences, self._rate)
        )
        played_frames = self._edges.fade(
            played_frames, played_start, self._start, self._stop, self._rate
        )
        self._meter.process(played_frames)
        self._true_peak.process(played_frames)
        bits = self._writer.format.bits
        if bits == "float":
            self._writer.write(_core.single(played_frames, 1.0))
        elif bits == "double":
            self._writer.write(played_frames)
        else:
            self._writer.write(_core.pcm(played_frames, 1.0, 16 if bits == 16 else 24))

    def close(self) -> None:
        """Push out what the limiter still holds, and end the file."""
        import numpy as np

        if self._output_frame < self._stop:
            self.take(np.zeros((self._stop - self._output_frame, self._writer.format.n_channels)))
        self._writer.close()
