"""Loops and conditions among names: `for i in 1..12:` and `if i < 12:`, with names below them.

They are written out before their names are read: each turn of a loop copies the nodes below it,
with the places that they have, into a document in which the variable is a value of `let:`. A name
followed by an expression in parentheses, such as `m(i+1)`, becomes the name with its number, `m4`.
No code is executed, and what may be written out is bounded.
"""

from __future__ import annotations

import re
from collections import ChainMap
from collections.abc import Iterator
from dataclasses import replace
from fractions import Fraction

from ergon.notation.tables.conditions import is_true
from ergon.notation.tables.expressions import UNITS, Amount, evaluate
from ergon.notation.tables.named_values import NamedAmounts, add_named, named_amounts
from ergon.notation.text import document
from ergon.notation.text.document import Document, Node, Scalar
from ergon.notation.text.errors import Collector, TextError, quote

MAX_TURNS = 20_000  # turns of all loops in one mapping
MAX_NODES = 500_000  # nodes, plus one per 64 characters, that loops of a file may produce
MAX_INSIDE = 8  # levels of nested loops and conditions

SYNTAX = "write `for i in 1..12:` or `if i < 12:`, with names below"
# The names of loops and conditions, for editors.
PATTERN = "^(for|if) "
_HEAD = re.compile(r"(for|if)(\s.*)?", re.DOTALL)
_FOR = re.compile(r"for\s+([A-Za-z_]\w*)\s+in\s+(.+?)\.\.(.+?)(?:\s+by\s+(.+))?", re.DOTALL)
_NUMBERED = re.compile(r"((?<![\w-])[^\W\d](?:[\w-]{0,62}\w)?|(?<=[\w)])\.)\(")
_TEXT_COST = 64  # characters of a text that count as another value
# Words that laws and expressions have before parentheses.
_FUNCTIONS = {"where", "abs", "min", "max", "sqrt", "sign", "exp", "tanh", "noise"} | {
    "and",
    "or",
    "not",
}

Entries = dict[str, tuple[Scalar, Node]]
Names = ChainMap[str, Amount]


def is_loop(word: str) -> bool:
    """Whether a name is that of a loop or a condition."""
    return _HEAD.fullmatch(word) is not None and " " in word


def written_out(mapping_node: document.Mapping, collector: Collector) -> document.Mapping:
    """The mapping with the names that its loops make, in their order; itself if it has none.

    Mistakes are reported; names in a loop that cannot be read are left out.
    """
    if not any(map(is_loop, mapping_node.entries)):
        return mapping_node
    return _Writer(mapping_node, collector).mapping()


class _LoopError(Exception):
    """Ends the writing of a mapping, after a report."""


