"""Real-time priority, for a helper whose own clock must not be late."""

import contextlib
import os
import sys


def real_time(process: int = 0, *, priority: int) -> None:
    """Run a process (0: this thread) by SCHED_FIFO, without the processes that it starts; does
    nothing if refused.
    """
    if sys.platform == "linux":
        policy = os.SCHED_FIFO | os.SCHED_RESET_ON_FORK
        with contextlib.suppress(PermissionError):
            os.sched_setscheduler(process, policy, os.sched_param(priority))
