"""A plan within the accuracy that a piece asks for, and what would fit where it costs too much."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from ergon import _core
from ergon.scores.reading.piece import Accuracy

# What is offered where a plan costs too much, the most exact first [dB].
_LOOSER = (-80.0, -60.0, -40.0, -20.0)

Pins = Sequence[tuple[int, int, int, Sequence[Sequence[int]]]]


@dataclass(frozen=True, slots=True)
class Planned:
    """A plan, and a sentence where it costs more than it may."""

    plan: _core.Plan
    excess: str | None = None


def cost(plan: _core.Plan) -> float:
    """Work on one core for a second of sound [s/s], by the table of costs."""
    return sum(row.cost for row in plan.rows())


def make(
    network: _core.Network, timeline: _core.Timeline, accuracy: Accuracy, pins: Pins | None = None
) -> Planned:
    """The cheapest plan that is exact enough. Raises EngineError where there is none.

    Where `cpu` alone is given: the most exact plan that it can pay for.
    """

    def plan(wished: Accuracy) -> _core.Plan:
        return _core.Plan(
            network,
            timeline,
            method=wished.method,
            error_db=wished.error,
            cents=wished.cents,
            upto=wished.upto,
            pins=pins,
        )

    if accuracy.cpu is None or pins is not None:
        return Planned(plan(accuracy))
    is_free = accuracy == Accuracy(cpu=accuracy.cpu)
    first = plan(accuracy)
    if not is_free and cost(first) <= accuracy.cpu:
        return Planned(first)
    cheapest = first
    for error in _LOOSER:
        other = plan(Accuracy(error=error))
        if cost(other) <= accuracy.cpu:
            if is_free:
                return Planned(other)
            return Planned(first, _excess(first, accuracy.cpu, f"error: {error:g}dB would fit"))
        cheapest = min(cheapest, other, key=cost)
    least = f"the least is {cost(cheapest):.0%}"
    return Planned(first if not is_free else cheapest, _excess(first, accuracy.cpu, least))


def _excess(plan: _core.Plan, most: float, what: str) -> str:
    return f"the plan takes {cost(plan):.0%} of a core, more than the {most:.0%} it may; {what}"


def wished(
    accuracy: Accuracy, *, method: str | None, error: float | None, cents: float | None
) -> Accuracy:
    """What the command line asks for instead of the score; `cpu` stays."""
    if method is None and error is None and cents is None:
        return accuracy
    upto = accuracy.upto if cents is not None else None
    return replace(Accuracy(method, error, cents, upto), cpu=accuracy.cpu)  # type: ignore[arg-type]
