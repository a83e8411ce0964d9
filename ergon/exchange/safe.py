"""Writing files whole or not at all, and never over a file of others unless forced.

One rule for every command that writes: a file is overwritten unasked if it is empty, or if it is
byte for byte as ergon wrote it (`written`); everything else needs `force`. docs/files.md lists what
each command writes.
"""

from __future__ import annotations

import contextlib
import errno
import io
import os
import shutil
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

from ergon.common.errors import ErgonError
from ergon.common.terminal import clean

from . import temporary, written
from .wave import is_render

if TYPE_CHECKING:
    from _typeshed import ReadableBuffer

MARK = b"made by ergon"  # stands within the first bytes of texts and MIDI files of ours
_MARK_BYTES_MAX = 1024
# Errors of writing that name no file: the disk, a quota or the largest size of a file is reached.
_FULL_DISK_ERRNOS = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)


class FileRefusedError(ErgonError):
    """A file that is not written; the message says why, and what to do."""


def is_ours(path: Path) -> bool:
    """Whether a file is as ergon wrote it, so that it can be computed again. An empty file, in
    which there is nothing to lose, counts too.
    """
    with contextlib.suppress(OSError):
        return path.stat().st_size == 0 or written.is_known(path)
    return False


def _has_mark(path: Path) -> bool:
    """Whether a file says that ergon made it: a render by its originator, others by their mark."""
    try:
        with path.open("rb") as file:
            first_bytes = file.read(_MARK_BYTES_MAX)
    except OSError:
        return False
    return MARK in first_bytes or is_render(path)


def is_one_of(path: Path, other_paths: Iterable[Path]) -> bool:
    """Whether the file is one of `other_paths` under any name: a link or another case."""
    try:
        stat = path.stat()
    except OSError:
        return False
    for other_path in other_paths:
        with contextlib.suppress(OSError, ValueError):
            if os.path.samestat(stat, other_path.stat()):
                return True
    return False


