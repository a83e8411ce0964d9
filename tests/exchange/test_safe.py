"""Files appear whole or not at all."""

import io
import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import soundfile
from patience import PATIENCE

from ergon.exchange import atomic_writes, temporary
from ergon.exchange.atomic_writes import write_all
from ergon.exchange.safe import MARK, FileRefusedError, is_ours, open_for_writing, write_text
from ergon.exchange.wave import WaveWriter
from ergon.exchange.wave_header import Stamp, WaveFormat


def test_nothing_is_seen_until_the_end(tmp_path: Path) -> None:
    path = tmp_path / "deep" / "x.bin"
    with open_for_writing(path, binary=True) as file:
        file.write(b"abc")
        assert not path.exists()
    assert path.read_bytes() == b"abc"
    assert list(path.parent.iterdir()) == [path]


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt, SystemExit])
def test_an_early_end_leaves_the_old_file(tmp_path: Path, error: type[BaseException]) -> None:
    path = tmp_path / "x.txt"
    write_text(path, "made by ergon: old")

    def fail() -> None:
        with open_for_writing(path, binary=True) as file:
            file.write(b"half")
            raise error

    with pytest.raises(error):
        fail()
    assert path.read_text() == "made by ergon: old"
    assert list(tmp_path.iterdir()) == [path]


def test_an_early_end_leaves_no_new_folder(tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt), open_for_writing(tmp_path / "a/b/x.txt", binary=False):
        raise KeyboardInterrupt
    assert list(tmp_path.iterdir()) == []


def test_a_place_that_takes_no_file_is_named_as_it_was_asked() -> None:
    with pytest.raises(FileRefusedError, match=r"^/proc/x\.wav cannot be written: "):
        write_text("/proc/x.wav", "x")


def test_foreign_files_are_refused_unless_forced(tmp_path: Path) -> None:
    path = tmp_path / "song.wav"
    soundfile.write(path, np.zeros(10), 44_100)
    before = path.read_bytes()
    with pytest.raises(FileRefusedError, match="not made by ergon"):
        write_text(path, "x")
    assert path.read_bytes() == before
    write_text(path, "x", force=True)
    assert path.read_text() == "x"


def test_our_own_files_are_recognised(tmp_path: Path) -> None:
    path = tmp_path / "x.wav"
    file = io.BytesIO()
    WaveWriter(file, WaveFormat(44_100, 1, 16), 0, Stamp("t")).close()
    path.write_bytes(file.getvalue())
    assert is_ours(path)
    text = tmp_path / "x.csv"
    text.write_bytes(b"# " + MARK + b"\n")
    assert is_ours(text)
    other = tmp_path / "notes.txt"
    other.write_text("mine")
    assert not is_ours(other)


def test_a_folder_is_refused(tmp_path: Path) -> None:
    with pytest.raises(FileRefusedError, match="folder"):
        write_text(tmp_path, "x")


def test_a_link_stays_a_link(tmp_path: Path) -> None:
    real, link = tmp_path / "real.txt", tmp_path / "link.txt"
    link.symlink_to(real)
    write_text(link, "made by ergon 1")
    write_text(link, "made by ergon 2")
    assert link.is_symlink()
    assert real.read_text() == "made by ergon 2"


def test_permissions_are_kept_and_new_files_follow_the_umask(tmp_path: Path) -> None:
    path = tmp_path / "x.txt"
    before = os.umask(0o027)
    try:
        write_text(path, "made by ergon")
    finally:
        os.umask(before)
    assert path.stat().st_mode & 0o777 == 0o640
    path.chmod(0o600)
    write_text(path, "made by ergon again")
    assert path.stat().st_mode & 0o777 == 0o600


def test_devices_are_written_straight() -> None:
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
def test_signals_leave_no_half_file(tmp_path: Path, number: signal.Signals) -> None:
    command = [sys.executable, "-c", SLOW, str(tmp_path / "x.wav")]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        assert len(list(tmp_path.iterdir())) == 1
        process.send_signal(number)
        assert process.wait(timeout=PATIENCE) == 128 + number
    assert list(tmp_path.iterdir()) == []


def test_a_reader_that_has_seen_enough_ends_the_writing_quietly() -> None:
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


def test_no_binary_data_on_a_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
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


def test_what_a_killed_writer_left_is_swept_and_nothing_else(tmp_path: Path) -> None:
    command = [sys.executable, "-c", KILLED, str(tmp_path / "x.wav")]
    foreign = [tmp_path / name for name in (".x.part", "song.1-2.part", ".notes.txt", "x.part")]
    for path in foreign:
        path.write_text("mine")
    (tmp_path / ".y.wav.1-0.part").symlink_to(foreign[0])
    (tmp_path / ".z.wav.1-0.part").mkdir()
    kept = {*tmp_path.iterdir()}
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        assert process.stdout.readline() == b"ready\n"
        (part,) = {*tmp_path.iterdir()} - kept
        assert temporary.remove_abandoned(tmp_path) == []  # its writer lives
        assert part.exists()
        process.stdin.write(b"x")
        process.stdin.close()
        assert process.wait(timeout=PATIENCE) == -signal.SIGKILL
    assert part.exists()
    subprocess.run(
        [sys.executable, "-c", "from ergon.exchange.safe import write_text as w;"
         "import sys; w(sys.argv[1], 'x')", str(tmp_path / "new.txt")], check=True
    )  # fmt: skip
    assert {*tmp_path.iterdir()} == kept | {tmp_path / "new.txt"}


def test_a_file_that_is_being_written_is_not_swept(tmp_path: Path) -> None:
    with open_for_writing(tmp_path / "x.bin", binary=True) as file:
        file.write(b"abc")
        assert temporary.remove_abandoned(tmp_path) == []
    assert (tmp_path / "x.bin").read_bytes() == b"abc"


def test_long_names_have_temporary_files_too(tmp_path: Path) -> None:
    path = tmp_path / ("é" * 120 + ".txt")
    write_text(path, "x")
    assert path.read_text() == "x"


def test_several_files_are_written_together_or_not_at_all(tmp_path: Path) -> None:
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


def test_who_makes_a_new_file_first_keeps_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    old, new = tmp_path / "a.txt", tmp_path / "b.txt"
    old.write_text("before")
    put = atomic_writes._move_to_target

    def raced(part: Path, target: Path, *, is_new: bool) -> None:
        if target == new:
            new.write_text("theirs")
        put(part, target, is_new=is_new)

    monkeypatch.setattr(atomic_writes, "_move_to_target", raced)
    with pytest.raises(FileRefusedError, match="File exists"):
        write_all({old: b"after", new: b"ours"}, lambda path: None)
    assert (old.read_text(), new.read_text()) == ("before", "theirs")
    assert sorted(tmp_path.iterdir()) == [old, new]


def test_a_file_in_the_place_of_a_folder_is_named(tmp_path: Path) -> None:
    (tmp_path / "blocker").touch()
    with (
        pytest.raises(FileRefusedError, match="blocker is a file, and no folder to write into"),
        open_for_writing(tmp_path / "blocker" / "deep" / "x.wav", binary=True),
    ):
        pass
