"""Automation and strikes as far as they were read before: an entry is read again only if it or a
module that it names has changed.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from itertools import chain
from typing import Any, NamedTuple, TypeVar

from ergon.common.changed import changed_part
from ergon.instruments.names import PartNames
from ergon.notation.tables.fields import Values
from ergon.notation.text.memory import Memory
from ergon.scores.reading.automation import Automation
from ergon.scores.reading.piece import Strikes

_Module = tuple[str, str]  # a part and a module in it; "": the part as a whole
_Entry = TypeVar("_Entry", Automation, Strikes)


class _Meaning(NamedTuple):
    """What an entry means, and the modules on which that depends (None: on more)."""

    entry: Any
    modules: tuple[_Module, ...] | None


class _Section(NamedTuple):
    """The entries of a section and what each means (None: that is read again); and how many depend
    on a module, with the state of that module.
    """

    section: object
    entries: tuple[Any, ...]
    meanings: tuple[Any, ...]
    results: list[_Meaning | None]
    uses: Counter[_Module]
    states: dict[_Module, Any]


class KnownEntries:
    """What entries of a section mean, kept in a memory while the modules that they name stay the
    same.
    """

    def __init__(self, memory: Memory | None, section: str, file: str) -> None:
        """Take a section of a file. Without a memory nothing is known."""
        self._memory, self._name = memory, f"{section} {file}"

    def read(
        self,
        section: Mapping[str, Any] | Sequence[Any],
        read: Callable[[Any], _Entry | None],
        find_modules: Callable[[_Entry, Values], tuple[_Module, ...] | None],
        names: PartNames,
        owner: Callable[[str], Any],
    ) -> tuple[_Entry, ...]:
        """What the entries of a section mean: known, or read now.

        `find_modules` tells on which modules something depends; None: it is read each time.
        `owner` gives the part of a name.
        """
        memo: _Section | None = None
        if self._memory is not None:
            memo = self._memory.held(self._name, None)
        if memo is None:
            memo = _Section(None, (), (), [], Counter(), {})
        new_states = {module: _module_state(module, names, owner) for module in memo.states}
        changed = {module for module, state in memo.states.items() if new_states[module] != state}
        if memo.section is section and not changed and None not in memo.results:
            names.referenced_parts |= {part for part, _ in memo.uses if owner(part) is not None}
            return memo.meanings
        section_entries = tuple(section.values() if isinstance(section, Mapping) else section)
        change = changed_part(memo.entries, section_entries)
        removed = memo.results[change.start : change.start + len(change.before)]
        known_results: list[_Meaning | None] = change.put(memo.results, [None] * len(change.now))
        if changed:
            stale: list[_Meaning | None] = [
                result
                for result in known_results
                if result and not changed.isdisjoint(result.modules or ())
            ]
            removed += stale
            ids = {*map(id, stale)}
            known_results = [None if id(result) in ids else result for result in known_results]
        uses = memo.uses.copy()
        uses.subtract(chain.from_iterable(result.modules or () for result in removed if result))
        unknown_indices = [number for number, result in enumerate(known_results) if result is None]
        for entry_index in unknown_indices:
            n_reports = names.collector.n_reports
            if (read_entry := read(section_entries[entry_index])) is None:
                continue
            has_no_report = names.collector.n_reports == n_reports
            modules = (
                find_modules(read_entry, section_entries[entry_index]) if has_no_report else None
            )
            known_results[entry_index] = _Meaning(read_entry, modules)
            uses.update(modules or ())
        uses = +uses
        states = {
            w: new_states[w] if w in new_states else _module_state(w, names, owner) for w in uses
        }
        names.referenced_parts |= {part for part, _ in uses if owner(part) is not None}
        is_replacement = len(unknown_indices) == len(change.now) and len(memo.meanings) == len(
            memo.entries
        )
        new_entries = [
            known_result.entry
            for number in unknown_indices
            if (known_result := known_results[number]) is not None
        ]
        if is_replacement and len(new_entries) == len(unknown_indices) and not changed:
            meanings = tuple(change.put(memo.meanings, new_entries))
        else:
            meanings = tuple([result.entry for result in known_results if result is not None])
        if self._memory is not None:
            remembered = [*known_results]
            for entry_index in unknown_indices:
                if (
                    known_result := known_results[entry_index]
                ) is not None and known_result.modules is None:
                    remembered[entry_index] = None
            new_section = _Section(section, section_entries, meanings, remembered, uses, states)
            self._memory.hold(self._name, None, new_section)
        return meanings


def _module_state(module_key: _Module, part_names: PartNames, owner: Callable[[str], Any]) -> Any:
    """What a result depends on in a module, without its place in the text; None if it is not
    there.
    """
    part_name, module_name = module_key
    owning_part = owner(part_name)
    if owning_part is None or part_name not in part_names.parts:
        return None
    part_modules = part_names.parts[part_name].modules
    acts = [
        (act.name, act.at, act.reach, act.holds, act.is_drawn)
        for act in part_names.parts[part_name].acts.values()
    ]
    ca_rate = getattr(owning_part, "ca_rate", None)
    if module_name:
        module = part_modules.get(module_name)
        return None if module is None else (module.kind, module.fields, ca_rate, acts)
    fields = [(module.name, module.kind, module.fields) for module in part_modules.values()]
    return fields, ca_rate, getattr(owning_part, "pitch", None), acts