class _Writer:
    """Writes the loops of one mapping out."""

    def __init__(self, mapping_node: document.Mapping, collector: Collector) -> None:
        self.node = mapping_node
        self.collector = collector
        self.entries: Entries = {}
        self.keys_of_loops: dict[str, Scalar] = {}  # names that loops make
        self.n_turns = 0
        self.n_nodes = 0
        loops = self.node.document.loops
        self.n_nodes_of_others = sum(n for start, n in loops.items() if start != mapping_node.start)

    def mapping(self) -> document.Mapping:
        for line in self.node.lines.values():
            line.node.document.let, line.node.document.lets = self.node.document.let, None
        values_by_name = ChainMap(named_amounts(self.node.document).names)
        try:
            for entry_word, (key_node, child) in self.node.entries.items():
                if is_loop(entry_word):
                    self.loop(key_node, child, values_by_name, 1)
                elif entry_word in self.keys_of_loops:
                    self.entries[entry_word] = (
                        key_node,
                        _merge_exception(self.entries[entry_word][1], child),
                    )
                else:
                    self.entries[entry_word] = self.node.entries[entry_word]
        except _LoopError:
            pass
        self.node.document.loops[self.node.start] = self.n_nodes
        return replace(self.node, entries=self.entries)

    def add(self, word: str, key: Scalar, child: Node) -> None:
        """Add what a loop makes; what is written beside the loop, above or below, is an exception
        from it.
        """
        if word in self.keys_of_loops:
            message = (
                f"{quote(word)} is already made on line {self.keys_of_loops[word].place.line}; "
            )
            message += "two modules need two names, such as m(i) in a loop"
            self.collector.error("E102", message, key.place)
            return
        self.keys_of_loops[word] = key
        if word in self.entries:
            written_key, written_node = self.entries[word]
            self.entries[word] = written_key, _merge_exception(child, written_node)
        else:
            self.entries[word] = key, child

    def loop(self, key: Scalar, child: Node, names: Names, depth: int) -> None:
        """Write one loop or condition out."""
        if depth > MAX_INSIDE:
            self.refuse(f"loops stand at most {MAX_INSIDE} deep inside one another", key)
        if not isinstance(child, document.Mapping):
            message = f"below {quote(key.text)} names stand, each with what it is"
            if isinstance(child, Scalar) and child.is_empty:
                message = f"nothing is written below {quote(key.text)}; indent what belongs to it"
            self.collector.error("E106", message, key.place)
            self.collector.lacks_names = True
            return
        try:
            scopes_by_turn = list(self.loop_scopes(key.text, names))
        except TextError as error:
            self.report(error, key)
            self.collector.lacks_names = True
            return
        self.n_turns += 0 if key.text.startswith("if") else len(scopes_by_turn)
        if self.n_turns > MAX_TURNS:
            self.refuse(f"loops side by side have at most {MAX_TURNS:,} turns together", key)
        self.collector.loop(key.place, child.document.place(child.end))
        for scope in scopes_by_turn:
            self.body(child, scope, depth)

    def loop_scopes(self, text: str, names: Names) -> Iterator[Names]:
        """The values that names have in each turn. Raises TextError."""
        if text.startswith("if"):
            if is_true(text, 2, names):
                yield names
            return
        text_match = _FOR.fullmatch(text)
        if text_match is None:
            raise TextError(f"{quote(text)} is no loop; {SYNTAX}", length=len(text), code="E113")
        variable = text_match[1]
        if not variable[0].islower() or variable in UNITS:
            message = f"{quote(variable)} cannot be the variable of a loop; "
            message += "it begins with a small letter, and is no unit"
            raise TextError(message, offset=text_match.start(1), length=len(variable), code="E110")
        if variable in names:
            message = f"{quote(variable)} is named already; a loop needs a variable of its own"
            raise TextError(message, offset=text_match.start(1), length=len(variable), code="E102")
        first_number, last_number = (_integer(text_match, group, names) for group in (2, 3))
        step_amount = 1 if text_match[4] is None else _integer(text_match, 4, names)
        if step_amount < 1:
            message = "the step of a loop is 1 or more"
            raise TextError(
                message, offset=text_match.start(4), length=len(text_match[4]), code="E202"
            )
        turn_numbers = range(first_number, last_number + 1, step_amount)
        if len(turn_numbers) > MAX_TURNS:
            message = f"a loop has at most {MAX_TURNS:,} turns, not {len(turn_numbers):,}"
            raise TextError(message, offset=text_match.start(2), length=len(text), code="E105")
        for number in turn_numbers:
            yield names.new_child({variable: Amount(Fraction(number), "")})

    def body(self, body: document.Mapping, names: Names, depth: int) -> None:
        """Write out the nodes below a loop for one turn."""
        turn_copy = _NodeCopier(self, names)
        for entry_word, (name_node, child_node) in body.entries.items():
            if entry_word == "let" and isinstance(child_node, document.Mapping):
                turn_copy = _NodeCopier(self, self.named(child_node, turn_copy.names))
            elif is_loop(entry_word):
                self.loop(name_node, child_node, turn_copy.names, depth + 1)
            else:
                name_copy = turn_copy.scalar(name_node)
                if "(" not in name_copy.text:  # a name with a parenthesis was refused
                    self.add(name_copy.text, name_copy, turn_copy.node(child_node))

    def named(self, section: document.Mapping, names: Names) -> Names:
        """The values of a `let` below a loop, beside those that have names already."""
        inner_amounts = NamedAmounts(names.new_child(), [])
        for let_index, (let_word, (let_key, let_node)) in enumerate(section.entries.items()):
            if let_word in names:
                message = f"{quote(let_word)} is named already; give this value a name of its own"
                self.collector.error("E102", message, let_key.place)
                continue
            add_named(inner_amounts, let_index, let_word, let_key, let_node, section.entries)
        for scalar, error in inner_amounts.mistakes:
            self.report(error, scalar)
        return ChainMap(inner_amounts.names)

    def count_node(self, node: Node) -> None:
        """Count a node that is written out, and the length of its text."""
        self.n_nodes += 1
        if isinstance(node, Scalar):
            self.n_nodes += len(node.text) // _TEXT_COST
        if self.n_nodes + self.n_nodes_of_others > MAX_NODES:
            message = f"loops of this file write more than {MAX_NODES:,} values out"
            self.refuse(message + "; take a STRING, a PLATE or a BANK for large bodies", node)

    def report(self, error: TextError, node: Scalar) -> None:
        """Report a mistake in a text."""
        place = node.place_at(error.offset, error.length)
        self.collector.error(error.code, error.message, place, suggestion=error.suggestion)

    def refuse(self, message: str, node: Node) -> None:
        self.collector.error("E105", message, node.place)
        self.collector.lacks_names = True
        raise _LoopError


