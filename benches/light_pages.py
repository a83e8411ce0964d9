"""Two pages without a browser: they send what two pointers move, as often as a page does at most.

`python -m benches.light_pages URL OFFSET SECONDS`, at the lowest priority: key 0 and key 1 move to
and fro. A page sends the positions that came since its last picture, 60 times a second; a pointer
has at most 1,000 a second. OFFSET: the piece's clock less this machine's monotonic one [s].
"""

from __future__ import annotations

import math
import os
import sys
import time

from raw_page import RawPage

PICTURES = 60  # a second
POSITIONS = 16  # of each pointer in a message
AMPLITUDE = 0.008  # [m] from the middle


def move(url: str, offset: float, seconds: float) -> int:
    """Move two keys for a while; returns the number of positions."""
    with RawPage(url) as first, RawPage(url) as second:
        pages = (first, second)
        for key, page in enumerate(pages):
            assert page.text(f"hold {key}"), f"no page may play key {key}"
        start = last = time.monotonic()
        sent = 0
        while (now := time.monotonic()) < start + seconds:
            gap = (now - last) / POSITIONS
            for key, page in enumerate(pages):
                times = [last + gap * (n + 1) for n in range(POSITIONS)]
                rows = [(t + offset, _place(t - start, key), 0.5) for t in times]
                assert page.positions(key, rows), f"the page of key {key} was dropped"
                sent += len(rows)
            last = now
            due = start + math.ceil((now - start) * PICTURES + 1e-9) / PICTURES
            time.sleep(max(due - time.monotonic(), 0.001))
    return sent


def _place(t: float, key: int) -> float:
    return AMPLITUDE * math.sin(2.0 * math.pi * (0.7 + key) * t)


if __name__ == "__main__":
    os.nice(19)
    print(move(sys.argv[1], float(sys.argv[2]), float(sys.argv[3])))
