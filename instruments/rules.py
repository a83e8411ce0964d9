"""Checks the rules of the formalism for a whole instrument or key, with a sentence for each
mistake.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from ergon.instruments import following_names, proxy_names, spread
from ergon.instruments.laws import LawText, resolved
from ergon.instruments.members import members
from ergon.instruments.model import Layout, Module, Output, Target
from ergon.instruments.module_kinds import BODIES, GENERATORS, LINKS, member_count
from ergon.instruments.names import Part, PartNames, Wanted
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
        part: Part,
        part_names: PartNames,
        laws: Mapping[str, LawText],
        takes: Mapping[str, Any],
        bodies: Mapping[str, Values],
    ) -> None:
        """Begin with no module."""
        self._part, self._part_names = part, part_names
        self._laws, self._takes, self._bodies = laws, takes, bodies
        self._driven: dict[tuple[str, str, object], str] = {}

    def resolved(self, module: Module) -> Module | None:
        """A module with every name replaced by its target; None if it was refused."""
        part, part_names = self._part, self._part_names
        who = f"{module.shown_kind} {quote('.'.join(filter(None, (part.name, module.name))))}"
        fields = dict(module.fields)
        if module.kind in LINKS:
            ends = fields["between"] = _ends(module, part, part_names, who)
            if "gap" in fields and part.axes == 1:
                fields["gap"] = spread.gaps(module, spread.size(ends), who, part_names.collector)
        elif module.kind in ("ENX", "ENF"):
            _drive(module, part, part_names, self._takes, fields, self._driven, who)
        elif module.kind == "SURFACE":
            fields["of"] = _body(module, part, part_names, who)
            if fields["of"] is None:
                return None
        elif module.kind == "PROXY":
            if not proxy_names.resolve(module, part, part_names, fields, who):
                return None
        elif module.kind in GENERATORS and part.axes == 1:
            _starts(module, who, part_names.collector)
        named = following_names.resolve(replace(module, fields=fields), part, part_names, who)
        body = self._bodies.get(module.name)
        return with_checked_law(named, self._laws, body, who, part_names.collector)


def with_checked_law(
    module: Module,
    laws: Mapping[str, LawText],
    body: Values | None,
    who: str,
    collector: Collector,
) -> Module:
    """The module with its law written out and checked; other modules, and laws that were refused,
    are unchanged.
    """
    fields = module.fields
    refused = (n in module.places and fields[n] is None for n in ("law", "damping", "points"))
    if module.kind != "LNL" or any(refused):
        return module
    return resolved(module, laws, who, _locator(module, body), collector)


def _ends(module: Module, part: Part, part_names: PartNames, who: str) -> tuple[Target, ...]:
    """The ends of a link; checks that each <L> point joins one <M> point, and a link two different
    ones.
    """
    names = module.fields["between"] or ()
    wanted: Wanted = "points" if part.axes > 1 else "mats"
    targets = (part_names.target(name, wanted, who, part) for name in names)
    ends = tuple(end for end in targets if end is not None)
    if spread.is_pairwise(module.kind, module.fields, ends):
        spread.may_touch_all(
            module.kind, ends, spread.has_wall(module.fields), who, part_names.collector
        )
    else:
        spread.is_fitting(ends, who, part_names.collector)
    return ends


def _body(module: Module, part: Part, part_names: PartNames, who: str) -> Target | None:
    """The masses that carry a surface, which must be those of a STRING or PLATE; None if an error
    was reported.
    """
    name = module.fields["of"]
    target = None if name is None else part_names.target(name, "body", who, part)
    if target is None:
        return None
    kind = part_names.parts[target.part].modules[target.module].kind
    if kind not in BODIES:
        message = (
            f"{who}: of: {quote(target.text)} is a {kind}; a surface is that of a STRING or a "
        )
        part_names.collector.error("E304", f"{message}PLATE: of: gong", name.place)
        return None
    return target


def _starts(module: Module, who: str, collector: Collector) -> None:
    """Report initial values for members that a generator does not have."""
    count = member_count(module.kind, module.fields)
    for name in ("X0", "V0"):
        starts = module.fields.get(name)
        for start in starts if isinstance(starts, tuple) else (starts,):
            if isinstance(start, Start):
                try:
                    members(str(start.at), count, module.name or "it")
                except TextError as error:
                    message = f"{who}: {name}: {error.message}"
                    collector.error("E304", message, start.at.place)


def _point(target: Target) -> tuple[str, str, object]:
    return target.part, target.module, target.first


def _drive(
    module: Module,
    part: Part,
    part_names: PartNames,
    takes: Mapping[str, Any],
    fields: dict[str, Any],
    driven: dict[tuple[str, str, object], str],
    who: str,
) -> None:
    """Look up the target and source of an ENX or ENF, and report two imposed positions at one
    point.
    """
    target = part_names.target(fields["to"], "mat", who, part)
    fields["to"] = target
    source = fields["from"]
    if isinstance(source, Name) and source not in takes:
        full = f"{part.prefix}.{source}"
        if full in takes:
            fields["from"] = Name(full, source.place)
        else:
            message = f"{who}: {quote(source)} is neither a take nor a number"
            part_names.collector.error(
                "E301", message, source.place, word=str(source), names=tuple(takes)
            )
    else:
        _check_input(module, takes.get(str(source)), who, part_names.collector)
    if target is None or module.kind != "ENX":
        return
    if part_names.parts[target.part].modules[target.module].kind == "PROXY":
        message = (
            f"{who}: {quote(target.text)} is a PROXY, which moves as its masses do; drive one "
        )
        part_names.collector.error("E304", f"{message}of its masses instead", module.place)
    first = driven.setdefault(_point(target), module.name)
    if first != module.name:
        message = (
            f"{who}: {first} already imposes the position of {target.text}; only forces add up"
        )
        part_names.collector.error("E304", message, module.place)


def _check_input(module: Module, take: Any, who: str, collector: Collector) -> None:
    """Report an input whose unit does not fit what it drives, or that does not begin at the
    beginning.
    """
    values = getattr(take, "values", None)
    if not isinstance(values, Values) or values["input"] is None or values["gain"] is None:
        return
    _, is_force = values["gain"]
    if is_force != (module.kind == "ENF"):
        unit, kind = ("force", "ENF") if is_force else ("length", "ENX")
        name = quote(str(module.fields["from"]))
        message = f"{who}: the gain of the input {name} is a {unit}, which drives an {kind}"
        collector.error("E304", message, module.places.get("from", module.place))
    if module.fields["at"] is not None:
        message = f"{who}: an input is heard from the beginning on; remove `at`"
        collector.error("E111", message, module.places.get("at", module.place))


def outputs(
    part: Part,
    written: tuple[Output, ...],
    part_names: PartNames,
    layout: Callable[[str, Place], Layout | None],
) -> tuple[Output, ...]:
    """Outputs with names replaced by their targets."""
    result = []
    for output in written:
        called = f"{part.name}.{output.name}" if output.name else part.name
        who = f"{output.kind} of {quote(called)}"
        family = "point" if output.is_distance else output.traits.sources
        names: tuple[Any, ...] = output.targets
        each = (one for name in names for one in _each(name, part, part_names))
        target_lists = (_output_target(name, family, who, part, part_names) for name in each)
        targets = tuple(target for target in target_lists if target is not None)
        if output.is_distance and not _is_distance(targets, who, part_names):
            continue
        room = None
        if isinstance(output.nearest, str):
            room = layout(output.nearest, output.place)
            if not any(module.kind == "BANK" for module in part.modules.values()):
                message = f"{who}: `nearest` needs the members of a BANK"
                part_names.collector.error("E304", message, output.place)
        result.append(replace(output, targets=targets, nearest=room))
    return tuple(result)


def _is_distance(targets: tuple[Target, ...], who: str, part_names: PartNames) -> bool:
    """Whether the targets are two different points of spaces with equally many axes; reports an
    error if not.
    """
    if len(targets) != 2:
        return False
    a, b = targets
    axes = [part_names.parts[end.part].axes for end in targets]
    problem = ""
    if _point(a) == _point(b):
        problem = f"both points are {b.text}; a distance is that of two different points"
    elif axes[0] != axes[1]:
        problem = f"{quote(a.text)} has {axes[0]} axes and {quote(b.text)} {axes[1]}"
    if problem:
        part_names.collector.error("E304", f"{who}: {problem}", b.place)
    return not problem


def _each(name: Name, part: Part, part_names: PartNames) -> list[Name]:
    """The name itself; for another instrument with notes, the name of each note."""
    is_own = name.partition(".")[0] in (*part.modules, *part.selves)
    return [name] if is_own else part_names.members(name, part.prefix)


def _output_target(
    name: Name, family: Any, who: str, part: Part, part_names: PartNames
) -> Target | None:
    """The target of an output. SOF also accepts the ground springs of a CEL or BANK, and all
    springs of a net.
    """
    if family == "links":
        output_module = part.modules.get(str(name))
        if output_module is not None and output_module.kind in NETS:
            return Target(part.name, output_module.name, 0, 1, str(name), name.place)
        head = name.split(".")[0] if name not in part.modules else name
        module = part.modules.get(str(head)) or part.modules.get("")
        if module is not None and module.kind in ("CEL", "BANK"):
            return part_names.target(name, "body", who, part)
    return part_names.target(name, family, who, part)


def _locator(module: Module, body: Values | None) -> Callable[[str, int, int], Place]:
    def locate(field: str, offset: int, length: int) -> Place:
        node = body.nodes.get(field) if body else None
        place_at = getattr(node, "place_at", None)
        return place_at(offset, length) if place_at else module.place

    return locate
