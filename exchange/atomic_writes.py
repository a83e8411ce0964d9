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

    All are written and synced beside their targets before the first replaces its target. `check`
    is called for each path just before that, and raises if the file may not be written. Raises
    FileRefusedError, and what `check` raises.
    """
    at = {path: _resolved_path(path) for path in files}  # a link stays a link
    new_folders = {folder for path in at.values() for folder in path.parents if not folder.exists()}
    replaced: list[tuple[Path, Path | None]] = []  # what was written, and what was there before
    path = Path()
    with contextlib.ExitStack() as stack:
        try:
            parts = {}
            for path, data in files.items():
                at[path].parent.mkdir(parents=True, exist_ok=True)
                parts[path] = _write_beside(at[path], data, stack)
            for path in files:
                check(path)
            for path in files:
                exists = at[path].exists()
                old = _write_beside(at[path], at[path].read_bytes(), stack) if exists else None
                _move_to_target(parts[path], at[path], is_new=old is None)
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


def _write_beside(target: Path, data: bytes, stack: contextlib.ExitStack) -> Path:
    """Write and sync a temporary file beside the target; closing the stack removes it."""
    paths: list[Path] = []
    file = temporary.open_temporary(target, paths)
    part = paths[-1]
    stack.callback(part.unlink, missing_ok=True)
    stack.enter_context(file)
    file.write(data)
    file.flush()
    os.fsync(file.fileno())
    keep_mode(target, part)
    if not temporary.IS_LOCKED:  # on such systems an open file cannot be renamed
        file.close()
    return part


def _move_to_target(part: Path, target: Path, *, is_new: bool) -> None:
    """Move a file to its target; if `is_new`, the target must not exist by now."""
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
    """Sync folders, so that new names are on the disk."""
    for folder in dict.fromkeys(folders):
        with contextlib.suppress(OSError):
            handle = os.open(folder, os.O_RDONLY)
            try:
                os.fsync(handle)
            finally:
                os.close(handle)


def _resolved_path(path: Path) -> Path:
    """The path with its links resolved. Raises FileRefusedError."""
    try:
        return path.resolve()
    except (OSError, RuntimeError):  # RuntimeError up to Python 3.12, OSError from 3.13 on
        raise FileRefusedError(f"{path} is a symbolic link in a circle") from None
