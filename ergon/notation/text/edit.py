"""Edits of a YAML text that change what they name and leave every other byte as it was.

A text is never written anew from its values: characters are replaced where they stand, then the
result is read again and refused unless it says exactly what was there with the one thing changed.
A path is the names and indices (from 0) that lead to a value; what is set is one line of YAML.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from typing import Any

from ergon.notation.text import document
from ergon.notation.text.document import Document, Node, Scalar, compose
from ergon.notation.text.errors import Collector, quote
from ergon.notation.text.spans import Layout, Span, Splice, apply_splices, layout
from ergon.notation.text.splices import Changes, named
from ergon.notation.text.splices import EditError as EditError
from ergon.notation.text.splices import Path as Path

Tree = str | list[Any] | dict[str, Any] | None  # values of a text; None is an empty value


@lru_cache(maxsize=16)  # the next edit begins with the text checked after this one
def read(yaml_text: str, file_name: str) -> Document:
    """The nodes of a text, for reading only. Raises EditError."""
    collector = Collector()
    document = compose(yaml_text, file_name, collector)
    if collector.has_errors():
        raise EditError(collector.finish()[0].message)
    return document


def put(document: Document, path: Path, value_text: str, name_order: Sequence[str] = ()) -> str:
    """Set the value at a path; its last name and mappings on the way are made where missing.

    A new section goes where `name_order` has it. Raises EditError.
    """
    edit = _Edit(document)
    spans = edit.follow(path)
    if len(spans) > len(path):
        child_index = spans[-2].index(path[-1]) if path else None
        if child_index is None:
            raise EditError("a whole file cannot be set; name a field of it")
        splices = edit.changes.replace_child(spans[-2], child_index, value_text)
        is_in_flow = spans[-2].is_flow
    else:
        splices = edit.changes.add_entry(spans, path, value_text, name_order, is_item=False)
        is_in_flow = False
    new_value = _parse_value(value_text, is_in_flow)
    return edit.checked_text(splices, _with_value(edit.tree, path, lambda _: new_value))


def insert(document: Document, path: Path, item_text: str) -> str:
    """Put an item before the one at a path, whose last name is its index. Raises EditError."""
    edit = _Edit(document)
    spans = edit.follow(path)
    item_index = path[-1] if path else None
    if len(spans) <= len(path) or not isinstance(item_index, int):
        raise EditError(f"there is no {named(path)}")
    item_value = _parse_value(item_text, is_in_flow=True)
    splices = edit.changes.insert_before(spans[-2], item_index, item_text)

    def with_item(items_before: Any) -> Tree:
        return [*items_before[:item_index], item_value, *items_before[item_index:]]

    return edit.checked_text(splices, _with_value(edit.tree, path[:-1], with_item))


def append(document: Document, path: Path, text: str, order: Sequence[str] = ()) -> str:
    """Add an item at the end of a sequence, which is made where missing.

    A lone value where a list may stand becomes the first of two. Raises EditError.
    """
    edit = _Edit(document)
    spans = edit.follow(path)
    last_span = spans[-1] if spans else None
    item_value = _parse_value(text, is_in_flow=True)
    if len(spans) <= len(path) or last_span is None or last_span.is_empty:
        splices = edit.changes.add_entry(spans, path, text, order, is_item=True)
        return edit.checked_text(splices, _with_value(edit.tree, path, lambda _: [item_value]))
    if last_span.kind == "sequence":
        splices = edit.changes.append_item(last_span, text)
        return edit.checked_text(
            splices, _with_value(edit.tree, path, lambda old: [*(old or ()), item_value])
        )
    splices = edit.changes.wrap_in_list(spans[-2], last_span, text)
    return edit.checked_text(splices, _with_value(edit.tree, path, lambda old: [old, item_value]))


def extend(
    document: Document, path: Path, item_texts: Sequence[str], name_order: Sequence[str] = ()
) -> str:
    """Add several items at the end of a sequence, as `append` does one. Raises EditError."""
    first_text, *later_texts = item_texts
    extended_text = append(document, path, first_text, name_order)
    if not later_texts:
        return extended_text
    document = read(extended_text, document.file)
    edit = _Edit(document)
    node = edit.follow(path)[-1]
    item_values = [_parse_value(text, is_in_flow=True) for text in later_texts]
    splices = [splice for text in later_texts for splice in edit.changes.append_item(node, text)]
    try:
        return edit.checked_text(
            splices, _with_value(edit.tree, path, lambda old: [*old, *item_values])
        )
    except EditError:  # each has a comma of its own
        for text in later_texts:
            extended_text = append(read(extended_text, document.file), path, text, name_order)
        return extended_text


def remove(document: Document, *paths: Path) -> str:
    """Take away entries or items, each with the comment at the end of its line.

    Raises EditError.
    """
    edit = _Edit(document)
    splices: list[Splice] = []
    removed_children: list[tuple[Span, int]] = []
    for path in paths:
        spans = edit.follow(path)
        if not path or len(spans) <= len(path):
            raise EditError(f"there is no {named(path)}")
        item_index = spans[-2].index(path[-1])
        assert item_index is not None
        removed_children.append((spans[-2], item_index))
    removed_indices = {number for _, number in removed_children}  # all of one parent
    for parent, item_index in removed_children:
        changes = edit.changes
        splices += (
            changes.cut_flow(parent, item_index, removed_indices)
            if parent.is_flow
            else changes.cut_block(parent, item_index)
        )
    return edit.checked_text(splices, _without_values(edit.tree, list(paths)))


def rows(text: str) -> list[str]:
    """The lines of a table's text."""
    return text.rstrip("\n").split("\n") if text.strip() else []


