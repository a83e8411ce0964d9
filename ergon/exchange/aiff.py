"""Samples out of an AIFF file, as the bytes of a WAVE file.

Sources: Apple, "Audio Interchange File Format: AIFF", version 1.3 (1989), and "AIFF-C", draft of
26 August 1991; the other codings without loss are those of Apple's "Technical Note TN2271" and of
libsndfile (src/aiff.c). Nothing is written.
"""

from __future__ import annotations

import hashlib
import math
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

from ergon.common.regular import open_regular

from .wave import blocks_of_bytes
from .wave_header import BYTES, Bits, NotWaveError, WaveFormat, WaveInfo, read_exactly

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

_COMM = struct.Struct(">HIHH8s")  # channels, frames, bits, exponent and mantissa of the rate
_BIG, _LITTLE = ">", "<"
_INTEGERS: tuple[Bits, ...] = (8, 16, 24, 32)
# Codings of AIFF-C by their names: order of bytes, and bits where the name says them.
_CODINGS: dict[bytes, tuple[str, Bits | None]] = {
    b"NONE": (_BIG, None),
    b"twos": (_BIG, None),
    b"sowt": (_LITTLE, None),
    b"in24": (_BIG, 24),
    b"in32": (_BIG, 32),
    b"fl32": (_BIG, "float"),
    b"FL32": (_BIG, "float"),
    b"fl64": (_BIG, "double"),
    b"FL64": (_BIG, "double"),
    b"raw ": ("unsigned", 8),
}
_FILLING = (b"FVER", b"PEAK", b"FLLR")  # that say nothing of the piece
_TEXT_MAX = 1 << 16  # bytes of a title, and of all marks
_MARKS_MAX = 1000
_OTHERS_MAX = 100
_BLOCK_BYTES = 1 << 20
_CUT_HEADER = "this AIFF file ends within its header"
_CUT_SAMPLES = "this file became shorter while it was read"


def read_info(path: Path) -> WaveInfo:
    """What the file says it holds. Raises NotWaveError or OSError."""
    with open_regular(path) as file:
        return _parse(file)[0]


def read_blocks(path: Path) -> Iterator[NDArray[np.float64]]:
    """The samples as (n_frames, n_channels) blocks; integers are scaled so that full scale is 1.

    Raises NotWaveError or OSError.
    """
    format = read_info(path).format
    yield from blocks_of_bytes(_samples(path), format)


def hash_samples(path: Path) -> str:
    """SHA-256 of the samples as a WAVE file has them. Raises NotWaveError or OSError."""
    digest = hashlib.sha256()
    for data in _samples(path):
        digest.update(data)
    return digest.hexdigest()


