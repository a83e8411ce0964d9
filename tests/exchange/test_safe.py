"""Files appear whole or not at all."""

import io
import os
import random
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import soundfile
from patience import PATIENCE

from ergon.exchange import safe, temporary
from ergon.exchange.safe import (
    FileRefusedError,
    file_group,
    is_ours,
    open_for_writing,
    write_all,
    write_text,
)
from ergon.exchange.wave import WaveWriter
from ergon.exchange.wave_header import Stamp, WaveFormat


def test_open_for_writing_shows_file_at_end_only(tmp_path: Path) -> None:
    path = tmp_path / "deep" / "x.bin"
    with open_for_writing(path, binary=True) as file:
        file.write(b"abc")
        assert not path.exists()
    assert path.read_bytes() == b"abc"
    assert list(path.parent.iterdir()) == [path]


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt, SystemExit])
def test_interrupted_write_leaves_old_file(tmp_path: Path, error: type[BaseException]) -> None:
    path = tmp_path / "x.txt"
    write_text(path, "old")

    def fail() -> None:
        with open_for_writing(path, binary=True) as file:
            file.write(b"half")
            raise error

    with pytest.raises(error):
        fail()
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_interrupted_write_leaves_no_new_folder(tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt), open_for_writing(tmp_path / "a/b/x.txt", binary=False):
        raise KeyboardInterrupt
    assert list(tmp_path.iterdir()) == []


def test_unwritable_path_message_names_it() -> None:
    with pytest.raises(FileRefusedError, match=r"^/proc/x\.wav cannot be written: "):
        write_text("/proc/x.wav", "x")


def test_foreign_files_are_refused_unless_forced(tmp_path: Path) -> None:
    path = tmp_path / "song.wav"
    soundfile.write(path, np.zeros(10), 44_100)
    before = path.read_bytes()
    with pytest.raises(FileRefusedError, match="no record of writing it as it is now"):
        write_text(path, "x")
    assert path.read_bytes() == before
    write_text(path, "x", force=True)
    assert path.read_text() == "x"


def test_write_over_written_file_until_edited(tmp_path: Path) -> None:
    path = tmp_path / "x.bin"
    write_text(path, "first")
    write_text(path, "second")
    assert is_ours(path)
    path.write_text("secont")  # as long as it was
    assert not is_ours(path)
    with pytest.raises(FileRefusedError, match="no record of writing it as it is now"):
        write_text(path, "third")
    assert path.read_text() == "secont"
    path.write_text("second")  # the edit was taken back
    write_text(path, "third")


def test_moved_wave_file_is_recognised(tmp_path: Path) -> None:
    path, moved = tmp_path / "x.wav", tmp_path / "y.wav"
    with open_for_writing(path, binary=True) as file:
        WaveWriter(file, WaveFormat(44_100, 1, 16), 0, Stamp("t")).close()
    path.rename(moved)
    assert is_ours(moved)
    with moved.open("r+b") as file:
        file.seek(60)
        file.write(b"x")
    assert not is_ours(moved)


def test_write_over_text_mentioning_ergon_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "notes.txt"
    path.write_text("What was made by ergon on Monday\n")
    with pytest.raises(FileRefusedError, match="was edited since ergon wrote it, or was written"):
        write_text(path, "x")
    assert path.read_text() == "What was made by ergon on Monday\n"


def test_write_over_render_of_earlier_version_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "x.wav"
    file = io.BytesIO()
    WaveWriter(file, WaveFormat(44_100, 1, 16), 0, Stamp("Of an earlier version")).close()
    path.write_bytes(file.getvalue())
    with pytest.raises(FileRefusedError, match=r"by an earlier version of ergon; -f overwrites it"):
        write_text(path, "x")


def test_write_over_empty_file(tmp_path: Path) -> None:
    path = tmp_path / "x.txt"
    path.touch()
    write_text(path, "x")
    assert path.read_text() == "x"


def test_write_over_irreplaceable_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "x.take"
    write_text(path, "hands", replaceable=False)
    assert not is_ours(path)
    with pytest.raises(FileRefusedError, match=r"x\.take exists; -f overwrites it"):
        write_text(path, "x", replaceable=False)
    assert path.read_text() == "hands"


@pytest.mark.parametrize("before", ["there", "missing"])
def test_write_over_file_changed_meanwhile_is_refused(tmp_path: Path, before: str) -> None:
    path = tmp_path / "x.txt"
    if before == "there":
        write_text(path, "first")

    def write() -> None:
        with open_for_writing(path, binary=False) as file:
            file.write(b"second")
            path.write_text("theirs")

    with pytest.raises(FileRefusedError, match="no record of writing it as it is now"):
        write()
    assert path.read_text() == "theirs"
    assert list(tmp_path.iterdir()) == [path]


def test_write_over_folder_is_refused(tmp_path: Path) -> None:
    with pytest.raises(FileRefusedError, match="folder"):
        write_text(tmp_path, "x")


