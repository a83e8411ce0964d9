"""A process of its own that sends MIDI messages at their instants.

In the process of a session, computing a line can hold the interpreter for milliseconds. This
process only waits and sends, with real-time priority if the system grants it. Its input is a
line `INSTANT BYTES` for each message: the instant in nanoseconds of the monotonic clock, the
bytes in hexadecimal.
"""

from __future__ import annotations

import contextlib
import gc
import heapq
import itertools
import os
import select
import subprocess
import sys
import time
from collections.abc import Callable
from typing import IO

from ergon.live.midi_messages import Transport
from ergon.live.midi_ports import MidiError, SystemOutput

ECHO = "echo"  # a port that writes what it sends to the standard output, with the instant
_PRIORITY = 70  # below the physics thread, above JACK's clients
_STOP_MESSAGE = bytes([Transport.STOP.value])
_CLOSE_TIMEOUT = 2.0  # [s] for the process to end


class TimedSender:
    """An output port whose messages wait in another process until they are due."""

    def __init__(self, port_name: str) -> None:
        """Start the process, which opens the output `port_name`. Raises MidiError."""
        command = [sys.executable, "-m", "ergon.live.midi_sender", port_name]
        pipe = subprocess.PIPE
        self._process = subprocess.Popen(
            command, stdin=pipe, stdout=pipe, start_new_session=True, bufsize=0
        )
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._stdin: IO[bytes] = self._process.stdin
        self._stdout: IO[bytes] = self._process.stdout
        first_word, _, reply = (
            self._stdout.readline().decode(errors="replace").strip().partition(" ")
        )
        if first_word != "ready":
            self.close()
            raise MidiError(reply or f"the process that sends MIDI to '{port_name}' did not start")
        self.name = reply

    def send_at(self, data: bytes, instant: float) -> None:
        """Send a message at an instant [s, time.monotonic]; at once if that is past."""
        with contextlib.suppress(OSError):  # the process is gone
            self._stdin.write(b"%d %s\n" % (round(instant * 1e9), data.hex().encode()))

    def next_echo(self) -> bytes:
        """The next line that the port `echo` has written; empty at the end."""
        with contextlib.suppress(ValueError):  # closed by another thread
            return self._stdout.readline()
        return b""

    def close(self) -> None:
        """End the process: it sends a MIDI stop and closes the port."""
        with contextlib.suppress(OSError):
            self._stdin.close()
        try:
            self._process.wait(_CLOSE_TIMEOUT)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._stdout.close()


def _send_due_messages(input_descriptor: int, send: Callable[[bytes], None]) -> None:
    """Send the messages that are read from a descriptor, each when it is due, until the descriptor
    ends.
    """
    waiting_messages: list[tuple[int, int, bytes]] = []
    message_numbers = itertools.count()
    unfinished_line = b""
    while True:
        seconds_left = (
            (waiting_messages[0][0] - time.monotonic_ns()) / 1e9 if waiting_messages else 1.0
        )
        if select.select([input_descriptor], [], [], max(0.0, min(seconds_left, 1.0)))[0]:
            bytes_read = os.read(input_descriptor, 1 << 16)
            if not bytes_read:
                return
            *lines, unfinished_line = (unfinished_line + bytes_read).split(b"\n")
            for line in lines:
                due_nanoseconds, _, hex_text = line.partition(b" ")
                heapq.heappush(
                    waiting_messages,
                    (int(due_nanoseconds), next(message_numbers), bytes.fromhex(hex_text.decode())),
                )
        while waiting_messages and waiting_messages[0][0] <= time.monotonic_ns():
            send(heapq.heappop(waiting_messages)[2])


def _echo(data: bytes) -> None:
    os.write(1, b"%d %s\n" % (time.monotonic_ns(), data.hex().encode()))


def main(port_name: str) -> None:
    """Run as the process that sends."""
    try:
        output = None if port_name == ECHO else SystemOutput(port_name)
    except MidiError as error:
        print(f"error {error}", flush=True)
        return
    with contextlib.suppress(AttributeError, OSError):  # not granted: like any other program
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(_PRIORITY))
    gc.disable()
    print(f"ready {port_name if output is None else output.name}", flush=True)
    send = _echo if output is None else output.send
    with contextlib.suppress(KeyboardInterrupt):
        _send_due_messages(0, send)
    with contextlib.suppress(OSError):
        send(_STOP_MESSAGE)
    if output is not None:
        output.close()


if __name__ == "__main__":
    main(sys.argv[1])
