"""The names that a score defines or brings in, each with its place."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from ergon.notation.tables.fields import Values
from ergon.notation.tables.tuning import Tuning
from ergon.notation.text import document
from ergon.notation.text.values import Place
from ergon.scores.reading.load import Loaded
from ergon.scores.reading.uses import NOUN_BY_SECTION, Names

# Sections whose names other files cannot use, each with the noun for one of its entries.
_LOCAL_SECTIONS = {"marks": "mark", "players": "player", "strikes": "strikes"}
MODULES = "modules"


@dataclass(frozen=True, slots=True)
class Definition:
    """A name, what it names ("gesture", "CEL" …), and where it is defined."""

    name: str
    noun: str
    place: Place


@dataclass(frozen=True, slots=True)
class Catalogue:
    """Definitions by section and name; those of `modules` are written `instrument.module`."""

    sections: Mapping[str, Mapping[str, Definition]] = field(default_factory=dict)
    tuning: Tuning | None = None  # tuning of the score's notes
    tunings: Mapping[str, Tuning] = field(
        default_factory=dict
    )  # tunings of instruments that have one

    def definitions_in(self, *sections: str) -> list[Definition]:
        """All definitions of some sections, in their order."""
        return [
            definition for name in sections for definition in self.sections.get(name, {}).values()
        ]

    def find(self, word: str, sections: tuple[str, ...] = ()) -> Definition | None:
        """The definition of a word, or of the longest part before one of its dots."""
        searched_sections = sections or tuple(self.sections)
        while word:
            for section in searched_sections:
                if (entry := self.sections.get(section, {}).get(word)) is not None:
                    return entry
            word = word.rpartition(".")[0]
        return None


def build_catalogue(loaded: Loaded) -> Catalogue:
    """The names of a score that was read. Files that could not be read bring in none."""
    score_names, uses = loaded.names, loaded.uses
    if score_names is None or uses is None:
        return Catalogue()
    root = score_names.document.root
    sections: dict[str, dict[str, Definition]] = {MODULES: {}}
    for section_name, noun in NOUN_BY_SECTION.items():
        sections[section_name] = {
            name: Definition(name, noun, _place(entry.values, entry.brought_place, score_names))
            for name, entry in score_names.tables[section_name].items()
        }
    for section_name, noun in _LOCAL_SECTIONS.items():
        node = root.get(section_name) if isinstance(root, document.Mapping) else None
        entries = node.entries if isinstance(node, document.Mapping) else {}
        sections[section_name] = {
            name: Definition(name, noun, key.place) for name, (key, _) in entries.items()
        }
    for section_name in ("instruments", "keys"):
        for defined_name, entry in score_names.tables[section_name].items():
            values, _ = uses.resolved(section_name, entry)
            modules = None if values is None else values.by_name.get("modules")
            for module, module_fields in (modules or {}).items():
                if isinstance(module_fields, Values):
                    qualified_name = f"{defined_name}.{module}"
                    sections[MODULES][qualified_name] = Definition(
                        qualified_name, module_fields.kind or "module", module_fields.place
                    )
    return Catalogue(sections, score_names.tuning, score_names.tunings)


def _place(values: object, brought: Place | None, names: Names) -> Place:
    if isinstance(values, Values):
        return values.place
    return brought or Place(names.document.file, 1, 1)