def test_write_through_symbolic_link(tmp_path: Path) -> None:
    real, link = tmp_path / "real.txt", tmp_path / "link.txt"
    link.symlink_to(real)
    write_text(link, "1")
    write_text(link, "2")
    assert link.is_symlink()
    assert real.read_text() == "2"


def test_write_preserves_permissions_and_follows_umask(tmp_path: Path) -> None:
    path = tmp_path / "x.txt"
    before = os.umask(0o027)
    try:
        write_text(path, "x")
    finally:
        os.umask(before)
    assert path.stat().st_mode & 0o777 == 0o640
    path.chmod(0o600)
    write_text(path, "again")
    assert path.stat().st_mode & 0o777 == 0o600


def test_write_to_device_file_leaves_it_a_device() -> None:
    with open_for_writing("/dev/null", binary=True) as file:
        file.write(b"abc")
    assert Path("/dev/null").is_char_device()


SLOW = """
import sys, time
from ergon.exchange.safe import open_for_writing
from ergon.cli.signals import Terminated, signals_as_exceptions
try:
    with signals_as_exceptions(), open_for_writing(sys.argv[1], binary=True) as file:
        file.write(b"half")
        file.flush()
        print("ready", flush=True)
        time.sleep(60)
except KeyboardInterrupt:
    sys.exit(130)
except Terminated as end:
    sys.exit(128 + end.number)
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_signal_during_write_leaves_no_half_file(tmp_path: Path, number: signal.Signals) -> None:
    command = [sys.executable, "-c", SLOW, str(tmp_path / "x.wav")]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        assert len(list(tmp_path.iterdir())) == 1
        process.send_signal(number)
        assert process.wait(timeout=PATIENCE) == 128 + number
    assert list(tmp_path.iterdir()) == []


def test_closed_pipe_ends_writing_without_error() -> None:
    code = (
        "from ergon.cli import app\n"
        "from ergon.exchange.safe import open_for_writing\n"
        "def flood(*_, **__):\n"
        "    with open_for_writing('-', binary=True) as file:\n"
        "        while True: file.write(bytes(100_000))\n"
        "app.invoke = flood\n"
        "app.main([])"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        assert len(process.stdout.read(44)) == 44
        process.stdout.close()
        assert process.stderr.read() == b""
        assert process.wait(timeout=PATIENCE) == 0


def test_binary_output_to_terminal_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.stdout.isatty", lambda: True, raising=False)
    with pytest.raises(FileRefusedError, match="terminal"), open_for_writing("-", binary=True):
        pass


KILLED = """
import os, signal, sys
from ergon.exchange.safe import open_for_writing
with open_for_writing(sys.argv[1], binary=True) as file:
    file.write(b"half")
    file.flush()
    print("ready", flush=True)
    sys.stdin.read(1)
    os.kill(os.getpid(), signal.SIGKILL)
"""


WRITE = "import sys; from ergon.exchange.safe import write_text; write_text(sys.argv[1], 'x')"


def test_temporary_of_killed_writer_is_removed(tmp_path: Path) -> None:
    command = [sys.executable, "-c", KILLED, str(tmp_path / "x.wav")]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        assert process.stdout.readline() == b"ready\n"
        (part,) = tmp_path.iterdir()
        assert temporary.remove_abandoned(tmp_path) == []  # its writer lives
        assert part.exists()
        process.stdin.write(b"x")
        process.stdin.close()
        assert process.wait(timeout=PATIENCE) == -signal.SIGKILL
    assert part.read_bytes() == b"half"
    saved = (tmp_path / part.name.replace("x.wav", "rescued.wav"), tmp_path / f"{part.name}.wav")
    for copy in saved:
        copy.write_bytes(part.read_bytes())
    subprocess.run([sys.executable, "-c", WRITE, str(tmp_path / "new.txt")], check=True)
    assert {*tmp_path.iterdir()} == {*saved, tmp_path / "new.txt"}


def test_foreign_files_are_not_removed_as_temporaries(tmp_path: Path) -> None:
    chance = random.Random(3)
    digits = ["".join(chance.choices("0123456789abcdef", k=32)) for _ in range(1000)]
    names = [".holiday.2024-11.part", ".x.wav.1-0.part", ".x.part", "song.1-2.part", ".notes.txt"]
    for name in (*names, *(f".x.wav.{drawn}.part" for drawn in digits)):
        (tmp_path / name).write_text("mine")
    ours: list[Path] = []
    temporary.open_temporary(tmp_path / "x.wav", ours).close()
    name = ours[0].name
    ours[0].unlink()
    (tmp_path / name).symlink_to(tmp_path / names[0])
    before = {*tmp_path.iterdir()}
    assert temporary.remove_abandoned(tmp_path) == []
    assert {*tmp_path.iterdir()} == before
    (tmp_path / name).unlink()
    (tmp_path / name).touch()
    assert temporary.remove_abandoned(tmp_path) == [tmp_path / name]


def test_temporary_of_other_machine_is_not_removed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Locks of another machine are not seen on every network file system."""
    paths: list[Path] = []
    with monkeypatch.context() as patch:
        patch.setattr(temporary.platform, "node", lambda: "elsewhere")
        temporary.open_temporary(tmp_path / "x.wav", paths).close()
    assert temporary.remove_abandoned(tmp_path) == []
    assert paths[0].exists()


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can give a file away")
def test_temporary_of_other_user_is_not_removed(tmp_path: Path) -> None:
    paths: list[Path] = []
    temporary.open_temporary(tmp_path / "x.wav", paths).close()
    os.chown(paths[0], 12345, 12345)
    assert temporary.remove_abandoned(tmp_path) == []
    assert paths[0].exists()


