"""The time until the force on a hand is zero: every way to stop, idle and while a line is running.

A simulated board records each packet by CLOCK_MONOTONIC. The result is the time from the signal,
or from the write of a key or a line, to the first packet after which no force follows.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from statistics import median

from real_time import real_time
from simulated_board import Simulated, simulated
from terminals import CTRL_D, ENTER, F12, Terminal

from benches.measure import Row

_ERGON = [sys.executable, "-m", "ergon.cli"]
_FORCE = 0.01  # [N]; less is none
_AFTER = 0.3  # [s] that the board is watched after a stop
_BUSY_SECONDS = 1.0  # [s] after which a slow line is surely at work
_PATIENCE = 60.0  # [s] for a force to be there
# A line that never ends: it locks a C mutex twice, and releases the GIL meanwhile.
_SLOW = (
    "py (lambda c, m: (c.pthread_mutex_lock(m), c.pthread_mutex_lock(m)))"
    '(__import__("ctypes").CDLL(None), __import__("ctypes").create_string_buffer(64))'
)
_SCORE = """\
ergon: 1
keys: {k1: {M: 400g, K: 60N/m, Z: 1.2Ns/m, travel: -15mm..15mm}, k2: {like: k1}}
instruments:
  bell:
    modules:
      m: {CEL: {M: 20g, f: 110Hz, t60: 1s}}
      b: {BUT: {between: [k2, m], K: 300N/m, Z: 0.1Ns/m, gap: 0mm}}
    out: {SOX: m}
gestures: {knock: 0mm@0 smooth 6mm@60ms 0mm@160ms}
players: {ada: {key: k1}, remi: {hand: live, key: k2}}
"""
WAYS = ("TERM", "INT", "HUP", "panic", "quit", "end", "F12")
# Ways that are documented to do something else: docs/repl.md, docs/socket.md.
LEFT_OUT = {
    ("terminal", "idle", "INT"): "clears the line",
    ("socket", "idle", "HUP"): "the engine outlives its terminal",
    ("socket", "slow", "HUP"): "the engine outlives its terminal",
    ("socket", "idle", "end"): "the prompt leaves, the session goes on",
    ("socket", "slow", "end"): "the prompt leaves, the session goes on",
}


@dataclass(frozen=True, slots=True)
class Prompt:
    """A running prompt: how it receives a line, a key and the end of input, and which process gets
    signals.
    """

    enter: Callable[[str], None]
    key: Callable[[str], None]
    end: Callable[[], None]
    process: int

    def stop(self, method: str) -> None:
        """Stop the force in this way."""
        if method in ("TERM", "INT", "HUP"):
            os.kill(self.process, getattr(signal, f"SIG{method}"))
        elif method == "F12":
            self.key(F12)
        elif method == "end":
            self.end()
        else:
            self.enter(method)


def stops(runs: int = 5) -> list[Row]:
    """Every way, `runs` times each."""
    rows = []
    for where in _PROMPTS:
        for state in ("idle", "slow"):
            result = {}
            for method in WAYS:
                if (where, state, method) not in LEFT_OUT:
                    result[method] = [_stopped(where, state, method) for _ in range(runs)]
                    print(
                        f"  {where:8} {state:4} {method:5} {_summary(result[method])}", flush=True
                    )
            output = "; ".join(f"{method} {_summary(times)}" for method, times in result.items())
            rows.append(
                Row(
                    f"zero force after a stop, {where}, {state}, {runs} runs each",
                    output,
                    "target: 10 ms; F12 in a terminal 70 ms",
                    None,
                    "",
                    {f"{method} median": median(times) for method, times in result.items()}
                    | {f"{method} most": max(times) for method, times in result.items()},
                )
            )
    return rows


def _summary(times: list[float]) -> str:
    return f"median {1e3 * median(times):.1f} ms, most {1e3 * max(times):.1f} ms"


def _stopped(where: str, state: str, method: str) -> float:
    """One run [s]."""
    with tempfile.TemporaryDirectory(prefix="ergon-") as name, ExitStack() as stack:
        folder = Path(name)
        (folder / "score.yaml").write_text(_SCORE, encoding="utf-8")
        # The board's hand is still and its watchdog is disabled: only the host can remove the
        # force.
        board = stack.enter_context(simulated(folder / "log.npy", hand=0.004, watchdog=1e6))
        real_time(board.process.pid, priority=40)  # what measures is not to be kept waiting
        live = ["--live", f"remi={board.url}", "--unchecked", "--gain", "0dB"]
        command = [*_ERGON, "repl", "score.yaml", *live, "--audio", "null"]
        prompt = stack.enter_context(_PROMPTS[where](command, folder))
        _until(board, lambda force: abs(force) > 0.3)
        if state == "slow":
            prompt.enter(_SLOW)
            time.sleep(_BUSY_SECONDS)
        began = time.monotonic()
        prompt.stop(method)
        time.sleep(_AFTER)
        return _after(board, began)


def _until(board: Simulated, true: Callable[[float], bool]) -> None:
    end = time.monotonic() + _PATIENCE
    while not true(board.look()[1]):
        assert time.monotonic() < end, "no force came"
        time.sleep(0.02)


def _after(board: Simulated, began: float) -> float:
    """Time from an instant until the last force was removed; the whole time watched if it never
    was.
    """
    log = board.log()
    after = log[log["t"] >= began]
    pushed = abs(after["force"]) >= _FORCE
    if not pushed.any():
        return float(after["t"][0] - began) if len(after) else 0.0
    last = int(pushed.nonzero()[0][-1])
    return float(after["t"][last + 1] - began) if last + 1 < len(after) else _AFTER


@contextmanager
def _plain(command: list[str], folder: Path) -> Iterator[Prompt]:
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    with subprocess.Popen([*command, "--plain"], cwd=folder, bufsize=0, **pipes) as process:
        assert process.stdin is not None
        write = process.stdin.write
        try:
            yield Prompt(
                lambda line: write(f"{line}\n".encode()) and None,
                lambda key: write(key.encode()) and None,
                process.stdin.close,
                process.pid,
            )
        finally:
            process.kill()


@contextmanager
def _terminal(command: list[str], folder: Path) -> Iterator[Prompt]:
    with Terminal(command, cwd=folder) as terminal:
        terminal.sees("quant bar")

        def write(text: str) -> None:
            os.write(terminal.child.child_fd, text.encode())

        yield Prompt(
            lambda line: write(line + ENTER), write, lambda: write(CTRL_D), terminal.child.pid
        )


@contextmanager
def _socket(command: list[str], folder: Path) -> Iterator[Prompt]:
    """A terminal connected to an engine process, which gets the signals."""
    place = folder / "s"
    with Terminal([*command, "--socket", str(place)], cwd=folder) as terminal:
        terminal.sees("quant bar")
        engine = int(terminal.text.partition("the engine is process ")[2].partition(";")[0])

        def write(text: str) -> None:
            os.write(terminal.child.child_fd, text.encode())

        try:
            yield Prompt(lambda line: write(line + ENTER), write, lambda: write(CTRL_D), engine)
        finally:
            os.kill(engine, signal.SIGKILL)


_PROMPTS = {"plain": _plain, "terminal": _terminal, "socket": _socket}


if __name__ == "__main__":
    print(json.dumps([row.values for row in stops(int((sys.argv[1:] or ["20"])[0]))], indent=1))
