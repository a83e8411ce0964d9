"""Standard streams: made usable at the start of a command, flushed and closed at its end."""

from __future__ import annotations

import io
import os
import sys
from typing import Any

_NAMES = (("stdin", "r"), ("stdout", "w"), ("stderr", "w"))


def make_whole() -> None:
    """Put the null device in place of closed streams, and escape characters that a stream cannot
    encode. Streams that lead to one place are written in the order of what is printed.

    Without this, the first file that is opened gets the number of a closed stream, and messages
    go into that file.
    """
    for file_number, (stream_name, stream_mode) in enumerate(_NAMES):
        stream = getattr(sys, stream_name)
        if stream is None:
            null = open(_open_null(file_number), stream_mode, encoding="utf-8", closefd=False)  # noqa: SIM115
            setattr(sys, stream_name, null)
        elif isinstance(stream, io.TextIOWrapper) and stream_mode == "w":
            stream.reconfigure(errors="backslashreplace")
    # stderr is written line by line. Python keeps 8 KiB of stdout back unless it is a terminal.
    if isinstance(sys.stdout, io.TextIOWrapper) and _lead_to_one_place():
        sys.stdout.reconfigure(line_buffering=True)


def flush_and_close() -> OSError | None:
    """Write what is still buffered, and ask the system whether all that was written has arrived.

    A stream that fails leads to the null device from then on, so that neither a later message nor
    the end of the interpreter fails once more. Returns the first failure, with the name of its
    stream as the file name.
    """
    failure = None
    for stream, stream_name in ((sys.stdout, "standard output"), (sys.stderr, "standard error")):
        file_number = _file_number(stream)
        if file_number is None:
            continue
        try:
            stream.flush()
            os.close(os.dup(file_number))  # file systems of a network report a full disk here
        except OSError as error:
            null = os.open(os.devnull, os.O_WRONLY)
            os.dup2(null, file_number)
            os.close(null)
            stream.flush()
            failure = failure or OSError(error.errno, error.strerror, stream_name)
    return failure


def _lead_to_one_place() -> bool:
    file_numbers = [_file_number(stream) for stream in (sys.stdout, sys.stderr)]
    if None in file_numbers:
        return False
    stdout_status, stderr_status = (
        os.fstat(number) for number in file_numbers if number is not None
    )
    return os.path.samestat(stdout_status, stderr_status)


def _file_number(stream: Any) -> int | None:
    """The number of an open stream; None for what is no file, as in a test that captures it."""
    try:
        file_number: int = stream.fileno()
        os.fstat(file_number)
    except (OSError, ValueError):
        return None
    return file_number


def _open_null(file_number: int) -> int:
    """Open the null device under the stream's own number, if that is free."""
    try:
        os.fstat(file_number)
    except OSError:
        opened = os.open(os.devnull, os.O_RDWR)
        if opened != file_number:
            os.dup2(opened, file_number)
            os.close(opened)
        os.set_inheritable(file_number, True)  # a shell's streams are inheritable too
        return file_number
    return os.open(os.devnull, os.O_RDWR)
