"""The engine's side of every scene: planned within a budget."""

from __future__ import annotations

from typing import Any

from ergon import _core


def planned(
    network: _core.Network, timeline: _core.Timeline, *, threads: int = 1, **budget: Any
) -> _core.Simulation:
    """A simulation within `budget` (error_db, cents, …: what `Plan` takes), on so many threads."""
    plan = _core.Plan(network, timeline, **budget)
    return _core.Simulation(network, timeline, plan=plan, threads=threads)
