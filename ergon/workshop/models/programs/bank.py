"""A part as a bank of modes: struck points, outputs, and the resonators between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

UNITS = ("m", "m/s", "m/s^2")  # of an output, by how often it is differentiated


@dataclass(frozen=True, slots=True)
class ModePath:
    """The path from a struck point to an output: four numbers for each mode.

    `modes` hold the damped frequency [Hz], the decay [1/s], and, for an impulse of 1 N·s, the
    amplitude [m] and phase [rad].
    """

    struck_index: int
    output_index: int
    modes: Sequence[tuple[float, float, float, float]]


@dataclass(frozen=True, slots=True)
class Bank:
    """A part as a bank of modes: struck points, outputs, and paths between them.

    `outputs` gives each output with the number of times that it is differentiated. `strikes` are
    those of each point: instant [s] and impulse [N·s]. `full_scales` is the value of each output at
    full scale.
    """

    name: str
    rate: float
    duration: float
    struck_names: Sequence[str]
    strikes: Sequence[Sequence[tuple[float, float]]]
    outputs: Sequence[tuple[str, int]]
    full_scales: Sequence[float]
    paths: Sequence[ModePath]


def join_banks(bank_name: str, banks: Sequence[Bank]) -> Bank:
    """The banks of several parts of one piece side by side, in one bank of this name."""
    paths: list[ModePath] = []
    n_struck = n_outputs = 0
    for bank in banks:
        paths += (
            replace(
                path,
                struck_index=n_struck + path.struck_index,
                output_index=n_outputs + path.output_index,
            )
            for path in bank.paths
        )
        n_struck += len(bank.struck_names)
        n_outputs += len(bank.outputs)
    return Bank(
        bank_name,
        banks[0].rate,
        max(bank.duration for bank in banks),
        [f"{bank.name}: {point_name}" for bank in banks for point_name in bank.struck_names],
        [point_strikes for bank in banks for point_strikes in bank.strikes],
        [
            (f"{bank.name}: {point_name}", order)
            for bank in banks
            for point_name, order in bank.outputs
        ],
        [full_scale for bank in banks for full_scale in bank.full_scales],
        paths,
    )
