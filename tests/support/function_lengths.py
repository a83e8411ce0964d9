"""How long the functions of a file are, in lines from the first to the last."""

from __future__ import annotations

import ast
from collections.abc import Iterator
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
    parser = tree_sitter.Parser(tree_sitter.Language(tree_sitter_rust.language()))
    nodes = [parser.parse(path.read_bytes()).root_node]
    while nodes:
        node = nodes.pop()
        nodes.extend(node.children)
        name = node.child_by_field_name("name")
        if node.type == "function_item" and name is not None and name.text is not None:
            first, last = node.start_point.row, node.end_point.row
            yield FunctionLength(name.text.decode(), first + 1, last - first + 1)
