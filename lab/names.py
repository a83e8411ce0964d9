"""What can be asked for, by name; nothing heavy stands here, so that `--help` may read it."""

from __future__ import annotations

from typing import Literal

# Method → order of its error in the step on smooth networks (None: exact where it applies).
Method = Literal["ca", "modal"]
ORDERS: dict[Method, int | None] = {"ca": 2, "modal": None}
METHODS: tuple[Method, ...] = tuple(ORDERS)
PRECISIONS = ("f64",)

Metric = Literal["waveform", "spectral", "cents", "energy"]
METRICS: dict[Metric, str] = {
    "waveform": "error of the waveform [dB]",
    "spectral": "difference of spectra [dB]",
    "cents": "worst pitch error of the strongest partials [cents]",
    "energy": "energy that the scheme made [dB of what was given]",
}
MAPS = ("cell", "contact", "strike", "rate", "coupling")
EXTRA = "pip install ergon-live[lab]"
