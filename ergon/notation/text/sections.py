"""A text whose sections are composed one by one, so that unchanged sections keep their nodes."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path

from ergon.notation.text import document
from ergon.notation.text.document import MAX_NODES, Document, Node, Scalar, compose, n_lines
from ergon.notation.text.errors import Collector
from ergon.notation.text.item_lines import compose_by_lines
from ergon.notation.text.memory import Memory

# A line that begins at the margin with a name: in a block mapping only its own names begin there.
# A search for a line break is ten times as fast as one for the beginning of a line.
_FIRST_NAME = re.compile(r"[^\s#'\"\-?:,\[\]{}&*!|>%@`][^:\n]*:(?=\s|\Z)")
_NEXT_NAME = re.compile(rf"\n{_FIRST_NAME.pattern}")
# What may stand before the first section: blank lines and comments.
_HEAD = re.compile(r"(?:[ \t]*(?:#.*)?\n)*")
_MARKERS = "---", "...", "%"  # marks that begin or end a YAML document


@dataclass(frozen=True, slots=True)
class Section:
    """A section's name and value, whose places count from its first line."""

    name: Scalar
    node: Node
    size: int


def section_span(source_text: str, section_name: str) -> tuple[int, int] | None:
    """Where a section's lines begin and end; None where it is not written at the margin."""
    return next(
        (
            (first_line, end)
            for name, first_line, end in _top_level_sections(source_text)
            if name == section_name
        ),
        None,
    )


def section_spans(text: str) -> list[tuple[str, int, int]]:
    """The sections at the margin: name, and where its lines begin and end."""
    return list(_top_level_sections(text))


def section_composed_alone(
    source_text: str, file_name: str, folder: Path, section_name: str, memory: Memory
) -> Section | None:
    """A section, if it can be read without the others; `memory` then also has it for
    `compose_with_memory`.
    """
    line_span = section_span(source_text, section_name)
    if line_span is None:
        return None
    composed_section = _composed(
        source_text[slice(*line_span)],
        file_name,
        folder,
        n_lines(source_text[: line_span[0]]),
        memory,
    )
    return (
        composed_section
        if composed_section is not None and composed_section.name.text == section_name
        else None
    )


def _composed(text: str, file: str, folder: Path, row: int, memory: Memory) -> Section | None:
    key = (file, text) if memory.is_loose else (file, text, row)
    return memory.recall(key, partial(_section, text, file, folder, row, memory))


def _has_marker(text: str) -> bool:
    """Whether a line begins with a marker."""
    return text.startswith(_MARKERS) or any(f"\n{marker}" in text for marker in _MARKERS)


# An edit asks for the sections of the same text again and again.
@lru_cache(maxsize=4)
def _top_level_sections(source_text: str) -> tuple[tuple[str, int, int], ...]:
    name_matches = (
        [(0, first_match.group())] if (first_match := _FIRST_NAME.match(source_text)) else []
    )
    name_matches += [
        (match.start() + 1, match.group()) for match in _NEXT_NAME.finditer(source_text)
    ]
    section_ends = [*(start for start, _ in name_matches[1:]), len(source_text)]
    return tuple(
        (name[:-1].strip(), start, end)
        for (start, name), end in zip(name_matches, section_ends, strict=False)
    )


def compose_with_memory(
    source_text: str, file_name: str, folder: Path, collector: Collector, memory: Memory
) -> Document:
    """The nodes of a text, as `compose` makes them, with those of sections that are known.

    Anything unusual is left to `compose`: an alias of another section, a name written twice, a
    mistake.
    """
    composed = Document(file_name, source_text)
    entries_by_name: dict[str, tuple[Scalar, Node]] = {}
    total_size, section_begin, section_row = 1, 0, 0
    for section_name, section_start, section_end in _top_level_sections(source_text):
        if not entries_by_name:
            section_begin = section_start
            if not _HEAD.fullmatch(source_text, 0, section_start):
                break
            section_row = n_lines(source_text[:section_start])
        section_text = source_text[section_start:section_end]
        composed_section = _composed(section_text, file_name, folder, section_row, memory)
        section_row += n_lines(section_text)
        if (
            composed_section is None
            or composed_section.name.text != section_name
            or section_name in entries_by_name
        ):
            break
        entries_by_name[section_name] = composed_section.name, composed_section.node
        total_size += composed_section.size
    else:
        if entries_by_name and total_size <= MAX_NODES:
            composed.root = document.Mapping(
                composed, section_begin, len(source_text), entries_by_name
            )
            let_node = entries_by_name["let"][1] if "let" in entries_by_name else None
            for _, value in entries_by_name.values():  # a section is a document of its own
                value.document.let, value.document.lets = let_node, None
            return composed
    return compose(source_text, file_name, collector)


def _section(
    source_text: str, file_name: str, folder: Path, row_index: int, memory: Memory
) -> Section | None:
    """A section alone, if it can be read so."""
    if _has_marker(source_text):
        return None
    collector = Collector()
    section_key = file_name, source_text.partition(":")[0]
    known_lines = memory.lines.get(section_key, {})
    composed = None
    if memory.is_loose:
        composed = compose_by_lines(source_text, file_name, folder, row_index, known_lines)
    if composed is None:
        section_document = compose(source_text, file_name, collector, row_index)
    else:
        section_document, memory.lines[section_key] = composed
    section_document.folder = folder
    if (
        collector.n_reports
        or not isinstance(section_document.root, document.Mapping)
        or len(section_document.root.entries) != 1
    ):
        return None
    (entry,) = section_document.root.entries.values()
    return Section(*entry, section_document.size)