def add_row(document: Document, path: Path, text: str) -> str:
    """Add a line at the end of a table, indented like the lines above it. Raises EditError."""
    edit = _Edit(document)
    table, value_span = edit.table(path)
    table_rows = [*rows(table), text]
    if not value_span.is_block:
        return put(document, path, json.dumps("\n".join(table_rows), ensure_ascii=False))
    text_layout = edit.layout
    line_end = text_layout.line_end(value_span.end)
    indent = text_layout.indent_step + edit.indent(path)
    for start, stop in reversed(edit.changes.rows(value_span)):
        if line := text_layout.text[start:stop].strip():
            indent = text_layout.text[start:stop].index(line)
            break
    splices = [Splice(line_end, line_end, f"{text_layout.newline}{' ' * indent}{text}")]
    return edit.checked_rows(splices, path, table_rows)


def put_row(document: Document, path: Path, row: int, text: str | None) -> str:
    """Set a line (from 0) of a table, its comment kept; None takes the line away.

    Raises EditError.
    """
    return put_rows(document, path, {row: text})


def put_rows(document: Document, path: Path, changes: Mapping[int, str | None]) -> str:
    """Set lines of a table by their numbers, or take them away. Raises EditError."""
    edit = _Edit(document)
    table, value_span = edit.table(path)
    table_rows: list[str | None] = [*rows(table)]
    splices, text_layout = [], edit.layout
    row_spans = edit.changes.rows(value_span) if value_span.is_block else []
    for row_index, row_text in changes.items():
        if not 0 <= row_index < len(table_rows):
            raise EditError(f"{named(path)} has no line {row_index + 1}")
        comment = _row_comment(table_rows[row_index] or "")
        table_rows[row_index] = None if row_text is None else row_text + comment
        if value_span.is_block:
            row_start, row_stop = row_spans[row_index]
            indent = len(text_layout.text[row_start:row_stop]) - len(
                text_layout.text[row_start:row_stop].lstrip()
            )
            changed_span = (
                text_layout.full_lines(row_start, row_stop)
                if row_text is None
                else (row_start + indent, row_stop - len(comment))
            )
            splices.append(Splice(*changed_span, row_text or ""))
    remaining_rows = [line for line in table_rows if line is not None]
    if not value_span.is_block:
        return put(document, path, quoted("\n".join(remaining_rows)))
    return edit.checked_rows(splices, path, remaining_rows)


def quoted(plain_text: str) -> str:
    """A text as a YAML scalar, in quotes only where it needs them."""
    if (
        plain_text not in ("", "~", "null")
        and "\n" not in plain_text
        and plain_text == plain_text.strip()
    ):
        collector = Collector()
        items = getattr(compose(f"[{plain_text}]", "", collector).root, "items", [])
        if not collector.has_errors() and len(items) == 1 and tree(items[0]) == plain_text:
            return plain_text
    return json.dumps(plain_text, ensure_ascii=False)


def flow(tree: Tree) -> str:
    """A value as one line of YAML in flow style."""
    if isinstance(tree, dict):
        return "{" + ", ".join(f"{name}: {flow(value)}" for name, value in tree.items()) + "}"
    if isinstance(tree, list):
        return "[" + ", ".join(map(flow, tree)) + "]"
    return "{}" if tree is None else quoted(tree)


