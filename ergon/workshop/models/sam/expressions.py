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
    before: tuple[str, ...] = ()


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


def names(node: Node) -> set[str]:
    """The names in an expression."""
    node_names = {node.word} if node.kind in ("name", "call") else set()
    return node_names.union(*map(names, node.parts))


class _Parser:
    def __init__(self, expression_text: str, line_number: int) -> None:
        self.text, self.line, self.index, self.depth = expression_text, line_number, 0, 0
        self.tokens: list[tuple[str, str]] = []
        match_position = 0
        while expression_text[match_position:].strip():
            token_match = _TOKEN.match(expression_text, match_position)
            if token_match is None or len(self.tokens) >= _TOKENS_MAX:
                unread_text = quote(expression_text[match_position:].strip()[:20])
                raise ModelError(f"of Faust {unread_text} is not read here", line_number)
            self.tokens.append((str(token_match.lastgroup), token_match[0].strip()))
            match_position = token_match.end()

    def read_all(self) -> Node:
        if not self.tokens:
            raise ModelError("an expression is missing", self.line)
        full_node = self.level(0)
        if self.index < len(self.tokens):
            raise self.wrong()
        return full_node

    def wrong(self) -> ModelError:
        if self.index >= len(self.tokens):
            return ModelError(f"{quote(self.text.strip()[:60])} ends too early", self.line)
        token_text = self.tokens[self.index][1]
        message = f"{quote(token_text)} in {quote(self.text.strip()[:60])} is not read here"
        return ModelError(message, self.line)

    def sign(self) -> str:
        kind, word = self.tokens[self.index] if self.index < len(self.tokens) else ("", "")
        return word if kind == "sign" else ""

    def take(self, expected: str) -> None:
        if self.sign() != expected:
            raise self.wrong()
        self.index += 1

    def level(self, nth: int) -> Node:
        if nth == len(_LEVELS):
            return self.primary()
        operand_nodes, operators = [self.level(nth + 1)], []
        while self.sign() in _LEVELS[nth] and self.sign():
            operators.append(self.sign())
            self.index += 1
            operand_nodes.append(self.level(nth + 1))
        if not operators:
            return operand_nodes[0]
        return Node("chain", "", tuple(operand_nodes), tuple(operators))

    def primary(self) -> Node:
        if self.index >= len(self.tokens):
            raise self.wrong()
        token_kind, token_word = self.tokens[self.index]
        self.depth += 1
        if self.depth > _DEPTH_MAX:
            message = f"more than {_DEPTH_MAX} parentheses or signs inside one another"
            raise ModelError(message, self.line)
        self.index += 1
        if token_kind == "number":
            parsed_node = Node("number", token_word)
        elif token_kind == "text":
            parsed_node = Node("text", token_word[1:-1])
        elif token_kind == "name":
            parsed_node = (
                Node("call", token_word, self.arguments())
                if self.sign() == "("
                else Node(token_kind, token_word)
            )
        elif token_word == "_":
            parsed_node = Node("input", token_word)
        elif token_word == "(":
            parsed_node = self.level(0)
            self.take(")")
        elif token_word in ("+", "-", "*", "/", "^") and self.sign() == "(":
            parsed_node = Node("partial", token_word, self.arguments())
        elif token_word == "-":
            parsed_node = Node("negative", token_word, (self.primary(),))
        else:
            self.index -= 1
            raise self.wrong()
        self.depth -= 1
        return parsed_node

    def arguments(self) -> tuple[Node, ...]:
        self.take("(")
        argument_nodes = []
        while True:
            # A comma separates arguments here, so an argument has no comma outside parentheses.
            first_index = self.index
            argument_parts, operators = [self.level(2)], []
            while self.sign() == ":":
                operators.append(":")
                self.index += 1
                argument_parts.append(self.level(2))
            node = (
                argument_parts[0]
                if not operators
                else Node("chain", "", tuple(argument_parts), tuple(operators))
            )
            text = " ".join(word for _, word in self.tokens[first_index : self.index])
            argument_nodes.append(replace(node, text=text))
            if self.sign() != ",":
                break
            self.index += 1
        self.take(")")
        return tuple(argument_nodes)


# --- definitions --------------------------------------------------------------------------------

_DEFINED = re.compile(
    r"\s*([A-Za-z]\w*)\s*(?:\(([A-Za-z]\w*(?:\s*,\s*[A-Za-z]\w*)*)\s*\))?\s*=(.*)"
)


def definitions(code: Sequence[Code]) -> dict[str, Definition]:
    """Lines of Faust by the names that they define. Raises ModelError.

    Expressions are parsed when they are needed, so that Faust code that nothing uses cannot
    fail.
    """
    by_name: dict[str, Definition] = {}
    waiting, first_line = "", 0
    comments_before: tuple[str, ...] = ()
    for code_line in code:
        source, comment = _without_comment(code_line.text)
        code_parts = source.split(";")
        for nth, code_part in enumerate(code_parts):
            if not waiting.strip():
                first_line, comments_before = code_line.line, code_line.before if nth == 0 else ()
            waiting += code_part + " "
            if nth + 1 == len(code_parts):
                break
            if not waiting.strip():
                continue
            defined = _DEFINED.fullmatch(waiting)
            if defined is None:
                raise ModelError(
                    "a line of Faust is written faustcode: name = expression;", first_line
                )
            defined_name, argument_text, definition_text = (
                defined[1],
                defined[2],
                defined[3].strip(),
            )
            if defined_name in by_name:
                message = (
                    f"{quote(defined_name)} is defined in line {by_name[defined_name].line} too"
                )
                raise ModelError(message, first_line)
            split = (
                tuple(word.strip() for word in argument_text.split(",")) if argument_text else ()
            )
            by_name[defined_name] = Definition(
                defined_name, split, definition_text, first_line, comment, comments_before
            )
            waiting = ""
    if waiting.strip():
        raise ModelError("a line of Faust ends with a semicolon", first_line)
    return by_name


def _without_comment(line: str) -> tuple[str, str]:
    code, slashes, comment = line.partition("//")
    return (code, comment.strip()) if slashes else (line, "")
