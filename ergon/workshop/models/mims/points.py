"""Points of a model in its score: modules, members of macros, points between masses."""

from __future__ import annotations

from ergon.workshop.models.mims import places
from ergon.workshop.models.mims.model import Point, Statement
from ergon.workshop.models.mims.proxies import Linear, fixed_proxy, moving_proxy, positions_along
from ergon.workshop.models.mims.signals import guide_of_signal
from ergon.workshop.models.mims.writing import ScoreDraft


def targets_of_point(
    draft: ScoreDraft, statement: Statement, point: Point
) -> list[tuple[float, str]]:
    """A point as a module, or as members of a macro with the share of each."""
    macro = draft.macros.get(point.name)
    if macro is None:
        return [(1.0, draft.mass_modules[point.name])]
    axis_positions = positions_along(draft.model, point, statement.line)
    if any(axis_position.signal for axis_position in axis_positions):
        return [(1.0, _moving_point(draft, macro, axis_positions))]
    return force_shares(draft, statement, point)


def force_shares(draft: ScoreDraft, statement: Statement, point: Point) -> list[tuple[float, str]]:
    """The masses that feel a force at a point in the first step, with the share of each."""
    macro = draft.macros.get(point.name)
    if macro is None:
        return [(1.0, draft.mass_modules[point.name])]
    positions = [
        axis_position.offset
        + axis_position.slope
        * (draft.model.number(axis_position.signal, "", 0) if axis_position.signal else 0.0)
        for axis_position in positions_along(draft.model, point, statement.line)
    ]
    return macro.point_shares(positions, is_2019=draft.laws == "2019", line=statement.line)


def _moving_point(draft: ScoreDraft, macro: places.Macro, axis_positions: list[Linear]) -> str:
    """Add a point that signals move; returns its name."""
    guide_names = []
    for axis_position in axis_positions:
        guide_names.append(
            guide_of_signal(draft, axis_position.signal)
            if axis_position.signal
            else _fixed_guide(draft, macro, axis_position)
        )
    key = (macro.name, *axis_positions)
    if key not in draft.proxies:
        draft.proxies[key] = draft.names.new(f"{macro.name}_point")
        text = moving_proxy(macro, axis_positions, guide_names, is_2019=draft.laws == "2019")
        draft.add(draft.proxies[key], text, f"a point of {macro.name}, which a signal moves")
    return draft.proxies[key]


def _fixed_guide(draft: ScoreDraft, macro: places.Macro, axis_position: Linear) -> str:
    key = f"a place at {axis_position.offset!r}"
    if key not in draft.guides:
        draft.guides[key] = draft.names.new(f"{macro.name}_place")
        draft.add(draft.guides[key], f"SOL: {{X0: {axis_position.offset!r}m}}")
    return draft.guides[key]


def fixed_point(draft: ScoreDraft, point: Point, force_shares: list[tuple[float, str]]) -> str:
    """Add a point between masses; returns its name."""
    key = tuple(force_shares)
    if key not in draft.proxies:
        draft.proxies[key] = draft.names.new(f"{draft.macros[point.name].name}_point")
        draft.add(draft.proxies[key], fixed_proxy(force_shares), f"a point of {point.name}")
    return draft.proxies[key]
