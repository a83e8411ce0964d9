"""Arrays of an npz file that is not trusted: nothing is unpacked before its size is checked.

The sizes that a zip file declares are checked against the file's size, and an array's header
against the size of its member. Arrays are unpacked a block at a time, and never unpickled.
"""

from __future__ import annotations

import io
import os
import warnings
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.lib import format as npy

from ergon.scores.gesture.take_file import (
    MAX_BYTES,
    MAX_CHANNELS,
    MAX_SAMPLES,
    Floats,
    TakeError,
    open_take,
)

_BLOCK_NUMBERS = 1 << 17  # numbers unpacked at once
_READ_BYTES_MAX = 1 << 21  # bytes: a block of the largest numbers, or the directory of all members
_HEADER_BYTES_MAX = 4096  # bytes of an array's header; usually 128
_COMPRESSION_RATIO_MAX = 1032  # deflate's highest ratio: 258 bytes from two bits


class Row(NamedTuple):
    """A one-dimensional array of numbers: its name, length and type, and the offset of its
    numbers.
    """

    name: str
    length: int
    dtype: np.dtype[np.generic]
    offset: int
    member: zipfile.ZipInfo


class _BoundedFile(io.BufferedReader):
    """A file that refuses large reads, because zipfile trusts the directory size that the file
    declares.
    """

    def read(self, size: int | None = -1, /) -> bytes:
        n_bytes = os.fstat(self.fileno()).st_size - self.tell()
        if min(n_bytes, n_bytes if size is None or size < 0 else size) > _READ_BYTES_MAX:
            raise zipfile.BadZipFile("the directory of the archive is too large")
        return super().read(size)


class Npz:
    """The arrays of an open npz file, by their names without `.npy`."""

    def __init__(self, path: Path, archive: zipfile.ZipFile, size: int) -> None:
        """Check the sizes that members declare against the file's `size` in bytes. Raises
        TakeError.
        """
        self._path = path
        self._archive = archive
        self._members = archive.infolist()
        self.names = [member.filename.removesuffix(".npy") for member in self._members]
        if len(self._members) > MAX_CHANNELS + 1:
            raise TakeError(f"the file has more than {MAX_CHANNELS:,} columns", path)
        if sum(member.file_size for member in self._members) > MAX_BYTES:
            raise TakeError("the file has more than 1 GB when it is unpacked", path)
        # If members overlapped, they would together have more bytes than the file.
        if sum(member.compress_size for member in self._members) > size:
            raise TakeError("the members of the archive have more bytes than the file", path)
        for member_name, zip_member in zip(self.names, self._members, strict=True):
            if zip_member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
                storage_rule = (
                    "must be stored or compressed by deflate, as numpy.savez_compressed does"
                )
                raise TakeError(f"'{member_name[:40]}' {storage_rule}", path)
            if zip_member.file_size > _COMPRESSION_RATIO_MAX * zip_member.compress_size:
                raise TakeError(f"'{member_name[:40]}' has an impossible size", path)

    def row(self, index: int) -> Row | None:
        """The header of an array; None if it is not a one-dimensional array of numbers.

        Raises TakeError if the header cannot be read, or declares more than fits or is there.
        """
        zip_member, member_name = self._members[index], self.names[index]
        with _as_take_error(self._path), self._archive.open(zip_member) as file:
            header_file = io.BytesIO(file.read(_HEADER_BYTES_MAX))
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error")  # warnings of Python's parser mean a bad header
                is_version_1 = npy.read_magic(header_file) == (1, 0)
                read_header = (
                    npy.read_array_header_1_0 if is_version_1 else npy.read_array_header_2_0
                )
                array_shape, _, dtype = read_header(header_file)
        except Exception as error:  # numpy lets the tokenizer's own errors through
            raise TakeError(
                f"the header of '{member_name[:40]}' cannot be read", self._path
            ) from error
        if dtype.hasobject or dtype.kind not in "fiu" or len(array_shape) != 1:
            return None
        if not 0 <= array_shape[0] <= MAX_SAMPLES:
            raise TakeError(
                f"more than {MAX_SAMPLES:,} samples in '{member_name[:40]}'", self._path
            )
        n_missing = header_file.tell() + array_shape[0] * dtype.itemsize - zip_member.file_size
        if n_missing:
            state = "cut short" if n_missing > 0 else "longer than its header says"
            raise TakeError(f"'{member_name[:40]}' is {state}", self._path)
        return Row(member_name, array_shape[0], dtype, header_file.tell(), zip_member)

    def blocks(self, row: Row) -> Iterator[Floats]:
        """The numbers of a row, some at a time. Raises TakeError."""
        n_left = row.length
        with _as_take_error(self._path), self._archive.open(row.member) as open_file:
            open_file.read(row.offset)
            while True:
                # Read once more at the end, so that zipfile checks the checksum.
                file_bytes = open_file.read(min(n_left, _BLOCK_NUMBERS) * row.dtype.itemsize or 1)
                if not n_left:
                    return
                block_numbers = np.frombuffer(file_bytes, dtype=row.dtype)
                if len(block_numbers) != min(n_left, _BLOCK_NUMBERS):
                    raise TakeError(f"'{row.name[:40]}' is cut short", self._path)
                n_left -= len(block_numbers)
                with np.errstate(all="ignore"):
                    yield block_numbers.astype(np.float64)

    def array(self, array_row: Row) -> Floats:
        """All numbers of a row. Raises TakeError."""
        array_numbers, n_read = np.empty(array_row.length), 0
        for block in self.blocks(array_row):
            array_numbers[n_read : n_read + len(block)] = block
            n_read += len(block)
        return array_numbers


@contextmanager
def open_npz(path: Path) -> Iterator[Npz]:
    """The arrays of an open file, as a context. Raises TakeError, OSError."""
    with _BoundedFile(open_take(path).detach()) as open_file:
        file_size = os.fstat(open_file.fileno()).st_size
        with _as_take_error(path):
            archive = zipfile.ZipFile(open_file)
        with archive:
            yield Npz(path, archive, file_size)


@contextmanager
def _as_take_error(path: Path) -> Iterator[None]:
    """Turn whatever zipfile and zlib raise for a damaged file, which is of many types, into
    TakeError.
    """
    try:
        yield
    except (TakeError, OSError, MemoryError):
        raise
    except Exception as error:
        reason = str(error) or type(error).__name__
        raise TakeError(f"this is not an npz file that can be read ({reason})", path) from None
