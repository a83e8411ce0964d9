"""Samples out of an AIFF file, as the bytes of a WAVE file.

Sources: Apple, "Audio Interchange File Format: AIFF", version 1.3 (1989), and "AIFF-C", draft of
26 August 1991; the other codings without loss are those of Apple's "Technical Note TN2271" and of
libsndfile (src/aiff.c). Nothing is written.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

from ergon.common.regular import open_regular

from .streamed import samples_end
from .wave import blocks_of_bytes, survey_of_bytes
from .wave_header import BYTES_BY_FORM, Bits, NotWaveError, WaveFormat, WaveInfo, read_exactly

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

_COMM_FORMAT = struct.Struct(">HIHH8s")  # channels, frames, bits, exponent and mantissa of the rate
_BIG_ENDIAN, _LITTLE_ENDIAN = ">", "<"
_INTEGER_BITS: tuple[Bits, ...] = (8, 16, 24, 32)
# Codings of AIFF-C by their names: order of bytes, and bits where the name says them.
_CODINGS: dict[bytes, tuple[str, Bits | None]] = {
    b"NONE": (_BIG_ENDIAN, None),
    b"twos": (_BIG_ENDIAN, None),
    b"sowt": (_LITTLE_ENDIAN, None),
    b"in24": (_BIG_ENDIAN, 24),
    b"in32": (_BIG_ENDIAN, 32),
    b"fl32": (_BIG_ENDIAN, "float"),
    b"FL32": (_BIG_ENDIAN, "float"),
    b"fl64": (_BIG_ENDIAN, "double"),
    b"FL64": (_BIG_ENDIAN, "double"),
    b"raw ": ("unsigned", 8),
}
_IGNORED_CHUNKS = (b"FVER", b"PEAK", b"FLLR")  # chunks without data of the piece
_SOX_STREAMED_SIZE = (
    0x7F000000  # bytes of samples that SoX states in a pipe, in frames (its aiff.c)
)
_LATE_CHUNKS = (b"NAME", b"AUTH", b"(c) ", b"ANNO", b"COMT", b"MARK", b"INST", b"APPL", b"ID3 ")
_TEXT_BYTES_MAX = 1 << 16  # bytes of a title, and of all marks
_MARKS_MAX = 1000
_OTHERS_MAX = 100
_BLOCK_BYTES = 1 << 20
_CUT_HEADER_MESSAGE = "this AIFF file ends within its header"
_CUT_SAMPLES_MESSAGE = "this file became shorter while it was read"


def read_info(path: Path) -> WaveInfo:
    """What the file says it holds. Raises NotWaveError or OSError."""
    with open_regular(path) as file:
        return _parse(file)[0]


def read_blocks(path: Path) -> Iterator[NDArray[np.float64]]:
    """The samples as (n_frames, n_channels) blocks; integers are scaled so that full scale is 1.

    Raises NotWaveError or OSError.
    """
    format = read_info(path).format
    yield from blocks_of_bytes(_sample_blocks(path), format)


def digest_samples(path: Path) -> tuple[str, int | None]:
    """SHA-256 of the samples as a WAVE file has them, and the first frame that is not finite.

    Raises NotWaveError or OSError.
    """
    return survey_of_bytes(_sample_blocks(path), read_info(path).format)


def _sample_blocks(path: Path) -> Iterator[bytes]:
    """The samples in the order of bytes of WAVE, in blocks of complete frames."""
    import numpy as np

    with open_regular(path) as open_file:
        info, byte_order = _parse(open_file)
        sample_bytes = BYTES_BY_FORM[info.format.bits]
        frame_size = info.format.frame_bytes
        open_file.seek(info.samples_offset)
        bytes_left = info.samples_size
        while bytes_left:
            n_bytes = min(bytes_left, max(1, _BLOCK_BYTES // frame_size) * frame_size)
            octets = np.frombuffer(read_exactly(open_file, n_bytes, _CUT_SAMPLES_MESSAGE), np.uint8)
            if byte_order == _BIG_ENDIAN:
                octets = octets.reshape(-1, sample_bytes)[:, ::-1]
            if info.format.bits == 8 and byte_order != "unsigned":
                octets = octets ^ np.uint8(0x80)  # WAVE counts 8 bits from 0
            yield octets.tobytes()
            bytes_left -= n_bytes


def _parse(open_file: BinaryIO) -> tuple[WaveInfo, str]:
    """What the chunks say, and the order of bytes of a sample."""
    header_bytes = open_file.read(12)
    if (
        len(header_bytes) < 12
        or header_bytes[:4] != b"FORM"
        or header_bytes[8:] not in (b"AIFF", b"AIFC")
    ):
        raise NotWaveError("this is not an AIFF file")
    is_compressed = header_bytes[8:] == b"AIFC"
    form_size = int.from_bytes(header_bytes[4:8], "big")
    end_offset = open_file.seek(0, 2)
    open_file.seek(12)
    format: WaveFormat | None = None
    byte_order, stated_frames, stated_title = _BIG_ENDIAN, 0, ""
    sound_place, stop_offset = None, end_offset
    named_marks: list[tuple[str, int]] = []
    other_chunks: list[tuple[str, int]] = []
    while len(chunk := open_file.read(8)) == 8:
        chunk_name, chunk_size = chunk[:4], int.from_bytes(chunk[4:], "big")
        start_offset = open_file.tell()
        if (
            format is not None
            and sound_place is not None
            and (chunk_size > end_offset - start_offset or not chunk_name.isascii())
        ):
            break  # the bytes after the samples are no chunk
        if chunk_name == b"COMM":
            content = read_exactly(open_file, min(chunk_size, 1024), _CUT_HEADER_MESSAGE)
            format, byte_order, stated_frames = _parse_comm(content, is_compressed=is_compressed)
        elif chunk_name == b"SSND" and sound_place is None:
            offset, _ = struct.unpack(">II", read_exactly(open_file, 8, _CUT_HEADER_MESSAGE))
            sound_place = start_offset + 8 + offset
            stop_offset = start_offset + chunk_size
            is_empty = chunk_size == 8 and form_size + 8 == end_offset
            if stop_offset > end_offset or (chunk_size <= 8 and not is_empty):
                stop_offset = samples_end(open_file, sound_place, _LATE_CHUNKS, is_big=True)
            chunk_size = stop_offset - start_offset
        elif chunk_name == b"NAME" and chunk_size <= _TEXT_BYTES_MAX:
            stated_title = (
                read_exactly(open_file, chunk_size, _CUT_HEADER_MESSAGE)
                .decode("utf-8", "replace")
                .strip("\0 ")
            )
        elif chunk_name == b"MARK" and chunk_size <= _TEXT_BYTES_MAX:
            named_marks = _parse_marks(read_exactly(open_file, chunk_size, _CUT_HEADER_MESSAGE))
        elif chunk_name not in _IGNORED_CHUNKS and len(other_chunks) < _OTHERS_MAX:
            other_chunks.append((chunk_name.decode("latin-1"), chunk_size))
        open_file.seek(start_offset + chunk_size + chunk_size % 2)
    if format is None or (sound_place is None and stated_frames):
        raise NotWaveError("this AIFF file holds no samples")
    sound_place = end_offset if sound_place is None else sound_place
    frame_bytes = format.frame_bytes
    frames_present = max(0, stop_offset - sound_place) // frame_bytes
    if _is_streamed(stated_frames, frames_present, frame_bytes):
        stated_frames = frames_present
    n_frames = min(stated_frames, frames_present)
    info = WaveInfo(
        "AIFC" if is_compressed else "AIFF",
        format,
        n_frames,
        sound_place,
        n_frames * frame_bytes,
        description=stated_title,
        missing_bytes=(stated_frames - n_frames) * frame_bytes,
        unread_chunks=tuple(other_chunks),
        marks=tuple(named_marks),
    )
    return info, byte_order


def _is_streamed(stated_frames: int, frames_present: int, frame_bytes: int) -> bool:
    """Whether a program that writes into a pipe, where it cannot go back, stated the frames."""
    if stated_frames in (0, 0xFFFFFFFF):
        return True
    return stated_frames > frames_present and stated_frames == _SOX_STREAMED_SIZE // frame_bytes


def _parse_comm(file_content: bytes, *, is_compressed: bool) -> tuple[WaveFormat, str, int]:
    """Format, order of bytes and number of frames of a chunk COMM."""
    if len(file_content) < _COMM_FORMAT.size + 4 * is_compressed:
        raise NotWaveError(_CUT_HEADER_MESSAGE)
    n_channels, n_frames, n_bits, exponent, mantissa = _COMM_FORMAT.unpack_from(file_content)
    coding = file_content[_COMM_FORMAT.size : _COMM_FORMAT.size + 4] if is_compressed else b"NONE"
    if coding not in _CODINGS:
        name = coding.decode("latin-1").strip()
        raise NotWaveError(f"its samples are coded as {name}; save it as PCM, as WAV or FLAC")
    coding_order, bits = _CODINGS[coding]
    if bits is None:
        # Samples of 12 or 20 bits are the upper bits of complete bytes.
        bits = next(
            (sample_bits for sample_bits in _INTEGER_BITS if n_bits and n_bits <= int(sample_bits)),
            None,
        )
    rate = _rate_of_extended(exponent, mantissa)
    if bits is None or not n_channels or not rate:
        raise NotWaveError(
            f"samples of {n_bits} bits on {n_channels} channels at {rate} Hz are not supported"
        )
    return WaveFormat(rate, n_channels, bits), coding_order, n_frames


def _rate_of_extended(exponent: int, mantissa: bytes) -> int:
    """The rate [Hz] of an 80-bit float (IEEE 754-1985); 0 if that is no valid rate."""
    if not 0 < exponent < 0x3FFF + 32:  # also those below 0
        return 0
    value = math.ldexp(int.from_bytes(mantissa, "big"), exponent - 0x3FFF - 63)
    return round(value)


def _parse_marks(chunk_content: bytes) -> list[tuple[str, int]]:
    """Name and frame of each mark."""
    named_marks: list[tuple[str, int]] = []
    mark_start = 2
    while mark_start + 7 <= len(chunk_content) and len(named_marks) < _MARKS_MAX:
        frame, name_length = struct.unpack_from(">IB", chunk_content, mark_start + 2)
        name = chunk_content[mark_start + 7 : mark_start + 7 + name_length].decode(
            "utf-8", "replace"
        )
        named_marks.append((name, frame))
        mark_start += (
            7 + name_length + (name_length + 1) % 2
        )  # a name with its length byte has an even size
    return named_marks
