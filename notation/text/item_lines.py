"""Lists of many items in braces: an item that is known is not composed again."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from itertools import accumulate
from pathlib import Path
from typing import NamedTuple

from ergon.notation.text import document
from ergon.notation.text.document import Document, Line, Node, Scalar, Sequence, compose
from ergon.notation.text.errors import Collector

# An item in braces, without quotes or remarks.
_ITEM = r"\{(?:[^][{}\"'#\n]|\[[^][{}\"'#\n]*\])*\}"
# Lines of one indentation, each an item; or items in one line. Of fewer nothing is gained.
_RUN = re.compile(
    r"^( *)- \{[^\n]*\}\n(?:\1- \{[^\n]*\}\n){7,}"
    rf"|(?:(?<=\[)|(?<=, ))(?:{_ITEM}, ){{7,}}+{_ITEM}",
    re.MULTILINE,
)
_NAME = "lines"  # of the one that stands for them


class _Run(NamedTuple):
    """Where items begin and end in a text, and where one stands for them in a shorter one."""

    first: int
    end: int
    short_first: int
    item: int  # after its dash
    short_end: int
    words: list[str]  # lines, or what is between braces
    gap: int  # between two of them

    def whole(self, index: int) -> int:
        """The place in the text of one in the shorter text, at this run or below it."""
        if index < self.item:
            return self.first + index - self.short_first
        return self.end + index - self.short_end


def by_lines(
    text: str, file: str, folder: Path, row: int, known: Mapping[str, Line]
) -> tuple[Document, dict[str, Line]] | None:
    """The nodes of a text, and the lines of its lists; those that are `known` are not composed.

    `row` is the first line of the text in its file; an item keeps the line at which it was
    composed. None where there is no such list, or where its items cannot be read alone (an alias,
    a text of several lines, a mistake).
    """
    short, runs = _shortened(text)
    collector = Collector()
    own = compose(short, file, collector, row) if runs else None
    if own is None or own.root is None or collector.told:
        return None
    own.text = text
    own.forget_lines()
    lines: dict[str, Line] = {}
    for run in runs:
        for number, word in enumerate(run.words):
            if word not in lines and word not in known:
                here = own.row(run.first) + (0 if run.gap else number)
                line = _line(f"{{{word}}}" if run.gap else word, file, row + here)
                if line is None:
                    return None
                line.node.document.folder = folder
                lines[word] = line
        lines |= {word: known[word] for word in run.words if word in known}
    return (own, lines) if _filled(own, runs, lines) else None


def _shortened(text: str) -> tuple[str, list[_Run]]:
    """The text with one item in place of each run of them, and the runs."""
    short, runs, done = "", [], 0
    for match in _RUN.finditer(text):
        short += text[done : match.start()]
        first, done, indent = len(short), match.end(), match[1]
        short += _NAME if indent is None else f"{indent}- {_NAME}\n"
        if indent is None:
            words, item, gap = match.group()[1:-1].split("}, {"), first, len("}, {")
        else:
            words, item, gap = match.group().splitlines(keepends=True), first + len(indent) + 2, 0
        runs.append(_Run(match.start(), done, first, item, len(short), words, gap))
    return short + text[done:], runs


def _line(text: str, file: str, row: int) -> Line | None:
    collector = Collector()
    own = compose(text, file, collector, row)
    if collector.told:
        return None
    if isinstance(own.root, Sequence):
        return Line(own.root.items[0], own.size - 1) if len(own.root.items) == 1 else None
    return Line(own.root, own.size) if isinstance(own.root, document.Mapping) else None


def _filled(own: Document, runs: list[_Run], lines: Mapping[str, Line]) -> bool:
    """Put the lines in their places, and all other nodes where they are in the text.

    False where what looks like a list is none.
    """
    assert own.root is not None
    by_item, nodes = {run.item: run for run in runs}, list(_nodes(own.root))
    places = {id(node): (_whole(node.start, runs), _whole(node.end, runs)) for node in nodes}
    n_found = 0
    for node in nodes:
        if not isinstance(node, Sequence):
            continue
        found = [
            isinstance(item, Scalar) and item.text == _NAME and by_item.get(item.start)
            for item in node.items
        ]
        if any(found):
            n_found += _fill(node, found, lines)
    for node in nodes:
        node.start, node.end = places[id(node)]
    own.size += sum([lines[word].size for run in runs for word in run.words]) - len(runs)
    return n_found == len(runs)


def _nodes(root: Node) -> Iterator[Node]:
    todo = [root]
    while todo:
        node = todo.pop()
        yield node
        if isinstance(node, document.Mapping):
            todo += [child for entry in node.entries.values() for child in entry]
        elif isinstance(node, Sequence):
            todo += node.items


def _whole(index: int, runs: list[_Run]) -> int:
    """The place in the text of one in the shorter text."""
    above = [run for run in runs if run.short_first <= index]
    return above[-1].whole(index) if above else index


def _fill(
    sequence: Sequence, found: Iterable[_Run | bool | None], lines: Mapping[str, Line]
) -> int:
    """The items of the runs that are `found`, in the place of what stands for them."""
    items: list[Node] = []
    known: list[Line | None] = []
    bases: list[int] = []
    n_found = 0
    for item, run in zip(sequence.items, found, strict=True):
        if isinstance(run, _Run):
            own = [lines[word] for word in run.words]
            known += own
            items += [line.node for line in own]
            lengths = [len(word) + run.gap for word in run.words[:-1]]
            bases += accumulate(lengths, initial=run.first)
            n_found += 1
        else:
            items.append(item)
            known.append(None)
            bases.append(0)
    sequence.items, sequence.lines, sequence.bases = items, known, bases
    return n_found