def _samples(path: Path) -> Iterator[bytes]:
    """The samples in the order of bytes of WAVE, in blocks of complete frames."""
    import numpy as np

    with open_regular(path) as file:
        info, order = _parse(file)
        width = BYTES[info.format.bits]
        frame = info.format.frame_bytes
        file.seek(info.offset)
        frames_left = info.size
        while frames_left:
            count = min(frames_left, max(1, _BLOCK_BYTES // frame) * frame)
            octets = np.frombuffer(read_exactly(file, count, _CUT_SAMPLES), np.uint8)
            if order == _BIG:
                octets = octets.reshape(-1, width)[:, ::-1]
            if info.format.bits == 8 and order != "unsigned":
                octets = octets ^ np.uint8(0x80)  # WAVE counts 8 bits from 0
            yield octets.tobytes()
            frames_left -= count


def _parse(file: BinaryIO) -> tuple[WaveInfo, str]:
    """What the chunks say, and the order of bytes of a sample."""
    head = file.read(12)
    if len(head) < 12 or head[:4] != b"FORM" or head[8:] not in (b"AIFF", b"AIFC"):
        raise NotWaveError("this is not an AIFF file")
    is_compressed = head[8:] == b"AIFC"
    end = file.seek(0, 2)
    file.seek(12)
    format: WaveFormat | None = None
    order, stated, title = _BIG, 0, ""
    place, stop = None, end
    marks: list[tuple[str, int]] = []
    other_chunks: list[tuple[str, int]] = []
    while len(chunk := file.read(8)) == 8:
        name, size = chunk[:4], int.from_bytes(chunk[4:], "big")
        start = file.tell()
        if format is not None and place is not None and (size > end - start or not name.isascii()):
            break  # what follows the samples is no chunk
        if name == b"COMM":
            content = read_exactly(file, min(size, 1024), _CUT_HEADER)
            format, order, stated = _common(content, is_compressed=is_compressed)
        elif name == b"SSND" and place is None:
            offset, _ = struct.unpack(">II", read_exactly(file, 8, _CUT_HEADER))
            place = start + 8 + offset
            stop = start + size if 8 < size <= end - start else end
        elif name == b"NAME" and size <= _TEXT_MAX:
            title = read_exactly(file, size, _CUT_HEADER).decode("utf-8", "replace").strip("\0 ")
        elif name == b"MARK" and size <= _TEXT_MAX:
            marks = _marks(read_exactly(file, size, _CUT_HEADER))
        elif name not in _FILLING and len(other_chunks) < _OTHERS_MAX:
            other_chunks.append((name.decode("latin-1"), size))
        file.seek(start + size + size % 2)
    if format is None or (place is None and stated):
        raise NotWaveError("this AIFF file holds no samples")
    place = end if place is None else place
    frame = format.frame_bytes
    n_frames = min(stated, max(0, stop - place) // frame)
    info = WaveInfo(
        "AIFC" if is_compressed else "AIFF",
        format,
        n_frames,
        place,
        n_frames * frame,
        description=title,
        missing=(stated - n_frames) * frame,
        others=tuple(other_chunks),
        marks=tuple(marks),
    )
    return info, order


def _common(content: bytes, *, is_compressed: bool) -> tuple[WaveFormat, str, int]:
    """Format, order of bytes and number of frames of a chunk COMM."""
    if len(content) < _COMM.size + 4 * is_compressed:
        raise NotWaveError(_CUT_HEADER)
    n_channels, n_frames, n_bits, exponent, mantissa = _COMM.unpack_from(content)
    coding = content[_COMM.size : _COMM.size + 4] if is_compressed else b"NONE"
    if coding not in _CODINGS:
        name = coding.decode("latin-1").strip()
        raise NotWaveError(f"its samples are coded as {name}; save it as PCM, as WAV or FLAC")
    order, bits = _CODINGS[coding]
    if bits is None:
        # Samples of 12 or 20 bits are the upper bits of complete bytes.
        bits = next(
            (n_bits_text for n_bits_text in _INTEGERS if n_bits and n_bits <= int(n_bits_text)),
            None,
        )
    rate = _rate(exponent, mantissa)
    if bits is None or not n_channels or not rate:
        raise NotWaveError(
            f"samples of {n_bits} bits on {n_channels} channels at {rate} Hz are not supported"
        )
    return WaveFormat(rate, n_channels, bits), order, n_frames


def _rate(exponent: int, mantissa: bytes) -> int:
    """The rate [Hz] of an extended number (IEEE 754-1985, 80 bits); 0 for one that is none."""
    if not 0 < exponent < 0x3FFF + 32:  # also those below 0
        return 0
    value = math.ldexp(int.from_bytes(mantissa, "big"), exponent - 0x3FFF - 63)
    return round(value)


def _marks(content: bytes) -> list[tuple[str, int]]:
    """Name and frame of each mark."""
    marks: list[tuple[str, int]] = []
    start = 2
    while start + 7 <= len(content) and len(marks) < _MARKS_MAX:
        frame, length = struct.unpack_from(">IB", content, start + 2)
        name = content[start + 7 : start + 7 + length].decode("utf-8", "replace")
        marks.append((name, frame))
        start += 7 + length + (length + 1) % 2  # with its length a name has an even size
    return marks
