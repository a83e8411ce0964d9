"""Files with seeded damage: bits that flip, ends that are missing, headers of another file."""

from __future__ import annotations

import random
import struct
from collections.abc import Iterator

# Numbers at which sizes and counts overflow or fail, as bytes.
_EDGES = [
    struct.pack(form, value)
    for form, bits in (("<H", 16), ("<I", 32), ("<Q", 64), (">I", 32))
    for value in (
        0,
        1,
        (1 << bits) - 1,
        1 << (bits - 1),
        (1 << (bits - 1)) - 1,
        0x10000 % (1 << bits),
    )
]
_WORDS = (
    b"nan",
    b"inf",
    b"-1",
    b"1e400",
    b"1e308",
    b",",
    b"\n",
    b"\0",
    b"[",
    b"'",
    b"(",
    b"\xff",
    b"O8",
)


def corrupted(data: bytes, count: int, seed: int, *others: bytes) -> Iterator[bytes]:
    """`count` damaged copies; `others` are files whose parts are spliced in."""
    chance = random.Random(seed)
    for number in range(count):
        damaged = bytearray(data)
        for _ in range(chance.choice((1, 1, 1, 2, 3, 8))):
            # Headers, and the directory at the end of a zip, are short: hit them more often.
            edge = min(len(damaged), chance.choice((64, 256, len(damaged) or 1)))
            index = chance.randrange(edge or 1)
            if chance.random() < 0.4:
                index = len(damaged) - 1 - index
            _damage(damaged, max(0, index), number, chance, others or (data,))
        yield bytes(damaged)


def _damage(
    damaged: bytearray, offset: int, number: int, chance: random.Random, others: tuple[bytes, ...]
) -> None:
    kind = chance.randrange(8)
    if not damaged:
        damaged += bytes([number % 256])
    elif kind <= 1:
        damaged[offset] ^= 1 << chance.randrange(8)
    elif kind == 2:
        damaged[offset] = chance.randrange(256)
    elif kind == 3:
        del damaged[offset:]
    elif kind == 4:
        del damaged[offset : offset + chance.randrange(1, 64)]
    elif kind == 5:
        edge = chance.choice(_EDGES)
        damaged[offset : offset + len(edge)] = edge
    elif kind == 6:
        word = chance.choice(_WORDS)
        damaged[offset : offset + chance.choice((0, len(word)))] = word
    else:
        other = chance.choice(others)
        start = chance.randrange(max(1, len(other)))
        part = other[start : start + chance.randrange(1, 200)]
        damaged[offset : offset + len(part)] = part
