"""What all files of takes share: size limits, errors, reading of lines."""

from __future__ import annotations

import codecs
import math
import os
from collections.abc import Iterator
from io import BufferedReader, TextIOWrapper
from pathlib import Path
from typing import IO

import numpy as np
from numpy.typing import NDArray

from ergon.common.regular import open_regular
from ergon.notation.text.errors import TextError

Floats = NDArray[np.float64]

SUFFIXES = (".take", ".csv", ".tsv", ".wav", ".npz", ".c3d", ".bvh", ".trc", ".sdif")
MAX_SAMPLES = 20_000_000  # two hours at 2.8 kHz; what `ergon._core.Take` accepts
MAX_BYTES = 1 << 30  # largest CSV or npz file, and largest unpacked npz file
LINE_LENGTH_MAX = 65_536  # characters; a thousand channels fit
MAX_CHANNELS = 1024
_BLOCK_BYTES = 1 << 20  # bytes of a text that are looked at together


class TakeError(TextError):
    """A take that cannot be read, with the `field` at fault, and the `line` (from 1) of a text
    file.
    """

    def __init__(
        self,
        message: str,
        path: Path,
        line: int | None = None,
        suggestion: str | None = None,
        field: str = "file",
    ) -> None:
        """Prefix the message with the file, and with the line if there is one."""
        place = path.name if line is None else f"{path.name}:{line}"
        super().__init__(f"{place}: {message}", suggestion=suggestion)
        self.line = line
        self.field = field


def time_order_error(
    row_instant: float, last_instant: float, path: Path, line_number: int
) -> TakeError:
    """The mistake of a row [s] that is not later than the row before it [s]."""
    message = (
        f"the time {row_instant:g} is not later than the time {last_instant:g} of the row before; "
    )
    return TakeError(f"{message}times must rise from row to row", path, line_number)


def open_take(path: Path) -> BufferedReader:
    """Open a file for reading, unless it is larger than a take may be. Raises TakeError,
    OSError.
    """
    raw_file = open_regular(path)
    if os.fstat(raw_file.fileno()).st_size > MAX_BYTES:
        raw_file.close()
        raise TakeError("the file has more than 1 GB", path)
    return raw_file


def open_text(path: Path) -> TextIOWrapper:
    """Open a text of a stranger: in UTF-8, in UTF-16 with its mark, else in Latin-1. Raises
    TakeError, OSError.
    """
    raw_file = open_take(path)
    try:
        encoding = _encoding(raw_file)
        raw_file.seek(0)
    except BaseException:
        raw_file.close()
        raise
    if encoding is None:
        raw_file.close()
        raise TakeError("this is not text", path)
    return TextIOWrapper(raw_file, encoding=encoding, errors="replace")


def _encoding(raw_file: BufferedReader) -> str | None:
    """How a text is coded; None for bytes that no text has."""
    byte_block = raw_file.read(_BLOCK_BYTES)
    if byte_block.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return "utf-16"
    decoder: codecs.IncrementalDecoder = codecs.getincrementaldecoder("utf-8")()
    is_utf8 = True
    while byte_block:
        if b"\0" in byte_block:
            return None
        try:
            decoder.decode(byte_block)
        except UnicodeDecodeError:
            is_utf8 = False
            decoder = codecs.getincrementaldecoder("latin-1")()
        byte_block = raw_file.read(_BLOCK_BYTES)
    try:
        decoder.decode(b"", final=True)
    except UnicodeDecodeError:
        is_utf8 = False
    return "utf-8-sig" if is_utf8 else "latin-1"


def content_lines(open_file: IO[str], path: Path) -> Iterator[tuple[int, str]]:
    """The lines of a text file without empty lines and comments, numbered from 1. Raises
    TakeError.
    """
    line_number = 0
    while text_line := open_file.readline(LINE_LENGTH_MAX):
        line_number += 1
        if len(text_line) == LINE_LENGTH_MAX:
            raise TakeError(
                f"this line has more than {LINE_LENGTH_MAX:,} characters", path, line_number
            )
        if (text := text_line.strip(" \r\n")) and text[0] != "#":
            yield line_number, text


def parse_cell(cell_text: str, path: Path, line_number: int) -> float:
    """The number in a cell of a table. Raises TakeError."""
    try:
        number = float(cell_text)
    except ValueError:
        number = math.nan
    if not abs(number) <= 1e15 or "_" in cell_text:  # also refuses nan
        raise TakeError(
            f"'{cell_text.strip()[:40]}' is not a number that a take can hold", path, line_number
        )
    return number
