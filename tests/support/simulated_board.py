"""A force-feedback board as its own process, written from docs/open-frame.md alone.

One fader of 50 g and 1 N·s/m between two stops, a motor of 20 N, a hand of 400 N/m and 4 N·s/m
that holds it. It logs every packet: its instant, the force requested, the position of the key,
the work of the motor. It has two clocks: the wall clock, or lockstep, in which a packet is one
period of 1 ms and nothing depends on how busy the machine is.

`python tests/support/simulated_board.py --lockstep` prints its URL as JSON; lines of JSON on its
standard input change it while it runs (`{"hand": 0.005}`). When its input ends it writes its log
and ends.
"""

import argparse
import contextlib
import json
import math
import select
import socket
import struct
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from emulators import crc
from patience import PATIENCE

MASS, FRICTION = 0.05, 1.0  # [kg, N·s/m]
FORCE_MAX = 20.0  # [N]
RANGE = 0.05  # [m] to either side
STEP = 125e-6  # [s] in which the key is moved; exact for a force and a hand that are held
PERIOD = 1e-3  # [s] of a packet in lockstep
OWNED = 1.0  # [s] of the wall that a host may be silent in lockstep, where there is no watchdog
ENABLE, ASK = 1, 2
TOUCHED, ENABLED, HOT, LET_GO = 1, 2, 4, 8
LOG = np.dtype(
    [
        ("t", float),  # [s] of CLOCK_MONOTONIC; in lockstep of the board
        ("asked", float),  # [N] that the host asked for
        ("force", float),  # [N] that the motor then gave
        ("x", float),  # [m] truly
        ("v", float),  # [m/s]
        ("hand", float),  # [N] of the hand on the key
        ("work", float),  # [J] that the motor did since the packet before
        ("status", int),  # bits, as replied
    ]
)


@dataclass
class Ways:
    """Properties of the board that can be changed while it runs."""

    hand: float = 0.0  # [m] where the hand holds
    stiffness: float = 400.0  # [N/m] of the hand
    damping: float = 4.0  # [N·s/m] of the hand
    sine: float = 0.0  # [m] by which the hand goes to and fro
    hertz: float = 0.0
    watchdog: float = 0.05  # [s]; by the wall only
    motor: float = 1.0  # -1: wired the other way round
    frozen: bool = False  # the sensor shows the same place for ever
    since: float = 0.0  # [s] of the board, from when `motor` and `frozen` are so
    hot: bool = False
    continuous: float = FORCE_MAX  # [N] that it bears for long
    lets_go: bool = False  # every reply says that it had let go
    silent: bool = False  # no replies


class Key:
    """The mass, moved exactly for a force and a hand that are constant over a step."""

    def __init__(self, ways: Ways) -> None:
        self.ways, self.x, self.v, self.force, self.work = ways, 0.0, 0.0, 0.0, 0.0
        self.steps = 0
        # Computed before anybody waits for a reply, because scipy is slow to load.
        self._coefficients = (ways.stiffness, FRICTION + ways.damping)
        self._flow = exactly(*self._coefficients)

    def hand(self) -> float:
        """The position of the hand now [m]."""
        position = self.steps * STEP
        return self.ways.hand + self.ways.sine * math.sin(2 * math.pi * self.ways.hertz * position)

    def pull(self) -> float:
        """The hand's force on the key [N]."""
        return self.ways.stiffness * (self.hand() - self.x) - self.ways.damping * self.v

    def step(self) -> None:
        """One step of the clock."""
        k, b = self.ways.stiffness, FRICTION + self.ways.damping
        if self._coefficients != (k, b):
            self._coefficients, self._flow = (k, b), exactly(k, b)
        there = self.hand() + self.force / k if k else 0.0
        push = 0.0 if k else self.force / MASS
        a, c, d, e, f, g = self._flow
        x, v = self.x - there, self.v
        before = self.x
        self.x, self.v = there + a * x + c * v + f * push, d * x + e * v + g * push
        if abs(self.x) > RANGE:
            self.x, self.v = math.copysign(RANGE, self.x), 0.0
        self.work += self.force * (self.x - before)
        self.steps += 1


def exactly(k: float, b: float) -> tuple[float, ...]:
    """exp(A·STEP) of the key's (x, v), and the additional effect of an acceleration of 1 m/s²."""
    from scipy.linalg import expm

    complete = expm(STEP * np.array([[0, 1, 0], [-k / MASS, -b / MASS, 1], [0, 0, 0]]))
    (a, c, f), (d, e, g) = complete[0].tolist(), complete[1].tolist()
    return a, c, d, e, f, g


