"""Samples into and out of a WAVE file; the same frames always give the same bytes."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

from ergon.common.regular import open_regular

from .wave_header import (
    BYTES_BY_FORM,
    ORIGINATOR,
    RIFF_LIMIT,
    NotWaveError,
    Stamp,
    WaveFormat,
    WaveInfo,
    pack,
    parse,
    read_exactly,
)

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

_BLOCK_FRAMES = 65_536  # frames read at once
_BLOCK_BYTES = 1 << 24  # a file may have 65,535 channels
_CUT_SAMPLES_MESSAGE = "this file became shorter while it was read"


class WaveWriter:
    """Writes a header for exactly `n_frames`, then blocks until they are all there.

    The length is known before the first sample: nothing is patched afterwards, a pipe will do.
    `sha256` is of the sample bytes alone: it does not change with the title.
    """

    def __init__(
        self,
        file: BinaryIO,
        format: WaveFormat,
        n_frames: int,
        stamp: Stamp,
        *,
        riff_limit: int = RIFF_LIMIT,
    ) -> None:
        """Write the header at once; a file larger than `riff_limit` [bytes] is RF64."""
        self.format = format
        self._file = file
        self._frames_left = n_frames
        self._hash = hashlib.sha256()
        self._n_pad_bytes = (n_frames * format.frame_bytes) & 1
        file.write(pack(format, n_frames, stamp, riff_limit=riff_limit))

    @property
    def sha256(self) -> str:
        """Hash of the samples written so far, 64 hex digits."""
        return self._hash.hexdigest()

    def write(self, block: NDArray[np.int32] | NDArray[np.float32] | NDArray[np.float64]) -> None:
        """Append (n_frames, n_channels): int32 with the sample in its top bits, or floats."""
        n_frames, n_channels = block.shape
        if n_channels != self.format.n_channels:
            raise ValueError(f"{n_channels} channels for a file of {self.format.n_channels}")
        if n_frames > self._frames_left:
            raise ValueError(
                f"{n_frames - self._frames_left} frames more than the header announced"
            )
        data = encode(block, self.format)
        self._hash.update(data)
        self._file.write(data)
        self._frames_left -= n_frames

    def close(self) -> None:
        """Finish the last chunk. Raises ValueError when frames are missing."""
        if self._frames_left:
            raise ValueError(f"{self._frames_left} frames fewer than the header announced")
        self._file.write(bytes(self._n_pad_bytes))
        self._n_pad_bytes = 0


def encode(sample_block: NDArray[Any], format: WaveFormat) -> bytes:
    """The bytes of samples (n_frames, n_channels) in a file. Raises TypeError."""
    import numpy as np

    float_types = {"float": "<f4", "double": "<f8"}
    sample_type = np.dtype(float_types.get(str(format.bits), "<i4"))
    if sample_block.dtype != sample_type:
        raise TypeError(f"samples for {format.bits} bits come as {sample_type.name}")
    if format.bits in ("float", "double"):
        return sample_block.astype(sample_type, copy=False).tobytes()
    from ergon import _core

    return _core.packed(
        np.ascontiguousarray(sample_block, dtype=np.int32), BYTES_BY_FORM[format.bits]
    )


def read_info(path: Path) -> WaveInfo:
    """What the file says it holds. Raises NotWaveError or OSError."""
    with open_regular(path) as file:
        return parse(file)


def read_blocks(path: Path) -> Iterator[NDArray[np.float64]]:
    """The samples as (n_frames, n_channels) blocks; integers are scaled so that full scale is 1.

    Raises NotWaveError or OSError.
    """
    info = read_info(path)
    frame_bytes = info.format.frame_bytes
    block_bytes = min(_BLOCK_FRAMES, max(1, _BLOCK_BYTES // frame_bytes)) * frame_bytes
    yield from blocks_of_bytes(_sample_bytes_blocks(path, info, block_bytes), info.format)


def blocks_of_bytes(
    data_blocks: Iterable[bytes], format: WaveFormat
) -> Iterator[NDArray[np.float64]]:
    """Blocks (n_frames, n_channels) of pieces that hold complete frames; full scale is 1."""
    import numpy as np

    bits = format.bits
    for sample_bytes in data_blocks:
        if bits in ("float", "double"):
            float_type = "<f4" if bits == "float" else "<f8"
            with np.errstate(invalid="ignore"):  # a signalling NaN of a stranger's file
                flat_samples = np.frombuffer(sample_bytes, float_type).astype(np.float64)
        elif bits == 8:  # unsigned, around 128
            flat_samples = np.frombuffer(sample_bytes, np.uint8) / 128.0 - 1.0
        else:
            sample_width = BYTES_BY_FORM[bits]
            octets = np.zeros((len(sample_bytes) // sample_width, 4), np.uint8)
            octets[:, 4 - sample_width :] = np.frombuffer(sample_bytes, np.uint8).reshape(
                -1, sample_width
            )
            flat_samples = octets.view("<i4")[:, 0] / 2.0**31
        yield flat_samples.reshape(-1, format.n_channels)


def hash_samples(path: Path) -> str:
    """SHA-256 of the sample bytes, as `WaveWriter.sha256` gives it.

    Raises NotWaveError or OSError.
    """
    digest = hashlib.sha256()
    for data in _sample_bytes_blocks(path, read_info(path), 1 << 20):
        digest.update(data)
    return digest.hexdigest()


def digest_samples(path: Path) -> tuple[str, int | None]:
    """The same hash, and the first frame with a sample that is not finite. Raises NotWaveError or
    OSError.
    """
    info = read_info(path)
    return survey_of_bytes(_sample_bytes_blocks(path, info, 1 << 20), info.format)


def survey_of_bytes(data_blocks: Iterable[bytes], format: WaveFormat) -> tuple[str, int | None]:
    """The SHA-256 of pieces that hold complete frames, and the first frame with a sample that is
    not finite; only floats can have one.
    """
    import numpy as np

    digest, frames_before, first_bad_frame = hashlib.sha256(), 0, None
    for sample_data in data_blocks:
        digest.update(sample_data)
        if format.bits not in ("float", "double") or first_bad_frame is not None:
            continue
        samples = np.frombuffer(sample_data, "<f4" if format.bits == "float" else "<f8")
        is_finite = np.isfinite(samples)
        if not is_finite.all():
            first_bad_frame = frames_before + int(is_finite.argmin()) // format.n_channels
        frames_before += samples.size // format.n_channels
    return digest.hexdigest(), first_bad_frame


def _sample_bytes_blocks(path: Path, info: WaveInfo, block_bytes: int) -> Iterator[bytes]:
    """The bytes of the samples, at most `block_bytes` at a time."""
    with open_regular(path) as open_file:
        open_file.seek(info.samples_offset)
        bytes_per_sample = BYTES_BY_FORM[info.format.bits]
        block_bytes -= block_bytes % info.format.frame_bytes
        block_bytes = max(block_bytes, info.format.frame_bytes)
        n_bytes_left = info.n_frames * info.format.frame_bytes
        while n_bytes_left:
            data = read_exactly(open_file, min(n_bytes_left, block_bytes), _CUT_SAMPLES_MESSAGE)
            yield _byte_swapped(data, bytes_per_sample) if info.container == "RIFX" else data
            n_bytes_left -= len(data)


def _byte_swapped(sample_data: bytes, bytes_per_sample: int) -> bytes:
    """Samples with their bytes in the other order."""
    import numpy as np

    return np.frombuffer(sample_data, np.uint8).reshape(-1, bytes_per_sample)[:, ::-1].tobytes()


def is_render(path: Path) -> bool:
    """Whether the file is an earlier render of ours, by its BWF originator."""
    try:
        return read_info(path).originator == ORIGINATOR
    except (NotWaveError, OSError):
        return False
