"""How soon a force ends when something goes wrong: the table of `ergon doctor --safety`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from ergon import _core


@dataclass(frozen=True, slots=True)
class FaultResult:
    """One fault on one device, in words.

    `seconds` [s] is from the fault to zero force; None if the force does not end, or if the
    fault is not made: `said` tells which. `bound` [s] is the longest that is allowed, if there
    is a bound. `force` [N] is the greatest force from the fault on, `rise` [N/ms] its fastest
    growth. `exceeds` says that time, force or growth is beyond its bound.
    """

    device: str
    said: str
    seconds: float | None
    bound: float | None
    force: float
    rise: float
    exceeds: bool


@dataclass(frozen=True, slots=True)
class FaultRow:
    """One fault on every device."""

    fault: str
    results: Sequence[FaultResult]


def measure_faults() -> list[FaultRow]:
    """Simulate every fault on every emulated device, in virtual time: the same figures on any
    machine.

    Raises EngineError if an emulator does not answer its own driver.
    """
    fault_rows: dict[str, list[FaultResult]] = {}
    for measurement in _core.measure_faults():
        cell = FaultResult(
            measurement.device,
            _result_text(measurement),
            measurement.seconds,
            measurement.bound if measurement.excluded is None else None,
            measurement.force,
            measurement.rise,
            measurement.exceeds,
        )
        fault_rows.setdefault(measurement.fault, []).append(cell)
    return [FaultRow(fault, results) for fault, results in fault_rows.items()]


def _result_text(measurement: _core.FaultMeasurement) -> str:
    if measurement.excluded is not None:
        return f"not made: {measurement.excluded}"
    if measurement.unbounded is not None:
        return f"no bound: {measurement.unbounded}"
    if measurement.seconds is None:
        return "it does not end"
    return f"{1e3 * measurement.seconds:.4g} ms"


def bounds_text(row: FaultRow) -> str:
    """The bounds of a row, in words; only one if all devices have the same."""
    bounds = sorted({cell.bound for cell in row.results if cell.bound is not None})
    return ", ".join(f"{1e3 * seconds:g} ms" for seconds in bounds) or "none"
