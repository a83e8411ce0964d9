"""Points of a model in its score: modules, members of macros, points between masses."""

from __future__ import annotations

from ergon.workshop.models.mims import places
from ergon.workshop.models.mims.model import Point, Statement
from ergon.workshop.models.mims.proxies import Along, along, between_masses, moving
from ergon.workshop.models.mims.signals import guide
from ergon.workshop.models.mims.writing import Writing


def points(
    writing: Writing, model_statement: Statement, mass_point: Point
) -> list[tuple[float, str]]:
    """A point as a module, or as members of a macro with the share of each."""
    macro = writing.macros.get(mass_point.name)
    if macro is None:
        return [(1.0, writing.targets[mass_point.name])]
    sides = along(writing.model, mass_point, model_statement.line)
    if any(side.signal for side in sides):
        return [(1.0, _moving(writing, macro, sides))]
    return shares(writing, model_statement, mass_point)


def shares(
    writing: Writing, model_statement: Statement, mass_point: Point
) -> list[tuple[float, str]]:
    """The masses that feel a force at a point in the first step, with the share of each."""
    macro = writing.macros.get(mass_point.name)
    if macro is None:
        return [(1.0, writing.targets[mass_point.name])]
    sides = [
        side.start + side.slope * (writing.model.number(side.signal, "", 0) if side.signal else 0.0)
        for side in along(writing.model, mass_point, model_statement.line)
    ]
    return macro.points(sides, is_2019=writing.laws == "2019", line=model_statement.line)


def _moving(writing: Writing, macro: places.Macro, macro_sides: list[Along]) -> str:
    """Add a point that signals move; returns its name."""
    guides = []
    for side in macro_sides:
        guides.append(guide(writing, side.signal) if side.signal else _place(writing, macro, side))
    point_key = (macro.name, *macro_sides)
    if point_key not in writing.proxies:
        writing.proxies[point_key] = writing.names.new(f"{macro.name}_point")
        text = moving(macro, macro_sides, guides, is_2019=writing.laws == "2019")
        writing.add(
            writing.proxies[point_key], text, f"a point of {macro.name}, which a signal moves"
        )
    return writing.proxies[point_key]


def _place(writing: Writing, macro: places.Macro, side: Along) -> str:
    start_place = f"a place at {side.start!r}"
    if start_place not in writing.guides:
        writing.guides[start_place] = writing.names.new(f"{macro.name}_place")
        writing.add(writing.guides[start_place], f"SOL: {{X0: {side.start!r}m}}")
    return writing.guides[start_place]


def still(writing: Writing, macro_point: Point, shares: list[tuple[float, str]]) -> str:
    """Add a point between masses; returns its name."""
    shares_key = tuple(shares)
    if shares_key not in writing.proxies:
        writing.proxies[shares_key] = writing.names.new(
            f"{writing.macros[macro_point.name].name}_point"
        )
        writing.add(
            writing.proxies[shares_key], between_masses(shares), f"a point of {macro_point.name}"
        )
    return writing.proxies[shares_key]
