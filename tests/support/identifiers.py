"""Identifiers that files bind, read by the parsers of their languages: what each is, and where."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import tree_sitter
import tree_sitter_rust

# Words that say nothing of what is stored. No identifier is, or begins with, one of them.
EMPTY_WORDS = frozenset(
    {
        *("own", "one", "found", "told", "said", "made", "given", "way", "whole", "most", "at"),
        *("of", "lean", "carry", "bend", "dear", "kept", "heard", "felt"),
    }
)
# In a scope of so many lines a reader sees all of a name.
SHORT_SCOPE = 3
_SCOPES = {
    *(ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda),
    *(ast.ListComp, ast.SetComp, ast.DictComp, ast.GeneratorExp),
}
_BINDING = {
    *(ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef, ast.arg, ast.Name, ast.Attribute),
    *(ast.ExceptHandler, ast.MatchAs, ast.Import, ast.ImportFrom),
}
_RUST_ITEMS = {
    *("function_item", "function_signature_item", "struct_item", "enum_item", "enum_variant"),
    *("trait_item", "const_item", "static_item", "type_item", "mod_item", "field_declaration"),
}
# Nodes of patterns that name types and fields, and bind nothing.
_NOT_BINDING = {
    *("scoped_identifier", "type_identifier", "field_identifier", "generic_type"),
    *("scoped_type_identifier", "range_pattern"),
}


@dataclass(frozen=True, slots=True)
class Identifier:
    """A name that a file binds in `line`; `scope`: lines of what can see it."""

    name: str
    line: int
    scope: int
    is_let: bool = False  # of a `let` in Rust

    @property
    def is_empty(self) -> bool:
        """Whether it begins with a word that says nothing, beyond a short scope."""
        return (
            self.scope > SHORT_SCOPE and self.name.strip("_").lower().split("_")[0] in EMPTY_WORDS
        )


def identifiers(path: Path) -> Iterator[Identifier]:
    """All that a Python or Rust file binds, in the order of the text."""
    if path.suffix == ".rs":
        return _rust_identifiers(path.read_bytes())
    return _python_identifiers(ast.parse(path.read_text(encoding="utf-8")), 1 << 30)


def _python_identifiers(tree: ast.AST, scope: int) -> Iterator[Identifier]:
    # A stack instead of a recursion: each name would pass all generators above it.
    nodes: list[tuple[Any, int]] = [(tree, scope)]
    while nodes:
        node, scope = nodes.pop()
        kind, inner = type(node), scope
        if kind in _SCOPES:
            inner = (node.end_lineno or node.lineno) - node.lineno + 1
        elif kind is ast.ClassDef:
            inner = 1 << 30
        if kind in _BINDING:
            for name in _bound(node):
                yield Identifier(name, getattr(node, "lineno", 0), scope)
        if kind is not ast.Name and node._fields:
            nodes += [(child, inner) for child in ast.iter_child_nodes(node)][::-1]


def _bound(node: ast.AST) -> list[str]:
    """Names that a node of Python binds by itself."""
    match node:
        case ast.FunctionDef(name) | ast.AsyncFunctionDef(name) | ast.ClassDef(name):
            return [name]
        case ast.arg(name) | ast.Name(name, ast.Store()) | ast.Attribute(_, name, ast.Store()):
            return [name]
        case ast.ExceptHandler(_, str(name)) | ast.MatchAs(_, str(name)):
            return [name]
        case ast.Import(names) | ast.ImportFrom(_, names):
            return [alias.asname for alias in names if alias.asname]
    return []


@cache
def _rust_parser() -> tree_sitter.Parser:
    return tree_sitter.Parser(tree_sitter.Language(tree_sitter_rust.language()))


def _rust_identifiers(source: bytes) -> Iterator[Identifier]:
    return _rust_node_identifiers(_rust_parser().parse(source).root_node, 1 << 30)


def _rust_node_identifiers(node: tree_sitter.Node, scope: int) -> Iterator[Identifier]:
    kind, pattern = node.type, node.child_by_field_name("pattern")
    if kind in _RUST_ITEMS and (name := node.child_by_field_name("name")) is not None:
        yield _rust_identifier(name, scope)
    if kind in ("function_item", "closure_expression", "match_arm", "for_expression"):
        scope = node.end_point[0] - node.start_point[0] + 1
    if kind == "match_arm" and pattern is not None and pattern.named_children:
        first = pattern.named_children[0]
        # A capital letter alone is a constant or a variant, which an arm compares.
        if first.type != "identifier" or not first.text or not first.text[:1].isupper():
            yield from _bound_by_pattern(first, scope)
    elif kind in ("let_declaration", "let_condition", "for_expression", "parameter"):
        if pattern is not None:
            is_let = kind.startswith("let")
            yield from _bound_by_pattern(pattern, scope, is_let)
    elif kind == "closure_parameters":
        for child in node.named_children:
            if child.type != "parameter":
                yield from _bound_by_pattern(child, scope)
    for child in node.named_children:
        yield from _rust_node_identifiers(child, scope)


def _bound_by_pattern(
    node: tree_sitter.Node, scope: int, is_let: bool = False
) -> Iterator[Identifier]:
    if node.type in ("identifier", "shorthand_field_identifier"):
        yield _rust_identifier(node, scope, is_let)
    elif node.type not in _NOT_BINDING:
        first = node.type in ("tuple_struct_pattern", "struct_pattern")  # the name of its type
        for child in node.named_children[first:]:
            yield from _bound_by_pattern(child, scope, is_let)


def _rust_identifier(node: tree_sitter.Node, scope: int, is_let: bool = False) -> Identifier:
    return Identifier((node.text or b"").decode(), node.start_point[0] + 1, scope, is_let)
