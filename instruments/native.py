"""Laws as machine code, where a score computes them often enough to be worth a compiler.

What is compiled are the operations that the core has read and checked, never a composer's text. The
language of laws is closed and bounded, so there is no law that the core takes and numba does not.
"""

from __future__ import annotations

import ctypes
import math
import threading
from collections.abc import Sequence
from typing import Any

from ergon import _core
from ergon.instruments.native_source import SLOW, Row, source

# From `python -m benches laws`: a row takes native code 1 ns less than the core's own steps in a
# link alone, 0.05 ns less in a run. On that machine numba takes 0.2 s to load, 0.4 s for its first
# law, then 0.05 s and 0.005 s a row; here twice that, so that it is worth it elsewhere too.
_SAVED_ALONE, _SAVED_IN_RUN = 1e-9, 0.05e-9
_COST, _COST_OF_ROW = 1.2, 0.01
# Compiled code by its rows. It must stay where it is until the process ends.
_compiled: dict[tuple[Row, ...], Any] = {}
_lock = threading.Lock()


def speed_up(network: _core.Network, n_frames: int) -> int:
    """Compile the laws that `n_frames` of sound make worth it; how many those are."""
    entries = [
        (index, address(rows))
        for index, (rows, alone, in_runs) in enumerate(network.laws())
        if is_worth_it(rows, alone, in_runs, n_frames)
    ]
    if entries:
        network.native(entries)
    return len(entries)


def is_worth_it(rows: Sequence[Row], alone: int, in_runs: int, n_frames: int) -> bool:
    """Whether native code saves more than compiling takes: a function of the score, of no clock.

    `alone` and `in_runs` are numbers of links. Where a law's time goes into functions of the core
    that take link by link, nothing is saved.
    """
    if any(row[0] in SLOW for row in rows):
        return False
    saved = (_SAVED_ALONE * alone + _SAVED_IN_RUN * in_runs) * len(rows) * n_frames
    return saved > _COST + _COST_OF_ROW * len(rows)


def address(rows: Sequence[Row]) -> int:
    """Where the machine code of a law begins; laws with the same rows share one."""
    key = tuple(rows)
    with _lock:
        if key not in _compiled:
            _compiled[key] = _compile(source(key))
        return int(_compiled[key].address)


def _compile(text: str) -> Any:
    # Loading it takes longer than most scores are computed.
    import numba
    from numba import types

    room, integer = ctypes.POINTER(ctypes.c_double), ctypes.c_int64
    function = ctypes.CFUNCTYPE(None, room, integer, integer, integer, integer)
    names: dict[str, Any] = {name: function(at) for name, at in _core.law_functions()}
    names["sqrt"] = math.sqrt
    exec(compile(text, "<law>", "exec"), names)
    pointer: Any = types.CPointer
    signature = types.void(*[pointer(types.float64)] * 5, types.int64)
    # numpy's model of errors: a division by zero is a number, as in the core. No fast mathematics:
    # the bits are the core's.
    return numba.cfunc(signature, error_model="numpy")(names["law"])
