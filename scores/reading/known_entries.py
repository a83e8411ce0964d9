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
    known: list[_Meaning | None]
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
        modules_of: Callable[[_Entry, Values], tuple[_Module, ...] | None],
        names: PartNames,
        owner: Callable[[str], Any],
    ) -> tuple[_Entry, ...]:
        """What the entries of a section mean: known, or read now.

        `modules_of` tells on which modules something depends; None: it is read each time.
        `owner` gives the part of a name.
        """
        section_before: _Section | None = None
        if self._memory is not None:
            section_before = self._memory.held(self._name, None)
        if section_before is None:
            section_before = _Section(None, (), (), [], Counter(), {})
        states_now = {
            module_key: _module_state(module_key, names, owner)
            for module_key in section_before.states
        }
        changed_modules = {
            module_key
            for module_key, state in section_before.states.items()
            if states_now[module_key] != state
        }
        if (
            section_before.section is section
            and not changed_modules
            and None not in section_before.known
        ):
            names.reached |= {
                part_name for part_name, _ in section_before.uses if owner(part_name) is not None
            }
            return section_before.meanings
        entries = tuple(section.values() if isinstance(section, Mapping) else section)
        replaced_range = changed_part(section_before.entries, entries)
        forgotten = section_before.known[
            replaced_range.start : replaced_range.start + len(replaced_range.before)
        ]
        meanings_by_number: list[_Meaning | None] = replaced_range.put(
            section_before.known, [None] * len(replaced_range.now)
        )
        if changed_modules:
            stale: list[_Meaning | None] = [
                meaning
                for meaning in meanings_by_number
                if meaning and not changed_modules.isdisjoint(meaning.modules or ())
            ]
            forgotten += stale
            ids = {*map(id, stale)}
            meanings_by_number = [
                None if id(meaning) in ids else meaning for meaning in meanings_by_number
            ]
        uses = section_before.uses.copy()
        uses.subtract(
            chain.from_iterable(meaning.modules or () for meaning in forgotten if meaning)
        )
        unknown = [number for number, meaning in enumerate(meanings_by_number) if meaning is None]
        for number in unknown:
            n_reports = names.collector.n_reports
            if (entry := read(entries[number])) is None:
                continue
            has_no_report = names.collector.n_reports == n_reports
            modules = modules_of(entry, entries[number]) if has_no_report else None
            meanings_by_number[number] = _Meaning(entry, modules)
            uses.update(modules or ())
        uses = +uses
        states = {
            w: states_now[w] if w in states_now else _module_state(w, names, owner) for w in uses
        }
        names.reached |= {part_name for part_name, _ in uses if owner(part_name) is not None}
        is_new_alone = len(unknown) == len(replaced_range.now) and len(
            section_before.meanings
        ) == len(section_before.entries)
        new_entries = [
            meaning.entry
            for number in unknown
            if (meaning := meanings_by_number[number]) is not None
        ]
        if is_new_alone and len(new_entries) == len(unknown) and not changed_modules:
            meanings = tuple(replaced_range.put(section_before.meanings, new_entries))
        else:
            meanings = tuple(
                [meaning.entry for meaning in meanings_by_number if meaning is not None]
            )
        if self._memory is not None:
            remembered = [*meanings_by_number]
            for number in unknown:
                if (meaning := meanings_by_number[number]) is not None and meaning.modules is None:
                    remembered[number] = None
            section_now = _Section(section, entries, meanings, remembered, uses, states)
            self._memory.hold(self._name, None, section_now)
        return meanings


def _module_state(module_key: _Module, names: PartNames, owner: Callable[[str], Any]) -> Any:
    """What a result depends on in a module, without its place in the text; None if it is not
    there.
    """
    part, name = module_key
    holder = owner(part)
    if holder is None or part not in names.parts:
        return None
    modules = names.parts[part].modules
    acts = [
        (act.name, act.at, act.reach, act.holds, act.is_drawn)
        for act in names.parts[part].acts.values()
    ]
    ca_rate = getattr(holder, "ca_rate", None)
    if name:
        module = modules.get(name)
        return None if module is None else (module.kind, module.fields, ca_rate, acts)
    fields = [(module.name, module.kind, module.fields) for module in modules.values()]
    return fields, ca_rate, getattr(holder, "pitch", None), acts
