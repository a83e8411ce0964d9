"""Checks the rules of the formalism for a whole instrument or key, with a sentence for each
mistake.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from ergon.instruments import following_names, proxy_names, spread
from ergon.instruments.laws import LawText, with_law_text
from ergon.instruments.members import parse_members
from ergon.instruments.model import Layout, Module, Output, Target
from ergon.instruments.module_kinds import BODY_KINDS, GENERATOR_KINDS, LINK_KINDS, member_count
from ergon.instruments.names import PartContents, PartNames, WantedFamily
from ergon.instruments.space import NETS
from ergon.instruments.starts import Start
from ergon.notation.tables.fields import Values
from ergon.notation.tables.shapes import Name
from ergon.notation.text.errors import Collector, TextError, quote
from ergon.notation.text.values import Place


class ModuleRules:
    """Checks the modules of one part, and replaces every name in them by its target.

    `bodies` are the fields as written.
    """

    def __init__(
        self,
        part: PartContents,
        part_names: PartNames,
        laws: Mapping[str, LawText],
        takes: Mapping[str, Any],
        bodies: Mapping[str, Values],
    ) -> None:
        """Begin with no module."""
        self._part, self._part_names = part, part_names
        self._law_texts, self._takes, self._written_values = laws, takes, bodies
        self._driver_of_point: dict[tuple[str, str, object], str] = {}

    def resolve(self, module: Module) -> Module | None:
        """A module with every name replaced by its target; None if it was refused."""
        module_part, part_names = self._part, self._part_names
        module_label = (
            f"{module.shown_kind} {quote('.'.join(filter(None, (module_part.name, module.name))))}"
        )
        module_fields = dict(module.fields)
        if module.kind in LINK_KINDS:
            ends = module_fields["between"] = _link_ends(
                module, module_part, part_names, module_label
            )
            if "gap" in module_fields and module_part.axes == 1:
                module_fields["gap"] = spread.contact_gaps(
                    module, spread.link_count(ends), module_label, part_names.collector
                )
        elif module.kind in ("ENX", "ENF"):
            _resolve_drive(
                module,
                module_part,
                part_names,
                self._takes,
                module_fields,
                self._driver_of_point,
                module_label,
            )
        elif module.kind == "SURFACE":
            module_fields["of"] = _carrying_masses(module, module_part, part_names, module_label)
            if module_fields["of"] is None:
                return None
        elif module.kind == "PROXY":
            if not proxy_names.resolve_names(
                module, module_part, part_names, module_fields, module_label
            ):
                return None
        elif module.kind in GENERATOR_KINDS and module_part.axes == 1:
            _check_start_members(module, module_label, part_names.collector)
        named_module = following_names.with_targets(
            replace(module, fields=module_fields), module_part, part_names, module_label
        )
        body = self._written_values.get(module.name)
        return with_checked_law(
            named_module, self._law_texts, body, module_label, part_names.collector
        )


def with_checked_law(
    law_module: Module,
    laws: Mapping[str, LawText],
    body: Values | None,
    module_label: str,
    collector: Collector,
) -> Module:
    """The module with its law written out and checked; other modules, and laws that were refused,
    are unchanged.
    """
    fields = law_module.fields
    refused_fields = (
        n in law_module.places and fields[n] is None for n in ("law", "damping", "points")
    )
    if law_module.kind != "LNL" or any(refused_fields):
        return law_module
    return with_law_text(
        law_module, laws, module_label, _place_locator(law_module, body), collector
    )


def _link_ends(
    link_module: Module, link_part: PartContents, part_names: PartNames, module_label: str
) -> tuple[Target, ...]:
    """The ends of a link; checks that each <L> point joins one <M> point, and a link two different
    ones.
    """
    names = link_module.fields["between"] or ()
    wanted: WantedFamily = "points" if link_part.axes > 1 else "mats"
    targets = (part_names.target(name, wanted, module_label, link_part) for name in names)
    ends = tuple(end for end in targets if end is not None)
    if spread.is_pairwise(link_module.kind, link_module.fields, ends):
        spread.may_act_on_all_pairs(
            link_module.kind,
            ends,
            spread.has_wall(link_module.fields),
            module_label,
            part_names.collector,
        )
    else:
        spread.may_join(ends, module_label, part_names.collector)
    return ends


def _carrying_masses(
    part_module: Module, seen_from: PartContents, part_names: PartNames, module_label: str
) -> Target | None:
    """The masses that carry a surface, which must be those of a STRING or PLATE; None if an error
    was reported.
    """
    body_name = part_module.fields["of"]
    body_target = (
        None if body_name is None else part_names.target(body_name, "body", module_label, seen_from)
    )
    if body_target is None:
        return None
    body_kind = part_names.parts[body_target.part].modules[body_target.module].kind
    if body_kind not in BODY_KINDS:
        message = (
            f"{module_label}: of: {quote(body_target.text)} is a {body_kind}; a surface is that of "
            "a STRING or a "
        )
        part_names.collector.error("E304", f"{message}PLATE: of: gong", body_name.place)
        return None
    return body_target


def _check_start_members(generator_module: Module, module_label: str, collector: Collector) -> None:
    """Report initial values for members that a generator does not have."""
    count = member_count(generator_module.kind, generator_module.fields)
    for field_name in ("X0", "V0"):
        starts = generator_module.fields.get(field_name)
        for start_values in starts if isinstance(starts, tuple) else (starts,):
            if isinstance(start_values, Start):
                try:
                    parse_members(str(start_values.at), count, generator_module.name or "it")
                except TextError as error:
                    message = f"{module_label}: {field_name}: {error.message}"
                    collector.error("E304", message, start_values.at.place)


def _point_key(target: Target) -> tuple[str, str, object]:
    return target.part, target.module, target.first


def _resolve_drive(
    module: Module,
    part: PartContents,
    part_names: PartNames,
    takes: Mapping[str, Any],
    fields: dict[str, Any],
    driver_of_point: dict[tuple[str, str, object], str],
    label: str,
) -> None:
    """Look up the target and source of an ENX or ENF, and report two imposed positions at one
    point.
    """
    target = part_names.target(fields["to"], "mat", label, part)
    fields["to"] = target
    source = fields["from"]
    if isinstance(source, Name) and source not in takes:
        full_name = f"{part.prefix}.{source}"
        if full_name in takes:
            fields["from"] = Name(full_name, source.place)
        else:
            message = f"{label}: {quote(source)} is neither a take nor a number"
            part_names.collector.error(
                "E301", message, source.place, word=str(source), names=tuple(takes)
            )
    else:
        _check_input(module, takes.get(str(source)), label, part_names.collector)
    if target is None or module.kind != "ENX":
        return
    if part_names.parts[target.part].modules[target.module].kind == "PROXY":
        message = (
            f"{label}: {quote(target.text)} is a PROXY, which moves as its masses do; drive one "
        )
        part_names.collector.error("E304", f"{message}of its masses instead", module.place)
    first_driver = driver_of_point.setdefault(_point_key(target), module.name)
    if first_driver != module.name:
        message = (
            f"{label}: {first_driver} already imposes the position of {target.text}; "
            "only forces add up"
        )
        part_names.collector.error("E304", message, module.place)


def _check_input(drive_module: Module, take: Any, module_label: str, collector: Collector) -> None:
    """Report an input whose unit does not fit what it drives, or that does not begin at the
    beginning.
    """
    input_values = getattr(take, "values", None)
    if (
        not isinstance(input_values, Values)
        or input_values["input"] is None
        or input_values["gain"] is None
    ):
        return
    _, is_force = input_values["gain"]
    if is_force != (drive_module.kind == "ENF"):
        quantity, drive_kind = ("force", "ENF") if is_force else ("length", "ENX")
        name = quote(str(drive_module.fields["from"]))
        message = (
            f"{module_label}: the gain of the input {name} is a {quantity}, which drives an "
            f"{drive_kind}"
        )
        collector.error("E304", message, drive_module.places.get("from", drive_module.place))
    if drive_module.fields["at"] is not None:
        message = f"{module_label}: an input is heard from the beginning on; remove `at`"
        collector.error("E111", message, drive_module.places.get("at", drive_module.place))


def resolved_outputs(
    output_part: PartContents,
    written: tuple[Output, ...],
    part_names: PartNames,
    layout: Callable[[str, Place], Layout | None],
) -> tuple[Output, ...]:
    """Outputs with names replaced by their targets."""
    outputs = []
    for output in written:
        full_name = f"{output_part.name}.{output.name}" if output.name else output_part.name
        output_label = f"{output.kind} of {quote(full_name)}"
        family = "point" if output.is_distance else output.kind_facts.sources
        names: tuple[Any, ...] = output.targets
        targets = (
            target for name in names for target in _names_of_notes(name, output_part, part_names)
        )
        target_lists = (
            _output_target(name, family, output_label, output_part, part_names) for name in targets
        )
        output_targets = tuple(target for target in target_lists if target is not None)
        if output.is_distance and not _is_distance(output_targets, output_label, part_names):
            continue
        loudspeakers = None
        if isinstance(output.nearest, str):
            loudspeakers = layout(output.nearest, output.place)
            if not any(module.kind == "BANK" for module in output_part.modules.values()):
                message = f"{output_label}: `nearest` needs the members of a BANK"
                part_names.collector.error("E304", message, output.place)
        outputs.append(replace(output, targets=output_targets, nearest=loudspeakers))
    return tuple(outputs)


def _is_distance(
    output_targets: tuple[Target, ...], output_label: str, part_names: PartNames
) -> bool:
    """Whether the targets are two different points of spaces with equally many axes; reports an
    error if not.
    """
    if len(output_targets) != 2:
        return False
    first, second = output_targets
    n_axes = [part_names.parts[end.part].axes for end in output_targets]
    problem_text = ""
    if _point_key(first) == _point_key(second):
        problem_text = f"both points are {second.text}; a distance is that of two different points"
    elif n_axes[0] != n_axes[1]:
        problem_text = (
            f"{quote(first.text)} has {n_axes[0]} axes and {quote(second.text)} {n_axes[1]}"
        )
    if problem_text:
        part_names.collector.error("E304", f"{output_label}: {problem_text}", second.place)
    return not problem_text


def _names_of_notes(name: Name, part: PartContents, part_names: PartNames) -> list[Name]:
    """The name itself; for another instrument with notes, the name of each note."""
    is_own = name.partition(".")[0] in (*part.modules, *part.self_names)
    return [name] if is_own else part_names.member_names(name, part.prefix)


def _output_target(
    target_name: Name,
    family: Any,
    output_label: str,
    output_part: PartContents,
    part_names: PartNames,
) -> Target | None:
    """The target of an output. SOF also accepts the ground springs of a CEL or BANK, and all
    springs of a net.
    """
    if family == "links":
        output_module = output_part.modules.get(str(target_name))
        if output_module is not None and output_module.kind in NETS:
            return Target(
                output_part.name, output_module.name, 0, 1, str(target_name), target_name.place
            )
        first_name = (
            target_name.split(".")[0] if target_name not in output_part.modules else target_name
        )
        module = output_part.modules.get(str(first_name)) or output_part.modules.get("")
        if module is not None and module.kind in ("CEL", "BANK"):
            return part_names.target(target_name, "body", output_label, output_part)
    return part_names.target(target_name, family, output_label, output_part)


def _place_locator(part_module: Module, body: Values | None) -> Callable[[str, int, int], Place]:
    def locate(field: str, offset: int, length: int) -> Place:
        node = body.nodes.get(field) if body else None
        place_at = getattr(node, "place_at", None)
        return place_at(offset, length) if place_at else part_module.place

    return locate
