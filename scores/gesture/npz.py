"""Arrays of an npz file, read without trusting it: nothing is unpacked before its size is judged.

The sizes that a zip file declares are held against the bytes that it has, an array's header against
the size of its member. Arrays are unpacked a block at a time, and never unpickled.
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
    opened,
)

_BLOCK = 1 << 17  # numbers unpacked at once
_READ_MAX = 1 << 21  # bytes: a block of the largest numbers, or the directory of all members
_HEADER_MAX = 4096  # bytes of an array's header; that of a row takes 128
_RATIO_MAX = 1032  # deflate makes a run of 258 bytes of two bits, and no more of any


class Row(NamedTuple):
    """A one-dimensional array of numbers: its name, how many, and where its numbers begin."""

    name: str
    length: int
    dtype: np.dtype[np.generic]
    offset: int
    member: zipfile.ZipInfo


class _Bounded(io.BufferedReader):
    """A file of which nobody reads much at once: zipfile believes the size of a directory."""

    def read(self, size: int | None = -1, /) -> bytes:
        n_bytes = os.fstat(self.fileno()).st_size - self.tell()
        if min(n_bytes, n_bytes if size is None or size < 0 else size) > _READ_MAX:
            raise zipfile.BadZipFile("the directory of the archive is too large")
        return super().read(size)


class Npz:
    """The arrays of an open npz file, by their names without `.npy`."""

    def __init__(self, path: Path, archive: zipfile.ZipFile, size: int) -> None:
        """Judge what the members of a file of `size` bytes say of themselves. Raises TakeError."""
        self._path = path
        self._archive = archive
        self._members = archive.infolist()
        self.names = [member.filename.removesuffix(".npy") for member in self._members]
        if len(self._members) > MAX_CHANNELS + 1:
            raise TakeError(f"the file has more than {MAX_CHANNELS:,} columns", path)
        if sum(member.file_size for member in self._members) > MAX_BYTES:
            raise TakeError("the file has more than 1 GB when it is unpacked", path)
        # Members that lie over one another would together have more bytes than the file.
        if sum(member.compress_size for member in self._members) > size:
            raise TakeError("the members of the archive have more bytes than the file", path)
        for name, member in zip(self.names, self._members, strict=True):
            if member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
                how = "must be stored or compressed by deflate, as numpy.savez_compressed does"
                raise TakeError(f"'{name[:40]}' {how}", path)
            if member.file_size > _RATIO_MAX * member.compress_size:
                raise TakeError(f"'{name[:40]}' has an impossible size", path)

    def row(self, index: int) -> Row | None:
        """What the header of an array says; None where it is no row of numbers.

        Raises TakeError where it cannot be read, or says more than fits or is there.
        """
        member, name = self._members[index], self.names[index]
        with _as_take_error(self._path), self._archive.open(member) as file:
            head = io.BytesIO(file.read(_HEADER_MAX))
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error")  # what a parser of Python has doubts of is no header
                old = npy.read_magic(head) == (1, 0)
                read_header = npy.read_array_header_1_0 if old else npy.read_array_header_2_0
                shape, _, dtype = read_header(head)
        except Exception as error:  # numpy lets the tokenizer's own errors through
            raise TakeError(f"the header of '{name[:40]}' cannot be read", self._path) from error
        if dtype.hasobject or dtype.kind not in "fiu" or len(shape) != 1:
            return None
        if not 0 <= shape[0] <= MAX_SAMPLES:
            raise TakeError(f"more than {MAX_SAMPLES:,} samples in '{name[:40]}'", self._path)
        missing = head.tell() + shape[0] * dtype.itemsize - member.file_size
        if missing:
            state = "cut short" if missing > 0 else "longer than its header says"
            raise TakeError(f"'{name[:40]}' is {state}", self._path)
        return Row(name, shape[0], dtype, head.tell(), member)

    def blocks(self, row: Row) -> Iterator[Floats]:
        """The numbers of a row, some at a time. Raises TakeError."""
        n_values = row.length
        with _as_take_error(self._path), self._archive.open(row.member) as file:
            file.read(row.offset)
            while True:
                # At the end nothing is asked for once more: so the checksum is looked at.
                data = file.read(min(n_values, _BLOCK) * row.dtype.itemsize or 1)
                if not n_values:
                    return
                numbers = np.frombuffer(data, dtype=row.dtype)
                if len(numbers) != min(n_values, _BLOCK):
                    raise TakeError(f"'{row.name[:40]}' is cut short", self._path)
                n_values -= len(numbers)
                with np.errstate(all="ignore"):
                    yield numbers.astype(np.float64)

    def array(self, row: Row) -> Floats:
        """All numbers of a row. Raises TakeError."""
        numbers, at = np.empty(row.length), 0
        for block in self.blocks(row):
            numbers[at : at + len(block)] = block
            at += len(block)
        return numbers


@contextmanager
def npz(path: Path) -> Iterator[Npz]:
    """The arrays of a file while the block lasts. Raises TakeError, OSError."""
    with _Bounded(opened(path).detach()) as file:
        size = os.fstat(file.fileno()).st_size
        with _as_take_error(path):
            archive = zipfile.ZipFile(file)
        with archive:
            yield Npz(path, archive, size)


@contextmanager
def _as_take_error(path: Path) -> Iterator[None]:
    """Whatever zipfile and zlib raise of a damaged file: of a dozen kinds, and each has others."""
    try:
        yield
    except (TakeError, OSError, MemoryError):
        raise
    except Exception as error:
        why = str(error) or type(error).__name__
        raise TakeError(f"this is not an npz file that can be read ({why})", path) from None
