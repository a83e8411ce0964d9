"""Points of a model in its score: modules, members of macros, points between masses."""

from __future__ import annotations

from ergon.workshop.models.mims import places
from ergon.workshop.models.mims.model import Point, Statement
from ergon.workshop.models.mims.proxies import Linear, fixed_proxy, moving_proxy, positions_along
from ergon.workshop.models.mims.signals import guide
from ergon.workshop.models.mims.writing import ScoreDraft


def points(draft: ScoreDraft, statement: Statement, point: Point) -> list[tuple[float, str]]:
    """A point as a module, or as members of a macro with the share of each."""
    macro = draft.macros.get(point.name)
    if macro is None:
        return [(1.0, draft.mass_modules[point.name])]
    sides = positions_along(draft.model, point, statement.line)
    if any(side.signal for side in sides):
        return [(1.0, _moving_point(draft, macro, sides))]
    return shares(draft, statement, point)


def shares(draft: ScoreDraft, statement: Statement, point: Point) -> list[tuple[float, str]]:
    """The masses that feel a force at a point in the first step, with the share of each."""
    macro = draft.macros.get(point.name)
    if macro is None:
        return [(1.0, draft.mass_modules[point.name])]
    positions = [
        side.offset + side.slope * (draft.model.number(side.signal, "", 0) if side.signal else 0.0)
        for side in positions_along(draft.model, point, statement.line)
    ]
    return macro.points(positions, is_2019=draft.laws == "2019", line=statement.line)


def _moving_point(draft: ScoreDraft, macro: places.Macro, sides: list[Linear]) -> str:
    """Add a point that signals move; returns its name."""
    guide_names = []
    for side in sides:
        guide_names.append(
            guide(draft, side.signal) if side.signal else _fixed_guide(draft, macro, side)
        )
    key = (macro.name, *sides)
    if key not in draft.proxies:
        draft.proxies[key] = draft.names.new(f"{macro.name}_point")
        text = moving_proxy(macro, sides, guide_names, is_2019=draft.laws == "2019")
        draft.add(draft.proxies[key], text, f"a point of {macro.name}, which a signal moves")
    return draft.proxies[key]


def _fixed_guide(draft: ScoreDraft, macro: places.Macro, side: Linear) -> str:
    key = f"a place at {side.offset!r}"
    if key not in draft.guides:
        draft.guides[key] = draft.names.new(f"{macro.name}_place")
        draft.add(draft.guides[key], f"SOL: {{X0: {side.offset!r}m}}")
    return draft.guides[key]


def fixed_point(draft: ScoreDraft, point: Point, shares: list[tuple[float, str]]) -> str:
    """Add a point between masses; returns its name."""
    key = tuple(shares)
    if key not in draft.proxies:
        draft.proxies[key] = draft.names.new(f"{draft.macros[point.name].name}_point")
        draft.add(draft.proxies[key], fixed_proxy(shares), f"a point of {point.name}")
    return draft.proxies[key]
