"""Late ticks of a duet by the wall clock, with and without four pages that watch it, one of them
slow.

The machine's own lateness drifts for minutes. So each kind is played twice, the runs without
pages first and last, and a bare loop beside each shows how late the machine alone was.
"""

from __future__ import annotations

import json
import re
import socket
import subprocess
import tempfile
import threading
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from benches.beside import Bare, bare
from benches.duet import ERGON, key, written
from benches.measure import Row
from benches.native import Loops

_AHEAD = 4096  # frames kept ready, as docs/view.md advises with pages
_PAUSES = (0.0, 0.0, 0.0, 0.5)  # [s] that a page waits before it takes more
_TAKEN = 1 << 16  # bytes at once
_TAKEN_SLOWLY = 1 << 10  # bytes at once of who is slow: 2 kB/s, less than is sent
_TARGET = 0.0002  # of all ticks, more than without pages
# The data that a page of a large piece receives: as many flights as strikes.
_SKY = (
    "cloud: {BANK: {count: 10000, M: 0.5g, f: 20Hz..10kHz, t60: 0.3s..6s}, out: {SOX: cloud.all}}"
)
_RAIN = """\
strikes: {{rain: {{to: cloud.all, at: 0s, for: {seconds}s, rate: 0.05Hz, impulse: -6uNs..6uNs}}}}
"""


@dataclass
class _Run:
    """The result of one duet, and a bare loop beside it."""

    ticks: int
    late: int
    beside: Bare | None
    taken: Sequence[int] = ()  # bytes that each page took


def pages(loops: Loops | None, minutes: float = 1.0) -> list[Row]:
    """Late ticks of a duet of `minutes` minutes, without pages and with four."""
    seconds = max(1, round(30 * minutes))
    runs = [_played(seconds, loops, is_seen=is_seen) for is_seen in (False, True, True, False)]
    plain, seen = (runs[0], runs[3]), (runs[1], runs[2])
    without, beside = (
        sum(r.late for r in some) / sum(r.ticks for r in some) for some in (plain, seen)
    )
    bares = [[r.beside for r in some if r.beside] for some in (plain, seen)]
    alone = [
        sum(b.late * b.ticks for b in some) / max(1, sum(b.ticks for b in some)) for some in bares
    ]
    text = (
        f"a bare loop beside them: {alone[0]:.3%} and {alone[1]:.3%}"
        if all(bares)
        else "no bare loop"
    )
    least = min(min(run.taken) for run in seen)
    limit = max(max(run.taken) for run in seen)
    return [
        Row(
            f"a duet of two keys over UDP beside 10,000 oscillators, {_AHEAD:,} kept ready, "
            f"without pages and with four, 2 × {seconds} s each",
            f"{without:.3%} of ticks late without, {beside:.3%} with ({beside - without:+.3%}); "
            f"a page took {least / 1e6:.1f} to {limit / 1e6:.1f} MB",
            f"{text}; target: {_TARGET:+.2%} at most",
            None,
            "by the clock",
            {
                "late_without": without,
                "late_with": beside,
                "bare_without": alone[0],
                "bare_with": alone[1],
                "bytes_least": least,
                "bytes_most": limit,
            },
        )
    ]


def _played(seconds: int, loops: Loops | None, *, is_seen: bool) -> _Run:
    with tempfile.TemporaryDirectory() as folder, ExitStack() as keys:
        score = written(Path(folder), seconds, _SKY)
        with score.open("a") as file:
            file.write(_RAIN.format(seconds=seconds))
        first, second = (keys.enter_context(key(seconds, "--udp", "0")) for _ in range(2))
        live = ("--live", f"ada={first}", "--live", f"remi={second}")
        audio = ("--audio", "null,block=256", "--gain", "0dB", "--unchecked", "--json")
        view = ("--view",) if is_seen else ()
        command = [*ERGON, "duet", str(score), *live, *audio, "--ahead", str(_AHEAD), *view]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
            return _followed(process, loops, is_seen=is_seen)


def _followed(process: subprocess.Popen[str], loops: Loops | None, *, is_seen: bool) -> _Run:
    """Follow a duet to its end, with pages if `is_seen`."""
    assert process.stdout is not None
    url = json.loads(process.stdout.readline())["url"] if is_seen else None
    process.stdout.readline()  # it plays
    taken, over = [0] * len(_PAUSES), threading.Event()
    readers = [
        threading.Thread(target=_read, args=(url, taken, number, pause, over))
        for number, pause in enumerate(_PAUSES)
        if url is not None
    ]
    last = ""
    with bare(loops) as beside:
        for reader in readers:
            reader.start()
        for line in process.stdout:
            last = line
    over.set()
    for reader in readers:
        reader.join()
    assert process.wait() == 0, f"the duet ended with {process.returncode}: {last}"
    output = json.loads(last)
    assert not is_seen or min(taken) > 0, f"a page took nothing: {taken}"
    return _Run(output["ticks"], output["late_ticks"], beside, taken)


def _read(url: str, taken: list[int], number: int, pause: float, over: threading.Event) -> None:
    """A page: reads and counts what is sent until the duet is over."""
    result = re.match(r"http://(127\.0\.0\.1):(\d+)(.*/)", url)
    assert result is not None, url
    host, port, path = result.groups()
    with socket.socket() as page:
        if pause:
            page.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _TAKEN_SLOWLY)
        page.connect((host, int(port)))
        page.sendall(
            f"GET {path}live HTTP/1.1\r\nHost: {host}:{port}\r\nOrigin: http://{host}:{port}\r\n"
            "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
            "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n".encode()
        )
        head = page.recv(4096)
        assert b" 101 " in head.split(b"\r\n", 1)[0] + b" ", head
        try:
            while got := len(page.recv(_TAKEN_SLOWLY if pause else _TAKEN)):
                taken[number] += got
                if over.wait(pause) if pause else over.is_set():
                    return
        except ConnectionError:
            pass  # the duet has ended
