"""The time that modes and admittances of up to 10⁵ masses take, and their distance from closed
forms.
"""

from __future__ import annotations

import time

import numpy as np

from benches.measure import Row, interleaved
from benches.modes import row
from ergon import _core

_RADIUS, _COUNT, _F = 157, 50, 65.0
_LIMIT = 15.0  # [s]


def part_modes() -> list[Row]:
    """A square membrane with a fixed rim: pairs of modes have the same frequency."""
    network = _core.Network()
    network.part("membrane")
    network.plate("p", shape="square", radius=_RADIUS, M=0.3, f=_F, rim="fixed")
    result = network.part_modes("membrane", count=_COUNT)
    n_masses = len(result.mats)
    values, _ = row(round(n_masses**0.5))
    wanted = np.sqrt(np.sort((values[:, None] + values).ravel())[:_COUNT])
    cents = np.abs(1200 * np.log2(result.poles.imag / (2 * np.pi) / (wanted * _F / wanted[0])))
    start = time.process_time()
    taken = interleaved(3, {"modes": lambda: network.part_modes("membrane", count=_COUNT)})
    spent = (time.process_time() - start) / 4
    return [
        Row(
            "part_modes",
            f"{n_masses:,} masses, {_COUNT} modes: {taken['modes']:.1f} s ({spent:.1f} s of CPU), "
            f"worst {cents.max():.0e} cents, {'certified' if result.is_certified else 'UNCERTAIN'}",
            f"at most {_LIMIT:.0f} s",
            taken["modes"] / _LIMIT,
            "of the limit",
            {"seconds": taken["modes"], "cpu": spent, "cents": float(cents.max())},
        )
    ]


def admittance() -> list[Row]:
    """The same membrane driven and heard at one mass, between its resonances."""
    rows = []
    for radius, count in ((15, 100), (50, 20), (_RADIUS, 3)):
        network = _core.Network()
        network.part("membrane")
        first = network.plate("p", shape="square", radius=radius, M=0.3, f=_F, rim="fixed")
        elements = network.elements(["membrane"])
        side = round(len(elements.mats) ** 0.5)
        point = np.flatnonzero(np.array(elements.mats) == network.centre(first))[0]
        values, _ = row(side)
        place = divmod(int(point), side)
        sines = [
            np.sin(np.pi * np.arange(1, side + 1) * (at + 1) / (side + 1)) ** 2 for at in place
        ]
        levels = np.outer(*sines) * (2 / (side + 1)) ** 2 / elements.masses[0]
        squares = (2 * np.pi * _F) ** 2 * (values[:, None] + values) / (2 * values[0])
        f = np.linspace(70.3, 901.7, count)
        omega = 2 * np.pi * f
        wanted = np.array([1j * w * np.sum(levels / (squares - w * w)) for w in omega])
        start = time.perf_counter()
        result = network.admittance(
            ["membrane"], [elements.mats[point]], [[elements.mats[point]]], f
        )
        taken = (time.perf_counter() - start) / count
        error = float((np.abs(result[0] - wanted) / np.abs(wanted)).max())
        rows.append(
            Row(
                f"admittance {side * side:,}",
                f"{side * side:,} masses: {1e3 * taken:.1f} ms a frequency, worst {error:.0e}",
                "at most 5 s a frequency",
                taken / 5.0,
                "of the limit",
                {"seconds": taken, "error": error},
            )
        )
    return rows
