"""Points of a model in its score: modules, members of macros, points between masses."""

from __future__ import annotations

from ergon.workshop.models.mims import places
from ergon.workshop.models.mims.model import Point, Statement
from ergon.workshop.models.mims.proxies import Along, along, between_masses, moving
from ergon.workshop.models.mims.signals import guide
from ergon.workshop.models.mims.writing import Writing


def points(own: Writing, one: Statement, point: Point) -> list[tuple[float, str]]:
    """A point as a module, or as members of a macro with the share of each."""
    macro = own.macros.get(point.name)
    if macro is None:
        return [(1.0, own.targets[point.name])]
    sides = along(own.model, point, one.line)
    if any(side.signal for side in sides):
        return [(1.0, _moving(own, macro, sides))]
    return shares(own, one, point)


def shares(own: Writing, one: Statement, point: Point) -> list[tuple[float, str]]:
    """The masses that feel a force at a point in the first step, with the share of each."""
    macro = own.macros.get(point.name)
    if macro is None:
        return [(1.0, own.targets[point.name])]
    sides = [
        side.start + side.slope * (own.model.number(side.signal, "", 0) if side.signal else 0.0)
        for side in along(own.model, point, one.line)
    ]
    return macro.points(sides, is_2019=own.laws == "2019", line=one.line)


def _moving(own: Writing, macro: places.Macro, sides: list[Along]) -> str:
    """Add a point that signals move; returns its name."""
    guides = []
    for side in sides:
        guides.append(guide(own, side.signal) if side.signal else _place(own, macro, side))
    key = (macro.name, *sides)
    if key not in own.proxies:
        own.proxies[key] = own.names.new(f"{macro.name}_point")
        text = moving(macro, sides, guides, is_2019=own.laws == "2019")
        own.add(own.proxies[key], text, f"a point of {macro.name}, which a signal moves")
    return own.proxies[key]


def _place(own: Writing, macro: places.Macro, side: Along) -> str:
    known = f"a place at {side.start!r}"
    if known not in own.guides:
        own.guides[known] = own.names.new(f"{macro.name}_place")
        own.add(own.guides[known], f"SOL: {{X0: {side.start!r}m}}")
    return own.guides[known]


def still(own: Writing, point: Point, shares: list[tuple[float, str]]) -> str:
    """Add a point between masses; returns its name."""
    key = tuple(shares)
    if key not in own.proxies:
        own.proxies[key] = own.names.new(f"{own.macros[point.name].name}_point")
        own.add(own.proxies[key], between_masses(shares), f"a point of {point.name}")
    return own.proxies[key]
