"""The command `ergon`. Whatever is imported later, a signal already ends it without a traceback."""

from __future__ import annotations

import gc
import os
import signal
from types import FrameType

_ENDING_SIGNALS = [
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
]


# New objects that make the collector look for cycles, and how many such searches make it look at
# older objects. Importing makes 100,000 that all stay; a search of 50,000 takes milliseconds, which
# no line of a session is late for; a session of hours still looks at all objects.
_COLLECTOR_THRESHOLDS = (50_000, 5, 2)


def end_at_once(number: int, frame: FrameType | None) -> None:
    """Exit with the code that shells give to a signal; there is nothing to clean up."""
    os._exit(128 + number)


def main() -> None:
    """Run the command line; before and after `cli.signals` a signal ends the process at once."""
    gc.set_threshold(*_COLLECTOR_THRESHOLDS)
    for number in _ENDING_SIGNALS:
        if signal.getsignal(number) is not signal.SIG_IGN:  # nohup: what is ignored stays ignored
            signal.signal(number, end_at_once)
    from .app import main as command

    command()


if __name__ == "__main__":
    main()