def test_temporary_in_use_is_not_removed(tmp_path: Path) -> None:
    with open_for_writing(tmp_path / "x.bin", binary=True) as file:
        file.write(b"abc")
        assert temporary.remove_abandoned(tmp_path) == []
    assert (tmp_path / "x.bin").read_bytes() == b"abc"


def test_write_of_long_name_has_temporary_file(tmp_path: Path) -> None:
    path = tmp_path / ("é" * 120 + ".txt")
    write_text(path, "x")
    assert path.read_text() == "x"


def test_file_group_writes_all_or_nothing(tmp_path: Path) -> None:
    old, new = tmp_path / "old.txt", tmp_path / "deep" / "new.txt"
    old.write_text("before")
    old.chmod(0o600)
    files = {old: b"after", new: b"new"}

    def refuse(path: Path) -> None:
        if path == new:
            raise FileRefusedError("not this one")

    with pytest.raises(FileRefusedError, match="not this one"):
        write_all(files, refuse)
    assert old.read_text() == "before"
    assert list(tmp_path.iterdir()) == [old]
    write_all(files, lambda path: None)
    assert (old.read_text(), new.read_text()) == ("after", "new")
    assert old.stat().st_mode & 0o777 == 0o600
    assert sorted(tmp_path.rglob("*")) == [new.parent, new, old]


def test_file_group_with_failing_move_is_rolled_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    old, new, last = (tmp_path / name for name in ("old", "deep/new", "last"))
    write_text(old, "before")
    move = safe._move_to_target

    def full(part: Path, target: Path, *, is_new: bool) -> None:
        if target == last:
            raise OSError(28, "No space left on device")
        move(part, target, is_new=is_new)

    def write() -> None:
        with file_group() as files:
            for path in (old, new, last):
                files.write(path, b"after")

    for has_links in (True, False):
        if not has_links:
            monkeypatch.setattr(os, "link", _no_links)
        with monkeypatch.context() as patch:
            patch.setattr(safe, "_move_to_target", full)
            with pytest.raises(FileRefusedError, match="cannot be written: No space left"):
                write()
        assert [*tmp_path.iterdir()] == [old]
        assert old.read_text() == "before"
    write()
    assert {path.read_text() for path in (old, new, last)} == {"after"}
    assert sorted(tmp_path.rglob("*")) == [new.parent, new, last, old]


def test_file_group_with_same_file_twice_is_refused(tmp_path: Path) -> None:
    def write() -> None:
        with file_group() as files:
            files.write(tmp_path / "x.csv", b"table")
            files.write(tmp_path / "." / "deep" / ".." / "x.csv", b"picture")

    with pytest.raises(FileRefusedError, match=r"x\.csv would be written twice"):
        write()
    assert [*tmp_path.iterdir()] == []


@pytest.mark.parametrize("last", "abc")
def test_file_group_interrupted_is_rolled_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, last: str
) -> None:
    paths = [tmp_path / name for name in "abc"]
    write_text(paths[1], "before")
    move = safe._move_to_target

    def interrupted(part: Path, target: Path, *, is_new: bool) -> None:
        move(part, target, is_new=is_new)
        if target.name == last:
            raise KeyboardInterrupt

    def write() -> None:
        with file_group() as files:
            for path in paths:
                files.write(path, b"after")

    monkeypatch.setattr(safe, "_move_to_target", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write()
    assert [*tmp_path.iterdir()] == [paths[1]]
    assert paths[1].read_text() == "before"


def _no_links(*_: object) -> None:
    raise PermissionError(1, "Operation not permitted")


def test_write_all_does_not_replace_concurrent_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    old, new = tmp_path / "a.txt", tmp_path / "b.txt"
    old.write_text("before")
    put = safe._move_to_target

    def raced(part: Path, target: Path, *, is_new: bool) -> None:
        if target == new:
            new.write_text("theirs")
        put(part, target, is_new=is_new)

    def check(path: Path) -> None:
        if path == new and path.exists():
            raise FileRefusedError("theirs")

    monkeypatch.setattr(safe, "_move_to_target", raced)
    with pytest.raises(FileRefusedError, match="theirs"):
        write_all({old: b"after", new: b"ours"}, check)
    assert (old.read_text(), new.read_text()) == ("before", "theirs")
    assert sorted(tmp_path.iterdir()) == [old, new]


def test_write_below_regular_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "blocker").touch()
    with (
        pytest.raises(FileRefusedError, match="blocker is a file, and no folder to write into"),
        open_for_writing(tmp_path / "blocker" / "deep" / "x.wav", binary=True),
    ):
        pass
