"""Folders appear under their names when all that belongs in them is there."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from patience import PATIENCE

from ergon.exchange import temporary
from ergon.exchange.new_folder import new_folder
from ergon.exchange.safe import FileRefusedError


def fill(folder: Path) -> None:
    with new_folder(folder) as built:
        (built / "deep").mkdir()
        (built / "deep" / "a.txt").write_text("a")
        (built / "b.txt").write_text("b")
        assert not (folder / "b.txt").exists()


@pytest.mark.parametrize("before", ["missing", "empty"])
def test_new_folder_appears_complete(tmp_path: Path, before: str) -> None:
    folder = tmp_path / "above" / "new"
    if before == "empty":
        folder.mkdir(parents=True, mode=0o750)
    fill(folder)
    result = sorted(path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*"))
    inside = ["above/new/b.txt", "above/new/deep", "above/new/deep/a.txt"]
    assert result == ["above", "above/new", *inside]
    assert before == "missing" or folder.stat().st_mode & 0o777 == 0o750


@pytest.mark.parametrize("before", ["missing", "empty"])
def test_new_folder_interrupted_leaves_nothing(tmp_path: Path, before: str) -> None:
    folder = tmp_path / "above" / "new"
    if before == "empty":
        folder.mkdir(parents=True)
    saved = [*tmp_path.rglob("*")]

    def end_early() -> None:
        with new_folder(folder) as built:
            (built / "b.txt").write_text("b")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        end_early()
    assert [*tmp_path.rglob("*")] == saved


def test_new_folder_over_filled_folder_is_refused(tmp_path: Path) -> None:
    (tmp_path / "mine.txt").write_text("mine")
    with pytest.raises(FileRefusedError, match="exists already and is not empty"):
        fill(tmp_path)
    assert [*tmp_path.iterdir()] == [tmp_path / "mine.txt"]


@pytest.mark.parametrize("before", ["missing", "empty"])
def test_new_folder_filled_meanwhile_is_refused(tmp_path: Path, before: str) -> None:
    folder = tmp_path / "new"
    if before == "empty":
        folder.mkdir()

    def fill_too() -> None:
        with new_folder(folder) as built:
            (built / "a.txt").write_text("ours")
            (built / "b.txt").write_text("ours")
            folder.mkdir(exist_ok=True)
            (folder / "b.txt").write_text("theirs")

    with pytest.raises(FileRefusedError, match="new cannot be written: "):
        fill_too()
    assert [*folder.iterdir()] == [folder / "b.txt"]
    assert (folder / "b.txt").read_text() == "theirs"
    assert [*tmp_path.iterdir()] == [folder]


KILLED = """
import os, signal, sys
from pathlib import Path
from ergon.exchange.new_folder import new_folder
with new_folder(Path(sys.argv[1])) as made:
    (made / "deep").mkdir()
    (made / "deep" / "a.txt").write_text("a")
    print("ready", flush=True)
    sys.stdin.read(1)
    os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.mark.parametrize("before", ["missing", "empty"])
def test_remains_of_killed_program_are_removed(tmp_path: Path, before: str) -> None:
    folder = tmp_path / "new"
    if before == "empty":
        folder.mkdir()
    command = [sys.executable, "-c", KILLED, str(folder)]
    place = folder if before == "empty" else tmp_path
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        assert process.stdout.readline() == b"ready\n"
        (part,) = place.iterdir()
        assert temporary.remove_abandoned(place) == []  # its maker lives
        process.stdin.write(b"x")
        process.stdin.close()
        assert process.wait(timeout=PATIENCE) == -signal.SIGKILL
    assert (part / "deep" / "a.txt").exists()
    temporary._swept_folders.discard(place)
    fill(folder)
    assert sorted(os.listdir(folder)) == ["b.txt", "deep"]
    assert [*tmp_path.iterdir()] == [folder]
