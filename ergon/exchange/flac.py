"""Samples into and out of a FLAC file, by libsndfile.

FLAC is lossless, so the samples are those of a WAV file of as many bits. The compressed bytes are
those of the installed libFLAC, so only the hash of the samples is the same on every machine. What
the channels are stands in blocks of metadata (`flac_blocks`).
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

from ergon.common.regular import open_regular

from .flac_blocks import MAGIC, InsertedBlocks, blocks_of, read_description
from .wave import encode
from .wave_header import ORIGINATOR, Bits, NotWaveError, Stamp, WaveFormat, WaveInfo, pack

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

CHANNELS_MAX = 8  # RFC 9639, section 9.1.3
# Loudspeakers of as many channels, where the file does not say them (the same section).
_USUAL_MASKS = {3: 0x7, 4: 0x33, 5: 0x37, 6: 0x3F, 7: 0x70F, 8: 0x63F}
RATE_MAX = 655_350  # [Hz]; RFC 9639, section 8.2, as libFLAC writes it
_COMMENT_MARK = "made by ergon;"  # this mark identifies a file of ergon
_SUBTYPE_BY_BITS: dict[Bits, str] = {16: "PCM_16", 24: "PCM_24"}
_BITS_BY_SUBTYPE: dict[str, Bits] = {subtype: bits for bits, subtype in _SUBTYPE_BY_BITS.items()}
_BLOCK_FRAMES = 65_536  # frames read at once
_FRAMES_PER_BYTE = 8192  # 65,535 equal samples take 11 bytes at least (RFC 9639, section 9)
_UNKNOWN_LENGTH = (
    1 << 36
)  # frames, of which the format counts less: libsndfile tells an unknown length


def refusal(format: WaveFormat) -> str | None:
    """Why FLAC cannot hold samples of this format; None when it can."""
    if format.bits not in _SUBTYPE_BY_BITS:
        return f"FLAC holds 16 or 24 bits, not {format.bits}; use --bits 24, or a .wav file"
    if format.n_channels > CHANNELS_MAX:
        return f"FLAC holds {CHANNELS_MAX} channels, not {format.n_channels}; use a .wav file"
    if format.rate > RATE_MAX:
        return f"FLAC holds at most {RATE_MAX:,} frames a second; use a .wav file"
    return None


class FlacWriter:
    """Writes blocks until `n_frames` are there; `sha256` is that of a WAV file of these samples."""

    def __init__(self, file: BinaryIO, format: WaveFormat, n_frames: int, stamp: Stamp) -> None:
        """Begin the file; `refusal(format)` has to be None."""
        import soundfile

        self.format = format
        self._left = n_frames
        self._hash = hashlib.sha256()
        blocks = blocks_of(pack(format, n_frames, stamp)) if stamp.chunks else b""
        self._target = InsertedBlocks(file, blocks)
        self._sound = soundfile.SoundFile(
            self._target,
            "w",
            samplerate=format.rate,
            channels=format.n_channels,
            subtype=_SUBTYPE_BY_BITS[format.bits],
            format="FLAC",
        )
        if stamp.title:  # libsndfile refuses an empty one
            self._sound.title = stamp.title
        self._sound.comment = f"{_COMMENT_MARK} {stamp.description().decode()}"

    @property
    def sha256(self) -> str:
        """Hash of the samples written so far, 64 hex digits."""
        return self._hash.hexdigest()

    def write(self, block: NDArray[np.int32]) -> None:
        """Append (n_frames, n_channels): int32 with the sample in its top bits."""
        import soundfile

        if len(block) > self._left:
            raise ValueError(f"{len(block) - self._left} frames more than were announced")
        self._hash.update(encode(block, self.format))
        try:
            self._sound.write(block)
        except (AssertionError, soundfile.LibsndfileError):  # AssertionError if the disk is full
            raise self._target.error or OSError(f"{self._sound.name} cannot be written") from None
        if self._target.error is not None:
            raise self._target.error
        self._left -= len(block)

    def close(self) -> None:
        """Finish the file. Raises ValueError when frames are missing, OSError of the disk."""
        if self._left:
            raise ValueError(f"{self._left} frames fewer than were announced")
        self._sound.close()
        if self._target.error is not None:
            raise self._target.error


def read_info(path: Path) -> WaveInfo:
    """What the file says it holds. Raises NotWaveError or OSError."""
    import soundfile

    with _open_flac(path) as open_file:
        try:
            with soundfile.SoundFile(open_file) as flac_file:
                bits = _BITS_BY_SUBTYPE.get(flac_file.subtype)
                if flac_file.format != "FLAC" or bits is None:
                    raise NotWaveError("the file is not FLAC of 16 or 24 bits")
                if flac_file.frames >= _UNKNOWN_LENGTH:
                    raise NotWaveError("the file does not say how long it is; encode it again")
                file_size = os.fstat(open_file.fileno()).st_size
                if flac_file.frames > _FRAMES_PER_BYTE * file_size:
                    message = (
                        f"the file is damaged: it declares {flac_file.frames:,} frames, which "
                    )
                    raise NotWaveError(f"{message}{file_size:,} bytes cannot hold")
                comment = flac_file.comment or ""
                is_ours = comment.startswith(_COMMENT_MARK)
                channel_description = read_description(open_file)
                mask = channel_description.mask
                if mask is None:  # what ergon writes goes out direct
                    mask = 0 if is_ours else _USUAL_MASKS.get(flac_file.channels, 0)
                return WaveInfo(
                    "FLAC",
                    WaveFormat(flac_file.samplerate, flac_file.channels, bits),
                    flac_file.frames,
                    0,
                    file_size,
                    ORIGINATOR if is_ours else None,
                    comment.removeprefix(_COMMENT_MARK).strip(),
                    channel_description.axml,
                    channel_description.chna,
                    mask,
                    unread_chunks=channel_description.others,
                )
        except soundfile.LibsndfileError as error:
            raise NotWaveError(f"the file is not FLAC: {error}") from None


@contextmanager
def _open_flac(path: Path) -> Iterator[BinaryIO]:
    """A file that begins as FLAC does: no other decoder of libsndfile sees a stranger's bytes."""
    with open_regular(path) as flac_file:
        if flac_file.read(len(MAGIC)) != MAGIC:
            raise NotWaveError("the file is not FLAC")
        flac_file.seek(0)
        yield flac_file


def read_blocks(path: Path) -> Iterator[NDArray[np.float64]]:
    """The samples as (n_frames, n_channels) blocks, scaled so that full scale is 1."""
    for block in _integer_blocks(path):
        yield block / 2.0**31


def digest_samples(path: Path) -> tuple[str, None]:
    """SHA-256 of the sample bytes, as `FlacWriter.sha256` gives it; integers are all finite. Raises
    NotWaveError.
    """
    format = read_info(path).format
    digest = hashlib.sha256()
    for block in _integer_blocks(path):
        digest.update(encode(block, format))
    return digest.hexdigest(), None


def _integer_blocks(path: Path) -> Iterator[NDArray[np.int32]]:
    import soundfile

    with _open_flac(path) as file:
        try:
            with soundfile.SoundFile(file) as flac_sound:
                frames_left = flac_sound.frames
                while frames_left:
                    sample_block = flac_sound.read(
                        min(frames_left, _BLOCK_FRAMES), dtype="int32", always_2d=True
                    )
                    if not len(sample_block):
                        raise NotWaveError(
                            f"the file is damaged: {frames_left:,} frames are missing"
                        )
                    yield sample_block
                    frames_left -= len(sample_block)
        except soundfile.LibsndfileError as error:
            raise NotWaveError(f"the file is damaged: {error}") from None