def check_target(
    path: Path, *, force: bool = False, inputs: Iterable[Path] = (), replaceable: bool = True
) -> None:
    """Raise FileRefusedError when `path` may not be written, before any work is done for it.

    A file in `inputs` is never written over, even with `force`. What is not `replaceable`, because
    nothing can compute it again, is never overwritten unasked.
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
    if not path.is_file() or force:
        return
    if not replaceable:
        raise FileRefusedError(f"{path} exists; -f overwrites it")
    if not is_ours(path):
        raise FileRefusedError(f"{path} {_overwrite_reason(path)}; -f overwrites it")


def _overwrite_reason(path: Path) -> str:
    if _has_mark(path):
        return (
            "was edited since ergon wrote it, or was written on another machine or by an earlier "
            "version of ergon"
        )
    return "exists, and ergon has no record of writing it as it is now"


class _Terminal(io.BytesIO):
    """Standard output on a terminal: text, with characters that steer a terminal replaced."""

    def write(self, data: ReadableBuffer, /) -> int:
        """Print whole characters in UTF-8."""
        data_bytes = bytes(data)
        sys.stdout.write(clean(data_bytes.decode(errors="replace")))
        return len(data_bytes)


@contextlib.contextmanager
def _standard_output(*, binary: bool) -> Iterator[BinaryIO]:
    """Standard output, refused for binary data on a terminal."""
    if binary and sys.stdout.isatty():
        raise FileRefusedError("binary data is not written to a terminal; give -o FILE or a pipe")
    sys.stdout.flush()
    yield _Terminal() if sys.stdout.isatty() else sys.stdout.buffer
    sys.stdout.flush()


@dataclass(frozen=True, slots=True)
class _PendingFile:
    """A file that has no name yet: `path` as it was asked for, `target` with its links resolved."""

    path: Path
    target: Path
    part_path: Path
    file: BinaryIO

    def has_its_name(self) -> bool:
        """Whether the target is this file by now."""
        if not temporary.IS_LOCKED:
            return not self.part_path.exists()
        return temporary.has_path(self.file.fileno(), self.target)


@dataclass(slots=True)
class FileGroup:
    """Files that get their names together, when all of them are whole.

    `check_target` raises if a file may not be written. It is called before any work, and again
    before the first file gets its name.
    """

    check_target: Callable[[Path], None]
    is_recorded: bool  # whether a later command may overwrite them unasked
    is_synced: bool = True
    exit_stack: contextlib.ExitStack = field(default_factory=contextlib.ExitStack)
    new_folders: set[Path] = field(default_factory=set)
    pending_files: list[_PendingFile] = field(default_factory=list)
    samples_hashes: dict[BinaryIO, str] = field(default_factory=dict)  # their hashes, where known

    def open(self, target: str | Path, *, binary: bool) -> BinaryIO:
        """A file of the group. `-` is stdout; it and devices are written straight.

        Raises FileRefusedError.
        """
        if str(target) == "-":
            return self.exit_stack.enter_context(_standard_output(binary=binary))
        path_as_given = Path(target)
        self.check_target(path_as_given)
        if (
            path_as_given.exists() and not path_as_given.is_file()
        ):  # a device or a named pipe: nothing to replace
            return self.exit_stack.enter_context(path_as_given.open("wb"))
        path = _resolved_path(path_as_given)  # a link stays a link; what it points to is replaced
        if any(pending_file.target == path for pending_file in self.pending_files):
            raise FileRefusedError(
                f"{path_as_given} would be written twice; give the outputs other names"
            )
        self.new_folders.update(folder for folder in path.parents if not folder.exists())
        make_folder(path.parent)
        paths: list[Path] = []
        self.exit_stack.callback(_unlink_all, paths)
        try:
            temporary_file = temporary.open_temporary(path, paths)
        except OSError as error:
            raise FileRefusedError(f"{path} cannot be written: {error.strerror}") from None
        self.exit_stack.enter_context(temporary_file)
        self.pending_files.append(_PendingFile(path_as_given, path, paths[-1], temporary_file))
        return temporary_file

    def write(self, target: str | Path, data: bytes) -> None:
        """A whole file of the group, on the disk but for its name."""
        temporary_file = self.open(target, binary=False)
        temporary_file.write(data)
        temporary_file.flush()
        if self.is_synced and self.pending_files and self.pending_files[-1].file is temporary_file:
            os.fsync(
                temporary_file.fileno()
            )  # some file systems say only now that the disk is full

    def note_samples_hash(self, file: BinaryIO, samples_hash: str) -> None:
        """Note the hash of the samples of a file, which need not be computed again."""
        self.samples_hashes[file] = samples_hash

    def commit(self) -> None:
        """Give all files their names; if one cannot get it, the others are as they were."""
        for pending in self.pending_files:
            pending.file.flush()
            if self.is_synced:
                os.fsync(pending.file.fileno())
            keep_mode(pending.target, pending.part_path)
            if self.is_recorded:
                hashed_samples = self.samples_hashes.get(pending.file)
                written.remember(written.digest(pending.file, hashed_samples))
            if not temporary.IS_LOCKED:  # such a system cannot rename an open file
                pending.file.close()
        for pending in self.pending_files:
            self.check_target(pending.path)  # somebody else may have written there meanwhile
        moved_files: list[
            tuple[_PendingFile, Path | None]
        ] = []  # files that were moved, with their predecessors
        try:
            for pending in self.pending_files:
                moved_files.append((pending, self._keep_old(pending.target)))
                self._move(pending)
        except BaseException:
            for pending, path_before in reversed(moved_files):
                if not pending.has_its_name():
                    continue
                if path_before is None:
                    pending.target.unlink()
                else:
                    os.replace(path_before, pending.target)
            raise
        if self.is_synced and not self.is_recorded:  # content that cannot be computed again
            _sync_folders(pending.target.parent for pending in self.pending_files)

    def _keep_old(self, target_path: Path) -> Path | None:
        """A second name or a copy of a file that is about to be replaced; None if there is none, or
        if nothing can fail after it.
        """
        if len(self.pending_files) == 1 or not target_path.exists():
            return None
        paths: list[Path] = []
        self.exit_stack.callback(_unlink_all, paths)
        try:
            self.exit_stack.callback(os.close, temporary.link_temporary(target_path, paths))
        except OSError:  # a file system without links
            copy = self.exit_stack.enter_context(temporary.open_temporary(target_path, paths))
            with target_path.open("rb") as file:
                shutil.copyfileobj(file, copy)
            copy.flush()
            keep_mode(target_path, paths[-1])
        return paths[-1]

    def _move(self, pending: _PendingFile) -> None:
        try:
            _move_to_target(pending.part_path, pending.target, is_new=not pending.target.exists())
        except FileExistsError:  # somebody was faster
            self.check_target(pending.path)
            _move_to_target(pending.part_path, pending.target, is_new=False)


@contextlib.contextmanager
def _committed_group(open_group: FileGroup) -> Iterator[FileGroup]:
    """A group for the time of a block. Whatever ends the block early (an exception, Ctrl-C, SIGTERM
    under `signals_as_exceptions`) removes what was written.
    """
    try:
        with open_group.exit_stack:
            yield open_group
            open_group.commit()
    except BaseException as error:
        remove_folders(sorted(open_group.new_folders, key=lambda folder: -len(folder.parts)))
        if (
            isinstance(error, OSError)
            and error.errno in _FULL_DISK_ERRNOS
            and open_group.pending_files
        ):
            names = [str(pending_file.target) for pending_file in open_group.pending_files]
            if error.filename is None or error.filename in names:
                name = error.filename or names[0]
                raise FileRefusedError(f"{name} cannot be written: {error.strerror}") from error
        raise


def file_group(
    *,
    force: bool = False,
    inputs: Iterable[Path] = (),
    sync: bool = True,
    replaceable: bool = True,
) -> contextlib.AbstractContextManager[FileGroup]:
    """Files that appear under their names together when the block ends well, or not at all.

    `force`, `inputs` and `replaceable` are those of `check_target`. Without `sync`, a failing
    power supply may lose what was written.
    """
    check = partial(check_target, force=force, inputs=tuple(inputs), replaceable=replaceable)
    return _committed_group(FileGroup(check, replaceable, sync))


@contextlib.contextmanager
def open_for_writing(
    target_path: str | Path,
    *,
    binary: bool,
    force: bool = False,
    sync: bool = True,
    inputs: Iterable[Path] = (),
    replaceable: bool = True,
) -> Iterator[BinaryIO]:
    """A file that appears under its name only when the block ends well; see `file_group`.

    `-` is stdout, refused for binary data on a terminal.
    """
    grouped = file_group(force=force, inputs=inputs, sync=sync, replaceable=replaceable)
    with grouped as group:
        yield group.open(target_path, binary=binary)


def write_text(
    target_path: str | Path,
    file_text: str,
    *,
    force: bool = False,
    inputs: Iterable[Path] = (),
    replaceable: bool = True,
) -> None:
    """Write a whole text; see `file_group`."""
    with file_group(force=force, inputs=inputs, replaceable=replaceable) as group:
        group.write(target_path, file_text.encode())


def write_all(files: Mapping[Path, bytes], check: Callable[[Path], None]) -> None:
    """Write files of the user, all of them or none; `check` raises if one may not be written.

    Raises FileRefusedError, and what `check` raises.
    """
    path = Path()
    try:
        with _committed_group(FileGroup(check, is_recorded=False)) as group:
            for path, data in files.items():
                group.write(path, data)
    except OSError as error:
        raise FileRefusedError(f"{path} cannot be written: {error.strerror}") from None


def make_folder(folder: Path) -> None:
    """Make a folder and those above it. Raises FileRefusedError where a file is in the way."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError):
        existing = next(ancestor for ancestor in (folder, *folder.parents) if ancestor.exists())
        raise FileRefusedError(f"{existing} is a file, and no folder to write into") from None


