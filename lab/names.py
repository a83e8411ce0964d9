"""What can be asked for, by name; nothing heavy stands here, so that `--help` may read it."""

from __future__ import annotations

from typing import Literal

# Method → order of its error in the step on smooth networks (None: exact where it applies).
ORDERS: dict[str, int | None] = {
    "ca": 2,
    "ca2p": 4,
    "bm4": 4,
    "modal": None,
    "ieq": 2,
    "trapezoid": 2,
}
METHODS = tuple(ORDERS)
PRECISIONS = ("f64", "f32")

Metric = Literal["waveform", "spectral", "cents", "energy"]
METRICS: dict[Metric, str] = {
    "waveform": "error of the waveform [dB]",
    "spectral": "difference of spectra [dB]",
    "cents": "worst pitch error of the strongest partials [cents]",
    "energy": "energy that the scheme made [dB of what was given]",
}
MAPS = ("cell", "contact", "strike", "rate", "coupling")
EXTRA = "pip install ergon-live[lab]"
