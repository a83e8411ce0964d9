"""`ergon view`: what it serves, what it refuses, and how it ends."""

import ctypes
import http.client
import json
import os
import re
import signal
import subprocess
import sys
import urllib.parse
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import pytest
from commands import ERGON
from motions import Piece
from one_bell import SCORE
from patience import PATIENCE

from ergon.cli import app

pytestmark = pytest.mark.usefixtures("work_folder")


@contextmanager
def view(
    *arguments: str, env: Mapping[str, str] | None = None
) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """The command, and the address that it printed."""
    process = subprocess.Popen(
        [*ERGON, "view", *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | (env or {}),
    )
    try:
        assert process.stdout is not None
        yield process, process.stdout.readline().strip()
    finally:
        process.kill()
        process.communicate()


def get(url: str) -> tuple[int, bytes]:
    place = urllib.parse.urlsplit(url)
    line = http.client.HTTPConnection(place.netloc, timeout=PATIENCE)
    line.request("GET", place.path)
    answer = line.getresponse()
    return answer.status, answer.read()


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
def test_view_serves_motion_file_until_ctrl_c() -> None:
    path = Piece().write(Path("a.motion"))
    with view("a.motion", "--stage") as (process, url):
        assert url.startswith("http://127.0.0.1:")
        assert url.endswith("/?stage")
        status, page = get(url)
        assert status == 200
        assert b"main.js" in page
        assert get(url.replace("?stage", "motion")) == (200, path.read_bytes())
        process.send_signal(signal.SIGINT)
        assert process.wait(PATIENCE) == 130


def test_view_of_a_bundled_piece_as_on_the_first_page() -> None:
    readme = Path(__file__).parents[2] / "README.md"
    [name] = re.findall(r"^ergon view ([\w-]+)  ", readme.read_text(encoding="utf-8"), re.MULTILINE)
    with view(name) as (_, url):
        status, page = get(url)
        assert status == 200
        assert b"main.js" in page
        status, motion = get(url.partition("?")[0] + "motion")
        assert (status, motion[:4]) == (200, b"ERGM")
    assert list(Path().iterdir()) == []  # nothing is written here


@pytest.mark.skipif(sys.platform != "linux", reason="signals to one thread")
def test_view_ends_by_signal_to_another_thread() -> None:
    Piece().write(Path("a.motion"))
    with view("a.motion") as (process, url):
        assert get(url)[0] == 200
        threads = [int(name) for name in os.listdir(f"/proc/{process.pid}/task")]
        others = [number for number in threads if number != process.pid]
        assert others
        if ctypes.CDLL(None, use_errno=True).tgkill(process.pid, others[0], signal.SIGINT):
            raise OSError(ctypes.get_errno(), "tgkill")
        assert process.wait(PATIENCE) == 130


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
def test_view_of_score_with_sound_and_cleanup() -> None:
    Path("s.yaml").write_text(SCORE)
    Path("tmp").mkdir()
    with view("s.yaml", env={"TMPDIR": str(Path("tmp").absolute())}) as (process, url):
        assert url.endswith("/?sound")
        status, motion = get(url.replace("?sound", "motion"))
        assert status == 200
        assert motion.startswith(b"ERGM")
        status, listened = get(url.replace("?sound", "sound.wav"))
        assert status == 200
        assert listened.startswith(b"RIFF")
        assert list(Path("tmp").iterdir())
        process.send_signal(signal.SIGINT)
        assert process.wait(PATIENCE) == 130
    assert not list(Path("tmp").iterdir())
    assert {path.name for path in Path().iterdir()} == {"s.yaml", "tmp"}


def test_view_on_all_interfaces_has_key_in_url() -> None:
    Piece().write(Path("a.motion"))
    with view("a.motion", "--at", "0.0.0.0:0", "--json") as (_, line):
        url = json.loads(line)["url"]
        key = urllib.parse.urlsplit(url).path.strip("/")
        assert len(bytes.fromhex(key)) == 16
        assert get(url)[0] == 200
        assert get(url.replace(key + "/", ""))[0] == 404


def test_view_refuses_files_other_than_motion(capsys: pytest.CaptureFixture[str]) -> None:
    Path("x.wav").write_bytes(b"RIFF")
    os.mkfifo("pipe.motion")
    for path, words in {
        "x.wav": "x.wav is neither a score (.yaml) nor a .motion file",
        "none.motion": "none.motion: No such file",
        ".": "Is a directory",
        "pipe.motion": "pipe.motion: not a regular file",  # whose other end nobody opens
    }.items():
        assert app.run(["view", path]) == 2
        assert words in capsys.readouterr().err
    Piece().write(Path("a.motion"))
    Path("s.yaml").write_text("strikes: 3\n")
    for arguments, words in {
        ("a.motion", "--see", "all"): "--see needs a score",
        ("s.yaml", "--sound", "x.wav"): "--sound needs a .motion file",
        ("a.motion", "--sound", "x.wav"): "x.wav: ",
        ("a.motion", "--sound", "none.wav"): "none.wav: No such file",
    }.items():
        assert app.run(["view", *arguments]) == 2
        assert words in capsys.readouterr().err
    assert app.run(["view", "s.yaml"]) == 1
    assert "s.yaml:1:" in capsys.readouterr().err
    for position in ("elsewhere.invalid:80", "127.0.0.1", "127.0.0.1:70000"):
        assert app.run(["view", "a.motion", "--at", position]) == 2
        assert "write HOST:PORT" in capsys.readouterr().err
