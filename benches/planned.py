"""The engine's side of every scene: planned where it can plan, plain where it cannot."""

from __future__ import annotations

from typing import Any

from ergon import _core

_PLAN: Any = getattr(_core, "Plan", None)


def can_plan() -> bool:
    """Whether this core has a planner; without one every scene runs the plain scheme."""
    return _PLAN is not None


def planned(
    network: _core.Network, timeline: _core.Timeline, *, threads: int = 1, **budget: Any
) -> _core.Simulation:
    """A simulation within `budget` (error_db, cents, …: what `Plan` takes), on so many threads."""
    if _PLAN is None:
        return _core.Simulation(network, timeline)
    plan = _PLAN(network, timeline, **budget)
    simulation: Any = _core.Simulation
    made: _core.Simulation = simulation(network, timeline, plan=plan, threads=threads)
    return made
