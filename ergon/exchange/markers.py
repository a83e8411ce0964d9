"""The marks of a piece as CSV: name, position (bar|beat) and seconds."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable

HEADER = ("name", "bar|beat", "time [s]")


def markers_csv(marks: Iterable[tuple[str, str, float]]) -> str:
    """One row per (name, bar|beat, seconds), in the order given, after a line that names the form.

    Seconds have six decimals: 1 µs is a tenth of a sample at 96 kHz, and no sequencer places a
    mark more finely than a sample.
    """
    csv_text = io.StringIO()
    csv_text.write("# marks 1, made by ergon\n")
    rows = csv.writer(csv_text, lineterminator="\n")
    rows.writerow(HEADER)
    rows.writerows((name, position, f"{seconds:.6f}") for name, position, seconds in marks)
    return csv_text.getvalue()
