"""Standard streams that never fail to write: closed ones, and those of narrow encodings."""

from __future__ import annotations

import io
import os
import sys

_NAMES = (("stdin", "r"), ("stdout", "w"), ("stderr", "w"))


def make_whole() -> None:
    """Put the null device where a stream is closed, and escape what one has no characters for.

    Else the first file that is opened gets the number of the closed stream, and what is said goes
    into it.
    """
    for number, (name, mode) in enumerate(_NAMES):
        stream = getattr(sys, name)
        if stream is None:
            null = open(_null(number), mode, encoding="utf-8", closefd=False)  # noqa: SIM115
            setattr(sys, name, null)
        elif isinstance(stream, io.TextIOWrapper) and mode == "w":
            stream.reconfigure(errors="backslashreplace")


def _null(number: int) -> int:
    """The null device under a stream's own number, if that is free."""
    try:
        os.fstat(number)
    except OSError:
        opened = os.open(os.devnull, os.O_RDWR)
        if opened != number:
            os.dup2(opened, number)
            os.close(opened)
        os.set_inheritable(number, True)  # as those of a shell are
        return number
    return os.open(os.devnull, os.O_RDWR)
