"""Growth of cost and memory with modules and with ergons; each size runs in its own process."""

from __future__ import annotations

import json
import math
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benches.measure import Row
from benches.native import Loops
from benches.planned import planned
from ergon import _core

RATE = 44100.0
COLUMNS = "what,number,s_per_s,set_up_s,peak_mb\n"
_RINGS = (3, 9, 28, 91, 288, 500)  # of a hex gong: 1e2 to 3e6 modules
_OSCILLATORS = (100, 1_000, 10_000, 100_000, 1_000_000, 10_000_000)
_POSITIONS_MAX = 1_000_000
_BANK_MAX = 2_000_000  # what one BANK may have
_ERGONS = (100, 1_000, 10_000, 100_000, 1_000_000)
_CELLS = 1_000
_ROUNDS = 3
# Module steps in one round: enough to be timed, few enough for a million modules.
_WORK = 2e9


def growth(_: Loops | None) -> list[Row]:
    """Three rows; each holds its sizes as lines of a table."""
    measured = {"modules": [_apart("modules", rings) for rings in _RINGS]}
    measured["oscillators"] = [_apart("oscillators", number) for number in _OSCILLATORS]
    measured["ergons"] = [_apart("ergons", number) for number in _ERGONS]
    scenes = {
        "modules": "a gong with hardening, by its modules",
        "oscillators": "banks of oscillators, by their number",
        "ergons": f"{_CELLS:,} cells, by ergons in a second",
    }
    return [_row(what, scenes[what], np.array(found)) for what, found in measured.items()]


def _row(what: str, scene: str, outcome: NDArray[np.float64]) -> Row:
    number, cost, set_up, memory = outcome.T
    slope = float(np.polyfit(np.log(number), np.log(cost), 1)[0])
    last = math.log(cost[-1] / cost[-2]) / math.log(number[-1] / number[-2])
    each = 2**20 * (memory[-1] - memory[0]) / (number[-1] - number[0])
    text = (
        f"cost ∝ number^{slope:.2f} (last decade {last:.2f}); at {number[-1]:,.0f}: "
        f"{cost[-1]:.3g} s of a processor a second of sound, set up in {set_up[-1]:.2g} s, "
        f"{memory[-1]:.0f} MB ({each:.0f} bytes each)"
    )
    lines = [",".join([what, *(f"{value:.6g}" for value in one)]) for one in outcome]
    values: dict[str, float | int | str] = {"slope": slope, "slope_last": last}
    values |= {"bytes_each": each, "table": "\n".join(lines)}
    return Row(f"growth: {scene}", text, "in proportion: 1", slope, "exponent", values)


def _apart(what: str, size: int) -> list[float]:
    """Number, cost [s/s], set-up [s] and peak memory [MB], measured in a process that has made
    nothing else.

    Times are CPU times, so other load on the machine hardly counts.
    """
    line = [sys.executable, "-m", "benches.growth", what, str(size)]
    root = Path(__file__).parent.parent
    done = subprocess.run(line, check=True, capture_output=True, cwd=root)
    result: list[float] = json.loads(done.stdout)
    return result


def _measured_size(what: str, size: int) -> list[float]:
    start = time.thread_time()
    network = _core.Network()
    network.part("body")
    if what == "modules":
        # A larger gong is lower and decays more slowly, so that at every size the links are of the
        # same kind.
        f, t60 = 3_800.0 / size, 4e-3 * size**2
        first = network.plate("", shape="hex", radius=size, M=0.3, f=f, t60=t60, hardening=4e8)
        for i in range(network.count(first)):  # nothing lies still, and nothing is nearly zero
            network.start(first + i, 1e-5 * math.sin(0.37 * i), 0.0)
        listened: Sequence[int] = [network.centre(first)]
    else:
        sizes = [_CELLS]
        if what == "oscillators":
            sizes = [min(_BANK_MAX, size - index) for index in range(0, size, _BANK_MAX)]
        for count in sizes:
            first = network.bank("", count=count, M=1e-3, f=(20.0, 10_000.0), t60=(0.5, 8.0))
        listened = [first]
        if what == "oscillators":
            listened = range(size)
            for mat in listened:
                network.start(mat, 1e-6, 0.0)
    # Positions are added in pieces, so that the lists of this file do not dominate the memory.
    for index in range(0, len(listened), _POSITIONS_MAX):
        positions = [(mat, 1, 1.0) for mat in listened[index : index + _POSITIONS_MAX]]
        network.listen(f"out{index}", positions=positions)
    number = network.n_mat + network.n_lia
    n_frames = max(64, min(int(RATE), int(_WORK / number)))
    timeline = _core.Timeline(network, RATE)
    if what == "ergons":
        n_frames = int(RATE)
        number = timeline.rain(
            range(_CELLS), start=0.0, stop=1.0, rate=size / _CELLS, impulse=(1e-6, 4e-6),
            seed=5, name="rain",
        )  # fmt: skip
    simulation = planned(network, timeline, method=None if what == "oscillators" else "ca")
    set_up = time.thread_time() - start
    begun, taken = simulation.snapshot(), []
    block = np.empty((n_frames, simulation.n_out))
    for _ in range(_ROUNDS):
        simulation.restore(begun)
        start = time.thread_time()
        simulation.process(block)
        taken.append(time.thread_time() - start)
    return [number, sorted(taken)[_ROUNDS // 2] * RATE / n_frames, set_up, _peak()]


def _peak() -> float:
    """Peak memory of this process [MB]. getrusage is not used, because it counts the parent process
    too.
    """
    status = Path("/proc/self/status")
    lines = status.read_text().splitlines() if status.is_file() else []
    result = [float(line.split()[1]) / 2**10 for line in lines if line.startswith("VmHWM")]
    return result[0] if result else math.nan


if __name__ == "__main__":
    print(json.dumps(_measured_size(sys.argv[1], int(sys.argv[2]))))
