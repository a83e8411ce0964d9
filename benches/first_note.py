"""The time from the command to the first tick of twelve real hands on a board.

The board is an emulated frame of twelve axes, of which no direction is known: all are tried at the
same time. `python -m benches.first_note URL` plays on it, and prints its processor time [s].
"""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benches.measure import Row

_AXES = 12
_STARTS = 3
_TARGET = 5.0  # [s]
_SOURCES = Path(__file__).parents[1]


def first_note() -> list[Row]:
    """Wall and processor time of several starts, each in a process of its own."""
    board = [sys.executable, "-m", "ergon", "emulate", "frame", "--udp", "0", "--axes", str(_AXES)]
    with subprocess.Popen(
        board, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    ) as emulator:
        try:
            assert emulator.stdout is not None
            url = emulator.stdout.readline().strip()
            starts = [_start(url) for _ in range(_STARTS)]
        finally:
            emulator.terminate()
    wall, processor = (statistics.median(times) for times in zip(*starts, strict=True))
    return [
        Row(
            f"from the command to the first tick of {_AXES} hands whose directions are tried, "
            f"median of {_STARTS} starts",
            f"{wall:.1f} s, of which the processor computed for {processor:.1f} s",
            f"target: {_TARGET:.0f} s",
            None,
            "by the clock",
            {"wall": wall, "processor": processor},
        )
    ]


def _start(url: str) -> tuple[float, float]:
    """(wall, processor) time [s] of a start by a user of whom nothing is stored."""
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "s.yaml").write_text(_score())
        variables = {
            f"XDG_{kind}_HOME": str(Path(folder, kind)) for kind in ("CONFIG", "STATE", "CACHE")
        }
        before = time.monotonic()
        done = subprocess.run(
            [sys.executable, "-m", "benches.first_note", url, str(Path(folder, "s.yaml"))],
            cwd=_SOURCES,
            env={**os.environ, **variables},
            stdout=subprocess.PIPE,
            text=True,
            check=True,
        )
    ended, processor = map(float, done.stdout.split())
    return ended - before, processor


def _score() -> str:
    numbers = range(_AXES)
    keys = ", ".join(f"k{n}: {{M: 50g, K: 0N/m, Z: 1Ns/m}}" for n in numbers)
    players = ", ".join(f"p{n}: {{hand: live, key: k{n}}}" for n in numbers)
    modules = "\n".join(
        f"      m{n}: {{CEL: {{M: 2g, f: {220 + 20 * n}Hz, t60: 1s}}}}\n"
        f"      b{n}: {{BUT: {{between: [k{n}, m{n}], K: 200N/m, Z: 0.1Ns/m, gap: 1mm}}}}"
        for n in numbers
    )
    return (
        f"ergon: 1\nkeys: {{{keys}}}\ninstruments:\n  bells:\n    modules:\n{modules}\n"
        "    out: {SOX: m0}\n"
        f"players: {{{players}}}\nmix: {{route: [{{from: bells, to: 1}}]}}\nrender: {{tail: 60s}}\n"
    )


def _play(url: str, score: str) -> None:
    from ergon.api.options import PlayOptions
    from ergon.api.play import begin, prepare
    from ergon.common.report import Report

    live = [f"p{n}={url}#{n}" for n in range(_AXES)]
    options = PlayOptions(live=live, audio="null,block=256", gain="-20dB")
    ready = prepare(score, options, Report())
    performance = begin(ready.stage, ready.config, Report())
    try:
        while not performance.status().ticks:
            time.sleep(0.001)
        print(time.monotonic(), time.process_time(), flush=True)
    finally:
        performance.stop()
        performance.close(10.0)
        ready.close()


if __name__ == "__main__":
    _play(*sys.argv[1:])
