"""SDIF files: movements in columns of matrices, in frames that each have an instant.

Sound Description Interchange Format (Wright & others, SDIF Specification, CNMAT, 1999; Virolle &
Schwarz, SDIF Format Specification 3, IRCAM, 2006). A channel is `MATRIX.COLUMN`, by the name
that the file gives the column (its 1TYP declarations) or by its number from 1. If several
streams or rows have it, their numbers follow: `XPOS.x stream 2 row 1`. Numbers have no unit.
"""

from __future__ import annotations

import math
import os
import re
import struct
from array import array
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from io import BufferedReader
from pathlib import Path

import numpy as np

from ergon.notation.text.spelling import nearest
from ergon.scores.gesture.motion import metres_per_unit
from ergon.scores.gesture.take_file import MAX_CHANNELS, MAX_SAMPLES, Floats, TakeError, open_take

_FRAME_HEADER = struct.Struct(">dii")  # time, stream, number of matrices
_MATRIX_HEADER = struct.Struct(">4sIII")  # name, type, rows, columns
_DTYPE_BY_CODE = {
    0x0004: ">f4",
    0x0008: ">f8",
    0x0101: "i1",
    0x0102: ">i2",
    0x0104: ">i4",
    0x0108: ">i8",
}
_DTYPE_BY_CODE |= {0x0201: "u1", 0x0202: ">u2", 0x0204: ">u4", 0x0208: ">u8"}
_FRAME_BYTES_MAX = 1 << 24  # bytes of a frame
_TEXT_CHUNKS = (b"1NVT", b"1IDS")
_TEXT_BYTES_MAX = 1 << 20  # largest text of declarations
_DECLARATION_PATTERN = re.compile(r"1MTD\s+(\S{4})\s*\{([^{}]*)\}")
_STREAMS_LISTED_MAX = 12
_INSTANT_SECONDS_MAX = (
    1e9  # [s]; IRCAM's library writes the largest number where a frame has no instant
)
_KINDS_MAX = 64  # kinds of what is passed over that are counted each
_TOO_MANY = f"the file has more than {MAX_CHANNELS:,} columns in its matrices"

_Key = tuple[bytes, int, int, int]  # matrix, stream, row, column; from 0


@dataclass(slots=True)
class Column:
    """Values and their instants [s], in the order of the frames."""

    instants: array[float]
    values: array[float]


def read_columns(path: Path, unread: Counter[str] | None = None) -> dict[str, Column]:
    """All columns of a file by name; what is not a column is counted in `unread`. Raises
    TakeError, also if there are more than a take may have.
    """
    skipped_counts = Counter[str]() if unread is None else unread
    columns_by_key: dict[_Key, Column] = {}
    declared_columns: dict[bytes, list[str]] = {}
    n_values = 0
    for matrix_name, t, stream, matrix in _matrices(path, declared_columns, skipped_counts):
        n_values += matrix.size
        if matrix.size > MAX_CHANNELS:
            raise TakeError(_TOO_MANY, path)
        if n_values > MAX_SAMPLES:
            raise TakeError(f"the file has more than {MAX_SAMPLES:,} samples", path)
        for row_index, values in enumerate(matrix.tolist()):
            for column_index, column_value in enumerate(values):
                column_key = matrix_name, stream, row_index, column_index
                if (column := columns_by_key.get(column_key)) is None:
                    if len(columns_by_key) == MAX_CHANNELS:
                        raise TakeError(_TOO_MANY, path)
                    column = columns_by_key[column_key] = Column(array("d"), array("d"))
                column.instants.append(t)
                column.values.append(column_value)
    if not columns_by_key:
        raise TakeError("the file has no matrices of numbers", path)
    return _columns_by_name(columns_by_key, declared_columns)


def read_track(
    path: Path, channel_name: str | None, written_unit: float | None
) -> tuple[Floats, Floats]:
    """Instants [s] and positions [m] of a column, both counted from its first value."""
    all_columns = read_columns(path)
    if channel_name is None and len(all_columns) == 1:
        (channel_name,) = all_columns
    listed_names = ", ".join(list(all_columns)[:_STREAMS_LISTED_MAX])
    if (n_unlisted := len(all_columns) - _STREAMS_LISTED_MAX) > 0:
        listed_names += f" and {n_unlisted} more"
    if channel_name is None:
        raise TakeError(
            f"the file has several columns; write `channel` as one of {listed_names}", path
        )
    if channel_name not in all_columns:
        raise TakeError(
            f"no column '{channel_name[:60]}'; there are {listed_names}",
            path,
            suggestion=nearest(channel_name, all_columns),
            field="channel",
        )
    metres = metres_per_unit(None, written_unit, path)
    t, x = (
        np.frombuffer(all_columns[channel_name].instants),
        np.frombuffer(all_columns[channel_name].values),
    )
    return t - t[0], (x - x[0]) * metres


