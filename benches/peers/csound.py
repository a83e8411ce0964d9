"""The bank in Csound: one `mode` for each oscillator."""

from __future__ import annotations

import math
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from benches.peers import by_difference, command, program_path

_SOURCE = Path(__file__).parent / "bank.csd"
SHORT, LONG = 0.5, 2.5  # seconds of sound


def bank(cells: Sequence[tuple[float, float]]) -> Callable[[], float]:
    """Cells as (f [Hz], t60 [s]). A call gives the seconds that LONG - SHORT of sound take."""
    csound = program_path("csound", "csound")
    folder = tempfile.TemporaryDirectory()

    def run(sound: float) -> float:
        # A mode falls by a factor of e in Q/(πf).
        notes = [f"i1 0 {sound} {f!r} {math.pi * f * t60 / math.log(1e3)!r}" for f, t60 in cells]
        path = Path(folder.name) / f"bank-{sound}.csd"
        if not path.is_file():
            text = "\n".join([*notes, f"i2 0 {sound}"])
            path.write_text(_SOURCE.read_text().replace("@NOTES@", text))
        start = time.perf_counter()
        command([csound, "-n", "-d", "-m0", str(path)])
        return time.perf_counter() - start

    return by_difference(run, SHORT, LONG)
