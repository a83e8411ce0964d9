"""Sound files: written by the ending of their names, read by their first bytes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO, Protocol

from ergon.common.sound_files import (
    FLAC,
    WAVE,
    find_ending_mistake,
    first_bytes,
    kind_of,
    with_wave_suffix,
)

from . import aiff, flac, wave
from .safe import FileRefusedError
from .wave_header import CHANNELS_MAX, NotWaveError, Stamp, WaveFormat, WaveInfo

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

_RATE_RANGE_HZ = (1_000, 1_000_000)  # [Hz] of scores; the work of filters grows with the rate


class _SoundReader(Protocol):
    def read_info(self, path: Path) -> WaveInfo: ...
    def read_blocks(self, path: Path) -> Iterator[NDArray[np.float64]]: ...
    def digest_samples(self, path: Path) -> tuple[str, int | None]: ...


_READERS: Mapping[str, _SoundReader] = {"wave": wave, "flac": flac, "aiff": aiff}


def check_ending(target_path: str) -> None:
    """Raise FileRefusedError if the ending of a name is not that of a sound file."""
    if (ending_mistake := find_ending_mistake(target_path)) is not None:
        raise FileRefusedError(f"{ending_mistake}; write {with_wave_suffix(target_path)}")


def check_format(target_path: str, format: WaveFormat) -> None:
    """Raise FileRefusedError if the kind of file that a name asks for cannot hold the samples."""
    check_ending(target_path)
    if format.n_channels > CHANNELS_MAX:
        message = f"a sound file has at most {CHANNELS_MAX} channels, not {format.n_channels}"
        raise FileRefusedError(f"{target_path}: {message}; write `mix: {{channels: 2}}`")
    if _is_flac(Path(target_path)) and (reason := flac.refusal(format)):
        raise FileRefusedError(f"{target_path}: {reason}")


def suffix_of(target_path: str) -> str:
    """The ending of files of the same kind as a target."""
    return FLAC if _is_flac(Path(target_path)) else WAVE


def writer(
    target_path: str, sound_file: BinaryIO, format: WaveFormat, n_frames: int, stamp: Stamp
) -> wave.WaveWriter | flac.FlacWriter:
    """A writer of the kind that a name asks for; `check_format` must have accepted it."""
    sound_writer = flac.FlacWriter if _is_flac(Path(target_path)) else wave.WaveWriter
    return sound_writer(sound_file, format, n_frames, stamp)


def read_info(path: Path) -> WaveInfo:
    """What the file says it holds. Raises NotWaveError or OSError."""
    info = _reader(path).read_info(path)
    low, high = _RATE_RANGE_HZ
    if not low <= info.format.rate <= high:
        message = f"it has {info.format.rate:,} frames a second; from {low:,} to {high:,} are read"
        raise NotWaveError(message)
    return info


def read_blocks(path: Path) -> Iterator[NDArray[np.float64]]:
    """The samples as (n_frames, n_channels) blocks. Raises NotWaveError or OSError."""
    return _reader(path).read_blocks(path)


def digest_samples(path: Path) -> tuple[str, int | None]:
    """SHA-256 of the sample bytes, as the writer gave it, and the first frame with a sample that is
    not finite. Raises NotWaveError or OSError.
    """
    return _reader(path).digest_samples(path)


def _reader(path: Path) -> _SoundReader:
    """The module that reads a file, or that says why none does."""
    return _READERS[kind_of(first_bytes(path)) or ("flac" if _is_flac(path) else "wave")]


def _is_flac(path: Path) -> bool:
    return path.suffix.lower() == FLAC