def _columns_by_name(
    columns_by_key: dict[_Key, Column], declared_columns: dict[bytes, list[str]]
) -> dict[str, Column]:
    streams_by_cell = {(name, row, column): set[int]() for name, _, row, column in columns_by_key}
    rows_by_column = {
        (name, stream, column): set[int]() for name, stream, _, column in columns_by_key
    }
    for matrix_name, stream, row_index, column_index in columns_by_key:
        streams_by_cell[matrix_name, row_index, column_index].add(stream)
        rows_by_column[matrix_name, stream, column_index].add(row_index)
    columns_by_name = {}
    for key, column_of in columns_by_key.items():
        matrix_name, stream, row_index, column_index = key
        titles = declared_columns.get(matrix_name, [])
        title = titles[column_index] if column_index < len(titles) else str(column_index + 1)
        column_name = f"{matrix_name.decode('latin-1')}.{title}"
        if len(streams_by_cell[matrix_name, row_index, column_index]) > 1:
            column_name += f" stream {stream}"
        if len(rows_by_column[matrix_name, stream, column_index]) > 1:
            column_name += f" row {row_index + 1}"
        columns_by_name[
            column_name
            if column_name not in columns_by_name
            else f"{column_name} ({column_index + 1})"
        ] = column_of
    return columns_by_name


def _matrices(
    path: Path, declared_columns: dict[bytes, list[str]], skipped_counts: Counter[str]
) -> Iterator[tuple[bytes, float, int, Floats]]:
    """Name, instant, stream and numbers of each matrix; the names of columns go into
    `declared_columns`, and what has no instant or no numbers into `skipped_counts`.
    """
    with open_take(path) as open_file:
        file_size = os.fstat(open_file.fileno()).st_size
        if open_file.read(4) != b"SDIF":
            raise TakeError("this is not an SDIF file", path)
        open_file.seek(4)
        _frame_content(open_file, file_size, path)
        while signature := open_file.read(4):
            frame_bytes = _frame_content(open_file, file_size, path)
            if signature == b"1TYP":
                _read_declarations(frame_bytes, declared_columns)
                continue
            if signature in _TEXT_CHUNKS or len(frame_bytes) < _FRAME_HEADER.size:
                _count_skipped(
                    skipped_counts, f"frame {_printable_name(signature)} without columns"
                )
                continue
            instant, stream, n_matrices = _FRAME_HEADER.unpack_from(frame_bytes)
            if not (
                math.isfinite(instant) and abs(instant) <= _INSTANT_SECONDS_MAX
            ):  # it applies to the whole file
                _count_skipped(
                    skipped_counts, f"frame {_printable_name(signature)} without an instant"
                )
                continue
            if n_matrices < 0:
                raise TakeError(f"the file has a frame with {n_matrices:,} matrices", path)
            matrices = _frame_matrices(frame_bytes, n_matrices, path, skipped_counts)
            yield from (
                (name, instant, stream, matrix_numbers) for name, matrix_numbers in matrices
            )


def _count_skipped(skipped_counts: Counter[str], noun: str) -> None:
    """Count what is passed over; a damaged file may have a name for each frame."""
    skipped_counts[
        noun if noun in skipped_counts or len(skipped_counts) < _KINDS_MAX else "anything else"
    ] += 1


def _printable_name(name: bytes) -> str:
    return name.decode("latin-1")


def _frame_content(open_file: BufferedReader, file_size: int, path: Path) -> bytes:
    """The content of a frame, which follows its size."""
    size_bytes = open_file.read(4)
    body_length = int.from_bytes(size_bytes, "big")
    if len(size_bytes) < 4 or body_length > file_size - open_file.tell():
        raise TakeError("the file ends within a frame", path)
    if body_length > _FRAME_BYTES_MAX:
        raise TakeError("the file has a frame of more than 16 MB", path)
    return open_file.read(body_length)


def _read_declarations(data: bytes, declared_columns: dict[bytes, list[str]]) -> None:
    """Read the names of columns that the file declares: `1MTD XPOS {x, y, z}`."""
    for name, titles in _DECLARATION_PATTERN.findall(data[:_TEXT_BYTES_MAX].decode("latin-1")):
        words = [word.strip() for word in titles.split(",")]
        declared_columns[name.encode("latin-1")] = [
            word.replace(".", "_") for word in words if word
        ]


def _frame_matrices(
    frame_bytes: bytes, n_matrices: int, path: Path, skipped_counts: Counter[str]
) -> Iterator[tuple[bytes, Floats]]:
    """Name and numbers of each matrix of a frame; matrices of other types go into
    `skipped_counts`.
    """
    matrix_offset = _FRAME_HEADER.size
    for _ in range(n_matrices):
        if matrix_offset + _MATRIX_HEADER.size > len(frame_bytes):
            raise TakeError("the file has a frame that is too short for its matrices", path)
        matrix_name, matrix_type, n_rows, n_columns = _MATRIX_HEADER.unpack_from(
            frame_bytes, matrix_offset
        )
        matrix_offset += _MATRIX_HEADER.size
        matrix_size = n_rows * n_columns * (matrix_type & 0xFF)
        if matrix_offset + matrix_size > len(frame_bytes):
            raise TakeError("the file has a matrix that is longer than its frame", path)
        if matrix_type in _DTYPE_BY_CODE and matrix_size:
            cell_values = np.frombuffer(
                frame_bytes, _DTYPE_BY_CODE[matrix_type], n_rows * n_columns, matrix_offset
            )
            yield matrix_name, cell_values.astype(np.float64).reshape(n_rows, n_columns)
        else:
            _count_skipped(skipped_counts, f"matrix {_printable_name(matrix_name)} without numbers")
        matrix_offset += matrix_size + -matrix_size % 8  # padded
    if len(frame_bytes) - matrix_offset >= _MATRIX_HEADER.size:
        _count_skipped(skipped_counts, "rest of a frame behind the matrices that it counts")
