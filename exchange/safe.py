"""Writing files whole or not at all, and never over a file of another program unless forced."""

from __future__ import annotations

import contextlib
import errno
import io
import os
import sys
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

from ergon.common.errors import ErgonError
from ergon.common.terminal import clean

from . import temporary
from .wave import is_render

if TYPE_CHECKING:
    from _typeshed import ReadableBuffer

MARK = b"made by ergon"  # stands within the first bytes of every text and MIDI file of ours
_MARK_WITHIN = 1024
# Errors of writing that name no file: the disk, a quota or the largest size of a file is reached.
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)


class FileRefusedError(ErgonError):
    """A file that is not written; the message says why, and what to do."""


def is_ours(path: Path) -> bool:
    """Whether ergon wrote the file earlier: a render by its originator, others by their mark. An
    empty file counts too.
    """
    try:
        with path.open("rb") as file:
            head = file.read(_MARK_WITHIN)
    except OSError:
        return False
    return not head or MARK in head or is_render(path)


def is_one_of(path: Path, others: Iterable[Path]) -> bool:
    """Whether the file is one of `others` under any name: a link, another case, another path."""
    try:
        stat = path.stat()
    except OSError:
        return False
    for other in others:
        with contextlib.suppress(OSError, ValueError):
            if os.path.samestat(stat, other.stat()):
                return True
    return False


def check_target(
    path: Path,
    *,
    force: bool = False,
    ours: Callable[[Path], bool] = is_ours,
    inputs: Iterable[Path] = (),
) -> None:
    """Raise FileRefusedError when `path` may not be written, before any work is done for it.

    A file in `inputs` is never written over, even with `force`.
    """
    try:
        is_loop = False
        path.stat()
    except OSError as error:
        is_loop = error.errno == errno.ELOOP
    if is_loop:
        raise FileRefusedError(f"{path} is a symbolic link in a circle")
    if path.is_dir():
        raise FileRefusedError(f"{path} is a folder")
    if is_one_of(path, inputs):
        raise FileRefusedError(f"{path} is an input of this command; give the output another name")
    if path.is_file() and not force and not ours(path):
        raise FileRefusedError(f"{path} exists and was not made by ergon (-f overwrites it)")


class _Terminal(io.BytesIO):
    """Standard output on a terminal: text, with characters that steer a terminal replaced."""

    def write(self, data: ReadableBuffer, /) -> int:
        """Print whole characters in UTF-8."""
        octets = bytes(data)
        sys.stdout.write(clean(octets.decode(errors="replace")))
        return len(octets)


@contextlib.contextmanager
def open_for_writing(
    target: str | Path,
    *,
    binary: bool,
    force: bool = False,
    sync: bool = True,
    inputs: Iterable[Path] = (),
) -> Iterator[BinaryIO]:
    """A file that appears under its name only when the block ends well.

    `-` is stdout, refused for binary data on a terminal. Whatever ends the block early (an
    exception, Ctrl-C, SIGTERM under `signals_as_exceptions`) removes what was written.
    """
    if str(target) == "-":
        if binary and sys.stdout.isatty():
            raise FileRefusedError(
                "binary data is not written to a terminal; give -o FILE or a pipe"
            )
        sys.stdout.flush()
        yield _Terminal() if sys.stdout.isatty() else sys.stdout.buffer
        sys.stdout.flush()
        return
    path = Path(target)
    check_target(path, force=force, inputs=inputs)
    if path.exists() and not path.is_file():  # a device or a named pipe: nothing to replace
        with path.open("wb") as file:
            yield file
        return
    path = path.resolve()  # a link stays a link; what it points to is replaced
    folders = [folder for folder in path.parents if not folder.exists()]
    _make_folder(path.parent)
    paths: list[Path] = []
    try:
        try:
            opened = temporary.open_temporary(path, paths)
        except OSError as error:
            raise FileRefusedError(f"{path} cannot be written: {error.strerror}") from None
        part = paths[-1]
        with opened:
            yield opened
            opened.flush()
            if sync:
                os.fsync(opened.fileno())
            keep_mode(path, part)
            if temporary.IS_LOCKED:  # a closed file is unlocked, and may be swept
                os.replace(part, path)
        if not temporary.IS_LOCKED:
            os.replace(part, path)
    except BaseException as error:
        for part in paths:
            part.unlink(missing_ok=True)
        remove_folders(folders)
        if isinstance(error, OSError) and error.errno in _FULL and error.filename is None:
            raise FileRefusedError(f"{path} cannot be written: {error.strerror}") from error
        raise


def _make_folder(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError):
        own = next(one for one in (folder, *folder.parents) if one.exists())
        raise FileRefusedError(f"{own} is a file, and no folder to write into") from None


def keep_mode(path: Path, part: Path) -> None:
    """Give a file the rights of the one that it replaces, or those of a new file.

    Until then its owner alone may open it: it can hold what a replaced file kept from others.
    """
    umask = os.umask(0o077)
    os.umask(umask)
    part.chmod(path.stat().st_mode & 0o777 if path.exists() else 0o666 & ~umask)


def remove_folders(folders: list[Path]) -> None:
    """Remove folders that were made, innermost first."""
    with contextlib.suppress(OSError):  # somebody else's file is in it by now
        for folder in folders:
            folder.rmdir()


def write_text(
    target: str | Path, text: str, *, force: bool = False, inputs: Iterable[Path] = ()
) -> None:
    """Write a whole text; its first lines must contain MARK if a later run is to recognise the
    file.
    """
    with open_for_writing(target, binary=False, force=force, inputs=inputs) as file:
        file.write(text.encode())