class _Edit:
    """One document with its layout and its values, for an edit."""

    def __init__(self, document: Document) -> None:
        self.document = document
        self.layout: Layout = layout(document.text)
        self.changes = Changes(self.layout)
        self.tree = tree(document.root)

    def follow(self, path: Path) -> list[Span]:
        """The spans from the root to the value at a path, or to the last of them that is
        written.
        """
        if self.layout.root is None:
            return []
        spans = [self.layout.root]
        for depth, name in enumerate(path):
            span = spans[-1]
            if span.kind == "alias":
                alias_text = f"{named(path[:depth])} is the alias `*{span.value}` of a value "
                raise EditError(
                    f"{alias_text}that is written elsewhere; replace the alias by the value first"
                )
            child_index = span.index(name)
            if child_index is None:
                break
            spans.append(span.items[child_index])
        return spans

    def table(self, path: Path) -> tuple[str, Span]:
        """The text and the span of a table."""
        spans = self.follow(path)
        if len(spans) <= len(path) or spans[-1].kind != "scalar":
            raise EditError(f"{named(path)} is not a table")
        return spans[-1].value, spans[-1]

    def indent(self, path: Path) -> int:
        """The indentation of the name or dash of the value at a path."""
        parent = self.follow(path)[-2]
        child_index = parent.index(path[-1])
        return self.layout.column(self.layout.child_start(parent, child_index or 0))

    def checked_text(self, splices: list[Splice], expected: Tree) -> str:
        """The new text. Raises EditError if its values are not `expected`."""
        new_text = apply_splices(self.layout.text, splices)
        reread_document = read(new_text, self.document.file)
        if tree(reread_document.root) != expected:
            raise EditError(
                "the change would alter other values too; edit the text of the score instead"
            )
        return new_text

    def checked_rows(self, splices: list[Splice], path: Path, new_rows: list[str]) -> str:
        """The new text, in which the table has these lines."""
        text = apply_splices(self.layout.text, splices)
        table_node = read(text, self.document.file).root
        for name in path:
            table_node = _child(table_node, name)
        if not isinstance(table_node, Scalar) or rows(table_node.text) != [
            *rows("\n".join(new_rows))
        ]:
            raise EditError("the line is not a row of the table")
        return self.checked_text(
            splices, _with_value(self.tree, path, lambda _: table_node.text.rstrip("\n"))
        )


def _child(parent_node: Node | None, child_name: str | int) -> Node | None:
    if isinstance(parent_node, document.Mapping):
        return parent_node.get(str(child_name))
    if isinstance(parent_node, document.Sequence) and isinstance(child_name, int):
        return parent_node.items[child_name]
    return None


def _row_comment(table_row: str) -> str:
    """The comment at the end of a table's line, with the spaces before it."""
    code = table_row.rstrip()
    for column, character in enumerate(table_row):
        if character == "#" and (column == 0 or table_row[column - 1].isspace()):
            code = table_row[:column].rstrip()
            break
    return table_row[len(code) :]


def _parse_value(value_text: str, is_in_flow: bool) -> Tree:
    """The value of one line of YAML, in flow or block context. Raises EditError if it is not one
    value.
    """
    collector = Collector()
    source = f"[{value_text}\n]" if is_in_flow else f"k: {value_text}"
    root_node = compose(source, "", collector).root
    if "\n" in value_text or collector.has_errors():
        raise EditError(f"{quote(value_text)} is not one value")
    if isinstance(root_node, document.Sequence) and len(root_node.items) == 1:
        return tree(root_node.items[0])
    if isinstance(root_node, document.Mapping) and len(root_node.entries) == 1:
        return tree(root_node.entries["k"][1])
    raise EditError(f"{quote(value_text)} is not one value")


def tree(node: Node | None, tree_by_id: dict[int, Tree] | None = None) -> Tree:
    """The value of a node with its aliases resolved: texts, and lists and mappings of values; None
    if it is empty.
    """
    if node is None:
        return None
    tree_by_id = {} if tree_by_id is None else tree_by_id
    if id(node) not in tree_by_id:
        node_tree: Tree
        if isinstance(node, document.Mapping):
            node_tree = {
                name: tree(child, tree_by_id) for name, (_, child) in node.entries.items()
            } or None
        elif isinstance(node, document.Sequence):
            node_tree = [tree(child, tree_by_id) for child in node.items] or None
        else:
            assert isinstance(node, Scalar)
            text = node.text.rstrip("\n") if node.style in ("|", ">") else node.text
            node_tree = None if node.is_empty else text
        tree_by_id[id(node)] = node_tree
    return tree_by_id[id(node)]


def _with_value(tree: Tree, path: Path, value_change: Callable[[Any], Tree]) -> Tree:
    """The tree with the value at a path changed; the old one stays as it was."""
    if not path:
        return value_change(tree)
    first_name = path[0]
    if isinstance(tree, list) and isinstance(first_name, int):
        items = list(tree)
        items[first_name] = _with_value(items[first_name], path[1:], value_change)
        return items
    entries = dict(tree) if isinstance(tree, dict) else {}
    entries[str(first_name)] = _with_value(entries.get(str(first_name)), path[1:], value_change)
    return entries


def _without_values(tree: Tree, paths: list[Path]) -> Tree:
    """The tree without the values at `paths`. Raises EditError if they do not have one parent."""
    parents = {tuple(path[:-1]) for path in paths}
    if len(parents) > 1:
        raise EditError("entries can be removed together only from one list or mapping")
    last_names = {path[-1] for path in paths}

    def without_items(parent: Any) -> Tree:
        if isinstance(parent, list):
            return [item for index, item in enumerate(parent) if index not in last_names] or None
        return {name: value for name, value in parent.items() if name not in last_names} or None

    return _with_value(tree, parents.pop(), without_items)
