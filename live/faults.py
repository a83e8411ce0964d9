"""How soon a force ends when something goes wrong: the table of `ergon doctor --safety`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from ergon import _core


@dataclass(frozen=True, slots=True)
class Cell:
    """One fault on one device, in words.

    `seconds` [s] is from the fault to zero force; None if the force does not end, or if the
    fault is not made: `said` tells which. `bound` [s] is the longest that is allowed, if there
    is a bound.
    """

    device: str
    said: str
    seconds: float | None
    bound: float | None
    force: float
    rise: float
    exceeds: bool


@dataclass(frozen=True, slots=True)
class Row:
    """One fault on every device."""

    fault: str
    cells: Sequence[Cell]


def measured() -> list[Row]:
    """Simulate every fault on every emulated device, in virtual time: the same figures on any
    machine.

    Raises EngineError if an emulator does not answer its own driver.
    """
    rows: dict[str, list[Cell]] = {}
    for one in _core.measure_faults():
        cell = Cell(
            one.device,
            _said(one),
            one.seconds,
            one.bound if one.excluded is None else None,
            one.force,
            one.rise,
            one.exceeds,
        )
        rows.setdefault(one.fault, []).append(cell)
    return [Row(fault, cells) for fault, cells in rows.items()]


def _said(one: _core.FaultMeasurement) -> str:
    if one.excluded is not None:
        return f"not made: {one.excluded}"
    if one.unbounded is not None:
        return f"no bound: {one.unbounded}"
    if one.seconds is None:
        return "it does not end"
    return f"{1e3 * one.seconds:.4g} ms"


def bound(row: Row) -> str:
    """The bounds of a row, in words; only one if all devices have the same."""
    bounds = sorted({cell.bound for cell in row.cells if cell.bound is not None})
    return ", ".join(f"{1e3 * seconds:g} ms" for seconds in bounds) or "none"
