"""Looks up the MATs that constants of laws and masses follow."""

from __future__ import annotations

from dataclasses import replace

from ergon.instruments import following
from ergon.instruments.model import Module, Target
from ergon.instruments.names import PartContents, PartNames
from ergon.notation.tables.shapes import MISSING, Name
from ergon.notation.text.errors import quote


def with_targets(
    link_module: Module, link_part: PartContents, part_names: PartNames, module_label: str
) -> Module:
    """The module with names of MATs looked up; followings that are refused are reported and left
    out.
    """
    written_followings = following.followings(link_module)
    if not written_followings:
        return link_module
    follows_place = link_module.places.get("follows", link_module.place)
    if link_part.struck_mat is not None:
        message = (
            f"{module_label}: follows: a value that follows a MAT belongs to an instrument, not to "
            "a key"
        )
        part_names.collector.error("E304", message, follows_place)
        return replace(link_module, fields={**link_module.fields, "follows": ()})
    by_parameter: dict[str, following.Following] = {}
    for constant_name, following_value in written_followings.items():
        if following_value is MISSING or not isinstance(following_value.of, Name):
            continue
        followed_target = part_names.target(
            following_value.of, "mat", f"{module_label}: follows: {constant_name}", link_part
        )
        if followed_target is not None:
            by_parameter[constant_name] = replace(following_value, of=followed_target)
        if followed_target is not None and _is_itself(link_module, link_part, followed_target):
            message = (
                f"{module_label}: follows: {quote(followed_target.text)} is this mass itself; name "
                "another"
            )
            part_names.collector.error("E304", message, followed_target.place)
    return replace(link_module, fields={**link_module.fields, "follows": by_parameter})


def _is_itself(module: Module, part: PartContents, target: Target) -> bool:
    return module.kind == "MAS" and (target.part, target.module) == (part.name, module.name)
