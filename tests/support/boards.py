"""Boards for tests: an emulator in its own process, and one in this process with a given motor
gain.
"""

import socket
import struct
import threading
from collections.abc import Iterator
from contextlib import contextmanager

from emulators import crc, emulator


@contextmanager
def emulated(*arguments: str) -> Iterator[str]:
    """The URL of an emulated device."""
    with emulator(*arguments) as device:
        yield device.url


class Board(threading.Thread):
    """A board of the open frame (docs/open-frame.md) with one axis that moves `gain` metres per
    newton.
    """

    def __init__(self, gain: float) -> None:
        super().__init__(daemon=True)
        self.gain, self.over, self.strongest = gain, False, 0.0
        self.wire = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.wire.bind(("127.0.0.1", 0))
        self.wire.settimeout(0.1)
        # `localhost`, because an address 127.0.0.1 counts as an emulator.
        self.url = f"frame+udp:localhost:{self.wire.getsockname()[1]}"
        self.in_lockstep = f"{self.url}?lockstep"  # nobody is late, however busy the machine is

    def run(self) -> None:
        while not self.over:
            try:
                data, host = self.wire.recvfrom(512)
            except TimeoutError:
                continue
            assert crc(data[2:-2]) == data[-2:]
            number, n = struct.unpack_from("<HB", data, 2)
            if n == 0:
                # At most 20 N over 0.1 m; a sensor step of a hundredth of a millimetre.
                numbers = (5.0, 20.0, 1e-5, -0.05, 0.05, 1000.0, 0.05, 1.0)
                head, body = b"\xa5\x5d", struct.pack("<HBB8f", number, 1, 4, *numbers)
            else:
                force, flags = struct.unpack_from("<hB", data, 5)
                newtons = force / 32767 * 20.0 if flags & 1 else 0.0
                self.strongest = max(self.strongest, abs(newtons))
                position = round(newtons * self.gain / 1e-8)
                head, body = b"\xa5\x5a", struct.pack("<HIBiB", number, 0, 1, position, 3)
            self.wire.sendto(head + body + crc(body), host)

    def __enter__(self) -> "Board":
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.over = True
        self.join()
        self.wire.close()
