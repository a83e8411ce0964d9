"""Blocks of metadata of a FLAC file that say what its channels are.

The header of a WAVE file stands in blocks APPLICATION of the kind `riff`, a block for each chunk:
`flac --keep-foreign-metadata` writes them, and gives the WAVE file back (flac, man page and
src/flac/foreign_metadata.c). The mask of loudspeakers may also stand in a comment, as `flac` writes
it. Form of the blocks: RFC 9639, sections 8.1, 8.2, 8.4, 8.6 and 8.6.2.
"""

from __future__ import annotations

import io
import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import BinaryIO

from .wave_header import NotWaveError, parse

MAGIC = b"fLaC"
_HEAD_BYTES = 4  # bytes of the type and the size of a block
HEAD_END = len(MAGIC) + _HEAD_BYTES + 34  # bytes up to the end of STREAMINFO, which comes first
_APPLICATION, _COMMENT = 2, 4
_LAST_BLOCK_FLAG = 0x80
_RIFF_APPLICATION_ID = b"riff"
_FILE_HEADS = (b"RIFF", b"RF64", b"BW64")
_DATA_CHUNK_ID = b"data"
_BLOCKS_MAX = 1000
_BYTES_MAX = 32 << 20  # all blocks that are read, together
_MASK_PATTERN = re.compile(rb"WAVEFORMATEXTENSIBLE_CHANNEL_MASK=0x([0-9a-f]{1,8})", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class ChannelDescription:
    """What a file says of its channels (as `WaveInfo`), and the other chunks of its WAVE file;
    `mask` is None where neither a comment nor the WAVE file says one.
    """

    axml: bytes = b""
    chna: bytes = b""
    mask: int | None = None
    others: tuple[tuple[str, int], ...] = ()


def blocks_of(header: bytes) -> bytes:
    """The blocks for the header of a WAVE file, up to the first byte of its samples."""
    pieces, block_start = [header[:12]], 12
    while block_start < len(header):
        size = int.from_bytes(header[block_start + 4 : block_start + 8], "little")
        data_size = 0 if header.startswith(_DATA_CHUNK_ID, block_start) else size + size % 2
        pieces.append(header[block_start : block_start + 8 + data_size])
        block_start += 8 + data_size
    contents = [_RIFF_APPLICATION_ID + piece for piece in pieces]
    kind = bytes([_APPLICATION])
    return b"".join(kind + len(content).to_bytes(3, "big") + content for content in contents)


def read_description(open_file: BinaryIO) -> ChannelDescription:
    """What the blocks of a FLAC file say of its channels; what is damaged says nothing."""
    chunks: list[bytes] = []
    mask: int | None = None
    for block_kind, block_content in _described_blocks(open_file):
        if block_kind == _COMMENT and (match := _MASK_PATTERN.search(block_content)):
            mask = int(match[1], 16)
        elif block_kind == _APPLICATION and block_content.startswith(_RIFF_APPLICATION_ID):
            chunks.append(block_content.removeprefix(_RIFF_APPLICATION_ID))
    left_out = (*_FILE_HEADS, _DATA_CHUNK_ID, b"ds64")
    body = b"".join(chunk for chunk in chunks if not chunk.startswith(left_out))
    body = b"WAVE" + body + _DATA_CHUNK_ID + bytes(4)  # a file whose samples are elsewhere
    try:
        info = parse(io.BytesIO(b"RIFF" + len(body).to_bytes(4, "little") + body))
    except NotWaveError:
        return ChannelDescription(mask=mask)
    mask = info.speaker_mask if mask is None else mask
    return ChannelDescription(info.axml, info.chna, mask, info.unread_chunks)


def _described_blocks(open_file: BinaryIO) -> Iterator[tuple[int, bytes]]:
    """The type and the content of each block that may say something of the channels."""
    open_file.seek(len(MAGIC))
    n_bytes = 0
    for _ in range(_BLOCKS_MAX):
        header_bytes = open_file.read(_HEAD_BYTES)
        if len(header_bytes) < _HEAD_BYTES:
            return
        block_kind, chunk_size = (
            header_bytes[0] & ~_LAST_BLOCK_FLAG,
            int.from_bytes(header_bytes[1:], "big"),
        )
        if block_kind in (_APPLICATION, _COMMENT):
            n_bytes += chunk_size
            if n_bytes > _BYTES_MAX:
                return
            yield block_kind, open_file.read(chunk_size)
        else:
            open_file.seek(chunk_size, io.SEEK_CUR)
        if header_bytes[0] & _LAST_BLOCK_FLAG:
            return


class InsertedBlocks:
    """A file object that puts blocks behind STREAMINFO while libFLAC writes the rest.

    libFLAC sees a file without them. An error of the disk is stored, as no exception can pass
    through C.
    """

    def __init__(self, file: BinaryIO, blocks: bytes) -> None:
        """`file` is open for reading and writing; `blocks` may be empty."""
        self.file = file
        self.error: OSError | None = None
        self._blocks = blocks
        self._is_inserted = not blocks

    def write(self, data: bytes) -> int:
        """Write as a file does; 0 bytes after an error."""
        try:
            n_written = self.file.write(data)
            if not self._is_inserted and self.file.tell() == HEAD_END:
                self.file.write(self._blocks)
                self._is_inserted = True
            return n_written
        except OSError as error:
            self.error = error
            return 0

    def seek(self, offset: int, whence: int = io.SEEK_SET) -> int:
        """Move to a place in the file that libFLAC sees."""
        try:
            if whence == io.SEEK_SET and offset >= HEAD_END and self._is_inserted:
                offset += len(self._blocks)
            self.file.seek(offset, whence)  # this writes the buffer
        except OSError as error:
            self.error = error
            return 0
        return self.tell()

    def tell(self) -> int:
        """The place in the file that libFLAC sees."""
        place = self.file.tell()
        return place - len(self._blocks) if self._is_inserted and place > HEAD_END else place

    def read(self, n_bytes: int = -1) -> bytes:
        """What is in the file at this place."""
        return self.file.read(n_bytes)

    def flush(self) -> None:
        """Write what is buffered."""
        self.file.flush()
