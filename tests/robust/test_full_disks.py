"""A disk that gets full: every command that computes files leaves what was there before."""

from __future__ import annotations

import os
import resource
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
from commands import forked
from sweep import few
from writing_commands import MAKERS, WRITERS, Writer, contents, make_inputs, writers_of

IS_ROOT = hasattr(os, "geteuid") and os.geteuid() == 0
PAGE = 4096
SIZE = 32 << 20  # bytes of the disk
(SWEEP,) = writers_of("sweep")
EVERY = (*MAKERS, *(writer for writer in WRITERS if writer is not SWEEP))
SHOWN = writers_of("new piece", "export s.yaml -o")


@pytest.fixture(scope="module")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("inputs")
    make_inputs(folder)
    return folder


@pytest.fixture
def disk(inputs: Path, tmp_path: Path) -> Iterator[Path]:
    """A small disk with what the commands read."""
    disk = tmp_path / "disk"
    disk.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", f"size={SIZE}", "tmpfs", str(disk)]
    if not IS_ROOT or subprocess.run(mount, capture_output=True).returncode:
        pytest.skip("no disk can be mounted here")
    try:
        yield shutil.copytree(inputs, disk / "here")
    finally:
        subprocess.run(["umount", "-l", str(disk)], check=True)


def leave(disk: Path, n_pages: int) -> None:
    """Fill the disk but for so many pages."""
    free = os.statvfs(disk).f_bavail
    with open(disk / "fill", "wb") as file:
        file.write(bytes(PAGE * max(0, free - n_pages)))


def is_refused(writer: Writer, folder: Path, *limits: tuple[int, int], message: str) -> bool:
    """Whether a command ends with a sentence; False if it does all it should."""
    done = forked([*writer.words, "-q"], folder, limits=limits)
    assert "Traceback" not in done.stderr, done.stderr
    assert "internal error" not in done.stderr, done.stderr
    if done.returncode == 0:
        return False
    assert done.returncode == 2, done.stderr
    assert f" cannot be written: {message}" in done.stderr
    return True


def names(folder: Path) -> set[str]:
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*")}


@pytest.mark.parametrize("writer", few(EVERY, SHOWN), ids=lambda writer: writer.line)
def test_full_disk_leaves_existing_files(disk: Path, writer: Writer) -> None:
    """Over nothing, and over what an earlier run made; with room for none of it, and for some."""
    before, there = names(disk), contents(disk)
    complete = shutil.copytree(disk, disk.parent.parent / "whole")
    assert not is_refused(writer, complete, message="")
    built = [complete / name for name in writer.files]
    n_pages = sum(-(-path.stat().st_size // PAGE) for path in built)
    is_over = False
    while True:
        for room in {0, n_pages // 3, n_pages - 1}:
            leave(disk.parent, room)
            assert is_refused(writer, disk, message="No space left"), room
            (disk.parent / "fill").unlink()
            assert contents(disk) == there, room
            assert names(disk) == before, room
        if is_over or writer in MAKERS:
            return
        assert not is_refused(writer, disk, message="")
        before, there, is_over = names(disk), contents(disk), True


def test_sweep_resumes_after_full_disk(disk: Path) -> None:
    before = names(disk)
    leave(disk.parent, 8)
    assert is_refused(SWEEP, disk, message="No space left")
    (disk.parent / "fill").unlink()
    left = names(disk) - before
    assert left <= {"sw", *SWEEP.files}
    sounds = {name: (disk / name).read_bytes() for name in left if name.endswith(".wav")}
    assert not is_refused(SWEEP, disk, message="")
    assert names(disk) - before == {"sw", *SWEEP.files}
    assert sounds == {name: (disk / name).read_bytes() for name in sounds}


@pytest.mark.parametrize("writer", few(EVERY, SHOWN[:1]), ids=lambda writer: writer.line)
def test_file_size_limit_leaves_existing_files(
    inputs: Path, tmp_path: Path, writer: Writer
) -> None:
    complete, folder = (shutil.copytree(inputs, tmp_path / name) for name in ("whole", "folder"))
    assert not is_refused(writer, complete, message="")
    largest = max((complete / name).stat().st_size for name in writer.files)
    before, there = names(folder), contents(folder)
    limit = (resource.RLIMIT_FSIZE, largest - 1)
    assert is_refused(writer, folder, limit, message="File too large")
    assert contents(folder) == there
    assert names(folder) == before
