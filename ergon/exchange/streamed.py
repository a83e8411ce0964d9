"""Where the samples of a file end that was written into a pipe, so that no size could be stated."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import BinaryIO

_TAIL_BYTES_MAX = 1 << 20  # bytes at the end of a file that are searched for chunks


def samples_end(
    open_file: BinaryIO, start_offset: int, chunk_ids: Sequence[bytes], *, is_big: bool
) -> int:
    """The end of samples that begin at an offset and have no stated size: the file's end, or the
    first chunk of a known name from which chunks follow one another exactly to the end.
    """
    end_offset = open_file.seek(0, 2)
    tail_start = max(start_offset, end_offset - _TAIL_BYTES_MAX)
    open_file.seek(tail_start)
    tail_bytes = open_file.read(end_offset - tail_start)
    size_format = struct.Struct(">I" if is_big else "<I")
    places = {end_offset - tail_start}  # from which chunks lead to the end
    candidates = sorted(
        (place for chunk_id in chunk_ids for place in _places(tail_bytes, chunk_id)), reverse=True
    )
    for place in candidates:
        (chunk_size,) = size_format.unpack_from(tail_bytes, place + 4)
        next_place = place + 8 + chunk_size
        if next_place in places or (chunk_size % 2 and next_place + 1 in places):
            places.add(place)
    return tail_start + min(places)


def _places(tail_bytes: bytes, chunk_id: bytes) -> list[int]:
    """Where a name stands before a size."""
    places = []
    place = tail_bytes.find(chunk_id)
    while 0 <= place <= len(tail_bytes) - 8:
        places.append(place)
        place = tail_bytes.find(chunk_id, place + 1)
    return places
