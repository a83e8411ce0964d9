"""IFF files, chunk by chunk (J. Morrison, EA IFF 85, Electronic Arts 1985)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from ergon.common.errors import ErgonError

_GROUP_IDS = (b"FORM", b"LIST", b"CAT ", b"PROP")
_HEAD_BYTES = 8  # bytes of an identifier and a size
_DEPTH_MAX = 32
_CHUNKS_MAX = 100_000


class NotIffError(ErgonError):
    """The bytes are no IFF file: one sentence says where and why."""


@dataclass(frozen=True, slots=True)
class Chunk:
    """A chunk: how deep it lies, its identifier, the type of a group, and the size of its data."""

    depth: int
    name: str
    group_type: str
    size: int


def chunks(file_bytes: bytes) -> list[Chunk]:
    """All chunks of a file in their order; a group precedes its contents.

    Sizes are big-endian, and data of odd size are followed by a byte. Raises NotIffError.
    """
    if file_bytes[:4] not in _GROUP_IDS[:3]:
        raise NotIffError("the file does not begin with FORM, LIST or CAT, as every IFF file does")
    chunks_read: list[Chunk] = []
    for chunk in _walk_chunks(file_bytes, 0, len(file_bytes), 0):
        chunks_read.append(chunk)
        if len(chunks_read) > _CHUNKS_MAX:
            raise NotIffError(f"the file has more than {_CHUNKS_MAX:,} chunks")
    return chunks_read


def _walk_chunks(
    file_bytes: bytes, start_offset: int, stop_offset: int, depth: int
) -> Iterator[Chunk]:
    if depth > _DEPTH_MAX:
        raise NotIffError(f"byte {start_offset:,}: groups lie in groups deeper than {_DEPTH_MAX}")
    while start_offset < stop_offset:
        header_bytes = file_bytes[start_offset : start_offset + _HEAD_BYTES]
        if start_offset + _HEAD_BYTES > stop_offset:
            raise NotIffError(
                f"byte {start_offset:,}: {stop_offset - start_offset} bytes are too few for a chunk"
            )
        identifier, chunk_size = header_bytes[:4], int.from_bytes(header_bytes[4:], "big")
        content_start = start_offset + _HEAD_BYTES
        if not all(32 <= byte < 127 for byte in identifier):
            raise NotIffError(f"byte {start_offset:,}: {identifier!r} is not the name of a chunk")
        chunk_name = identifier.decode("ascii")
        if content_start + chunk_size > stop_offset:
            raise NotIffError(
                f"byte {start_offset:,}: the chunk {chunk_name} has {chunk_size:,} bytes, and "
                f"{stop_offset - content_start:,} follow"
            )
        if identifier in _GROUP_IDS:
            group = file_bytes[content_start : content_start + 4].decode("ascii", "replace")
            yield Chunk(depth, chunk_name, group, chunk_size)
            yield from _walk_chunks(
                file_bytes, content_start + 4, content_start + chunk_size, depth + 1
            )
        else:
            yield Chunk(depth, chunk_name, "", chunk_size)
        start_offset = content_start + chunk_size + chunk_size % 2
