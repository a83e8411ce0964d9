"""How long the functions of a file are, in lines from the first to the last."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

import tree_sitter
import tree_sitter_rust


class FunctionLength(NamedTuple):
    """A function and how many lines it has."""

    name: str
    first: int  # line, from 1
    lines: int


def function_lengths(path: Path) -> Iterator[FunctionLength]:
    """The functions of a Rust or Python file, those inside others too."""
    if path.suffix == ".py":
        for item in ast.walk(ast.parse(path.read_text())):
            if isinstance(item, ast.FunctionDef | ast.AsyncFunctionDef):
                last = item.end_lineno or item.lineno
                yield FunctionLength(item.name, item.lineno, last - item.lineno + 1)
        return
    parser, functions = _rust()
    tree = parser.parse(path.read_bytes())
    for _, captured in tree_sitter.QueryCursor(functions).matches(tree.root_node):
        (function,), (name,) = captured["function"], captured["name"]
        first, last = function.start_point.row, function.end_point.row
        yield FunctionLength((name.text or b"").decode(), first + 1, last - first + 1)


@cache
def _rust() -> tuple[tree_sitter.Parser, tree_sitter.Query]:
    """A parser, and what finds functions in its trees."""
    language = tree_sitter.Language(tree_sitter_rust.language())
    functions = "(function_item name: (_) @name) @function"
    return tree_sitter.Parser(language), tree_sitter.Query(language, functions)
