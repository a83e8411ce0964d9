"""The command line for tests: starting it as a process, and reading the JSON lines that it
printed.
"""

import atexit
import contextlib
import json
import os
import signal
import socket
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from patience import PATIENCE

ERGON = [sys.executable, "-m", "ergon.cli"]
PATIENT = [sys.executable, str(Path(__file__).with_name("patient_ergon.py"))]  # lines have no limit


def records(capsys: pytest.CaptureFixture[str]) -> list[dict[str, Any]]:
    """The lines printed on stdout since the last call, one record each."""
    return [json.loads(line) for line in capsys.readouterr().out.splitlines()]


class _Forks:
    """`forked_ergon.py` as a process, and the socket for requests to it."""

    def __init__(self) -> None:
        self.channel, other = socket.socketpair()
        with other:
            words = [sys.executable, str(Path(__file__).with_name("forked_ergon.py"))]
            number = other.fileno()
            self.process = subprocess.Popen(
                [*words, str(number)], pass_fds=[number], start_new_session=True
            )
        self.channel.settimeout(PATIENCE)
        atexit.register(self.end)

    def ask(self, what: Mapping[str, Any]) -> int:
        self.channel.sendall(json.dumps(what).encode() + b"\n")
        output = b""
        while not output.endswith(b"\n"):
            more = self.channel.recv(100)
            assert more, "the process that forks has ended"
            output += more
        return int(output)

    def end(self) -> None:
        self.channel.close()
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self.process.pid, signal.SIGKILL)  # with a command that has not ended
        self.process.wait()


_forks = cache(_Forks)


def forked(
    words: Sequence[str],
    folder: Path,
    *,
    lines: str = "",
    limits: Sequence[tuple[int, int]] = (),
    merged: bool = False,
    killed_at: int = 0,
    **environment: str | None,
) -> subprocess.CompletedProcess[str]:
    """Exit code, stdout and stderr of `ergon WORDS`, in a forked process instead of a newly started
    one.

    `lines` are its standard input, `limits` pairs of a resource and its limit; variables that
    are None are removed from its environment; `merged` puts stderr into stdout. The process is
    killed when its Python code is about to change a file in `folder` for the `killed_at`-th time.
    """
    arguments = {**os.environ, **environment}
    with tempfile.TemporaryDirectory() as name:
        stdin, stdout, stderr = (Path(name, stream) for stream in ("stdin", "stdout", "stderr"))
        stdin.write_text(lines, encoding="utf-8")
        stdout.touch()
        stderr.touch()
        code = _forks().ask(
            {
                "words": list(words),
                "folder": str(folder.absolute()),
                "environment": {name: to for name, to in arguments.items() if to is not None},
                "streams": [str(stdin), str(stdout), str(stdout if merged else stderr)],
                "limits": list(limits),
                "killed_at": killed_at,
            }
        )
        texts = stdout.read_text(encoding="utf-8"), stderr.read_text(encoding="utf-8")
    return subprocess.CompletedProcess(list(words), code, *texts)
