"""The names in a score, found in its text: fast enough for every press of Tab.

The text is neither parsed nor checked, so a half-typed score still completes. Names that come
from other files are not found.
"""

from __future__ import annotations

import re
from pathlib import Path

from ergon.common.regular import read_bounded

SECTIONS = ("gestures", "takes", "players", "keys", "marks", "instruments")
_SIZE_MAX = 1 << 20  # bytes: a written score has some 10,000; Tab must be fast
_SECTION = re.compile(r"^([a-z]+):\s*(.*)$")
_ENTRY = re.compile(r"^([ ]+)([^\W\d][\w-]*):")


def names_in(score_text: str) -> dict[str, list[str]]:
    """Names of every section of SECTIONS, in the order written."""
    names_by_section: dict[str, list[str]] = {section: [] for section in SECTIONS}
    section_names: list[str] | None = None
    indent = 0
    for score_line in score_text.splitlines():
        section_match = _SECTION.match(score_line)
        if section_match is not None:
            section_names, indent = names_by_section.get(section_match[1]), 0
            if section_names is not None and section_match[2].startswith("{"):
                section_names.extend(_top_level(section_match[2]))
            continue
        entry_match = _ENTRY.match(score_line) if section_names is not None else None
        if entry_match is None or section_names is None:
            continue
        indent = indent or len(entry_match[1])
        if len(entry_match[1]) == indent:
            section_names.append(entry_match[2])
    return names_by_section


def names_of(path: str, sections: tuple[str, ...]) -> list[str]:
    """Names of these sections in a file; none when it cannot be read."""
    try:
        names_by_section = names_in(read_bounded(Path(path), _SIZE_MAX).decode(errors="replace"))
    except OSError:
        return []
    return [name for section in sections for name in names_by_section[section]]


def _top_level(map_line: str) -> list[str]:
    """Keys of a map in braces on one line, without those of maps inside it."""
    key_names, depth = [], 0
    for match in re.finditer(r"[{}]|,|[^{},]+", map_line):
        word = match[0]
        depth += (word == "{") - (word == "}")
        key = re.match(r"\s*([^\W\d][\w-]*):", word)
        if depth == 1 and key is not None:
            key_names.append(key[1])
    return key_names
