"""Sound files by the ending of their names: `.wav` by our own writer, `.flac` by libsndfile."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

from ergon.common.sound_files import FLAC, WAVE, with_ending, wrong_ending

from . import flac, wave
from .safe import FileRefusedError
from .wave_header import NotWaveError, Stamp, WaveFormat, WaveInfo

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

_RATES = (1_000, 1_000_000)  # [Hz] of scores; the work of filters grows with the rate


def check_ending(target: str) -> None:
    """Raise FileRefusedError if the ending of a name is not that of a sound file."""
    if (wrong := wrong_ending(target)) is not None:
        raise FileRefusedError(f"{wrong}; write {with_ending(target)}")


def check_format(target: str, format: WaveFormat) -> None:
    """Raise FileRefusedError if the kind of file that a name asks for cannot hold the samples."""
    check_ending(target)
    if _is_flac(Path(target)) and (reason := flac.refusal(format)):
        raise FileRefusedError(f"{target}: {reason}")


def suffix_of(target: str) -> str:
    """The ending of files of the same kind as a target."""
    return FLAC if _is_flac(Path(target)) else WAVE


def writer(
    target: str, file: BinaryIO, format: WaveFormat, n_frames: int, stamp: Stamp
) -> wave.WaveWriter | flac.FlacWriter:
    """A writer of the kind that a name asks for; `check_format` must have accepted it."""
    sound_writer = flac.FlacWriter if _is_flac(Path(target)) else wave.WaveWriter
    return sound_writer(file, format, n_frames, stamp)


def read_info(path: Path) -> WaveInfo:
    """What the file says it holds. Raises NotWaveError or OSError."""
    info = flac.read_info(path) if _is_flac(path) else wave.read_info(path)
    low, high = _RATES
    if not low <= info.format.rate <= high:
        message = f"it has {info.format.rate:,} frames a second; from {low:,} to {high:,} are read"
        raise NotWaveError(message)
    return info


def read_blocks(path: Path) -> Iterator[NDArray[np.float64]]:
    """The samples as (n_frames, n_channels) blocks. Raises NotWaveError or OSError."""
    return flac.read_blocks(path) if _is_flac(path) else wave.read_blocks(path)


def hash_samples(path: Path) -> str:
    """SHA-256 of the sample bytes, as the writer gave it. Raises NotWaveError or OSError."""
    return flac.hash_samples(path) if _is_flac(path) else wave.hash_samples(path)


def _is_flac(path: Path) -> bool:
    return path.suffix.lower() == FLAC