class Board:
    """The firmware of the microcontroller."""

    def __init__(self, ways: Ways, lockstep: bool) -> None:
        self.ways, self.lockstep, self.key = ways, lockstep, Key(ways)
        self.log: list[tuple[float, ...]] = []
        self.began = time.monotonic()
        self.packet_time: float | None = None
        self.let_go, self.shown = False, 0.0
        self.owner: object = None  # the host whose forces act; nobody else is answered

    def is_faulty(self) -> bool:
        """Whether its fault has begun."""
        return self.key.steps * STEP >= self.ways.since

    def run_to(self, now: float) -> None:
        """Advance to a wall-clock instant; after a silence of the host the motor is released."""
        if self.lockstep:
            return
        due = int((now - self.began) / STEP)
        quiet = None if self.packet_time is None else self.packet_time + self.ways.watchdog
        while self.key.steps < due:
            if quiet is not None and self.began + self.key.steps * STEP > quiet:
                self.key.force, self.let_go, self.owner = 0.0, True, None
            self.key.step()

    def answer(self, packet: bytes, now: float, host: object = None) -> bytes | None:
        """The reply to a packet; None for an invalid packet, or for one from another host than the
        owner.
        """
        self.run_to(now)
        silent = self.packet_time is None or now - self.packet_time > OWNED
        if self.owner is not None and self.owner != host and not (self.lockstep and silent):
            return None
        if packet[:2] != b"\xa5\x5a" or crc(packet[2:-2]) != packet[-2:]:
            return None
        number, n = struct.unpack_from("<HB", packet, 2)
        if n == 0:
            traits = 12 if self.lockstep else 8
            numbers = (self.ways.continuous, FORCE_MAX, 1e-5, -RANGE, RANGE, 1000.0, MASS, FRICTION)
            body = struct.pack("<HBB8f", number, 1, traits, *numbers)
            return b"\xa5\x5d" + body + crc(body)
        wide, n = n & 0x80, n & 0x7F
        if n != 1:
            return None
        asked, flags = struct.unpack_from("<dB" if wide else "<hB", packet, 5)
        asked = asked if wide else asked / 32767 * FORCE_MAX
        self.run_to(now)
        had_let_go, key = self.let_go, self.key
        if not flags & ASK:
            arguments = asked if flags & ENABLE else 0.0
            motor = self.ways.motor if self.is_faulty() else 1.0
            key.force = motor * max(-FORCE_MAX, min(FORCE_MAX, arguments))
            self.packet_time, self.let_go = now, False
            self.owner = host if flags & ENABLE else None
            for _ in range(round(PERIOD / STEP) if self.lockstep else 0):
                key.step()
        bits = [
            (True, TOUCHED),
            (flags & ENABLE, ENABLED),
            (self.ways.hot, HOT),
            (had_let_go or self.ways.lets_go, LET_GO),
        ]
        status = sum(bit for is_so, bit in bits if is_so)
        if not (self.ways.frozen and self.is_faulty()):
            self.shown = round(key.x / 1e-5) * 1e-5  # the sensor's step
        if not flags & ASK:
            position = key.steps * STEP if self.lockstep else now
            self.log.append(
                (position, asked, key.force, key.x, key.v, key.pull(), key.work, status)
            )
            key.work = 0.0
        micros = int(1e6 * (key.steps * STEP if self.lockstep else now - self.began)) & 0xFFFFFFFF
        body = struct.pack("<HIB", number, micros, wide | 1)
        body += (
            struct.pack("<d", self.shown) if wide else struct.pack("<i", round(self.shown / 1e-8))
        )
        body += struct.pack("<B", status)
        return None if self.ways.silent else b"\xa5\x5a" + body + crc(body)


def serve(board: Board, log: Path | None) -> None:
    """Serve until the input ends."""
    wire = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    wire.bind(("127.0.0.1", 0))
    print(json.dumps({"url": f"frame+udp:127.0.0.1:{wire.getsockname()[1]}"}), flush=True)
    while True:
        ready, _, _ = select.select([wire, sys.stdin], [], [], board.ways.watchdog / 4)
        now = time.monotonic()
        board.run_to(now)
        if wire in ready:
            packet, host = wire.recvfrom(512)
            if (reply := board.answer(packet, time.monotonic(), host)) is not None:
                wire.sendto(reply, host)
        if sys.stdin in ready:
            line = sys.stdin.readline()
            if not line:
                break
            for name, value in json.loads(line).items():
                assert hasattr(board.ways, name), name
                setattr(board.ways, name, value)
            asked = board.log[-1][1] if board.log else 0.0
            text = {"changed": line.strip(), "packets": len(board.log), "asked": asked}
            print(json.dumps(text), flush=True)
    if log is not None:
        np.save(log, np.array(board.log, dtype=LOG))


@dataclass
class Simulated:
    """A running board, as a test controls it."""

    url: str
    process: subprocess.Popen[str]
    _log: Path

    def change(self, **ways: float | bool) -> None:
        """Change its properties; returns when they are in effect."""
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        print(json.dumps(ways), file=self.process.stdin, flush=True)
        assert json.loads(self.process.stdout.readline())["changed"]

    def look(self) -> tuple[int, float]:
        """The number of packets received, and the force requested by the last one [N]."""
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        print("{}", file=self.process.stdin, flush=True)
        output = json.loads(self.process.stdout.readline())
        return output["packets"], output["asked"]

    def log(self) -> np.ndarray:
        """End it; returns every packet that carried a force, with the fields of LOG."""
        assert self.process.stdin is not None
        self.process.stdin.close()
        assert self.process.wait(timeout=PATIENCE) == 0
        return np.load(self._log)


@contextlib.contextmanager
def simulated(log: Path, *, lockstep: bool = False, **ways: float | bool) -> Iterator[Simulated]:
    """A board in a process of its own; `ways` are those of `Ways`, `log` the file it writes."""
    command = [sys.executable, __file__, *(["--lockstep"] if lockstep else []), f"--log={log}"]
    command += [f"--{name}={value}" for name, value in ways.items()]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    with subprocess.Popen(command, **pipes, text=True) as process:
        try:
            assert process.stdout is not None
            yield Simulated(json.loads(process.stdout.readline())["url"], process, log)
        finally:
            process.kill()


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--lockstep", action="store_true")
    parser.add_argument("--log", type=Path)
    for field in fields(Ways):
        read = (lambda text: text == "True") if field.type is bool else float
        parser.add_argument(f"--{field.name}", type=read, default=field.default)
    arguments = vars(parser.parse_args())
    lockstep, log = arguments.pop("lockstep"), arguments.pop("log")
    with contextlib.suppress(KeyboardInterrupt):
        serve(Board(Ways(**arguments), lockstep), log)


if __name__ == "__main__":
    main()
