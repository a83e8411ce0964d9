"""How long the lowest 50 modes of 10⁵ masses take, and how near they are to their closed form."""

from __future__ import annotations

import time

import numpy as np

from benches.measure import Row, interleaved
from benches.modes import row
from ergon import _core

_RADIUS, _COUNT, _F = 157, 50, 65.0
_LIMIT = 15.0  # [s]


def part_modes() -> list[Row]:
    """A square membrane whose rim is fixed: pairs of modes share a pitch."""
    network = _core.Network()
    network.part("membrane")
    network.plate("p", shape="square", radius=_RADIUS, M=0.3, f=_F, rim="fixed")
    found = network.part_modes("membrane", count=_COUNT)
    n_masses = len(found.mats)
    values, _ = row(round(n_masses**0.5))
    wanted = np.sqrt(np.sort((values[:, None] + values).ravel())[:_COUNT])
    cents = np.abs(1200 * np.log2(found.poles.imag / (2 * np.pi) / (wanted * _F / wanted[0])))
    start = time.process_time()
    taken = interleaved(3, {"modes": lambda: network.part_modes("membrane", count=_COUNT)})
    spent = (time.process_time() - start) / 4
    return [
        Row(
            "part_modes",
            f"{n_masses:,} masses, {_COUNT} modes: {taken['modes']:.1f} s ({spent:.1f} s of CPU), "
            f"worst {cents.max():.0e} cents, {'certified' if found.is_certified else 'UNCERTAIN'}",
            f"at most {_LIMIT:.0f} s",
            taken["modes"] / _LIMIT,
            "of the limit",
            {"seconds": taken["modes"], "cpu": spent, "cents": float(cents.max())},
        )
    ]
