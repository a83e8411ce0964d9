"""The register of what ergon wrote: found again by later processes, bounded, never in the way."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from ergon.exchange import written
from ergon.exchange.safe import is_ours, write_text

WRITE = "import sys; from ergon.exchange.safe import write_text; write_text(*sys.argv[1:])"


@pytest.fixture
def state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A new register, and a process that remembers nothing."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.setattr(written, "_hashes_written_here", set())
    return tmp_path / "state" / "ergon"


def ergon(*words: object, **environment: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", WRITE, *map(str, words)]
    both = {**os.environ, **environment}
    return subprocess.run(command, capture_output=True, text=True, check=False, env=both)


def test_register_recognises_file_in_later_process(tmp_path: Path, state: Path) -> None:
    path = tmp_path / "x.txt"
    for text in ("one", "two"):
        assert ergon(path, text).returncode == 0
    assert is_ours(path)
    assert [len(line) for line in (state / "written").read_text().splitlines()] == [64, 64]
    assert (state / "written").stat().st_mode & 0o777 == 0o600
    assert state.stat().st_mode & 0o777 == 0o700


def test_register_absent_limits_knowledge_to_process(tmp_path: Path, state: Path) -> None:
    path = tmp_path / "x.txt"
    state.parent.write_text("no folder can be made here")
    write_text(path, "one")
    write_text(path, "two")
    again = ergon(path, "three")
    assert "no record of writing it as it is now; -f overwrites it" in again.stderr
    assert path.read_text() == "two"


def test_register_of_irregular_files_is_ignored(tmp_path: Path, state: Path) -> None:
    path = tmp_path / "x.txt"
    state.mkdir(parents=True)
    os.mkfifo(state / "written")
    (state / "written.old").symlink_to("/dev/zero")
    write_text(path, "one")
    written._hashes_written_here.clear()
    assert not is_ours(path)


def test_register_rotates_when_full(
    tmp_path: Path, state: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(written, "_REGISTER_BYTES_MAX", 65 * 10)
    paths = [tmp_path / f"{number}.txt" for number in range(35)]
    for path in paths:
        write_text(path, path.name)
    written._hashes_written_here.clear()
    assert [is_ours(path) for path in paths] == [False] * 20 + [True] * 15
    sizes = {path.name: path.stat().st_size for path in state.iterdir()}
    assert sizes == {"written": 65 * 5, "written.old": 65 * 10}


def test_register_with_concurrent_processes(tmp_path: Path, state: Path) -> None:
    many = "; ".join(["import sys", "from ergon.exchange.safe import write_text"])
    many += "\nfor i in range(50): write_text(f'{sys.argv[1]}-{i}', f'{sys.argv[1]} {i}')"
    words = [[sys.executable, "-c", many, str(tmp_path / name)] for name in "abcd"]
    processes = [subprocess.Popen(line) for line in words]
    assert [process.wait() for process in processes] == [0] * 4
    paths = [path for path in tmp_path.iterdir() if path.is_file()]
    assert len(paths) == 200
    assert all(map(is_ours, paths))
