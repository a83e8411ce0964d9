"""Parameters of C3D files, and numbers as the processor of a file writes them (The C3D File Format,
C3D.org, 2008).
"""

from __future__ import annotations

import math
import struct
from io import BufferedReader
from pathlib import Path

import numpy as np

from ergon.scores.gesture.take_file import Floats, TakeError

SECTOR_BYTES = 512
_DEC_PROCESSOR = 85
_BYTE_ORDER_BY_PROCESSOR = {84: "<", _DEC_PROCESSOR: "<", 86: ">"}  # Intel, DEC, MIPS
_BYTES_BY_TYPE = {-1: 1, 1: 1, 2: 2, 4: 4}  # bytes of a parameter's number, by type
_PARAMETER_BYTES_MAX = 1 << 17  # bytes: 255 sectors

Parameter = tuple[int, tuple[int, ...], bytes]  # type, dimensions, bytes
ParameterValues = dict[tuple[str, str], Parameter]  # by the names of their groups and their own


class NumberFormat:
    """Numbers as the processor of a file writes them."""

    def __init__(self, processor: int) -> None:
        """Of a processor by its number in a file."""
        self.byte_order = _BYTE_ORDER_BY_PROCESSOR[processor]
        self._is_dec = processor == _DEC_PROCESSOR

    def word(self, data: bytes, offset: int) -> int:
        """16 bits without a sign."""
        value: int = struct.unpack_from(f"{self.byte_order}H", data, offset)[0]
        return value

    def real(self, data: bytes, offset: int) -> float:
        """A number of 32 bits."""
        return float(self.reals(data[offset : offset + 4])[0])

    def reals(self, data: bytes) -> Floats:
        """Numbers of 32 bits. In DEC's format the two halves are swapped, and the value is four
        times as large.
        """
        if self._is_dec:
            halves = np.frombuffer(data, "<u2").reshape(-1, 2)[:, ::-1]
            return np.ascontiguousarray(halves).view("<f4")[:, 0].astype(np.float64) / 4
        return np.frombuffer(data, f"{self.byte_order}f4").astype(np.float64)


def read_parameters(
    open_file: BufferedReader, parameters_start: int, path: Path
) -> tuple[NumberFormat, ParameterValues, tuple[int, int]]:
    """How the file writes numbers, its parameters, and where the sector of the last one and their
    section end [bytes].
    """
    open_file.seek(parameters_start)
    section_bytes = open_file.read(_PARAMETER_BYTES_MAX)
    if len(section_bytes) < 4 or section_bytes[3] not in _BYTE_ORDER_BY_PROCESSOR:
        raise TakeError("this is not a C3D file that can be read: no parameters", path)
    number_format = NumberFormat(section_bytes[3])
    group_names: dict[int, str] = {}
    parameter_rows: list[tuple[int, str, Parameter]] = []
    cursor = 4
    while cursor + 2 < len(section_bytes):
        # A negative length of the name locks a parameter; a negative number makes it a group.
        name_length, group_number = (
            abs(struct.unpack_from("b", section_bytes, cursor)[0]),
            section_bytes[cursor + 1],
        )
        cursor += 2
        parameter_name = (
            section_bytes[cursor : cursor + name_length].decode("ascii", "replace").upper()
        )
        cursor += name_length
        if not name_length or cursor + 2 > len(section_bytes):
            break
        entry_distance = number_format.word(section_bytes, cursor)
        if group_number >= 0x80:
            group_names[0x100 - group_number] = parameter_name
        elif (value := _read_parameter(section_bytes, cursor + 2)) is not None:
            parameter_rows.append((group_number, parameter_name, value))
        if not entry_distance:
            break
        cursor += entry_distance
    parameter_values = {
        (group_names.get(group, ""), name): value for group, name, value in parameter_rows
    }
    n_used = -(-min(cursor, len(section_bytes)) // SECTOR_BYTES)
    # The third byte counts the sectors; some programs leave it 0.
    sector_counts = n_used, max(n_used, section_bytes[2])
    used_end, section_end = (parameters_start + SECTOR_BYTES * n for n in sector_counts)
    return number_format, parameter_values, (used_end, section_end)


def _read_parameter(parameter_bytes: bytes, byte_offset: int) -> Parameter | None:
    """The parameter that begins at an offset; None if it is damaged."""
    if byte_offset + 2 > len(parameter_bytes):
        return None
    number_type, n_dimensions = struct.unpack_from("bB", parameter_bytes, byte_offset)
    dimensions = tuple(parameter_bytes[byte_offset + 2 : byte_offset + 2 + n_dimensions])
    n_bytes = _BYTES_BY_TYPE.get(number_type, 0) * math.prod(dimensions)
    byte_offset += 2 + n_dimensions
    if number_type not in _BYTES_BY_TYPE or byte_offset + n_bytes > len(parameter_bytes):
        return None
    return number_type, dimensions, parameter_bytes[byte_offset : byte_offset + n_bytes]


def parameter_text(values: ParameterValues, group: str, name: str) -> str:
    """The characters of a parameter; empty if it has none."""
    kind, _, data = values.get((group, name), (0, (), b""))
    return data.decode("latin-1") if kind == -1 else ""


def first_number(
    parameter_values: ParameterValues,
    group_name: str,
    parameter_name: str,
    number_format: NumberFormat,
) -> float | None:
    """The first number of a parameter; two 16-bit integers are one number, the frame count of a
    long file.
    """
    number_type, _, value_bytes = parameter_values.get((group_name, parameter_name), (0, (), b""))
    if number_type == 4 and len(value_bytes) >= 4:
        return number_format.real(value_bytes, 0)
    if number_type == 2 and len(value_bytes) >= 4:
        return number_format.word(value_bytes, 0) + 0x10000 * number_format.word(value_bytes, 2)
    return (
        number_format.word(value_bytes, 0) if number_type == 2 and len(value_bytes) >= 2 else None
    )
