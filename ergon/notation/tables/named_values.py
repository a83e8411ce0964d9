"""Values of `let:` by name, and texts in which names and arithmetic stand for values."""

from __future__ import annotations

import re
from collections.abc import Callable, Container, Mapping, MutableMapping
from dataclasses import dataclass
from decimal import Decimal
from typing import TypeVar

from ergon.notation.tables.expressions import UNITS, WORD, Amount, evaluate, looks_like
from ergon.notation.text import document
from ergon.notation.text.document import Document, Node, Scalar
from ergon.notation.text.errors import TextError, quote
from ergon.notation.text.spelling import nearest

_T = TypeVar("_T")
MAX_NAMES = 1_000
_NAME = re.compile(r"[a-z_][A-Za-z0-9_]*")
_OPERAND = re.compile(r"\.\.|(?:(?!\.\.)[^\s()@|,;#])+")  # a word of a notation
_SUM_PATTERN = re.compile(
    r"\s*(\d+\|[\d./]+|[^\W\d]\w*(?:-[^\W\d]\w*)*)\s*([+-])(.+)"
)  # B+2, 3|1-gap
_BAR_BEAT = re.compile(r"\s*\d+\|[\d./]+\s*")
_MARKED = re.compile(r"\s*([^\W\d]\w*(?:-[^\W\d]\w*)*)")
_PATH = re.compile(r"[A-Za-z_]\w*(\.[^\s.()*/]+)+")  # a member or a module, such as bell.m
_SIGNS_OF_WORDS = re.compile(r"[*/(]|\w\+\d")  # no name has these


@dataclass(slots=True)
class NamedAmounts:
    """The named values of a document, and what is wrong with them."""

    names: MutableMapping[str, Amount]
    mistakes: list[tuple[Scalar, TextError]]


def named_amounts(source_document: Document) -> NamedAmounts:
    """The values that `let:` of a document names; read once."""
    if source_document.lets is None:
        root, let_node = source_document.root, source_document.let
        if let_node is None and isinstance(root, document.Mapping) and "let" in root.entries:
            let_node = root.entries["let"][1]
        source_document.lets = (
            _read_amounts(let_node)
            if isinstance(let_node, document.Mapping)
            else NamedAmounts({}, [])
        )
    amounts_by_name: NamedAmounts = source_document.lets
    return amounts_by_name


def _read_amounts(let_section: document.Mapping) -> NamedAmounts:
    amounts_by_name = NamedAmounts({}, [])
    for number, (word, (key, node)) in enumerate(let_section.entries.items()):
        if not add_named(amounts_by_name, number, word, key, node, let_section.entries):
            break
    return amounts_by_name


def add_named(
    amounts_by_name: NamedAmounts,
    name_index: int,
    value_name: str,
    key_node: Scalar,
    value_node: Node,
    all_names: Container[str],
) -> bool:
    """Add a name of `let:`, or what is wrong with it; False after the last one that is allowed.

    `name_index` is the number of earlier names; `all_names` are those of the section.
    """
    error: TextError | None = None
    if name_index >= MAX_NAMES:
        message = f"`let:` has more than {MAX_NAMES:,} names"
        error = TextError(message, length=len(value_name), code="E105")
    elif not _NAME.fullmatch(value_name) or value_name in UNITS or len(value_name) > 64:
        message = (
            f"{quote(value_name)} cannot be the name of a value; write a small letter, then "
            "letters, "
            "digits and _, and no unit"
        )
        error = TextError(message, length=len(value_name), code="E110")
    elif not isinstance(value_node, Scalar):
        message = f"{value_name}: one value or expression is expected, such as 400g or 2*heavy"
        error = TextError(message, length=len(value_name), code="E104")
    if error is not None or not isinstance(value_node, Scalar):
        assert error is not None
        amounts_by_name.mistakes.append((key_node, error))
        return name_index < MAX_NAMES
    if _BAR_BEAT.fullmatch(value_node.text):
        message = f"{quote(value_node.text.strip())} is a position; name it under `marks:`"
        error = TextError(message, length=len(value_node.text), code="E201")
        amounts_by_name.mistakes.append((value_node, error))
        return True
    try:
        amounts_by_name.names[value_name] = evaluate(
            value_node.text, amounts_by_name.names, all_names
        )
    except TextError as problem:
        amounts_by_name.mistakes.append((value_node, problem))
    return True


def parse_with_names(text_node: Scalar, parse: Callable[[str], _T]) -> _T:
    """Read a text of several words, in which names of `let:` may stand for values.

    The text is parsed as written; if that fails, words such as `low`, `low@2` or `2*low` are
    replaced by their values and it is parsed again. Raises TextError with the characters at
    fault, as written.
    """
    try:
        return parse(text_node.text)
    except TextError as plain_error:
        pieces = _replaced(text_node.text, named_amounts(text_node.document).names)
        if len(pieces) < 2:
            raise
        try:
            return parse("".join(text for _, text in pieces))
        except TextError as error:
            pieces_with_spans, replaced_end = [], 0
            for written, replacement in pieces:
                pieces_with_spans.append(
                    (replaced_end, replaced_end + len(replacement), written, replacement)
                )
                replaced_end += len(replacement)
            written_begin = 0
            for begin, end, written, replacement in pieces_with_spans:
                if begin <= error.offset < end or end == replaced_end:
                    offset_in_piece = error.offset - begin if written == replacement else 0
                    fault_length = len(written) if written != replacement else error.length
                    error.offset, error.length = (
                        written_begin + offset_in_piece,
                        max(1, fault_length),
                    )
                    raise error from plain_error
                written_begin += len(written)
            raise


