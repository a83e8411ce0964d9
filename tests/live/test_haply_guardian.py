"""A Haply is told zero when its performance is killed or stopped, or its service tells no state."""

import signal
import subprocess
import sys
from pathlib import Path

import pytest
from duets import duet
from simulated_service import Reply, Service

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")

SCORE = """\
ergon: 1
keys:
  k: {M: 50g, K: 60N/m, Z: 1Ns/m}
  v: {M: 50g, K: 60N/m, Z: 1Ns/m}
instruments: {bell: {modules: {m: {CEL: {M: 2g, f: 220Hz, t60: 1s}}}, out: {SOX: m}}}
gestures: {rest: 0mm@0 hold 0mm@1}
players: {ada: {key: v}, remi: {hand: live, key: k}}
duet: [{couple: [k, v], REF: {K: 60N/m, Z: 0.1Ns/m}}]
parts: {ada: [{at: 1|1, play: rest}]}
render: {tail: 300s}
"""


def playing(tmp_path: Path, service: Service) -> tuple[Path, tuple[object, ...]]:
    score = tmp_path / "score.yaml"
    score.write_text(SCORE)
    return score, ("--live", f"remi={service.url}", "--audio", "null", "--gain", "0dB")


def pushed(service: Service) -> float:
    """Wait until a force stands; when it came."""
    n = len(service.received)
    service.until(lambda own: len(own.received) > n and abs(own.received[-1].force[0]) > 0.01)
    return service.received[-1].time


def let_go(service: Service, after: float) -> None:
    """Wait until zero is the last that was told."""
    service.until(lambda own: own.first_zero(after) is not None and own.received[-1].is_zero)


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_haply_zero_force_after_kill_or_stop(tmp_path: Path, number: signal.Signals):
    with Service() as service:
        score, live = playing(tmp_path, service)
        with duet(score, *live) as performance:
            position = pushed(service)
            performance.process.send_signal(number)
            let_go(service, position)
            if number is signal.SIGSTOP:
                performance.process.send_signal(signal.SIGCONT)
                pushed(service)


@pytest.mark.parametrize("reply", ["empty", "silent"])
def test_haply_without_states_zeroed_until_return(tmp_path: Path, reply: Reply):
    with Service() as service:
        score, live = playing(tmp_path, service)
        with duet(score, *live):
            position = pushed(service)
            service.reply = reply
            let_go(service, position)
            service.reply = "state"
            pushed(service)


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        ("sys.frozen = True; _core.Device('haply:ws://127.0.0.1:1')", "cannot start"),
        ("_core.Device('haply:ws://127.0.0.1:1')", "refused"),
        ("_core.guard_haply()", "EngineError"),
    ],
)
def test_haply_guardian_refused_in_embedded_python(lines: str, words: str):
    """A program that holds Python inside cannot be started as a guardian; no host is at a pipe."""
    program = f"import sys; from ergon import _core; {lines}"
    command = [sys.executable, "-c", program]
    done = subprocess.run(command, input="", capture_output=True, text=True)
    assert done.returncode == 1
    assert words in done.stderr.splitlines()[-1]
