"""The energy error of a run, from its ledger: energy that the scheme itself made, and its drift."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, log10
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from ergon import _core


def production_db(ledger: _core.Energy) -> float:
    """10·log10 of the energy made or missing over the energy given; -inf if there is none."""
    spurious = abs(ledger.produced) + abs(ledger.residual)
    supplied = abs(ledger.start) + abs(ledger.injected)
    if spurious == 0.0:
        return -inf
    return 10.0 * log10(spurious / supplied) if supplied > 0.0 else inf


def energy_ratio_db(ratio: float) -> float:
    """10·log10 of the energy made over the energy that was there; -inf if none was made."""
    return 10.0 * log10(ratio) if ratio > 0.0 else -inf


# Energy that rounding alone makes in a few million steps [dB]: smaller errors are not compared.
ROUNDING_DB = -150.0


@dataclass(frozen=True, slots=True)
class Drift:
    """Stored and lost energy over the energy given: its trend [dB/s], and its worst error [dB]."""

    db_per_second: float
    worst_db: float


def drift(t: Sequence[float], ledgers: Sequence[_core.Energy]) -> Drift:
    """Follow (stored + lost)/(start + injected) through instants t [s]; 0 dB is exact."""
    ratios = np.array(
        [
            (ledger.stored + ledger.lost) / max(ledger.start + ledger.injected, 1e-300)
            for ledger in ledgers
        ]
    )
    levels = 10.0 * np.log10(np.maximum(ratios, 1e-300))
    if len(levels) < 2:
        return Drift(0.0, float(np.abs(levels).max(initial=0.0)))
    slope = np.polyfit(np.asarray(t), levels, 1)[0]
    return Drift(float(slope), float(np.abs(levels).max()))
