"""Names of methods, metrics and maps. This module imports nothing heavy, so that `--help` can use
it.
"""

from __future__ import annotations

from typing import Literal

# Method → order of its error in the step on smooth networks (None: exact where it applies).
Method = Literal["ca", "modal", "ca2p", "bm4", "ieq"]
ORDERS: dict[Method, int | None] = {
    "ca": 2,
    "modal": None,
    "ca2p": 4,  # on linear networks; 2 on others
    "bm4": 4,
    "ieq": 2,
}
METHODS: tuple[Method, ...] = tuple(ORDERS)
_PLAIN_ORDER = 2  # order of contacts and laws in a method exact otherwise
PRECISIONS = ("f64",)

Metric = Literal["waveform", "spectral", "cents", "energy"]
METRICS: dict[Metric, str] = {
    "waveform": "error of the waveform [dB]",
    "spectral": "difference of spectra [dB]",
    "cents": "worst pitch error of the strongest partials [cents]",
    "energy": "energy that the scheme made [dB of what was given]",
}
MAPS = ("cell", "contact", "strike", "rate", "coupling")
PLAN = "plan"  # whatever the planner chooses, by ear
ENERGY_MAPS = ("rattle",)  # maps of the energy error
MapMetric = Literal["waveform", "energy"]  # the criterion for a spot of a map
SLOW = "e4"  # the exact flow of a slow part: no method of its own for all of a scene
SLOW_MAPS = ("soft", "quick")  # its maps


def order_of(method: str | None) -> int:
    """The order of a method's error, as an upper bound."""
    orders = [order for name, order in ORDERS.items() if name == method]
    return (orders[0] if orders else None) or _PLAIN_ORDER
