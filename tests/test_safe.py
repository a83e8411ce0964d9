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

from ergon.exchange.safe import MARK, RefusedError, is_ours, write_text, writing
from ergon.exchange.wave import WaveWriter
from ergon.exchange.wave_header import Stamp, WaveFormat


def test_nothing_is_seen_until_the_end(tmp_path: Path) -> None:
    path = tmp_path / "deep" / "x.bin"
    with writing(path, binary=True) as file:
        file.write(b"abc")
        assert not path.exists()
    assert path.read_bytes() == b"abc"
    assert list(path.parent.iterdir()) == [path]


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt, SystemExit])
def test_an_early_end_leaves_the_old_file(tmp_path: Path, error: type[BaseException]) -> None:
    path = tmp_path / "x.txt"
    write_text(path, "made by ergon: old")

    def fail() -> None:
        with writing(path, binary=True) as file:
            file.write(b"half")
            raise error

    with pytest.raises(error):
        fail()
    assert path.read_text() == "made by ergon: old"
    assert list(tmp_path.iterdir()) == [path]


def test_an_early_end_leaves_no_new_folder(tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt), writing(tmp_path / "a/b/x.txt", binary=False):
        raise KeyboardInterrupt
    assert list(tmp_path.iterdir()) == []


def test_a_place_that_takes_no_file_is_named_as_it_was_asked() -> None:
    with pytest.raises(RefusedError, match=r"^/proc/x\.wav cannot be written: "):
        write_text("/proc/x.wav", "x")


def test_foreign_files_are_refused_unless_forced(tmp_path: Path) -> None:
    path = tmp_path / "song.wav"
    soundfile.write(path, np.zeros(10), 44_100)
    before = path.read_bytes()
    with pytest.raises(RefusedError, match="not made by ergon"):
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
    with pytest.raises(RefusedError, match="folder"):
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
    with writing("/dev/null", binary=True) as file:
        file.write(b"abc")
    assert Path("/dev/null").is_char_device()


SLOW = """
import sys, time
from ergon.exchange.safe import writing
from ergon.exchange.signals import Terminated, signals_as_exceptions
try:
    with signals_as_exceptions(), writing(sys.argv[1], binary=True) as file:
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
        assert process.wait(timeout=30) == 128 + number
    assert list(tmp_path.iterdir()) == []


def test_a_reader_that_has_seen_enough_ends_the_writing_quietly() -> None:
    code = (
        "from ergon.cli import app\n"
        "from ergon.exchange.safe import writing\n"
        "def flood(*_, **__):\n"
        "    with writing('-', binary=True) as file:\n"
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
        assert process.wait(timeout=30) == 0


def test_no_binary_data_on_a_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.stdout.isatty", lambda: True, raising=False)
    with pytest.raises(RefusedError, match="terminal"), writing("-", binary=True):
        pass
