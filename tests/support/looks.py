"""`looks.py LIMIT WORDS…`: run `ergon WORDS` for at most LIMIT seconds of processor time.

Prints the longest processor time [s] between two instants at which Ctrl-C was looked for, and where
it ended.

A signal's handler runs between two steps of Python, or at a poll of the core. So the handler of a
timer of processor time is called at each look, however busy the machine is.
"""

from __future__ import annotations

import contextlib
import json
import math
import signal
import sys
import time
import traceback
from types import FrameType

from ergon.cli.app import main

_EVERY = 0.005  # [s] of processor time


class _Looks:
    """The longest time without a look, up to `limit`."""

    def __init__(self, limit: float) -> None:
        self.limit, self.longest, self.where = limit, 0.0, ""
        self.last = time.process_time()

    def __call__(self, number: int, frame: FrameType | None) -> None:
        now = time.process_time()
        if now - self.last > self.longest:
            self.longest = now - self.last
            self.where = "".join(traceback.format_stack(frame, limit=2))
        self.last = now
        if now > self.limit:
            self.limit = math.inf  # Ctrl-C is pressed once
            raise KeyboardInterrupt


_looks = _Looks(float(sys.argv[1]))
signal.signal(signal.SIGPROF, _looks)
signal.setitimer(signal.ITIMER_PROF, _EVERY, _EVERY)
with contextlib.suppress(SystemExit):
    main(sys.argv[2:])
signal.signal(signal.SIGPROF, signal.SIG_IGN)
print(json.dumps([_looks.longest, _looks.where]))
