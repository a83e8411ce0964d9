"""Results as data and as a page, with the machine on which they were measured."""

from __future__ import annotations

import json
import os
import platform
import re
import shutil
import subprocess
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from benches.growth import COLUMNS
from benches.measure import Row
from benches.native import FLAGS, compiler
from ergon.workshop.lab.machine import cpu

_ROOT = Path(__file__).parent.parent
PAGE = _ROOT / "docs" / "benchmarks.md"
DATA = _ROOT / "benches" / "results.json"
TABLE = _ROOT / "benches" / "growth.csv"
_HEAD = """\
# Benchmarks

Made by `python -m benches`; do not edit. `python -m benches bank string` measures some and writes
nothing. Every figure is a ratio to a reference that ran in the same rounds on the same work:
interleaved, medians. Only the ratios travel to other machines.

* Machine: {cpu}, {cores} cores, {system}; Python {python}{load}.
* C: {compiler}; flags `{flags}`.
  AVX-512 by hand: 64 lanes, 256 samples at a time.
* Peers: {peers}. One that is not here has a row that says so. Faust's C++ is
  compiled with `-O3 -march=native` and runs in our own process. SuperCollider and Csound count the
  difference between two durations, so that starting and loading do not; their resonators have the
  same frequencies and decays, all summed, but begin with an impulse instead of a position, and
  SuperCollider's are in f32.
* All else is in f64, and in one thread where no other number stands. C and Faust begin in the state
  of the engine's plain scheme and are checked to go on alike (relative 1e-8) before they are timed.
  A module is a MAT or a LIA; an ergon counts as two where it is said.
* dB: root mean square of the difference from the exact motion over that of the motion, all outputs
  together. Exact are the modes, in closed form, and through a contact DOP853 to 1e-12.
* Late ticks begin more than half a tick after they were due. The bare loop is a thread in C that
  does nothing but wake so often, under SCHED_FIFO, while the duet plays: what is late there is late
  by the machine. A virtual one is stopped by its host for milliseconds, whatever runs in it.
* A mesh in f32 is no part of the engine: its loops are copied to `benches/rust/mesh.rs`, C's are
  compiled with another type, and `python -m benches precision` times all of them in turns, by
  processor time, least of eleven. The copy in f64 is held to the engine's samples. What memory
  allows: 144 bytes a mass and frame go beyond the nearest cache (x, d and forces in two passes over
  the links, then all that a mass is), at the speed at which numpy adds two arrays of that size.
* Growth in all sizes: `benches/growth.csv`.
* Voices of each instrument on one core, beside Csound and Faust: [voices](voices.md).
* Targets in brackets are wall time on an idle machine; beside it stands processor time, which does
  not count what else the machine did.

| scene | ergon | reference | ratio | meaning |
|---|---|---|---|---|
"""


# The command by which each program reports its version; the first words with a digit are used.
_PEERS = {
    "Faust": ["faust", "--version"],
    "SuperCollider": ["scsynth", "-v"],
    "Csound": ["csound", "--version"],
}


def machine() -> dict[str, str | int | float]:
    """The machine's properties on which the figures depend."""
    return {
        "cpu": cpu(),
        "cores": os.cpu_count() or 1,
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
        "compiler": _version(),
        "flags": " ".join(FLAGS),
        "peers": _peers(),
        "load_before": os.getloadavg()[0] if hasattr(os, "getloadavg") else -1.0,
    }


def _peers() -> str:
    """Peers with their versions."""
    here = []
    for name, line in _PEERS.items():
        if shutil.which(line[0]) is None:
            continue
        done = subprocess.run(line, capture_output=True, text=True)
        version = re.search(r"\d+(\.\d+)+", done.stdout + done.stderr)
        here.append(f"{name} {version.group() if version else '?'}")
    return ", ".join(here) or "none"


def _version() -> str:
    cc = compiler()
    if cc is None:
        return "no compiler"
    return subprocess.run([cc, "--version"], capture_output=True, text=True).stdout.split("\n")[0]


def write(rows: Sequence[Row], built_on: dict[str, str | int | float]) -> None:
    """Write the page and the data."""
    load = float(built_on["load_before"])
    # Other load on the same cores changes wall times, and ratios less, so the page reports it.
    busy = f"; load before the run {load:.1f}" if load > 0.5 else ""
    page = _HEAD.format(**built_on, load=busy)
    for row in rows:
        ratio = "–" if row.ratio is None else f"{row.ratio:.2f}"
        page += f"| {row.scene} | {row.ours} | {row.reference} | {ratio} | {row.sense} |\n"
    PAGE.parent.mkdir(exist_ok=True)
    PAGE.write_text(page)
    tables = [str(row.values["table"]) + "\n" for row in rows if "table" in row.values]
    TABLE.write_text(COLUMNS + "".join(tables))
    data = {"v": 1, "machine": built_on, "rows": [asdict(row) for row in rows]}
    DATA.write_text(json.dumps(data, indent=1, ensure_ascii=False) + "\n")
