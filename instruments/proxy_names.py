"""Looks up the names in the fields of a PROXY, and checks that they form rows of masses."""

from __future__ import annotations

from typing import Any

from ergon.instruments.model import Module, Target
from ergon.instruments.names import Part, PartNames
from ergon.notation.text.errors import quote


def resolve(
    module: Module, part: Part, part_names: PartNames, fields: dict[str, Any], who: str
) -> bool:
    """Replace names by their targets; False if an error was reported."""

    def wrong(message: str, name: str = "of", code: str = "E304") -> bool:
        place = module.places.get(name, module.place)
        part_names.collector.error(code, f"{who}: {message}", place)
        return False

    if part.struck is not None:
        return wrong("a PROXY can be a module of an instrument, not of a key")
    bodies = [part_names.target(name, "body", who, part) for name in fields["of"] or ()]
    follows = [part_names.target(name, "mat", who, part) for name in fields["follows"] or ()]
    rim = fields["rim"] and part_names.target(fields["rim"], "mat", who, part)
    bodies_and_rim = [*bodies, *follows, rim] if fields["rim"] else [*bodies, *follows]
    if not bodies or None in bodies_and_rim:
        return False
    named = [target for target in bodies_and_rim if target is not None]
    for target in named:
        kind = part_names.parts[target.part].modules[target.module].kind
        if kind == "PROXY":
            message = "is a PROXY itself; write the masses that it lies between"
            return wrong(f"{quote(target.text)} {message}")
    masses = [target for target in bodies if target is not None]
    fields["of"], fields["follows"], fields["rim"] = tuple(masses), tuple(follows), rim
    count = sum(target.count for target in masses)
    if fields["shares"] is not None:
        if len(fields["shares"]) != count:
            written = len(fields["shares"])
            message = f"it has {count:,} masses and {written:,} shares; write one share for each"
            return wrong(message, "shares", "E106")
        return True
    for target in masses:
        shape = part_names.parts[target.part].modules[target.module].fields.get("shape")
        if shape not in (None, "rectangle"):
            message = (
                f"{quote(target.text)} is a {shape}, whose masses are not in rows; write shares"
            )
            return wrong(message)
    columns = fields["columns"] or _columns(masses, part_names) or count
    fields["columns"] = columns
    if count % columns:
        message = f"{count:,} masses do not fill rows of {columns:,}"
        return wrong(message, "columns" if "columns" in module.places else "of", "E106")
    sides = [side for side in _sides(count, columns, rim is not None) if side > 1] or [1]
    field_name = "follows" if fields["follows"] else "at"
    for name in (field_name, "offset", "span"):
        n_values = len(fields[name] or ())
        if n_values != len(sides) and not (name in ("offset", "span") and n_values == 1):
            words = "a row and a column" if len(sides) > 1 else "one place"
            return wrong(f"{name}: it has {n_values} items; write {words}", name, "E106")
    for position, side in zip(fields["at"] or (), sides, strict=False):
        if not 0.0 <= position <= side - 1:
            message = f"at: {position:g} is beyond its masses, which are at 0 to {side - 1:,}"
            return wrong(message, "at", "E105")
    return True


def _columns(masses: list[Target], part_names: PartNames) -> int | None:
    """The number of masses in a row, if the target is a whole rectangle; else None."""
    if len(masses) != 1:
        return None
    module = part_names.parts[masses[0].part].modules[masses[0].module]
    sides = module.fields.get("sides")
    return int(sides[0]) if sides and masses[0].count == sides[0] * sides[1] else None


def _sides(count: int, columns: int, has_rim: bool) -> tuple[int, int]:
    """The numbers of rows and columns including the rim; a single row has the rim at its ends
    only.
    """
    rows = count // columns
    more = 2 * has_rim
    return (1 if rows == 1 else rows + more, columns + more)
