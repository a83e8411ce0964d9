"""What was measured, as data and as a page, with the machine it was measured on."""

from __future__ import annotations

import json
import os
import platform
import subprocess
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from benches.measure import Row
from benches.native import FLAGS, compiler
from ergon.lab.machine import cpu

_ROOT = Path(__file__).parent.parent
PAGE = _ROOT / "docs" / "benchmarks.md"
DATA = _ROOT / "benches" / "results.json"
_HEAD = """\
# Benchmarks

Made by `python -m benches`; do not edit. Every figure is a ratio to a reference that ran in the
same rounds on the same work: interleaved, medians. Only the ratios travel to other machines.

* Machine: {cpu}, {cores} cores, {system}; Python {python}{load}.
* C: {compiler}; flags `{flags}`.
* The engine and C begin in the same state and are checked to end in the same (relative 1e-8) before
  they are timed. A module is a MAT or a LIA.
* The engine runs in one thread, in f64, and its result does not depend on the machine.
* Targets in brackets are wall time on an idle machine; beside it stands processor time, which does
  not count what else the machine did.

| scene | ergon | reference | ratio | meaning |
|---|---|---|---|---|
"""


def machine() -> dict[str, str | int | float]:
    """What the figures depend on."""
    return {
        "cpu": cpu(),
        "cores": os.cpu_count() or 1,
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
        "compiler": _version(),
        "flags": " ".join(FLAGS),
        "load_before": os.getloadavg()[0] if hasattr(os, "getloadavg") else -1.0,
    }


def _version() -> str:
    cc = compiler()
    if cc is None:
        return "no compiler"
    return subprocess.run([cc, "--version"], capture_output=True, text=True).stdout.split("\n")[0]


def write(rows: Sequence[Row], made_on: dict[str, str | int | float]) -> None:
    """Write the page and the data."""
    load = float(made_on["load_before"])
    # Another's work on the same cores moves the wall times, less the ratios: say so.
    busy = f"; load before the run {load:.1f}" if load > 0.5 else ""
    page = _HEAD.format(**made_on, load=busy)
    for row in rows:
        ratio = "–" if row.ratio is None else f"{row.ratio:.2f}"
        page += f"| {row.scene} | {row.ours} | {row.reference} | {ratio} | {row.sense} |\n"
    PAGE.parent.mkdir(exist_ok=True)
    PAGE.write_text(page)
    data = {"v": 1, "machine": made_on, "rows": [asdict(row) for row in rows]}
    DATA.write_text(json.dumps(data, indent=1, ensure_ascii=False) + "\n")
