"""Wraps prose in Markdown: no line of a paragraph or a list is longer than 120 columns.

`python -m docs.generators.wrap FILE …` rewrites files; code, tables, headings and paragraphs that
fit stay as they are.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from pathlib import Path

from ergon.common.module_arguments import module_arguments

COLUMNS = 120
_FENCE = re.compile(r"\s*(```|~~~)")
_MARKER = re.compile(r"(\s*)([*+-]|\d+[.)])( +)")
# Lines that are not prose: headings, tables, quotes, HTML, definitions of links, rules.
_VERBATIM = re.compile(r"\s*(#|\||>|<|!\[|\[[^\]]+\]: |---|===|\$\$|\\\[)")
# What may not stand at the beginning of a line, where it would begin a list, a heading …
_BEGINNING = re.compile(r"([*+-]|\d+[.)]|#+|>.*|\|.*|=+|-+|<.*|:.*)$")
# What is not broken: code, links and images with their targets, formulas.
_SOLID = re.compile(r"(`+)(?:(?!\1).)+\1|!?\[[^\]]*\]\([^)]*\)|\$[^$\s](?:[^$]*[^$\s])?\$")


def wrapped(text: str) -> str:
    """The text of a page with its prose wrapped."""
    return "".join(_lines(text.splitlines(keepends=True)))


def is_prose(line: str) -> bool:
    """Whether a line outside code is one of a paragraph or a list."""
    return bool(line.strip()) and not _VERBATIM.match(line)


def long_lines(text: str) -> Iterator[int]:
    """The numbers of lines of prose that are too long and that could be broken."""
    fence = ""
    for number, line in enumerate(text.splitlines(), 1):
        if mark := _FENCE.match(line):
            fence = "" if fence == mark.group(1) else fence or mark.group(1)
        elif not fence and is_prose(line) and len(line) > COLUMNS and len(_atoms(line)) > 1:
            yield number


def _lines(lines: list[str]) -> Iterator[str]:
    fence, paragraph = "", list[str]()
    for line in lines:
        mark = _FENCE.match(line)
        is_part = not fence and not mark and is_prose(line)
        if paragraph and (not is_part or _MARKER.match(line)):
            yield from _paragraph(paragraph)
            paragraph = []
        if mark:
            fence = "" if fence == mark.group(1) else fence or mark.group(1)
        if is_part:
            paragraph.append(line)
        else:
            yield line
    yield from _paragraph(paragraph)


def _paragraph(lines: list[str]) -> Iterator[str]:
    """A paragraph or an item of a list; with hard line breaks it stays as it is."""
    texts = [line.rstrip("\n") for line in lines]
    is_hard = any(text.endswith(("  ", "\\")) for text in texts)
    if not texts or is_hard or all(len(text) <= COLUMNS for text in texts):
        yield from lines
        return
    marker = _MARKER.match(texts[0])
    first = marker.group() if marker else re.match(r"\s*", texts[0]).group()  # type: ignore[union-attr]
    indent = " " * len(first)
    atoms = _atoms(" ".join([texts[0][len(first) :], *(text.strip() for text in texts[1:])]))
    line = first
    for atom, after in zip(atoms, [*atoms[1:], ""], strict=True):
        is_new = line in (first, indent)
        # What may not begin a line goes with the atom before it.
        needed = len(atom) + (1 + len(after) if _BEGINNING.match(after) else 0)
        if not is_new and len(line) + 1 + needed > COLUMNS and not _BEGINNING.match(atom):
            yield f"{line}\n"
            line, is_new = indent, True
        line += atom if is_new else f" {atom}"
    yield f"{line}\n"


def _atoms(text: str) -> list[str]:
    """Words, and what is not broken, with what adjoins it."""
    solid = [match.span() for match in _SOLID.finditer(text)]
    atoms, begin = [], 0
    for match in re.finditer(r"\s+", text):
        if any(start < match.start() < stop for start, stop in solid):
            continue
        atoms.append(text[begin : match.start()])
        begin = match.end()
    atoms.append(text[begin:])
    return [atom for atom in atoms if atom]


def main(paths: Iterable[str]) -> None:
    """Rewrite files."""
    for name in paths:
        path = Path(name)
        before = path.read_text(encoding="utf-8")
        after = wrapped(before)
        if after != before:
            path.write_text(after, encoding="utf-8")


if __name__ == "__main__":
    main(module_arguments(rest_metavar="FILE"))
