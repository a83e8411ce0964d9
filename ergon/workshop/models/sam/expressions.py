"""Expressions of Faust as trees, as far as models of Synth-A-Modeler use them.

Infix operators bind tighter than `,`, and `,` binds tighter than `:`. `*(2)` alone is a function
that multiplies by 2; `_` is its input.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

from ergon.notation.text.errors import quote
from ergon.workshop.models.errors import ModelError
from ergon.workshop.models.sam.reading import Code

_TOKEN = re.compile(
    r"\s*(?:(?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)|(?P<name>[A-Za-z]\w*(?:\.[A-Za-z]\w*)?)"
    r'|(?P<text>"[^"]*")|(?P<sign><:|:>|[-+*/^%(),:_!~=;]))'
)
_LEVELS = ((":",), (",",), ("+", "-"), ("*", "/", "%"), ("^",))  # loosest first
_DEPTH_MAX, _TOKENS_MAX = 40, 20_000
_PLAIN_KINDS = {"number", "name", "chain", "negative"}


@dataclass(frozen=True, slots=True)
class Node:
    """A part of an expression, `kind`: number, text, name, call, chain, negative, partial, input.

    `word` is the number, the name, the text or the operator; a chain has an operator for each
    operand but the first. `text` is the whole part as written.
    """

    kind: str
    word: str
    parts: tuple[Node, ...] = ()
    operators: tuple[str, ...] = ()
    text: str = ""


@dataclass(frozen=True, slots=True)
class Definition:
    """A line `name(arguments) = expression;` of Faust; `comment` is the text after `//`."""

    name: str
    arguments: tuple[str, ...]
    text: str
    line: int
    comment: str = ""
    comments_before: tuple[str, ...] = ()


def parse(text: str, line: int) -> Node:
    """The tree of an expression. Raises ModelError."""
    return _Parser(text, line).read_all()


def is_plain(expression_node: Node) -> bool:
    """Whether an expression has only names, numbers and arithmetic, as expressions of a score
    do.
    """
    if expression_node.kind not in _PLAIN_KINDS or any(
        sign not in "+-*/" for sign in expression_node.operators
    ):
        return False
    return all(map(is_plain, expression_node.parts))


def names_in(node: Node) -> set[str]:
    """The names in an expression."""
    node_names = {node.word} if node.kind in ("name", "call") else set()
    return node_names.union(*map(names_in, node.parts))


class _Parser:
    def __init__(self, text: str, line: int) -> None:
        self.text, self.line, self.token_index, self.depth = text, line, 0, 0
        self.tokens: list[tuple[str, str]] = []
        position = 0
        while text[position:].strip():
            match = _TOKEN.match(text, position)
            if match is None or len(self.tokens) >= _TOKENS_MAX:
                unread_text = quote(text[position:].strip()[:20])
                raise ModelError(f"of Faust {unread_text} is not read here", line)
            self.tokens.append((str(match.lastgroup), match[0].strip()))
            position = match.end()

    def read_all(self) -> Node:
        if not self.tokens:
            raise ModelError("an expression is missing", self.line)
        full_node = self.read_level(0)
        if self.token_index < len(self.tokens):
            raise self.error()
        return full_node

    def error(self) -> ModelError:
        if self.token_index >= len(self.tokens):
            return ModelError(f"{quote(self.text.strip()[:60])} ends too early", self.line)
        token_text = self.tokens[self.token_index][1]
        message = f"{quote(token_text)} in {quote(self.text.strip()[:60])} is not read here"
        return ModelError(message, self.line)

    def next_sign(self) -> str:
        kind, word = (
            self.tokens[self.token_index] if self.token_index < len(self.tokens) else ("", "")
        )
        return word if kind == "sign" else ""

    def expect(self, expected: str) -> None:
        if self.next_sign() != expected:
            raise self.error()
        self.token_index += 1

    def read_level(self, level_index: int) -> Node:
        if level_index == len(_LEVELS):
            return self.read_primary()
        operands, operators = [self.read_level(level_index + 1)], []
        while self.next_sign() in _LEVELS[level_index] and self.next_sign():
            operators.append(self.next_sign())
            self.token_index += 1
            operands.append(self.read_level(level_index + 1))
        if not operators:
            return operands[0]
        return Node("chain", "", tuple(operands), tuple(operators))

    def read_primary(self) -> Node:
        if self.token_index >= len(self.tokens):
            raise self.error()
        kind, word = self.tokens[self.token_index]
        self.depth += 1
        if self.depth > _DEPTH_MAX:
            message = f"more than {_DEPTH_MAX} parentheses or signs inside one another"
            raise ModelError(message, self.line)
        self.token_index += 1
        if kind == "number":
            node = Node("number", word)
        elif kind == "text":
            node = Node("text", word[1:-1])
        elif kind == "name":
            node = (
                Node("call", word, self.read_arguments())
                if self.next_sign() == "("
                else Node(kind, word)
            )
        elif word == "_":
            node = Node("input", word)
        elif word == "(":
            node = self.read_level(0)
            self.expect(")")
        elif word in ("+", "-", "*", "/", "^") and self.next_sign() == "(":
            node = Node("partial", word, self.read_arguments())
        elif word == "-":
            node = Node("negative", word, (self.read_primary(),))
        else:
            self.token_index -= 1
            raise self.error()
        self.depth -= 1
        return node

    def read_arguments(self) -> tuple[Node, ...]:
        self.expect("(")
        argument_nodes = []
        while True:
            # A comma separates arguments here, so an argument has no comma outside parentheses.
            first_index = self.token_index
            argument_parts, operators = [self.read_level(2)], []
            while self.next_sign() == ":":
                operators.append(":")
                self.token_index += 1
                argument_parts.append(self.read_level(2))
            node = (
                argument_parts[0]
                if not operators
                else Node("chain", "", tuple(argument_parts), tuple(operators))
            )
            text = " ".join(word for _, word in self.tokens[first_index : self.token_index])
            argument_nodes.append(replace(node, text=text))
            if self.next_sign() != ",":
                break
            self.token_index += 1
        self.expect(")")
        return tuple(argument_nodes)


# --- definitions --------------------------------------------------------------------------------

_DEFINED = re.compile(
    r"\s*([A-Za-z]\w*)\s*(?:\(([A-Za-z]\w*(?:\s*,\s*[A-Za-z]\w*)*)\s*\))?\s*=(.*)"
)


def parse_definitions(code: Sequence[Code]) -> dict[str, Definition]:
    """Lines of Faust by the names that they define. Raises ModelError.

    Expressions are parsed when they are needed, so that Faust code that nothing uses cannot
    fail.
    """
    definition_by_name: dict[str, Definition] = {}
    unread_text, first_line = "", 0
    comments_before: tuple[str, ...] = ()
    for code_line in code:
        code_text, comment = _without_comment(code_line.text)
        code_parts = code_text.split(";")
        for part_index, code_part in enumerate(code_parts):
            if not unread_text.strip():
                first_line, comments_before = (
                    code_line.line,
                    code_line.comments_before if part_index == 0 else (),
                )
            unread_text += code_part + " "
            if part_index + 1 == len(code_parts):
                break
            if not unread_text.strip():
                continue
            match = _DEFINED.fullmatch(unread_text)
            if match is None:
                raise ModelError(
                    "a line of Faust is written faustcode: name = expression;", first_line
                )
            name, argument_text, expression_text = (match[1], match[2], match[3].strip())
            if name in definition_by_name:
                message = f"{quote(name)} is defined in line {definition_by_name[name].line} too"
                raise ModelError(message, first_line)
            arguments = (
                tuple(word.strip() for word in argument_text.split(",")) if argument_text else ()
            )
            definition_by_name[name] = Definition(
                name, arguments, expression_text, first_line, comment, comments_before
            )
            unread_text = ""
    if unread_text.strip():
        raise ModelError("a line of Faust ends with a semicolon", first_line)
    return definition_by_name


def _without_comment(line: str) -> tuple[str, str]:
    code, slashes, comment = line.partition("//")
    return (code, comment.strip()) if slashes else (line, "")
