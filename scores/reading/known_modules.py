"""The modules of parts with their names looked up, as far as they are known from the reading
before.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from ergon.instruments.model import Module
from ergon.instruments.module_kinds import LINK_KINDS
from ergon.instruments.names import PartContents, PartNames
from ergon.instruments.rules import ModuleRules
from ergon.notation.text.memory import Memory

# Kinds of which a name needs to know no more than that they are there.
_SELF_CONTAINED_KINDS = frozenset(("MAS", "CEL", "SOL", *LINK_KINDS))
# Kinds that depend on more than the modules that they name, or on modules before them.
_DEPENDENT_KINDS = frozenset(("ENX", "ENF", "LNL", "PROXY", "SURFACE"))


class _KnownModule(NamedTuple):
    """A module as `written_module` and with its names looked up, the parts that it reaches, and
    those in which its names were looked for.
    """

    written_module: Module
    resolved_module: Module | None
    reached_parts: frozenset[str]
    searched_parts: frozenset[str]


class _KnownPart(NamedTuple):
    """The modules of a part, with what they depend on: the kinds of its modules (`kinds`), and the
    parts that they reach, itself included.

    `resolved_modules` are all of them; None if one depends on more.
    """

    kinds: list[Any]
    modules: Mapping[str, _KnownModule]
    parts: Mapping[str, object]
    reached_parts: frozenset[str]
    resolved_modules: tuple[Module, ...] | None

    def is_same(self, parts: Mapping[str, Any]) -> bool:
        """Whether no part has changed on which they depend."""
        return all(parts.get(name) is part for name, part in self.parts.items())


def resolve_names(
    owning_part: PartContents,
    part_names: PartNames,
    make_rules: Callable[[], ModuleRules],
    memory: Memory | None,
    parts_by_name: Mapping[str, Any],
) -> tuple[Module, ...]:
    """The modules of a part with their names looked up; those that `memory` knows are not looked up
    again, unless a part in which they were looked for has changed.

    `parts_by_name` are all keys and instruments by name.
    """
    is_known = owning_part.axes == 1 and memory is not None and not part_names.refused_parts
    module_names = tuple(owning_part.modules)  # an act that is played may bring more
    condition = (
        tuple(parts_by_name),
        owning_part.prefix,
        owning_part.self_names,
        owning_part.struck_mat,
        owning_part.refused_modules,
        module_names,
    )
    old_part: _KnownPart | None = None
    if is_known and memory is not None:
        old_part = memory.held(f"modules {owning_part.name}", condition)
    if (
        old_part is not None
        and old_part.resolved_modules is not None
        and old_part.is_same(parts_by_name)
    ):
        part_names.referenced_parts |= old_part.reached_parts
        return old_part.resolved_modules
    written_modules = owning_part.modules.values()
    module_kinds = [
        (module.name, module.kind) if module.kind in _SELF_CONTAINED_KINDS else module
        for module in written_modules
    ]
    old_entries: Mapping[str, _KnownModule] = {}
    if old_part is not None and old_part.kinds == module_kinds:
        old_entries = _unchanged_entries(old_part, owning_part, parts_by_name)
    reached_before, searched_before = part_names.referenced_parts, part_names.searched_parts
    module_rules = make_rules()
    n_reports = part_names.collector.n_reports
    new_entries = {
        name: old_entries.get(name)
        or _resolved_entry(written_module, owning_part, part_names, module_rules)
        for name, written_module in owning_part.modules.items()
    }
    is_known &= part_names.collector.n_reports == n_reports
    reached_parts = frozenset[str]().union(*(entry.reached_parts for entry in new_entries.values()))
    part_names.referenced_parts = reached_before | reached_parts
    part_names.searched_parts = searched_before
    resolved_modules = tuple(
        [
            entry.resolved_module
            for entry in new_entries.values()
            if entry.resolved_module is not None
        ]
    )
    if is_known and memory is not None:
        searched_parts = frozenset[str]().union(
            *(entry.searched_parts for entry in new_entries.values())
        )
        independent_entries = {
            name: entry
            for name, entry in new_entries.items()
            if entry.written_module.kind not in _DEPENDENT_KINDS
        }
        known_part = _KnownPart(
            module_kinds,
            independent_entries,
            {name: parts_by_name[name] for name in (owning_part.name, *searched_parts)},
            reached_parts,
            resolved_modules if len(independent_entries) == len(new_entries) else None,
        )
        memory.hold(f"modules {owning_part.name}", condition, known_part)
    return resolved_modules


def _resolved_entry(
    written_module: Module,
    owning_part: PartContents,
    part_names: PartNames,
    module_rules: ModuleRules,
) -> _KnownModule:
    """A module with its names looked up now; `part_names` then has the parts of this one alone."""
    part_names.referenced_parts, part_names.searched_parts = set(), set()
    return _KnownModule(
        written_module,
        module_rules.resolve(written_module),
        frozenset(part_names.referenced_parts),
        frozenset(part_names.searched_parts - {owning_part.name}),
    )


def _unchanged_entries(
    old_part: _KnownPart, owning_part: PartContents, parts_by_name: Mapping[str, Any]
) -> Mapping[str, _KnownModule]:
    """The modules that are written as before and whose names were looked up in unchanged parts."""
    unchanged_parts = {
        name for name, part_used in old_part.parts.items() if parts_by_name.get(name) is part_used
    }
    return {
        name: entry
        for name, entry in old_part.modules.items()
        if entry.searched_parts <= unchanged_parts
        and entry.written_module is owning_part.modules.get(name)
    }
