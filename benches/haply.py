"""The time until a Haply receives zero force after its service falls silent or its host is killed
or stopped.

The host is a whole performance that pushes; the service records when each force arrives.
"""

from __future__ import annotations

import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from statistics import median

from real_time import real_time
from simulated_service import Reply, Service

from benches.measure import Row

_SCORE = """\
ergon: 1
keys: {k: {M: 50g, K: 60N/m, Z: 1Ns/m}, v: {like: k}}
instruments: {bell: {modules: {m: {CEL: {M: 2g, f: 220Hz, t60: 1s}}}, out: {SOX: m}}}
gestures: {rest: 0mm@0 hold 0mm@1}
players: {ada: {key: v}, remi: {hand: live, key: k}}
duet: [{couple: [k, v], REF: {K: 60N/m, Z: 0.1Ns/m}}]
parts: {ada: [{at: 1|1, play: rest}]}
render: {tail: 3600s}
"""
_PUSH = 0.01  # [N] from which on it counts as pushed

_Host = subprocess.Popen[bytes]


def haply(runs: int = 50) -> list[Row]:
    """`runs` runs of each kind; medians and the longest."""
    real_time(priority=60)  # as the service: the two share a lock of Python's
    with tempfile.TemporaryDirectory() as folder:
        score = Path(folder) / "push.yaml"
        score.write_text(_SCORE)
        silent = _answering(score, runs, "silent")
        empty = _answering(score, runs, "empty")
        stopped = _stopped(score, runs)
        killed = [_killed(score) for _ in range(runs)]
    return [
        _row("a Haply whose service falls silent", silent, 50),
        _row("a Haply whose service tells `{}`", empty, 50),
        _row("a Haply whose host is killed", killed, 100),
        _row("a Haply whose host is stopped", [from_signal for from_signal, _ in stopped], 100),
        _row("the same, from its last force", [from_force for _, from_force in stopped], 100),
    ]


def _row(scene: str, took: list[float], target: int) -> Row:
    middle, longest = median(took) * 1e3, max(took) * 1e3
    return Row(
        scene,
        f"told zero after {middle:.1f} ms, {longest:.1f} ms at most ({len(took)} runs)",
        f"target: {target} ms",
        None,
        "by the clock",
        {"median_ms": middle, "longest_ms": longest, "runs": len(took)},
    )


@contextmanager
def _performance(score: Path, service: Service) -> Iterator[_Host]:
    """A duet that plays on the service; yields its process."""
    command = [sys.executable, "-m", "ergon.cli", "duet", str(score), "--live"]
    command += [f"remi={service.url}", "--audio", "null", "--gain", "0dB"]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    with subprocess.Popen([*command, "--unchecked", "--plain"], **quiet) as host:
        try:
            yield host
        finally:
            host.kill()


def _zero(service: Service, act: Callable[[], object]) -> tuple[float, float]:
    """The time until the first zero force, from an act during a push, and from the last force
    before that zero [s].

    A signal stops a process only when the system next runs the thread that takes it; until then
    the other threads push as before. So the second time shows the guardian, and the first time
    includes the system.
    """
    seen = len(service.received)
    service.until(
        lambda own: len(own.received) > seen + 5 and abs(own.received[-1].force[0]) > _PUSH
    )
    time.sleep(random.uniform(0.0, 0.02))  # anywhere in a tick
    start = time.monotonic()
    act()
    service.until(lambda own: own.first_zero(start) is not None)
    zero = service.first_zero(start)
    assert zero is not None
    times = [force.time for force in service.received if force.time < zero.time]
    return zero.time - start, zero.time - max(times)


def _answering(score: Path, runs: int, reply: Reply) -> list[float]:
    took = []
    with Service(prompt=True) as service, _performance(score, service):
        for _ in range(runs):
            took.append(_zero(service, lambda: setattr(service, "reply", reply))[0])
            service.reply = "state"
    return took


def _stopped(score: Path, runs: int) -> list[tuple[float, float]]:
    took = []
    with Service(prompt=True) as service, _performance(score, service) as host:
        for _ in range(runs):
            stop = partial(host.send_signal, signal.SIGSTOP)
            took.append(_zero(service, stop))
            host.send_signal(signal.SIGCONT)
    return took


def _killed(score: Path) -> float:
    with Service(prompt=True) as service, _performance(score, service) as host:
        return _zero(service, host.kill)[0]
