"""A host that is stopped (SIGSTOP) and continued (SIGCONT) while a hand holds its key, by the
clock.

The measurement is what the board receives after that: no force from before the stop, and no
jump.
"""

from __future__ import annotations

import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from real_time import real_time
from simulated_board import simulated

from benches.measure import Row

_ERGON = [sys.executable, "-m", "ergon.cli"]
# A hand 20 mm away feels 2 N. There is no damper between the keys, because it would respond to
# delays of the machine.
_SCORE = """\
ergon: 1
keys: {k1: {M: 400g, K: 400N/m, Z: 8Ns/m}, k2: {like: k1}}
instruments: {bell: {modules: {m: {CEL: {M: 2g, f: 220Hz, t60: 1s}}}, out: {SOX: m}}}
players: {ada: {key: k1}, remi: {hand: live, key: k2}}
duet: [{couple: [k1, k2], REF: {K: 200N/m, Z: 0Ns/m}}]
render: {tail: 3600s}
"""
_HAND = {"hand": 0.02, "sine": 0.001, "hertz": 1.0}
_RISE = 3.0  # [s] until the first stop: forces rise for two
_REST = 0.5  # [s] between stops: a force fades in within a quarter
_FIRST = 3  # packets that may not bear an old force
_SHORT, _LONG = (0.03, 0.5), (1.0, 10.0)  # [s]
_OLD, _STEP = 0.05, 0.1  # [N] targets


def stall(stops: int = 100, seed: int = 1) -> list[Row]:
    """Stops of 0.03 s to 10 s, mostly short."""
    rng = np.random.default_rng(seed)
    short, long = (np.exp(rng.uniform(*np.log(ends), stops)) for ends in (_SHORT, _LONG))
    lengths = np.where(rng.random(stops) < 0.95, short, long)
    with tempfile.TemporaryDirectory() as folder:
        log, score = Path(folder) / "log.npy", Path(folder) / "stall.yaml"
        score.write_text(_SCORE)
        with simulated(log, **_HAND) as board:
            real_time(board.process.pid, priority=70)  # a real board runs beside no other program
            windows = list(_stopped(score, board.url, lengths))
            packets = board.log()
    result = [_after(packets, *window) for window in windows]
    before, old, step = (max(column) for column in zip(*result, strict=True))
    worse = sum(first > _OLD or jump > _STEP for _, first, jump in result)
    return [
        Row(
            f"a host that is stopped {stops} times, {lengths.min():.2f} s to {lengths.max():.1f} s",
            f"{worse} of {stops} felt; at most {old:.3f} N old, steps of {step:.3f} N",
            f"target: {_OLD} N and {_STEP} N; {before:.2f} N before the stop",
            None,
            "",
            {"stops": stops, "felt": worse, "old": old, "step": step, "before": before},
        )
    ]


def _stopped(score: Path, url: str, lengths: np.ndarray) -> Iterator[tuple[float, float]]:
    """When each stop began and ended [s]."""
    live = ("--live", f"remi={url}", "--audio", "null")
    command = [*_ERGON, "duet", str(score), *live, "--gain", "0dB", "--unchecked", "--json"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            while '"playing"' not in process.stdout.readline():
                assert process.poll() is None, "the duet ended"
            time.sleep(_RISE)
            for length in lengths:
                began = time.monotonic()
                process.send_signal(signal.SIGSTOP)
                time.sleep(length)
                ended = time.monotonic()
                process.send_signal(signal.SIGCONT)
                time.sleep(_REST)
                assert process.poll() is None, "the duet ended"
                yield began, ended
        finally:
            process.kill()


def _after(packets: np.ndarray, began: float, ended: float) -> tuple[float, float, float]:
    """The force before a stop, the greatest force of the first packets after it, and the largest
    step [N].
    """
    position, asked = packets["t"], packets["asked"]
    before = asked[position < began][-1]
    after = asked[(position >= ended) & (position < ended + _REST)]
    assert len(after) > _FIRST, "it goes on"
    # A busy machine may stop the host or the board again; that shows as a fall to zero.
    is_fall = after[1:] == 0
    steps = np.abs(np.diff(after))[~is_fall]
    return float(abs(before)), float(np.abs(after[:_FIRST]).max()), float(steps.max(initial=0.0))