def _merge_exception(module_of_loop: Node, written_node: Node) -> Node:
    """A module of a loop with the fields of a written module of the same name and kind. A
    written module of another kind replaces it.
    """
    if not (
        isinstance(module_of_loop, document.Mapping) and isinstance(written_node, document.Mapping)
    ):
        return written_node
    if not written_node.entries.keys() <= module_of_loop.entries.keys():
        return written_node
    merged_entries = dict(module_of_loop.entries)
    for kind_name, (key_node, written_fields) in written_node.entries.items():
        looped_fields = merged_entries[kind_name][1]
        if isinstance(looped_fields, document.Mapping) and isinstance(
            written_fields, document.Mapping
        ):
            written_fields = replace(
                written_fields, entries={**looped_fields.entries, **written_fields.entries}
            )
        merged_entries[kind_name] = key_node, written_fields
    return replace(written_node, entries=merged_entries)


class _NodeCopier:
    """Copies of nodes in which names have values; each has the place of what it is a copy of."""

    def __init__(self, writer: _Writer, names: Names) -> None:
        self.writer = writer
        self.names = names
        self._documents: dict[Document, Document] = {}

    def node(self, node: Node) -> Node:
        if isinstance(node, Scalar):
            return self.scalar(node)
        self.writer.count_node(node)
        copied_document = self._document(node.document)
        if isinstance(node, document.Mapping):
            entries: Entries = {}
            for key, child in node.entries.values():
                key_copy = self.scalar(key)
                entries[key_copy.text] = key_copy, self.node(child)
            return document.Mapping(copied_document, node.start, node.end, entries)
        assert isinstance(node, document.Sequence)
        items = [self.node(item) for item in node.items]
        return document.Sequence(copied_document, node.start, node.end, items)

    def scalar(self, node: Scalar) -> Scalar:
        self.writer.count_node(node)
        scalar_text = node.text
        if "(" in scalar_text:
            try:
                scalar_text = _numbered(scalar_text, self.names)
            except TextError as error:
                self.writer.report(error, node)
        return replace(node, document=self._document(node.document), text=scalar_text)

    def _document(self, source: Document) -> Document:
        copy = self._documents.get(source)
        if copy is None:
            amounts_by_name = NamedAmounts(self.names, [])
            copy = self._documents[source] = replace(source, lets=amounts_by_name)
        return copy


def _numbered(name_text: str, known_names: Names) -> str:
    """A text in which `m(i+1)` is replaced by `m4`. Raises TextError."""
    pieces, text_offset = [], 0
    while (text_match := _NUMBERED.search(name_text, text_offset)) is not None:
        if text_match[1] in _FUNCTIONS:
            pieces.append(name_text[text_offset : text_match.end()])
            text_offset = text_match.end()
            continue
        closing_end = _closing(name_text, text_match.end())
        index_text = name_text[text_match.end() : closing_end]
        number = _number_of_name(name_text, text_match, index_text, known_names)
        pieces.append(f"{name_text[text_offset : text_match.end() - 1]}{number}")
        text_offset = closing_end + 1
    return "".join((*pieces, name_text[text_offset:]))


def _number_of_name(
    name_text: str, name_match: re.Match[str], index_expression: str, names: Names
) -> int:
    try:
        amount = evaluate(index_expression, names)
    except TextError as error:
        error.offset += name_match.end()
        raise
    amount_number = amount.number
    if amount.unit or amount_number.denominator != 1 or amount_number < 0:
        index_text = name_text[name_match.start() : name_match.end() + len(index_expression) + 1]
        message = f"the number of a name is a whole one, 0 or more, and {quote(index_text)} "
        message += f"has {amount.literal}"
        length = max(1, len(index_expression))
        raise TextError(message, offset=name_match.end(), length=length, code="E202")
    return int(amount_number)


def _closing(inner_text: str, text_start: int) -> int:
    """The index of the parenthesis that closes one before `text_start`. Raises TextError."""
    depth = 1
    for text_index in range(text_start, len(inner_text)):
        depth += (inner_text[text_index] == "(") - (inner_text[text_index] == ")")
        if depth == 0:
            return text_index
    raise TextError("this parenthesis is never closed", offset=text_start - 1, code="E201")


def _integer(loop_match: re.Match[str], group_index: int, known_names: Names) -> int:
    """The whole number that a part of `for i in 1..12 by 2` gives. Raises TextError."""
    try:
        amount = evaluate(loop_match[group_index], known_names)
    except TextError as error:
        error.offset += loop_match.start(group_index)
        raise
    if amount.unit or amount.number.denominator != 1:
        message = (
            f"a loop counts by whole numbers, and {quote(loop_match[group_index].strip())} is "
        )
        message += amount.literal
        length = len(loop_match[group_index])
        raise TextError(message, offset=loop_match.start(group_index), length=length, code="E202")
    return int(amount.number)
