"""Looks up the names in the fields of a PROXY, and checks that they form rows of masses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ergon.instruments.model import Module, Target
from ergon.instruments.names import PartContents, PartNames
from ergon.notation.text.errors import quote


def resolve_names(
    proxy_module: Module,
    proxy_part: PartContents,
    part_names: PartNames,
    proxy_fields: dict[str, Any],
    module_label: str,
) -> bool:
    """Replace names by their targets; False if an error was reported."""

    def report_error(message: str, name: str = "of", code: str = "E304") -> bool:
        place = proxy_module.places.get(name, proxy_module.place)
        part_names.collector.error(code, f"{module_label}: {message}", place)
        return False

    if proxy_part.struck_mat is not None:
        return report_error("a PROXY can be a module of an instrument, not of a key")
    body_targets = [
        part_names.target(name, "body", module_label, proxy_part)
        for name in proxy_fields["of"] or ()
    ]
    follows = [
        part_names.target(name, "mat", module_label, proxy_part)
        for name in proxy_fields["follows"] or ()
    ]
    rim = proxy_fields["rim"] and part_names.target(
        proxy_fields["rim"], "mat", module_label, proxy_part
    )
    bodies_and_rim = (
        [*body_targets, *follows, rim] if proxy_fields["rim"] else [*body_targets, *follows]
    )
    if not body_targets or None in bodies_and_rim:
        return False
    all_targets = [target for target in bodies_and_rim if target is not None]
    for mass_target in all_targets:
        kind = part_names.parts[mass_target.part].modules[mass_target.module].kind
        if kind == "PROXY":
            message = "is a PROXY itself; write the masses that it lies between"
            return report_error(f"{quote(mass_target.text)} {message}")
    masses = [target for target in body_targets if target is not None]
    proxy_fields["of"], proxy_fields["follows"], proxy_fields["rim"] = (
        tuple(masses),
        tuple(follows),
        rim,
    )
    mass_count = sum(target.count for target in masses)
    if proxy_fields["shares"] is not None:
        if len(proxy_fields["shares"]) != mass_count:
            written = len(proxy_fields["shares"])
            message = (
                f"it has {mass_count:,} masses and {written:,} shares; write one share for each"
            )
            return report_error(message, "shares", "E106")
        return True
    for mass_target in masses:
        shape = part_names.parts[mass_target.part].modules[mass_target.module].fields.get("shape")
        if shape not in (None, "rectangle"):
            message = (
                f"{quote(mass_target.text)} is a {shape}, whose masses are not in rows; write "
                "shares"
            )
            return report_error(message)
    column_count = proxy_fields["columns"] or _row_length(masses, part_names) or mass_count
    proxy_fields["columns"] = column_count
    if mass_count % column_count:
        message = f"{mass_count:,} masses do not fill rows of {column_count:,}"
        return report_error(
            message, "columns" if "columns" in proxy_module.places else "of", "E106"
        )
    mesh_sides = [
        side for side in _mesh_sides(mass_count, column_count, rim is not None) if side > 1
    ] or [1]
    refusal = _refusal_of_place(proxy_fields, mesh_sides)
    return refusal is None or report_error(*refusal)


def _refusal_of_place(
    proxy_fields: Mapping[str, Any], mesh_sides: Sequence[int]
) -> tuple[str, str, str] | None:
    """A sentence, its field and its code, if a place does not lie in a mesh of these sides."""
    field_name = "follows" if proxy_fields["follows"] else "at"
    for field_key in (field_name, "offset", "span"):
        n_values = len(proxy_fields[field_key] or ())
        if n_values != len(mesh_sides) and not (field_key in ("offset", "span") and n_values == 1):
            words = "a row and a column" if len(mesh_sides) > 1 else "one place"
            return f"{field_key}: it has {n_values} items; write {words}", field_key, "E106"
    for position, side in zip(proxy_fields["at"] or (), mesh_sides, strict=False):
        if not 0.0 <= position <= side - 1:
            message = f"at: {position:g} is beyond its masses, which are at 0 to {side - 1:,}"
            return message, "at", "E105"
    return None


def _row_length(masses: list[Target], part_names: PartNames) -> int | None:
    """The number of masses in a row, if the target is a whole rectangle; else None."""
    if len(masses) != 1:
        return None
    module = part_names.parts[masses[0].part].modules[masses[0].module]
    sides = module.fields.get("sides")
    return int(sides[0]) if sides and masses[0].count == sides[0] * sides[1] else None


def _mesh_sides(mass_count: int, column_count: int, has_rim: bool) -> tuple[int, int]:
    """The numbers of rows and columns including the rim; a single row has the rim at its ends
    only.
    """
    rows = mass_count // column_count
    rim_rows = 2 * has_rim
    return (1 if rows == 1 else rows + rim_rows, column_count + rim_rows)
