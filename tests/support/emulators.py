"""Emulated devices as processes of their own: what they print, and how they end."""

import json
import math
import signal
import socket
import struct
import subprocess
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field

from commands import ERGON
from patience import PATIENCE

COMMAND = [*ERGON, "emulate"]


@dataclass
class Emulator:
    process: subprocess.Popen[str]
    url: str = ""
    records: list[dict[str, object]] = field(default_factory=list)

    def next(self) -> dict[str, object]:
        """The next line of JSON."""
        assert self.process.stdout is not None
        line = self.process.stdout.readline()
        assert line, "the emulator ended"
        self.records.append(json.loads(line))
        return self.records[-1]

    def until(self, event: str) -> dict[str, object]:
        """The next line that reports `event`."""
        while self.next()["event"] != event:
            pass
        return self.records[-1]

    def end(self, number: signal.Signals = signal.SIGINT) -> str:
        """Send a signal (default: Ctrl-C) and check the exit code, 128 + its number; returns the
        hash of all positions.
        """
        self.process.send_signal(number)
        self.until("over")
        assert self.process.wait(timeout=PATIENCE) == 128 + number
        return str(self.records[-1]["positions"])


@contextmanager
def emulator(*arguments: str) -> Iterator[Emulator]:
    command = [*COMMAND, *arguments, "--json"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        started = Emulator(process)
        try:
            started.url = str(started.next()["url"])
            yield started
        finally:
            process.kill()


def pulled(hand: Sequence[float], rate: float, n: int) -> list[float]:
    """Positions [m] of a key (50 g, 1 Ns/m) that a hand (400 N/m, 4 Ns/m) pulls, from its
    equation.
    """
    x = d = 0.0
    path = []
    for i in range(n):
        force = 0.0
        if i < len(hand):
            moved = hand[i] - hand[max(i - 1, 0)]
            force = 400 * (hand[i] - x) + 4 * rate * (moved - d)
        d = math.exp(-1 / 0.05 / rate) * d + force / 0.05 / rate**2
        x += d
        path.append(x)
    return path


def free_port() -> int:
    """A free UDP port."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as wire:
        wire.bind(("127.0.0.1", 0))
        return int(wire.getsockname()[1])


def crc(data: bytes) -> bytes:
    """The checksum at the end of a packet of the open frame."""
    value = 0xFFFF
    for byte in data:
        value ^= byte << 8
        for _ in range(8):
            value = (value << 1 ^ 0x1021 if value & 0x8000 else value << 1) & 0xFFFF
    return struct.pack("<H", value)