def has_name(word: str, document: Document) -> bool:
    """Whether a word contains a name of `let:`."""
    names = named_amounts(document).names
    return any(part in names for part in WORD.findall(word))


def is_computed(typed_word: str, document: Document) -> bool:
    """Whether a word of a table is an expression: it holds a name of `let:` or an operator."""
    if _PATH.fullmatch(typed_word):
        return False
    return has_name(typed_word, document) or _SIGNS_OF_WORDS.search(typed_word) is not None


def word_value(table_word: str, document: Document, parse: Callable[[str], _T]) -> _T:
    """Read one word of a table, for which an expression may stand. Raises TextError."""
    try:
        return parse(table_word)
    except TextError as plain_error:
        known_names = named_amounts(document).names
        if not is_computed(table_word, document):
            plain_error.suggestion = plain_error.suggestion or nearest(table_word, known_names)
            raise
        literal = evaluate(table_word, known_names).literal
    try:
        return parse(literal)
    except TextError as error:
        message = f"{quote(table_word)} is {literal}: {error.message}"
        raise TextError(message, length=len(table_word), code=error.code) from None


def position(position_text: str, document: Document, parse: Callable[[str], _T]) -> _T:
    """Read a position. Names of `let:` may stand in it for beats and lengths, unless a mark has the
    same name.

    Raises TextError.
    """
    known_names = named_amounts(document).names
    sum_match = _SUM_PATTERN.fullmatch(position_text)
    try:
        parsed_position = parse(position_text)
        if getattr(parsed_position, "mark", None) not in known_names or _is_mark(
            position_text, document
        ):
            return parsed_position
    except TextError:
        is_name_meant = (
            known_names and sum_match is not None and sum_match[3].lstrip()[:1].isalpha()
        )
        if not (
            has_name(position_text, document) or is_name_meant or re.search(r"[*(]", position_text)
        ):
            raise
    if sum_match is None or (sum_match[1] in known_names and not _is_mark(position_text, document)):
        literal = evaluate(position_text, known_names).literal
    else:
        try:
            added_length = evaluate(sum_match[3], known_names)
        except TextError as error:
            error.offset += sum_match.start(3)
            raise
        sign = "+" if (sum_match[2] == "+") == (added_length.number >= 0) else "-"
        literal = (
            f"{sum_match[1]}{sign}{Amount(abs(added_length.number), added_length.unit).literal}"
        )
    try:
        return parse(literal)
    except TextError as error:
        message = f"{quote(position_text.strip())} is {literal}: {error.message}"
        raise TextError(message, length=max(1, len(position_text)), code=error.code) from None


def _is_mark(text: str, source: Document) -> bool:
    """Whether a position begins with a mark of its own file."""
    root, mark_match = source.root, _MARKED.match(text)
    marks = root.entries.get("marks") if isinstance(root, document.Mapping) else None
    known_marks = marks[1] if marks is not None else None
    return (
        mark_match is not None
        and isinstance(known_marks, document.Mapping)
        and mark_match[1] in known_marks.entries
    )


def note_of(note_word: str, document: Document) -> str | None:
    """The note that a word of a table gives, if it is an expression. Raises TextError."""
    if not is_computed(note_word, document):
        return None
    amount = evaluate(note_word, named_amounts(document).names)
    return amount.literal if amount.unit == "note" else None


def _replaced(written_text: str, known_names: Mapping[str, Amount]) -> list[tuple[str, str]]:
    """Pieces of a text: as written, and with names of values replaced. Raises TextError."""
    pieces, copied_end = [], 0
    for operand_match in _OPERAND.finditer(written_text):
        if any(word in known_names for word in WORD.findall(operand_match.group())):
            try:
                literal = evaluate(operand_match.group(), known_names).literal
            except TextError as error:
                error.offset += operand_match.start()
                raise
            pieces += [
                (written_text[copied_end : operand_match.start()],) * 2,
                (operand_match.group(), literal),
            ]
            copied_end = operand_match.end()
    return [*pieces, (written_text[copied_end:],) * 2]


def percent(literal: str) -> str:
    """A plain number as a percentage, for fields that take nothing else."""
    number = Decimal(literal) if re.fullmatch(r"-?\d+(\.\d+)?", literal) else None
    return literal if number is None else f"{(100 * number).normalize():f}%"


def literal(text_node: Scalar) -> str | None:
    """The literal that the expression in a node gives; None if the node is not an expression.
    Raises TextError.
    """
    known_names = named_amounts(text_node.document).names
    node_text = text_node.text
    if not looks_like(node_text, known_names):
        return None
    low_text, dots, high_text = node_text.partition("..")
    if not dots:
        return evaluate(node_text, known_names).literal
    first_literal = evaluate(low_text, known_names).literal
    try:
        return f"{first_literal}..{evaluate(high_text, known_names).literal}"
    except TextError as error:
        error.offset += len(low_text) + 2
        raise
