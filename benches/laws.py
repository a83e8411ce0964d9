"""LNL laws as native code compared with the core's own steps: equal bits, and when compiling
pays.
"""

from __future__ import annotations

import subprocess
import sys
from functools import partial
from statistics import median

import numpy as np

from benches.measure import Row, interleaved
from ergon import _core
from ergon.instruments import native

ROUNDS = 7
_LENGTHS = {1: "alone", 10: "in a run of 10", 1_000: "of 1,000", 30_000: "of 30,000"}
_WORK = 300_000  # links a round
_CONSTANTS = {"k": 1e3, "q": 1e8, "z": 0.1, "F": 0.5, "w": 1e-3, "a": 60.0, "u": 0.05}
_CONSTANTS |= {"r": 0.3, "v1": 0.05, "v2": 0.1, "s": 0.01, "p": 1.5}
_SLIP = "F*sign(v - u)*(r + (1 - r)*v2/(v2 + abs(v - u) - v1))"
# Law and damping, as in instruments/library/laws.yaml.
_LAWS: dict[str, tuple[str | None, str | None]] = {
    "cubic": ("k*d + q*d**3", "z*v"),
    "detent": ("F*d/w*exp(0.5 - 0.5*(d/w)**2)", None),
    "pluck": ("-F*d/w*exp(0.5 - 0.5*(d/w)**2)", None),
    "bow": (None, "F*sqrt(2*a)*(v - u)*exp(0.5 - a*(v - u)**2)"),
    "bow-hyperbolic": (None, f"where(abs(v - u) < v1, F*(v - u)/v1, {_SLIP})"),
    "coulomb": (None, "F*tanh(v/s)"),
    "power": ("k*sign(d)*abs(d)**p", None),
}
# The first law loads the compiler.
_COMPILE = """
import time
from ergon import _core
from ergon.instruments import native
for law in ("d*2 + d**3", "d*2 - d**3 + abs(d)"):
    rows, start = _core.Law(law).rows(), time.perf_counter()
    native.address(rows)
    print(time.perf_counter() - start)
"""


def laws() -> list[Row]:
    """The laws that ship, for a link alone and in runs; then the time of compiling."""
    return [row for name in _LAWS for row in _law(name)] + [_compiling()]


def _law(name: str) -> list[Row]:
    steps = _core.Law(*_LAWS[name], _CONSTANTS)
    rows = steps.rows()
    assert rows is not None
    code = steps.native(native.code_address(rows))
    result = []
    for n, words in _LENGTHS.items():
        chance = np.random.default_rng(1)
        d, v, out = chance.normal(0.0, 1e-3, n), chance.normal(0.0, 0.1, n), np.empty(n)
        times = max(1, _WORK // max(n, 10))
        both = {"native": code, "steps": steps}
        sounds = []
        for law in both.values():
            law.forces(d, v, out)
            sounds.append(out.tobytes())
        assert sounds[0] == sounds[1], f"{name}: other bits"
        runs = {key: partial(law.forces, d, v, out, times) for key, law in both.items()}
        taken = interleaved(ROUNDS, runs)
        each = {key: 1e9 * spent / times / n for key, spent in taken.items()}
        values = {"rows": len(rows)} | {f"{key}, ns a link": ns for key, ns in each.items()}
        result.append(
            Row(
                f"law `{name}`, a link {words}",
                f"{each['native']:.2f} ns as native code",
                f"the core's steps: {each['steps']:.2f} ns",
                each["steps"] / each["native"],
                "speed over the reference's",
                values,
            )
        )
    return result


def _compiling() -> Row:
    command = [sys.executable, "-c", _COMPILE]
    runs = [subprocess.check_output(command, text=True).split() for _ in range(3)]
    first, next_ = (median(map(float, column)) for column in zip(*runs, strict=True))
    return Row(
        "laws to native code",
        f"{first:.2f} s for the first, {next_:.2f} s for one more",
        "compiled only where it saves more than 1.2 s and 0.01 s a row",
        None,
        "",
        {"first, s": first, "next, s": next_},
    )
