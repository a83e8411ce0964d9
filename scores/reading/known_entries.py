"""Automation and strikes as far as they were read before: an entry is read again only if it or a
module that it names has changed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, NamedTuple, TypeVar

from ergon.instruments.names import PartNames
from ergon.notation.tables.fields import Values
from ergon.notation.text.memory import Memory
from ergon.scores.reading.automation import Automation
from ergon.scores.reading.piece import Strikes

_Module = tuple[str, str]  # a part and a module in it; "": the part as a whole
_Entry = TypeVar("_Entry", Automation, Strikes)


class _Known(NamedTuple):
    """What values mean, and the modules on which that depends. The values are kept so that no
    others get their id.
    """

    values: Values
    entry: Any
    modules: tuple[_Module, ...]


class KnownEntries:
    """What entries of a section mean, kept in a memory while the modules that they name stay the
    same.
    """

    def __init__(self, memory: Memory | None, section: str, file: str) -> None:
        """Take a section of a file. Without a memory nothing is known."""
        self._memory, self._name = memory, f"{section} {file}"

    def read(
        self,
        section: Iterable[Any],
        read: Callable[[Any], _Entry | None],
        modules_of: Callable[[_Entry, Values], tuple[_Module, ...] | None],
        names: PartNames,
        owner: Callable[[str], Any],
    ) -> list[_Entry]:
        """What the entries of a section mean: known, or read now.

        `modules_of` tells on which modules something depends; None: it is read each time.
        `owner` gives the part of a name.
        """
        entries = section if isinstance(section, tuple) else tuple(section)
        before_all: Any = None if self._memory is None else self._memory.held(self._name, None)
        known: dict[int, _Known] = before_all[0] if before_all else {}
        modules: dict[_Module, Any] = before_all[1] if before_all else {}
        last: Any = before_all[2] if before_all else None
        now = {where: _state(where, names, owner) for where in modules}
        changed = {where for where, state in modules.items() if now[where] != state}
        if last is not None and not changed and last[0] == entries:
            names.reached |= {part for part, _ in modules if owner(part) is not None}
            return [*last[1]]
        following: dict[int, _Known] = {}
        result: list[_Entry] = []
        for values in entries:
            before = known.get(id(values))
            if before is not None and (not changed or changed.isdisjoint(before.modules)):
                following[id(values)] = before
                result.append(before.entry)
                continue
            n_reports = names.collector.told
            entry = read(values)
            if entry is None:
                continue
            result.append(entry)
            depends = modules_of(entry, values) if names.collector.told == n_reports else None
            if depends is not None:
                following[id(values)] = _Known(values, entry, depends)
                now |= {where: _state(where, names, owner) for where in depends}
        used = {where for entry_known in following.values() for where in entry_known.modules}
        names.reached |= {part for part, _ in used if owner(part) is not None}
        if self._memory is not None:
            states = {where: now[where] for where in used}
            all_known = (entries, (*result,)) if len(following) == len(entries) else None
            self._memory.hold(self._name, None, (following, states, all_known))
        return result


def _state(where: _Module, names: PartNames, owner: Callable[[str], Any]) -> Any:
    """What a result depends on in a module, without its place in the text; None if it is not
    there.
    """
    part, name = where
    holder = owner(part)
    if holder is None or part not in names.parts:
        return None
    modules = names.parts[part].modules
    ca_rate = getattr(holder, "ca_rate", None)
    if name:
        module = modules.get(name)
        return None if module is None else (module.kind, module.fields, ca_rate)
    fields = [(module.name, module.kind, module.fields) for module in modules.values()]
    return fields, ca_rate, getattr(holder, "pitch", None)
