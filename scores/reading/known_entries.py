"""Automation and strikes as far as they were read before: an entry is read again only if it or a
module that it names has changed.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from itertools import chain
from typing import Any, NamedTuple, TypeVar

from ergon.common.changed import Changed, changed_part
from ergon.instruments.names import PartNames
from ergon.notation.tables.fields import Values
from ergon.notation.text.memory import Memory
from ergon.scores.reading.automation import Automation
from ergon.scores.reading.piece import Strikes

_ModuleKey = tuple[str, str]  # a part and a module in it; "": the part as a whole
_Entry = TypeVar("_Entry", Automation, Strikes)


class _Meaning(NamedTuple):
    """What an entry means, and the modules on which that depends (None: on more)."""

    entry: Any
    modules: tuple[_ModuleKey, ...] | None


class _Section(NamedTuple):
    """The entries of a section and what each means (None: that is read again); and how many depend
    on a module, with the state of that module.
    """

    section: object
    entries: tuple[Any, ...]
    read_entries: tuple[Any, ...]
    meanings: list[_Meaning | None]
    use_counts: Counter[_ModuleKey]
    states: dict[_ModuleKey, Any]

    def meanings_after(
        self, change: Changed[Any], changed_modules: set[_ModuleKey]
    ) -> tuple[list[_Meaning | None], list[_Meaning | None]]:
        """What each entry still means after a change of entries and of modules (None: that is
        read again); and the meanings that no longer count.
        """
        removed_meanings = self.meanings[change.start : change.start + len(change.before)]
        known_meanings: list[_Meaning | None] = change.put(self.meanings, [None] * len(change.now))
        if not changed_modules:
            return known_meanings, removed_meanings
        stale_meanings: list[_Meaning | None] = [
            meaning
            for meaning in known_meanings
            if meaning and not changed_modules.isdisjoint(meaning.modules or ())
        ]
        stale_ids = {*map(id, stale_meanings)}
        known_meanings = [
            None if id(meaning) in stale_ids else meaning for meaning in known_meanings
        ]
        return known_meanings, removed_meanings + stale_meanings


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
        find_modules: Callable[[_Entry, Values], tuple[_ModuleKey, ...] | None],
        names: PartNames,
        find_part: Callable[[str], Any],
    ) -> tuple[_Entry, ...]:
        """What the entries of a section mean: known, or read now.

        `find_modules` tells on which modules something depends; None: it is read each time.
        `find_part` gives the part of a name.
        """
        known_section = self._known_section()
        new_states = {
            module: _module_state(module, names, find_part) for module in known_section.states
        }
        changed_modules = {
            module for module, state in known_section.states.items() if new_states[module] != state
        }
        if (
            known_section.section is section
            and not changed_modules
            and None not in known_section.meanings
        ):
            names.referenced_parts |= {
                part for part, _ in known_section.use_counts if find_part(part) is not None
            }
            return known_section.read_entries
        section_entries = tuple(section.values() if isinstance(section, Mapping) else section)
        change = changed_part(known_section.entries, section_entries)
        known_meanings, removed_meanings = known_section.meanings_after(change, changed_modules)
        use_counts = known_section.use_counts.copy()
        use_counts.subtract(
            chain.from_iterable(meaning.modules or () for meaning in removed_meanings if meaning)
        )
        unknown_indices = [
            number for number, meaning in enumerate(known_meanings) if meaning is None
        ]
        for entry_index in unknown_indices:
            n_reports = names.collector.n_reports
            if (read_entry := read(section_entries[entry_index])) is None:
                continue
            has_no_report = names.collector.n_reports == n_reports
            modules = (
                find_modules(read_entry, section_entries[entry_index]) if has_no_report else None
            )
            known_meanings[entry_index] = _Meaning(read_entry, modules)
            use_counts.update(modules or ())
        use_counts = +use_counts
        states = {
            module_key: new_states[module_key]
            if module_key in new_states
            else _module_state(module_key, names, find_part)
            for module_key in use_counts
        }
        names.referenced_parts |= {part for part, _ in use_counts if find_part(part) is not None}
        is_replacement = len(unknown_indices) == len(change.now) and len(
            known_section.read_entries
        ) == len(known_section.entries)
        new_entries = [
            known_meaning.entry
            for number in unknown_indices
            if (known_meaning := known_meanings[number]) is not None
        ]
        if is_replacement and len(new_entries) == len(unknown_indices) and not changed_modules:
            read_entries = tuple(change.put(known_section.read_entries, new_entries))
        else:
            read_entries = tuple(
                [meaning.entry for meaning in known_meanings if meaning is not None]
            )
        if self._memory is not None:
            remembered_meanings = _without_dependent(known_meanings, unknown_indices)
            new_section = _Section(
                section, section_entries, read_entries, remembered_meanings, use_counts, states
            )
            self._memory.hold(self._name, None, new_section)
        return read_entries

    def _known_section(self) -> _Section:
        """The section as it was read before; without entries if it was not."""
        known_section: _Section | None = None
        if self._memory is not None:
            known_section = self._memory.held(self._name, None)
        if known_section is None:
            return _Section(None, (), (), [], Counter(), {})
        return known_section


def _without_dependent(
    meanings: Sequence[_Meaning | None], new_indices: Sequence[int]
) -> list[_Meaning | None]:
    """Meanings without those of `new_indices` that depend on more than modules."""
    remembered_meanings = [*meanings]
    for index in new_indices:
        meaning = meanings[index]
        if meaning is not None and meaning.modules is None:
            remembered_meanings[index] = None
    return remembered_meanings


def _module_state(
    module_key: _ModuleKey, part_names: PartNames, find_part: Callable[[str], Any]
) -> Any:
    """What a result depends on in a module, without its place in the text; None if it is not
    there.
    """
    part_name, module_name = module_key
    owning_part = find_part(part_name)
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
