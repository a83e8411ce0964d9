"""The files that this process writes, by Python's audit events; a kill at one of these."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

_WRITES = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC
# Events that change files, and which of their arguments is a path.
_CHANGES = {
    "os.remove": (0,),
    "os.rename": (0, 1),
    "os.link": (0, 1),
    "os.symlink": (1,),
    "os.mkdir": (0,),
    "os.rmdir": (0,),
    "os.truncate": (0,),
    "os.chmod": (0,),
}
_IGNORED = ("/dev/null",)

# For each active watch: its folder, and the names outside it that were written.
_watches: list[tuple[Path, list[str]]] = []


def _names(event: str, arguments: tuple[object, ...]) -> list[object]:
    if event == "open":
        name, _, flags = arguments
        return [name] if isinstance(flags, int) and flags & _WRITES else []
    return [arguments[at] for at in _CHANGES.get(event, ())]


def _changed_paths(event: str, arguments: tuple[object, ...]) -> Iterator[str]:
    for name in _names(event, arguments):
        if not isinstance(name, str | bytes | os.PathLike):
            continue  # a descriptor: its file was opened before
        path = os.path.realpath(os.fsdecode(name))
        # Python keeps its compiled files beside the sources.
        if path not in _IGNORED and "__pycache__" not in path:
            yield path


def _hook(event: str, arguments: tuple[object, ...]) -> None:
    if not _watches:
        return
    for path in _changed_paths(event, arguments):
        for folder, outside in _watches:
            if not Path(path).is_relative_to(folder):
                outside.append(f"{event} {path}")


_is_hooked = False


@contextmanager
def written_outside(folder: Path) -> Iterator[list[str]]:
    """Files outside a folder that Python code writes, moves or removes during the block."""
    global _is_hooked
    if not _is_hooked:  # a hook cannot be removed
        sys.addaudithook(_hook)
        _is_hooked = True
    watch = Path(os.path.realpath(folder)), []
    _watches.append(watch)
    try:
        yield watch[1]
    finally:
        _watches.remove(watch)


def kill_at(number: int, folder: Path) -> None:
    """Kill this process just before its Python code changes a file in a folder for the `number`-th
    time.
    """
    left = number

    def hook(event: str, arguments: tuple[object, ...]) -> None:
        nonlocal left
        if any(Path(path).is_relative_to(folder) for path in _changed_paths(event, arguments)):
            left -= 1
            if not left:
                os.kill(os.getpid(), signal.SIGKILL)

    sys.addaudithook(hook)
