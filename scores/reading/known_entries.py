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


class _Known(NamedTuple):
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
    known: list[_Known | None]
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
        before: _Section | None = None
        if self._memory is not None:
            before = self._memory.held(self._name, None)
        if before is None:
            before = _Section(None, (), (), [], Counter(), {})
        now = {where: _state(where, names, owner) for where in before.states}
        changed = {where for where, state in before.states.items() if now[where] != state}
        if before.section is section and not changed and None not in before.known:
            names.reached |= {head for head, _ in before.uses if owner(head) is not None}
            return before.meanings
        entries = tuple(section.values() if isinstance(section, Mapping) else section)
        part = changed_part(before.entries, entries)
        gone = before.known[part.start : part.start + len(part.before)]
        known: list[_Known | None] = part.put(before.known, [None] * len(part.now))
        if changed:
            stale: list[_Known | None] = [
                meaning
                for meaning in known
                if meaning and not changed.isdisjoint(meaning.modules or ())
            ]
            gone += stale
            ids = {*map(id, stale)}
            known = [None if id(meaning) in ids else meaning for meaning in known]
        uses = before.uses.copy()
        uses.subtract(chain.from_iterable(meaning.modules or () for meaning in gone if meaning))
        unknown = [number for number, meaning in enumerate(known) if meaning is None]
        for number in unknown:
            n_reports = names.collector.n_reports
            if (entry := read(entries[number])) is None:
                continue
            is_whole = names.collector.n_reports == n_reports
            modules = modules_of(entry, entries[number]) if is_whole else None
            known[number] = _Known(entry, modules)
            uses.update(modules or ())
        uses = +uses
        states = {w: now[w] if w in now else _state(w, names, owner) for w in uses}
        names.reached |= {head for head, _ in uses if owner(head) is not None}
        is_new_alone = len(unknown) == len(part.now) and len(before.meanings) == len(before.entries)
        new = [meaning.entry for number in unknown if (meaning := known[number]) is not None]
        if is_new_alone and len(new) == len(unknown) and not changed:
            meanings = tuple(part.put(before.meanings, new))
        else:
            meanings = tuple([meaning.entry for meaning in known if meaning is not None])
        if self._memory is not None:
            lasting = [*known]
            for number in unknown:
                if (meaning := known[number]) is not None and meaning.modules is None:
                    lasting[number] = None
            section_now = _Section(section, entries, meanings, lasting, uses, states)
            self._memory.hold(self._name, None, section_now)
        return meanings


def _state(where: _Module, names: PartNames, owner: Callable[[str], Any]) -> Any:
    """What a result depends on in a module, without its place in the text; None if it is not
    there.
    """
    part, name = where
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
