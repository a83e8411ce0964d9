"""Ctrl-C and SIGTERM end a command at whatever import they come."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from ergon.cli.signals import Terminated, signals_as_exceptions

_SCORE = """\
ergon: 1
instruments:
  bell:
    modules:
      m: {CEL: {M: 2g, f: 220Hz, t60: 1s}}
      n: {CEL: {M: 2g, f: 330Hz, t60: 1s}}
      law: {LNL: {between: [m, n], law: "1000*d + tanh(d)"}}
    out: {SOX: m}
strikes: {s: {to: bell.m, at: 0, impulse: 1mNs}}
"""
_SUPPORT = Path(__file__).parents[1] / "support"


def _ends(folder: Path, number: int, every: int, *words: str) -> list[tuple[str, int, str]]:
    """Module, exit code and stderr of the command for each import at which the signal came."""
    (folder / "score.yaml").write_text(_SCORE, encoding="utf-8")
    line = [sys.executable, str(_SUPPORT / "signalled_start.py"), str(number), str(every), *words]
    environment = {**os.environ, "ERGON_CACHE": "off"}
    done = subprocess.run(line, cwd=folder, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return [tuple(json.loads(told)) for told in done.stdout.splitlines() if told.startswith("[")]


def _check(ends: list[tuple[str, int, str]], number: int, least: int) -> None:
    assert len(ends) >= least
    assert [end for end in ends if end[1] != 128 + number or end[2]] == []


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signal_at_each_30th_import_ends_command(tmp_path: Path, number: int):
    _check(_ends(tmp_path, number, 30, "check", "score.yaml"), number, least=5)


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
@pytest.mark.parametrize(
    "words",
    ["check score.yaml", "render score.yaml -o out.wav -f", "stability -o out", "fmt --check x"],
)
def test_signal_at_every_import_ends_command(tmp_path: Path, number: int, words: str):
    _check(_ends(tmp_path, number, 1, *words.split()), number, least=50)


@pytest.mark.parametrize("kind", [RuntimeError, SystemError, ImportError])
def test_signal_wrapped_in_other_exception_by_import(kind: type[Exception]):
    def wrap():
        try:
            signal.raise_signal(signal.SIGTERM)
        except Terminated as error:
            raise kind("Error calling __set_name__") from error

    with pytest.raises(Terminated) as ended, signals_as_exceptions():
        wrap()
    assert ended.value.number == signal.SIGTERM


def test_signal_replaced_by_internal_error():
    """A module in C may drop what a signal raised, and fail with an exception of its own."""

    def drop():
        with contextlib.suppress(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        raise SystemError from None

    with pytest.raises(KeyboardInterrupt), signals_as_exceptions(lambda error: True):
        drop()


def test_errors_without_signal_propagate():
    with pytest.raises(SystemError), signals_as_exceptions(lambda error: True):
        raise SystemError
