"""Looks up the MATs that constants of laws and masses follow."""

from __future__ import annotations

from dataclasses import replace

from ergon.instruments import following
from ergon.instruments.model import Module, Target
from ergon.instruments.names import Part, PartNames
from ergon.notation.tables.shapes import MISSING, Name
from ergon.notation.text.errors import quote


def resolve(module: Module, part: Part, part_names: PartNames, who: str) -> Module:
    """The module with names of MATs looked up; followings that are refused are reported and left
    out.
    """
    written = following.followings(module)
    if not written:
        return module
    place = module.places.get("follows", module.place)
    if part.struck is not None:
        message = (
            f"{who}: follows: a value that follows a MAT belongs to an instrument, not to a key"
        )
        part_names.collector.error("E304", message, place)
        return replace(module, fields={**module.fields, "follows": ()})
    by_parameter: dict[str, following.Following] = {}
    for name, value in written.items():
        if value is MISSING or not isinstance(value.of, Name):
            continue
        target = part_names.target(value.of, "mat", f"{who}: follows: {name}", part)
        if target is not None:
            by_parameter[name] = replace(value, of=target)
        if target is not None and _is_itself(module, part, target):
            message = f"{who}: follows: {quote(target.text)} is this mass itself; name another"
            part_names.collector.error("E304", message, target.place)
    return replace(module, fields={**module.fields, "follows": by_parameter})


def _is_itself(module: Module, part: Part, target: Target) -> bool:
    return module.kind == "MAS" and (target.part, target.module) == (part.name, module.name)
