"""Compiles laws to machine code, if a score computes them often enough to be worth it.

Only operations that the core has parsed and checked are compiled, never a composer's text. The
language of laws is closed and bounded, so numba can compile every law that the core accepts.
"""

from __future__ import annotations

import ctypes
import math
import threading
from collections.abc import Sequence
from typing import Any

from ergon import _core
from ergon.common.compiler import load_numba
from ergon.instruments.native_source import LINKWISE_FUNCTIONS, Row, source

# From `python -m benches laws`: native code saves 1 ns per row for a link alone, 0.05 ns in a run.
# On that machine numba takes 0.2 s to load, 0.4 s for its first law, then 0.05 s and 0.005 s a row;
# the costs here are twice that, so that compiling pays on other machines too.
_SECONDS_SAVED_ALONE, _SECONDS_SAVED_IN_RUN = 1e-9, 0.05e-9
_COMPILE_SECONDS, _COMPILE_SECONDS_PER_ROW = 1.2, 0.01
# Compiled code by the rows of its law. It must stay in memory until the process ends.
_compiled: dict[tuple[Row, ...], Any] = {}
_lock = threading.Lock()


def speed_up(network: _core.Network, n_frames: int) -> int:
    """Compile the laws for which `n_frames` of sound make it worth it; returns their number.

    Without numba it is 0: the core computes these laws, with the same bits.
    """
    laws_to_compile = [
        (index, rows)
        for index, (rows, row_alone, in_runs) in enumerate(network.laws())
        if is_worth_compiling(rows, row_alone, in_runs, n_frames)
    ]
    if not laws_to_compile or load_numba()[0] is None:
        return 0
    network.native([(index, code_address(rows)) for index, rows in laws_to_compile])
    return len(laws_to_compile)


def is_worth_compiling(
    law_rows: Sequence[Row], n_single_links: int, n_links_in_runs: int, n_frames: int
) -> bool:
    """Whether native code saves more time than compiling takes; depends on the score alone, not on
    a clock.

    `alone` and `in_runs` are numbers of links. A law with functions of the core that work link
    by link saves nothing.
    """
    if any(row[0] in LINKWISE_FUNCTIONS for row in law_rows):
        return False
    saved_seconds = (
        (_SECONDS_SAVED_ALONE * n_single_links + _SECONDS_SAVED_IN_RUN * n_links_in_runs)
        * len(law_rows)
        * n_frames
    )
    return saved_seconds > _COMPILE_SECONDS + _COMPILE_SECONDS_PER_ROW * len(law_rows)


def code_address(rows: Sequence[Row]) -> int:
    """The address of a law's machine code; laws with the same rows share it."""
    law_key = tuple(rows)
    with _lock:
        if law_key not in _compiled:
            _compiled[law_key] = _compile(source(law_key))
        return int(_compiled[law_key].address)


def _compile(source_text: str) -> Any:
    numba, reason = load_numba()
    if numba is None:
        raise ImportError(reason)
    types = numba.types
    double_pointer, integer = ctypes.POINTER(ctypes.c_double), ctypes.c_int64
    function_type = ctypes.CFUNCTYPE(None, double_pointer, integer, integer, integer, integer)
    functions_by_name: dict[str, Any] = {
        name: function_type(address) for name, address in _core.law_functions()
    }
    functions_by_name["sqrt"] = math.sqrt
    exec(compile(source_text, "<law>", "exec"), functions_by_name)
    pointer: Any = types.CPointer
    signature = types.void(*[pointer(types.float64)] * 5, types.int64)
    # error_model="numpy": a division by zero gives a number, as in the core. No fast math: results
    # have the core's bits.
    return numba.cfunc(signature, error_model="numpy")(functions_by_name["law"])
