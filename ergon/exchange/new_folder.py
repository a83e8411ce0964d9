"""A folder that appears under its name only when it is complete."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path

from . import temporary
from .safe import FileRefusedError, make_folder, remove_folders


def check_new_folder(folder: Path) -> None:
    """Raise FileRefusedError unless a folder may be made: there is none, or an empty one.

    Files that killed programs left in it are removed.
    """
    temporary.remove_abandoned(folder)
    if folder.exists() and not folder.is_dir():
        raise FileRefusedError(f"{folder} exists already and is not a folder")
    if folder.exists() and any(folder.iterdir()):
        raise FileRefusedError(f"{folder} exists already and is not empty")


@contextlib.contextmanager
def new_folder(folder: Path) -> Iterator[Path]:
    """A temporary folder to write into, whose files are in `folder` when the block ends well.

    A folder that exists and is empty is filled. Whatever ends the block early leaves no file.
    Raises FileRefusedError.
    """
    check_new_folder(folder)
    target_folder = folder.resolve()
    folder_exists = target_folder.exists()
    missing_parents = [ancestor for ancestor in target_folder.parents if not ancestor.exists()]
    make_folder(target_folder.parent)
    try:
        # Within a folder that exists: it may be the root of a file system, and keeps its rights.
        with temporary.temporary_folder(
            target_folder if folder_exists else target_folder.parent, target_folder.name
        ) as part_folder:
            yield part_folder
            _sync_files(part_folder)
            if folder_exists:
                _move_up(part_folder, target_folder)
            else:
                os.rename(part_folder, target_folder)
    except BaseException as error:
        remove_folders(missing_parents)
        if isinstance(error, OSError):
            reason = error.strerror or "it is in use"
            raise FileRefusedError(f"{folder} cannot be written: {reason}") from error
        raise


def _sync_files(folder: Path) -> None:
    for path in (*folder.rglob("*"), folder):
        with contextlib.suppress(PermissionError, IsADirectoryError):
            handle = os.open(path, os.O_RDONLY)
            try:
                os.fsync(handle)
            finally:
                os.close(handle)


def _move_up(part_folder: Path, target_folder: Path) -> None:
    """Move the content of `part_folder` into its parent: all of it, or nothing if a move fails."""
    moved_paths: list[tuple[Path, Path]] = []
    try:
        for path in sorted(part_folder.iterdir()):
            new_path = target_folder / path.name
            if new_path.exists():
                raise FileExistsError(17, "a file of this name appeared meanwhile", str(new_path))
            os.rename(path, new_path)
            moved_paths.append((path, new_path))
    except BaseException:
        for path, new_path in moved_paths:
            os.rename(new_path, path)
        raise
