"""A text without its long runs of lines, so that an edit reads little more than it changes."""

from __future__ import annotations

from collections.abc import Container
from dataclasses import dataclass
from itertools import groupby

from ergon.notation.text.item_lines import find_runs
from ergon.notation.text.window import is_plain

_MIN_LINES = 8  # shorter runs save no time
_PLACEHOLDER_PREFIX = "elided-"


@dataclass(frozen=True, slots=True)
class ShortenedText:
    """A text in which each of `runs` is one line; it holds that line and what it replaces."""

    text: str
    runs: tuple[tuple[str, str], ...]

    def restored(self, edited_text: str) -> str | None:
        """An edited text with all its runs; None if the edit has changed one of them."""
        edited_text = f"\n{edited_text}"
        for elided_line, run in self.runs:
            if edited_text.count(f"\n{elided_line}") != 1:
                return None
            edited_text = edited_text.replace(f"\n{elided_line}", f"\n{run}")
        return edited_text[1:]


def shorten(source_text: str, elided_names: Container[str]) -> ShortenedText | None:
    """A text whose long runs of entries and items are one line each, but for entries with these
    names. None if nothing is gained, or if its lines cannot be read alone.
    """
    if _PLACEHOLDER_PREFIX in source_text or not is_plain(source_text):
        return None
    pieces: list[str] = []
    runs: list[tuple[str, str]] = []
    copied_until = 0
    for run_start, run_end, indentation, is_mapping in find_runs(source_text):
        if indentation is None:
            continue  # items in one line
        pieces.append(source_text[copied_until:run_start])
        copied_until = run_end
        lines = source_text[run_start:run_end].splitlines(keepends=True)
        for is_named, line_group in groupby(lines, lambda line: _entry_name(line) in elided_names):
            run = [*line_group]
            if is_named or len(run) < _MIN_LINES:
                pieces += run
                continue
            name = f"{_PLACEHOLDER_PREFIX}{len(runs)}"
            line = f"{indentation}{name}: {{}}\n" if is_mapping else f"{indentation}- {name}\n"
            pieces.append(line)
            runs.append((line, "".join(run)))
    return (
        ShortenedText("".join((*pieces, source_text[copied_until:])), tuple(runs)) if runs else None
    )


def _entry_name(line: str) -> str:
    """The name of an entry's line."""
    return line.partition(":")[0].strip()
