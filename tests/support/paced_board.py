"""The simulated board inside a test's own process, in lockstep, advancing only on request.

A performance waits for the board's replies, so no time passes between two calls of `run`,
however busy the machine is: a line typed there acts at exactly that tick.
"""

import contextlib
import socket
import threading
import time
from collections.abc import Callable, Iterator

import numpy as np
from patience import PATIENCE
from simulated_board import LOG, Board, Ways

_ASK = 0.05  # [s] between two looks whether it is to end


class Paced:
    """A running board, as a test controls it."""

    def __init__(self, ways: Ways) -> None:
        self.board = Board(ways, lockstep=True)
        self._wire = self._bound(0)
        self._port = self._wire.getsockname()[1]
        # The host's patience is longer than any test. A board that is held still has its address;
        # an unplugged one has not, and that is how the host tells them apart.
        self.url = f"frame+udp:127.0.0.1:{self._port}?lockstep&patience={10 * PATIENCE}"
        self._is_away = False
        self._host: object = None
        self._may = 0  # periods that are still to be given
        self._free = self._over = False
        self._changed = threading.Condition()
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    @property
    def ways(self) -> Ways:
        """The properties that can be changed while it is held."""
        return self.board.ways

    @property
    def periods(self) -> int:
        """The number of periods so far."""
        return len(self.board.log)

    def run(self, periods: int, beside: Callable[[], object] = lambda: None) -> None:
        """Advance by so many periods of 1 ms; `beside` is called about every 20 of them."""
        while periods > 0:
            some = min(periods, 20)
            self.may(some)
            self.wait()
            periods -= some
            beside()

    def may(self, periods: int) -> None:
        """Allow so many more periods; if several boards play, allow all of them before waiting."""
        with self._changed:
            self._may += periods
            self._changed.notify_all()

    def wait(self) -> None:
        """Wait until the allowed periods have passed."""
        with self._changed:
            assert self._changed.wait_for(lambda: self._may == 0, PATIENCE), "nobody asks"

    def hold(self) -> None:
        """From now on reply only when periods are allowed."""
        with self._changed:
            self._may = 0
            self._free = False

    def leave(self) -> None:
        """Disappear from its address, as if unplugged."""
        with self._changed:
            self._is_away = True
            self._changed.notify_all()

    def come(self) -> None:
        """Return to its address."""
        with self._changed:
            self._is_away = False
            self._changed.notify_all()

    @staticmethod
    def _bound(port: int) -> socket.socket:
        wire = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        wire.bind(("127.0.0.1", port))
        wire.settimeout(_ASK)
        return wire

    def free(self) -> None:
        """From now on reply at once."""
        with self._changed:
            self._free = True
            self._changed.notify_all()

    def log(self) -> np.ndarray:
        """Every packet that carried a force, with the fields of LOG."""
        return np.array(self.board.log, dtype=LOG)

    def close(self) -> None:
        self._over = True
        self.free()
        self._thread.join()
        self._wire.close()

    def _serve(self) -> None:
        while not self._over:
            if self._is_away:
                if self._host is not None:
                    self._wire.sendto(b"", self._host)  # the farewell of a board in lockstep
                self._wire.close()
                with self._changed:
                    self._changed.wait_for(lambda: not self._is_away or self._over)
                self._wire = self._bound(self._port)
            try:
                packet, host = self._wire.recvfrom(512)
            except TimeoutError:
                continue
            self._host = host
            bears_force = packet[4] != 0 and not packet[-3] & 2
            with self._changed:
                if bears_force:
                    self._changed.wait_for(lambda: self._may > 0 or self._free or self._is_away)
                if self._is_away:
                    continue
                reply = self.board.answer(packet, time.monotonic())
                if reply is not None:
                    self._wire.sendto(reply, host)
                if bears_force and self._may > 0:
                    self._may -= 1
                    self._changed.notify_all()


@contextlib.contextmanager
def paced(**ways: float | bool) -> Iterator[Paced]:
    """A board whose time a test controls; `ways` are those of `Ways`."""
    board = Paced(Ways(**ways))
    try:
        yield board
    finally:
        board.close()