def keep_mode(path: Path, part_path: Path) -> None:
    """Give a file the rights of the one that it replaces, or those of a new file.

    Until then its owner alone may open it: it can hold what a replaced file kept from others.
    """
    umask = os.umask(0o077)
    os.umask(umask)
    part_path.chmod(path.stat().st_mode & 0o777 if path.exists() else 0o666 & ~umask)


def remove_folders(folders: Iterable[Path]) -> None:
    """Remove the folders of this group, innermost first, except those with files of others."""
    for folder in folders:
        with contextlib.suppress(OSError):
            folder.rmdir()


def _unlink_all(paths: list[Path]) -> None:
    for path in paths:
        path.unlink(missing_ok=True)


def _resolved_path(path: Path) -> Path:
    """The path with its links resolved. Raises FileRefusedError."""
    try:
        return path.resolve()
    except (OSError, RuntimeError):  # RuntimeError up to Python 3.12, OSError from 3.13 on
        raise FileRefusedError(f"{path} is a symbolic link in a circle") from None


def _move_to_target(part_path: Path, target_path: Path, *, is_new: bool) -> None:
    """Move a file to its target; if `is_new`, the target must not exist by now."""
    if is_new:
        try:
            os.link(part_path, target_path)
            return
        except FileExistsError:
            raise
        except OSError:  # a file system without links
            if target_path.exists():
                raise
    os.replace(part_path, target_path)


def _sync_folders(folders: Iterable[Path]) -> None:
    """Sync folders, so that new names are on the disk."""
    for folder in dict.fromkeys(folders):
        with contextlib.suppress(OSError):
            handle = os.open(folder, os.O_RDONLY)
            try:
                os.fsync(handle)
            finally:
                os.close(handle)
