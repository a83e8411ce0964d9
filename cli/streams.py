"""Standard streams that never fail to write, even if they are closed or cannot encode a
character.
"""

from __future__ import annotations

import io
import os
import sys

_NAMES = (("stdin", "r"), ("stdout", "w"), ("stderr", "w"))


def make_whole() -> None:
    """Put the null device in place of closed streams, and escape characters that a stream cannot
    encode.

    Without this, the first file that is opened gets the number of a closed stream, and messages
    go into that file.
    """
    for number, (name, mode) in enumerate(_NAMES):
        stream = getattr(sys, name)
        if stream is None:
            null = open(_null(number), mode, encoding="utf-8", closefd=False)  # noqa: SIM115
            setattr(sys, name, null)
        elif isinstance(stream, io.TextIOWrapper) and mode == "w":
            stream.reconfigure(errors="backslashreplace")


def _null(number: int) -> int:
    """Open the null device under the stream's own number, if that is free."""
    try:
        os.fstat(number)
    except OSError:
        opened = os.open(os.devnull, os.O_RDWR)
        if opened != number:
            os.dup2(opened, number)
            os.close(opened)
        os.set_inheritable(number, True)  # as a shell's streams are
        return number
    return os.open(os.devnull, os.O_RDWR)
