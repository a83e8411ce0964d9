"""Long lists and mappings of values in braces, composed line by line: a known line is not composed
again.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import accumulate, count
from operator import add, attrgetter
from pathlib import Path
from typing import NamedTuple, cast

from ergon.notation.text import document
from ergon.notation.text.document import Document, Line, Node, Scalar, Sequence, compose, n_lines
from ergon.notation.text.errors import Collector

# An item in braces, without quotes or comments.
_PLAIN_TEXT = r"[^][{}\"'#\n]*+"
_BRACED_TAIL = rf"{_PLAIN_TEXT}(?:\[{_PLAIN_TEXT}\]{_PLAIN_TEXT})*+\}}"
# Lines of one indentation, each an item or an entry; and items in one line. With fewer than 8,
# nothing is gained. Both begin with a character that is quickly found.
_ENTRY = r"[A-Za-z][\w-]*: "
_LINES = re.compile(
    r"\n( *)- \{[^\n]*\}(?=\n)(?:\n\1- \{[^\n]*\}(?=\n)){7,}"
    rf"|\n( +){_ENTRY}\{{[^\n]*\}}(?=\n)(?:\n\2{_ENTRY}\{{[^\n]*\}}(?=\n)){{7,}}"
)
_ITEMS = re.compile(rf"\{{(?:(?<=\[\{{)|(?<=, \{{)){_BRACED_TAIL}(?:, \{{{_BRACED_TAIL}){{7,}}+")
_size, _node = attrgetter("size"), attrgetter("node")
_PLACEHOLDER = "lines"  # placeholder for a run; in a mapping with a number


class FoundRun(NamedTuple):
    """A run of values from `start` to `end` of a text: whole lines with an indentation, or items in
    one line (None).
    """

    start: int
    end: int
    indentation: str | None
    is_mapping: bool


def find_runs(source_text: str) -> list[FoundRun]:
    """The runs of at least 8 values in a text, in order; none is in another."""
    runs = [
        FoundRun(
            line_match.start() + 1,
            line_match.end() + 1,
            line_match[2] if line_match[1] is None else line_match[1],
            line_match[1] is None,
        )
        for line_match in _LINES.finditer(source_text)
    ]
    if ", {" not in source_text:
        return runs
    item_runs = [FoundRun(*match.span(), None, False) for match in _ITEMS.finditer(source_text)]
    if not runs or not item_runs:
        return runs or item_runs
    disjoint_runs: list[FoundRun] = []
    for run in sorted(runs + item_runs):
        if not disjoint_runs or run.start >= disjoint_runs[-1].end:
            disjoint_runs.append(run)
    return disjoint_runs


@dataclass(slots=True)
class _LineRun:
    """A run of values in a text, and the position of the one value that replaces it in a shortened
    text; `lines` are its values, once they are composed.
    """

    start: int
    end: int
    short_start: int
    stand_in_index: int  # after its dash, or at its name
    short_end: int
    line_words: list[str]  # lines, or what is between braces
    gap_length: int  # between two of them
    placeholder: str  # the placeholder
    lines: list[Line] = field(default_factory=list)

    @property
    def is_mapping(self) -> bool:
        """Whether the values are entries with names."""
        return self.placeholder != _PLACEHOLDER

    def full_index(self, short_index: int) -> int:
        """Index in the text of an index of the shortened text, at this run or after it."""
        # A mapping begins where its first name does.
        if short_index < self.stand_in_index + self.is_mapping:
            return self.start + short_index - self.short_start
        return self.end + short_index - self.short_end

    def value_starts(self) -> Iterator[int]:
        """Where each value begins in the text."""
        gaps = count(self.start, self.gap_length)
        return map(add, accumulate(map(len, self.line_words[:-1]), initial=0), gaps)


def compose_by_lines(
    source_text: str, file_name: str, folder: Path, row_index: int, known_lines: Mapping[str, Line]
) -> tuple[Document, dict[str, Line]] | None:
    """The nodes of a text, and the lines of its lists and mappings; lines that are `known_lines`
    are not composed.

    `row_index` is the first line of the text in its file. Known lines keep the line numbers at
    which they were composed. None if there are no such lines, or if they cannot be read alone (an
    alias, a text of several lines, a mistake).
    """
    short_text, runs = _shortened(source_text)
    collector = Collector()
    composed = compose(short_text, file_name, collector, row_index) if runs else None
    if composed is None or composed.root is None or collector.n_reports:
        return None
    composed.text = source_text
    composed.forget_lines()
    lines_by_word: dict[str, Line] = {}
    for run in runs:
        first_row = row_index + n_lines(source_text[: run.start])
        run_lines = [*map(known_lines.get, run.line_words)]
        for line_index in [number for number, line in enumerate(run_lines) if line is None]:
            line_word, line_row = (
                run.line_words[line_index],
                first_row if run.gap_length else first_row + line_index,
            )
            composed_line = lines_by_word.get(line_word)
            if composed_line is None:
                composed_line = _compose_line(
                    f"{{{line_word}}}" if run.gap_length else line_word,
                    file_name,
                    line_row,
                    run.is_mapping,
                )
            if composed_line is None:
                return None
            composed_line.node.document.folder = folder
            run_lines[line_index] = lines_by_word[line_word] = composed_line
        run.lines = cast("list[Line]", run_lines)  # none is missing any more
        lines_by_word.update(zip(run.line_words, run.lines, strict=True))
    return (composed, lines_by_word) if _fill_runs(composed, runs) else None


def _shortened(source_text: str) -> tuple[str, list[_LineRun]]:
    """The text with one value in place of each run, and the runs."""
    short_text, copied_until = "", 0
    runs: list[_LineRun] = []
    for run_start, run_end, indentation, is_mapping in find_runs(source_text):
        short_text += source_text[copied_until:run_start]
        short_start, copied_until, stand_in_name, gap_length = (
            len(short_text),
            run_end,
            _PLACEHOLDER,
            0,
        )
        if indentation is None:
            run_words, stand_in_index, gap_length = (
                source_text[run_start + 1 : run_end - 1].split("}, {"),
                short_start,
                len("}, {"),
            )
            short_text += stand_in_name
        elif is_mapping:
            run_words, stand_in_index = (
                source_text[run_start:run_end].splitlines(keepends=True),
                short_start + len(indentation),
            )
            stand_in_name = f"{_PLACEHOLDER}{len(runs)}"
            short_text += f"{indentation}{stand_in_name}: {{}}\n"
        else:
            run_words, stand_in_index = (
                source_text[run_start:run_end].splitlines(keepends=True),
                short_start + len(indentation) + 2,
            )
            short_text += f"{indentation}- {stand_in_name}\n"
        runs.append(
            _LineRun(
                run_start,
                run_end,
                short_start,
                stand_in_index,
                len(short_text),
                run_words,
                gap_length,
                stand_in_name,
            )
        )
    return short_text + source_text[copied_until:], runs


def _compose_line(text: str, file: str, row: int, is_mapping: bool) -> Line | None:
    collector = Collector()
    composed = compose(text, file, collector, row)
    if collector.n_reports:
        return None
    if isinstance(composed.root, Sequence):
        return (
            Line(composed.root.items[0], composed.size - 1)
            if len(composed.root.items) == 1
            else None
        )
    if not isinstance(composed.root, document.Mapping):
        return None
    return Line(composed.root, composed.size - is_mapping)


def _fill_runs(composed: Document, runs: list[_LineRun]) -> bool:
    """Put the lines in their places, and move all other nodes to their places in the text.

    False if a run is not part of a list or mapping after all.
    """
    assert composed.root is not None
    runs_by_item, all_nodes = (
        {line_run.stand_in_index: line_run for line_run in runs},
        list(_nodes(composed.root)),
    )
    places_by_node = {
        id(node): (_full_index(node.start, runs), _full_index(node.end, runs)) for node in all_nodes
    }
    n_filled = 0
    for moved_node in all_nodes:
        if isinstance(moved_node, document.Mapping):
            n_filled += _fill_entries(moved_node, runs_by_item)
        if not isinstance(moved_node, Sequence):
            continue
        item_runs = [
            isinstance(item, Scalar) and item.text == _PLACEHOLDER and runs_by_item.get(item.start)
            for item in moved_node.items
        ]
        if any(item_runs):
            n_filled += _fill_items(moved_node, item_runs)
    for moved_node in all_nodes:
        moved_node.start, moved_node.end = places_by_node[id(moved_node)]
    composed.size += sum(sum(map(_size, line_run.lines)) for line_run in runs)
    composed.size -= sum(1 + line_run.is_mapping for line_run in runs)
    return n_filled == len(runs)


def _nodes(root: Node) -> Iterator[Node]:
    unvisited_nodes = [root]
    while unvisited_nodes:
        inner_node = unvisited_nodes.pop()
        yield inner_node
        if isinstance(inner_node, document.Mapping):
            unvisited_nodes += [child for entry in inner_node.entries.values() for child in entry]
        elif isinstance(inner_node, Sequence):
            unvisited_nodes += inner_node.items


def _full_index(index: int, runs: list[_LineRun]) -> int:
    """Index in the text of an index of the shortened text."""
    earlier_runs = [run for run in runs if run.short_start <= index]
    return earlier_runs[-1].full_index(index) if earlier_runs else index


def _fill_items(sequence: Sequence, item_runs: Iterable[_LineRun | bool | None]) -> int:
    """Put the items of the runs in `item_runs` in place of the values that replaced them; returns
    the number of runs.
    """
    item_nodes: list[Node] = []
    lines: list[Line | None] = []
    value_starts: list[int] = []
    n_filled = 0
    for item_node, run in zip(sequence.items, item_runs, strict=True):
        if isinstance(run, _LineRun):
            lines += run.lines
            item_nodes += map(_node, run.lines)
            value_starts += run.value_starts()
            n_filled += 1
        else:
            item_nodes.append(item_node)
            lines.append(None)
            value_starts.append(0)
    sequence.items, sequence.lines, sequence.bases = item_nodes, lines, value_starts
    return n_filled


def _fill_entries(mapping: document.Mapping, runs_by_item: Mapping[int, _LineRun]) -> int:
    """Put the entries of runs in place of the entries that replaced them; returns the number of
    runs.

    Returns 0 if a name is written twice.
    """
    fills = [
        run
        for name, (key, _) in mapping.entries.items()
        if (run := runs_by_item.get(key.start)) is not None and run.placeholder == name
    ]
    if not fills:
        return 0
    old_entries, n_names = mapping.entries, len(mapping.entries)
    mapping.entries = {}
    for entry_name, filled_entry in old_entries.items():
        run = runs_by_item.get(filled_entry[0].start)
        if run is None or run.placeholder != entry_name:
            mapping.entries[entry_name] = filled_entry
            continue
        n_names += len(run.line_words) - 1
        for run_line, base in zip(run.lines, run.value_starts(), strict=True):
            assert isinstance(run_line.node, document.Mapping)
            mapping.entries |= run_line.node.entries
            first_key = next(iter(run_line.node.entries))
            mapping.lines[first_key], mapping.bases[first_key] = run_line, base
    return len(fills) if len(mapping.entries) == n_names else 0
