"""Ctrl-C ends what would take hours, and so do a deadline and another thread."""

from __future__ import annotations

import contextlib
import os
import signal
import threading
from pathlib import Path

import numpy as np
import pytest
from patience import PATIENCE
from sweep import few

import ergon
from benches.interrupts import COMMANDS, begun
from ergon import _core
from ergon.cli import signals
from ergon.cli.signals import Terminated, signals_as_exceptions

# `fmt`, `info` and the rest are measured by the bench alone: they take seconds, not hours.
_HOURS = [what for what in COMMANDS if COMMANDS[what][0] and "large" not in what]
_HOURS = [what for what in _HOURS if what not in ("chart", "info")]


def test_interrupt_table_functions_exist():
    """A command whose function has another name now would be waited for without end."""
    package = Path(ergon.__file__).parent
    sources = [path.read_text(encoding="utf-8") for path in package.glob("*/**/*.py")]
    for _, _, function in COMMANDS.values():
        assert any(f"def {function}(" in source for source in sources), function


@pytest.mark.parametrize("what", few(_HOURS, 3))
def test_control_c_ends_a_command(what, tmp_path):
    with begun(tmp_path, what) as child:
        try:
            child.send_signal(signal.SIGINT)
            _, output = child.communicate(timeout=PATIENCE)
        finally:
            child.kill()
    assert child.returncode == 130
    assert "Traceback" not in output
    assert "error" not in output
    assert [path.name for path in tmp_path.iterdir()] == ["score.yaml"]


def _simulation() -> _core.Simulation:
    network = _core.Network()
    network.part("k")
    key = network.cel("m", M=0.4, f=440.0)
    network.listen("out", positions=[(key, 1, 1.0)])
    return _core.Simulation(network, _core.Timeline(network, 44100.0))


def test_work_limit_stops_simulation():
    simulation = _simulation()
    with _core.Work(0), pytest.raises(_core.StoppedError) as stopped:
        simulation.process(np.zeros((1 << 24, 1)))
    assert stopped.value.why == "costly"
    assert simulation.frame < 1 << 24
    # It stands in the middle of something: nobody takes it for a simulation at that frame.
    with pytest.raises(_core.EngineError, match="stopped in the middle"):
        simulation.process(np.zeros((1, 1)))


def test_work_cancelled_by_another_thread():
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
    assert begun.wait(PATIENCE)
    work.cancel()
    thread.join(PATIENCE)
    assert why == ["cancelled"]


def test_work_limits_per_thread_and_block():
    other = []
    with _core.Work() as work:
        work.cancel()
        with pytest.raises(_core.StoppedError):
            _core.poll()
        thread = threading.Thread(target=lambda: other.append(_core.poll()))
        thread.start()
        thread.join()
        with _core.Work(1 << 40), pytest.raises(_core.StoppedError):  # the outer one holds as well
            _core.poll()
    _core.poll()
    assert other == [None]


def test_work_limit_without_effect_on_samples():
    alone, limited = np.zeros((70_000, 1)), np.zeros((70_000, 1))
    _simulation().process(alone)
    with _core.Work(1 << 60):
        _simulation().process(limited)
    assert np.array_equal(alone, limited)


class _SignalledError(Exception):
    pass


def _compute() -> None:
    while True:
        _simulation().process(np.zeros((1 << 24, 1)))


def test_signal_handler_exception_ends_simulation():
    """What a signal's handler raises comes out of the core as it is."""

    def handler(number, frame):
        raise _SignalledError

    before = signal.signal(signal.SIGUSR1, handler)
    try:
        threading.Timer(0.05, os.kill, (os.getpid(), signal.SIGUSR1)).start()
        with pytest.raises(_SignalledError):
            _compute()
    finally:
        signal.signal(signal.SIGUSR1, before)


def test_ctrl_c_in_finaliser_is_raised_again():
    class Dropped:
        def __del__(self):
            signal.raise_signal(signal.SIGINT)

    def drop():
        Dropped()
        threading.Event().wait(PATIENCE)

    with signals_as_exceptions(), pytest.raises(KeyboardInterrupt):
        drop()


def test_ctrl_c_repeated_during_rescue(monkeypatch: pytest.MonkeyPatch):
    """One of 17,000 was lost on a busy machine: it came again while the first was still rescued."""

    class Dropped:
        def __del__(self):
            signal.raise_signal(signal.SIGINT)

    again, count = signals._send_again, []

    def interrupt_first(number, over):
        count.append(number)
        if len(count) == 1:
            signal.raise_signal(number)
        again(number, over)

    monkeypatch.setattr(signals, "_send_again", interrupt_first)

    def drop():
        Dropped()
        threading.Event().wait(PATIENCE)

    with signals_as_exceptions(), pytest.raises(KeyboardInterrupt):
        drop()
    assert len(count) >= 2


def test_swallowed_sigterm_is_raised_again():
    """Of 60 renders that were stopped while they began, one went on: an import had dropped it."""

    def swallow():
        with contextlib.suppress(BaseException):
            signal.raise_signal(signal.SIGTERM)
        threading.Event().wait(PATIENCE)

    with pytest.raises(Terminated) as ended, signals_as_exceptions():
        swallow()
    assert ended.value.number == signal.SIGTERM


class Panic(BaseException):
    """What a panic of the core is in Python."""


def test_panic_caused_by_signal_becomes_signal():
    def panic():
        try:
            signal.raise_signal(signal.SIGTERM)
        except Terminated as error:
            raise Panic from error

    with pytest.raises(Terminated) as ended, signals_as_exceptions():
        panic()
    assert ended.value.number == signal.SIGTERM
    with pytest.raises(Panic), signals_as_exceptions():
        raise Panic
