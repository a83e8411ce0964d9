"""Unknown keys, measured by the command through a driver, and the accuracy of the models.

The same key is then read by a sensor without steps or noise: the residual of `replay` is then
the model's own error.
"""

from __future__ import annotations

import json
import random
import re
import select
import socket
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from pathlib import Path
from statistics import median
from typing import Any

from commands import ERGON
from emulators import emulator

from benches.measure import Row
from ergon.workshop.metrology.ladder import TICK_RATE

_STEP = 7.32e-6  # of the sensor [m]
_SENSOR = ("--resolution=7.32um", "--noise=3.66um")
_NO_SENSOR = ("--resolution=0.001um", "--noise=0um")
_LOST = 0.01  # of the datagrams, each way
_DATAGRAM = 2048


def metrology(runs: int = 5) -> list[Row]:
    """`runs` keys for each way of connecting the device."""
    ways = {"lockstep": _by_lockstep, "the clock, over a pty": _by_pty, "1 % lost": _with_losses}
    rows = []
    for number, (method, device) in enumerate(ways.items()):
        every = [_error(key, device) for key in range(number * runs, (number + 1) * runs)]
        errors = [error for error in every if error is not None]
        if not errors:
            continue
        rows.append(
            Row(
                f"{len(errors)} of {runs} unknown keys measured by {method}",
                f"median {1e6 * median(errors):.2g} um, worst {1e6 * max(errors):.2g} um",
                f"a twentieth of the sensor's step: {1e6 * _STEP / 20:.2g} um",
                20 * max(errors) / _STEP,
                "× of it, the worst (rms of the model's own error)",
                {"errors_m": json.dumps(errors), "step_m": _STEP},
            )
        )
    return rows


def _key(seed: int) -> list[str]:
    """A key between 80 and 600 g with dry friction, a weight, a mode and a late motor."""
    chance = random.Random(seed)
    mass, rest = chance.uniform(0.08, 0.6), chance.uniform(-4e-3, 4e-3)
    stiffness = mass * (2 * 3.141592653589793 * chance.uniform(1.0, 4.0)) ** 2
    part, pitch = chance.uniform(0.03, 0.08) * mass, chance.uniform(90.0, 250.0)
    return [
        *(f"--mass={1e3 * mass:.4f}g", f"--stiffness={stiffness:.4f}N/m"),
        *(f"--damping={chance.uniform(0.3, 2.0):.4f}Ns/m", f"--dry={chance.uniform(5, 60):.3f}mN"),
        f"--weight={stiffness * rest:.4f}N",
        f"--mode={1e3 * part:.3f}g {pitch:.3f}Hz {chance.uniform(0.01, 0.03):.4f}",
        *(f"--delay={chance.choice([0.1, 0.5, 1.0, 1.7])}ms", f"--seed={seed}"),
        *("--travel=30mm", "--force-max=3N", "--free"),
    ]


@contextmanager
def _by_lockstep(key: list[str]) -> Iterator[str]:
    with emulator("frame", "--udp", "0", "--lockstep", *key) as board:
        yield board.url + "&patience=600"


@contextmanager
def _by_pty(key: list[str]) -> Iterator[str]:
    with emulator("frame", "--pty", *key) as board:
        yield board.url


@contextmanager
def _with_losses(key: list[str]) -> Iterator[str]:
    with emulator("frame", "--udp", "0", *key) as board, _lossy(board.url) as url:
        yield url


@contextmanager
def _lossy(url: str) -> Iterator[str]:
    """A relay that loses datagrams in both directions."""
    scheme, _, place = url.partition("127.0.0.1:")
    chance = random.Random(1)
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as host,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as device,
    ):
        host.bind(("127.0.0.1", 0))
        device.connect(("127.0.0.1", int(place)))
        asks: list[tuple[str, int]] = []

        def relay() -> None:
            # The loop ends when the sockets close, or with the emulator.
            with suppress(OSError, ValueError):
                while True:
                    for ready in select.select([host, device], [], [])[0]:
                        if ready is host:
                            data, sender = host.recvfrom(_DATAGRAM)
                            asks[:] = [sender]
                        else:
                            data = device.recv(_DATAGRAM)
                        if chance.random() >= _LOST:
                            if ready is host:
                                device.send(data)
                            else:
                                host.sendto(data, asks[0])

        threading.Thread(target=relay, daemon=True).start()
        yield f"{scheme}127.0.0.1:{host.getsockname()[1]}"


def _error(seed: int, device: Callable[[list[str]], AbstractContextManager[str]]) -> float | None:
    """Rms of the error of a model against the true motion [m]; None if the key could not be
    measured.

    By the clock a busy machine may be too late for a key, and the command then says so.
    """
    key = _key(seed)
    with tempfile.TemporaryDirectory() as folder:
        result = str(Path(folder) / "key.yaml")
        with device([*key, *_SENSOR]) as url:
            output = _ergon("metrology", url, "-o", result)
        if output["event"] == "error":
            print(f"key {seed}: {output['message']}", file=sys.stderr)
            return None
        if device is not _by_lockstep:
            _take_a_tick(result)
        with _by_lockstep([*key, *_NO_SENSOR]) as url:
            return float(_ergon("metrology", "replay", result, url)["rms_m"])


def _take_a_tick(calibration: str) -> None:
    """Shorten the delay by one tick: by the clock it is one tick longer than in lockstep."""
    text = Path(calibration).read_text(encoding="utf-8")

    def shorter(found: re.Match[str]) -> str:
        return f"delay: {max(float(found[1]) - 1e3 / TICK_RATE, 0.0):.6f}ms"

    Path(calibration).write_text(re.sub(r"delay: ([\d.]+)ms", shorter, text), encoding="utf-8")


def _ergon(*words: str) -> dict[str, Any]:
    """The last line of JSON that a command prints."""
    done = subprocess.run([*ERGON, *words, "--json"], capture_output=True, text=True)
    return dict(json.loads(done.stdout.splitlines()[-1]))
