"""Points of a model in its score: modules, members of macros, points between masses."""

from __future__ import annotations

from ergon.workshop.models.mims import places
from ergon.workshop.models.mims.model import Point, Statement
from ergon.workshop.models.mims.proxies import Along, along, between_masses, moving
from ergon.workshop.models.mims.signals import guide
from ergon.workshop.models.mims.writing import Writing


def points(writing: Writing, statement: Statement, point: Point) -> list[tuple[float, str]]:
    """A point as a module, or as members of a macro with the share of each."""
    macro = writing.macros.get(point.name)
    if macro is None:
        return [(1.0, writing.targets[point.name])]
    sides = along(writing.model, point, statement.line)
    if any(side.signal for side in sides):
        return [(1.0, _moving(writing, macro, sides))]
    return shares(writing, statement, point)


def shares(writing: Writing, statement: Statement, point: Point) -> list[tuple[float, str]]:
    """The masses that feel a force at a point in the first step, with the share of each."""
    macro = writing.macros.get(point.name)
    if macro is None:
        return [(1.0, writing.targets[point.name])]
    places = [
        side.start + side.slope * (writing.model.number(side.signal, "", 0) if side.signal else 0.0)
        for side in along(writing.model, point, statement.line)
    ]
    return macro.points(places, is_2019=writing.laws == "2019", line=statement.line)


def _moving(writing: Writing, macro: places.Macro, sides: list[Along]) -> str:
    """Add a point that signals move; returns its name."""
    guide_names = []
    for side in sides:
        guide_names.append(
            guide(writing, side.signal) if side.signal else _place(writing, macro, side)
        )
    key = (macro.name, *sides)
    if key not in writing.proxies:
        writing.proxies[key] = writing.names.new(f"{macro.name}_point")
        text = moving(macro, sides, guide_names, is_2019=writing.laws == "2019")
        writing.add(writing.proxies[key], text, f"a point of {macro.name}, which a signal moves")
    return writing.proxies[key]


def _place(writing: Writing, macro: places.Macro, side: Along) -> str:
    key = f"a place at {side.start!r}"
    if key not in writing.guides:
        writing.guides[key] = writing.names.new(f"{macro.name}_place")
        writing.add(writing.guides[key], f"SOL: {{X0: {side.start!r}m}}")
    return writing.guides[key]


def still(writing: Writing, point: Point, shares: list[tuple[float, str]]) -> str:
    """Add a point between masses; returns its name."""
    key = tuple(shares)
    if key not in writing.proxies:
        writing.proxies[key] = writing.names.new(f"{writing.macros[point.name].name}_point")
        writing.add(writing.proxies[key], between_masses(shares), f"a point of {point.name}")
    return writing.proxies[key]
