"""Waiting until files have changed and the editor has finished writing them."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

SETTLE = 50  # [ms] of quiet; editors write, rename and touch in bursts
_BURST = 1600  # [ms] after which a burst without an end counts as a change
_POLL_MILLISECONDS = 1000  # [ms] between extra looks, for changes between two waits


def changes(watched_files: set[Path]) -> Iterator[None]:
    """Yield once at the beginning, then after every change of one of `watched_files`.

    The caller may change the set in between. The folders are watched, not the files: many
    editors replace a file, which looks to a watcher of the file as if it disappeared.
    """
    from watchfiles import watch

    while True:
        states_before = _states(watched_files)
        yield
        # Files that the caller added meanwhile start with their present state.
        states_before = {
            **_states(watched_files),
            **{path: states_before[path] for path in states_before if path in watched_files},
        }
        folders = {path.resolve().parent for path in watched_files}
        for _ in watch(
            *folders,
            watch_filter=None,
            debounce=_BURST,
            step=SETTLE,
            rust_timeout=_POLL_MILLISECONDS,
            yield_on_timeout=True,
            recursive=False,
            raise_interrupt=True,
        ):
            states_now = _states(watched_files)
            # A missing file is being replaced: it will be back.
            if any(
                states_now[path] is not None and states_now[path] != states_before[path]
                for path in states_before
            ):
                break


def _states(files: set[Path]) -> dict[Path, tuple[int, int, int] | None]:
    return {path: _state(path) for path in files}


def _state(path: Path) -> tuple[int, int, int] | None:
    try:
        file_stat = path.stat()
    except OSError:
        return None
    return file_stat.st_ino, file_stat.st_mtime_ns, file_stat.st_size
