"""Ctrl-C ends what would take hours, and so do a deadline and another thread."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading

import numpy as np
import pytest

from ergon import _core

_PATIENCE = 60.0  # [s] on a machine that does much else
# Tells on standard output that some thread has been in a function for three looks in a row.
_CHILD = """
import sys, threading, time
from ergon.cli.app import main

def look():
    looks = 0
    while looks < 3:
        frames = sys._current_frames().values()
        looks = looks + 1 if any(is_in(frame) for frame in frames) else 0
        time.sleep(0.02)
    print("begun", flush=True)

def is_in(frame):
    return frame.f_code.co_name == sys.argv[1] and "ergon" in frame.f_code.co_filename

threading.Thread(target=look, daemon=True).start()
main(sys.argv[2:])
"""
_THROW = """\
ergon: 1
rates: {{audio: 2000kHz}}
keys: {{k: {{M: 400g, f: 90kHz{more}}}}}
players: {{p: {{key: k}}}}
gestures: {{g: 0mm@0s throw 1mm@80000s}}
parts: {{p: [{{at: 0, play: g}}]}}
instruments:
  bell:
    modules: {{m: {{CEL: {{M: 2g, f: 220Hz, t60: 1s}}}}, b: {{BUT: {{between: [k, m], K: 900N/m}}}}}}
    out: {{SOX: m}}
"""
_LONG = """\
ergon: 1
instruments:
  gong: {PLATE: {shape: hex, radius: 90, M: 1kg, f: 80Hz, t60: 9s, hardening: 4e8N/m3}, out: {SOX: gong.centre}}
strikes: {s: {to: gong.centre, at: 0, impulse: 1mNs}}
render: {tail: 80000s}
"""
# The score, the command, and the function that calls the core.
_COMMANDS = {
    "check, a rehearsal": (_THROW.format(more=", travel: -9mm..9mm"), "check", "_rehearsed"),
    "check --simulate": (_THROW.format(more=""), "check --simulate", "follow"),
    "plan": (_THROW.format(more=""), "plan", "plan"),
    "render, a plan": (_THROW.format(more=""), "render -o out.wav", "plan"),
    "render": (_LONG, "render -o out.wav --method ca", "frames_of"),
    "render, in one thread": (_LONG, "render -o out.wav --threads 1 --method ca", "frames_of"),
    "compile": (_THROW.format(more=""), "compile -o out.csv", "stream"),
    "plot": (_THROW.format(more=""), "plot g --svg out.svg", "asked_and_done"),
}


@pytest.mark.parametrize("what", _COMMANDS)
def test_control_c_ends_a_command(what, tmp_path):
    text, command, function = _COMMANDS[what]
    (tmp_path / "score.yaml").write_text(text, encoding="utf-8")
    name, *options = command.split()
    line = [sys.executable, "-c", _CHILD, function, name, "score.yaml", *options]
    env = {**os.environ, "ERGON_CACHE": "off"}
    with subprocess.Popen(
        line, cwd=tmp_path, env=env, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as child:
        try:
            assert child.stdout is not None
            assert "begun" in child.stdout.readline(), child.communicate(timeout=_PATIENCE)
            child.send_signal(signal.SIGINT)
            _, told = child.communicate(timeout=_PATIENCE)
        finally:
            child.kill()
    assert child.returncode == 130
    assert "Traceback" not in told and "error" not in told, told
    assert [path.name for path in tmp_path.iterdir()] == ["score.yaml"]


def _simulation() -> _core.Simulation:
    network = _core.Network()
    network.part("k")
    key = network.cel("m", M=0.4, f=440.0)
    network.listen("out", positions=[(key, 1, 1.0)])
    return _core.Simulation(network, _core.Timeline(network, 44100.0))


def test_work_has_a_deadline():
    simulation = _simulation()
    with _core.Work(0.0), pytest.raises(_core.StoppedError) as stopped:
        simulation.process(np.zeros((1 << 24, 1)))
    assert stopped.value.why == "late"
    assert simulation.frame < 1 << 24
    # It stands in the middle of something: nobody takes it for a simulation at that frame.
    with pytest.raises(_core.EngineError, match="stopped in the middle"):
        simulation.process(np.zeros((1, 1)))


def test_work_ends_where_another_thread_cancels_it():
    work, simulation, begun = _core.Work(), _simulation(), threading.Event()
    why = []

    def compute():
        with work:
            begun.set()
            try:
                while True:
                    simulation.process(np.zeros((1 << 16, 1)))
            except _core.StoppedError as error:
                why.append(error.why)

    thread = threading.Thread(target=compute)
    thread.start()
    assert begun.wait(_PATIENCE)
    work.cancel()
    thread.join(_PATIENCE)
    assert why == ["cancelled"]


def test_the_limits_of_a_thread_are_its_own_and_end_with_their_block():
    other = []
    with _core.Work() as work:
        work.cancel()
        with pytest.raises(_core.StoppedError):
            _core.poll()
        thread = threading.Thread(target=lambda: other.append(_core.poll()))
        thread.start()
        thread.join()
        with _core.Work(1e9), pytest.raises(_core.StoppedError):  # the outer one holds as well
            _core.poll()
    _core.poll()
    assert other == [None]


def test_a_deadline_of_no_work_changes_no_sample():
    alone, limited = np.zeros((70_000, 1)), np.zeros((70_000, 1))
    _simulation().process(alone)
    with _core.Work(1e6):
        _simulation().process(limited)
    assert np.array_equal(alone, limited)


def test_a_handler_that_raises_ends_the_engine_alone():
    """What a signal's handler raises comes out of the core as it is."""

    class Signalled(BaseException):
        pass

    def handler(number, frame):
        raise Signalled

    before = signal.signal(signal.SIGUSR1, handler)
    try:
        threading.Timer(0.05, lambda: os.kill(os.getpid(), signal.SIGUSR1)).start()
        with pytest.raises(Signalled):
            while True:
                _simulation().process(np.zeros((1 << 24, 1)))
    finally:
        signal.signal(signal.SIGUSR1, before)
