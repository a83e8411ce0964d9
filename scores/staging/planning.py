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
    """A plan, and what is to be said of it: code and sentence."""

    plan: _core.Plan
    notes: tuple[tuple[str, str], ...] = ()


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

    if pins is not None:
        return Planned(plan(accuracy))
    is_free = accuracy == Accuracy(cpu=accuracy.cpu) and accuracy.cpu is not None
    made = plan(accuracy)
    notes = [("W403", sentence) for sentence in _missed(made, accuracy.error)]
    if accuracy.cpu is None or (not is_free and cost(made) <= accuracy.cpu):
        return Planned(made, tuple(notes))
    others = {error: plan(Accuracy(error=error)) for error in _LOOSER}
    fits = [error for error, other in others.items() if cost(other) <= accuracy.cpu]
    if is_free and fits:
        return Planned(others[fits[0]])
    cheapest = min((made, *others.values()), key=cost)
    hint = f"error: {fits[0]:g}dB would fit" if fits else f"the least is {cost(cheapest):.0%}"
    excess = f"it takes {cost(made):.0%} of a core, more than the {accuracy.cpu:.0%} it may; {hint}"
    return Planned(cheapest if is_free else made, (*notes, ("W402", excess)))


def _missed(plan: _core.Plan, error: float | None) -> list[str]:
    """Parts whose error stays above what is asked for, once an island."""
    if error is None:
        return []
    found: dict[tuple[float, float | None], list[str]] = {}
    for row in plan.rows():
        if row.error_db is not None and row.error_db > error:
            found.setdefault((row.error_db, row.error_s), []).extend(row.parts)
    return [
        f"{' + '.join(dict.fromkeys(parts))} stays at {db:.0f} dB over the first {over:.2g} s, "
        f"above the {error:g} dB asked for"
        for (db, over), parts in found.items()
    ]


def wished(
    accuracy: Accuracy, *, method: str | None, error: float | None, cents: float | None
) -> Accuracy:
    """What the command line asks for instead of the score; `cpu` stays."""
    if method is None and error is None and cents is None:
        return accuracy
    upto = accuracy.upto if cents is not None else None
    return replace(Accuracy(method, error, cents, upto), cpu=accuracy.cpu)  # type: ignore[arg-type]
