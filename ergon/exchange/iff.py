"""IFF files, chunk by chunk (J. Morrison, EA IFF 85, Electronic Arts 1985)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from ergon.common.errors import ErgonError

_GROUPS = (b"FORM", b"LIST", b"CAT ", b"PROP")
_HEAD = 8  # bytes of an identifier and a size
_DEPTH_MAX = 32
_CHUNKS_MAX = 100_000


class NotIffError(ErgonError):
    """The bytes are no IFF file: one sentence says where and why."""


@dataclass(frozen=True, slots=True)
class Chunk:
    """A chunk: how deep it lies, its identifier, the type of a group, and the size of its data."""

    depth: int
    name: str
    group: str
    size: int


def chunks(data: bytes) -> list[Chunk]:
    """All chunks of a file in their order; a group precedes its contents.

    Sizes are big-endian, and data of odd size are followed by a byte. Raises NotIffError.
    """
    if data[:4] not in _GROUPS[:3]:
        raise NotIffError("the file does not begin with FORM, LIST or CAT, as every IFF file does")
    walked: list[Chunk] = []
    for chunk in _walked(data, 0, len(data), 0):
        walked.append(chunk)
        if len(walked) > _CHUNKS_MAX:
            raise NotIffError(f"the file has more than {_CHUNKS_MAX:,} chunks")
    return walked


def _walked(data: bytes, start: int, stop: int, depth: int) -> Iterator[Chunk]:
    if depth > _DEPTH_MAX:
        raise NotIffError(f"byte {start:,}: groups lie in groups deeper than {_DEPTH_MAX}")
    while start < stop:
        head = data[start : start + _HEAD]
        if start + _HEAD > stop:
            raise NotIffError(f"byte {start:,}: {stop - start} bytes are too few for a chunk")
        identifier, size = head[:4], int.from_bytes(head[4:], "big")
        inside = start + _HEAD
        if not all(32 <= byte < 127 for byte in identifier):
            raise NotIffError(f"byte {start:,}: {identifier!r} is not the name of a chunk")
        name = identifier.decode("ascii")
        if inside + size > stop:
            raise NotIffError(
                f"byte {start:,}: the chunk {name} has {size:,} bytes, and {stop - inside:,} follow"
            )
        if identifier in _GROUPS:
            group = data[inside : inside + 4].decode("ascii", "replace")
            yield Chunk(depth, name, group, size)
            yield from _walked(data, inside + 4, inside + size, depth + 1)
        else:
            yield Chunk(depth, name, "", size)
        start = inside + size + size % 2
