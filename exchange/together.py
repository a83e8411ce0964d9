"""Several files written at once: all of them, or none."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

from . import temporary
from .safe import FileRefusedError, keep_mode, remove_folders


def write_all(files: Mapping[Path, bytes], check: Callable[[Path], None]) -> None:
    """Write files, all of them or none.

    All stand beside their targets, on the disk, before the first takes its place. `check` is asked
    of each just before that, and raises where it may not be written. Raises FileRefusedError, and
    what `check` raises.
    """
    at = {path: _real(path) for path in files}  # a link stays a link
    new_folders = {folder for path in at.values() for folder in path.parents if not folder.exists()}
    replaced: list[tuple[Path, Path | None]] = []  # what was written, and what was there before
    path = Path()
    with contextlib.ExitStack() as stack:
        try:
            parts = {}
            for path, data in files.items():
                at[path].parent.mkdir(parents=True, exist_ok=True)
                parts[path] = _beside(at[path], data, stack)
            for path in files:
                check(path)
            for path in files:
                exists = at[path].exists()
                old = _beside(at[path], at[path].read_bytes(), stack) if exists else None
                _put(parts[path], at[path], is_new=old is None)
                replaced.append((at[path], old))
            _sync(path.parent for path in at.values())
        except BaseException as error:
            for target, old in reversed(replaced):
                if old is None:
                    target.unlink(missing_ok=True)
                else:
                    os.replace(old, target)
            stack.close()
            remove_folders(sorted(new_folders, key=lambda folder: -len(folder.parts)))
            if isinstance(error, OSError):
                raise FileRefusedError(f"{path} cannot be written: {error.strerror}") from None
            raise


def _beside(target: Path, data: bytes, stack: contextlib.ExitStack) -> Path:
    """A file beside its target, on the disk; it goes with the stack."""
    paths: list[Path] = []
    file = temporary.opened(target, paths)
    part = paths[-1]
    stack.callback(part.unlink, missing_ok=True)
    stack.enter_context(file)
    file.write(data)
    file.flush()
    os.fsync(file.fileno())
    keep_mode(target, part)
    if not temporary.IS_LOCKED:  # a system that renames no open file
        file.close()
    return part


def _put(part: Path, target: Path, *, is_new: bool) -> None:
    """Let a file take its place; one that is new takes nobody's."""
    if is_new:
        try:
            os.link(part, target)
            return
        except FileExistsError:
            raise
        except OSError:  # a file system without links
            if target.exists():
                raise
    os.replace(part, target)


def _sync(folders: Iterable[Path]) -> None:
    """Names on the disk."""
    for folder in dict.fromkeys(folders):
        with contextlib.suppress(OSError):
            handle = os.open(folder, os.O_RDONLY)
            try:
                os.fsync(handle)
            finally:
                os.close(handle)


def _real(path: Path) -> Path:
    """What a path leads to. Raises FileRefusedError."""
    try:
        return path.resolve()
    except (OSError, RuntimeError):  # as Python up to 3.12 and from 3.13 on says it
        raise FileRefusedError(f"{path} is a symbolic link in a circle") from None
