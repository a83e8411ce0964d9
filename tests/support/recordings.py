"""Recordings written from the layout of docs/takes.md alone: struct and zlib, without ergon."""

import struct
import zlib
from collections.abc import Sequence
from typing import NamedTuple

MAGIC = b"\x89TAKE\r\n\x1a"
HEADER, ROWS, EVENTS, END = 1, 2, 3, 4


class Axis(NamedTuple):
    position: float
    force: float = 0.0
    sent: float = 0.0
    flags: int = 0
    clock: int = 0


def chunk(kind: int, payload: bytes) -> bytes:
    """length u32, kind u8, crc32 u32 of these two and the payload, payload."""
    crc = zlib.crc32(struct.pack("<IB", len(payload), kind) + payload)
    return struct.pack("<IBI", len(payload), kind, crc) + payload


def header(
    axes: Sequence[tuple[str, str]] = (("remi", "k2"),),
    rate: float = 44100.0,
    frames: int = 44,
    about: str = "{}",
) -> bytes:
    words = [word.encode() for axis in axes for word in axis]
    names = b"".join(struct.pack("<H", len(word)) + word for word in words)
    payload = struct.pack("<dII", rate, frames, len(axes)) + names + about.encode()
    return MAGIC + struct.pack("<I", 1) + chunk(HEADER, payload)


def row(tick: int, *axes: Axis) -> bytes:
    return struct.pack("<Q", tick) + b"".join(struct.pack("<ddfBI", *axis) for axis in axes)


def rows(*every: bytes) -> bytes:
    return chunk(ROWS, b"".join(every))


def event(tick: int, line: str) -> bytes:
    return struct.pack("<QI", tick, len(line.encode())) + line.encode()


def end(dropped: int = 0) -> bytes:
    return chunk(END, struct.pack("<Q", dropped))


def chunks(data: bytes) -> list[tuple[int, bytes]]:
    """Kind and payload of every chunk of a whole file."""
    assert data[:12] == MAGIC + struct.pack("<I", 1)
    result, position = [], 12
    while position < len(data):
        length, kind, crc = struct.unpack_from("<IBI", data, position)
        payload = data[position + 9 : position + 9 + length]
        assert crc == zlib.crc32(data[position : position + 5] + payload)
        result.append((kind, payload))
        position += 9 + length
    return result
