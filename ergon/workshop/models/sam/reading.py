"""Reads a text into the statements of Synth-A-Modeler and its lines of Faust, with their
comments.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field

from ergon.notation.text.errors import quote
from ergon.notation.text.spelling import nearest
from ergon.workshop.models.errors import ModelError
from ergon.workshop.models.sam.words import CODE, LINKS, MASSES, OUTPUTS, REFUSED, WORDS, usage

LINES_MAX = 200_000  # lines
_CHARACTERS_MAX = 100_000  # longest line
_LINE_END = re.compile(r"\r\n|\r|\n")
_STATEMENT_HEAD = re.compile(r"\s*([A-Za-z]\w*)\s*([(,:])")
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9]*")
_LAYOUT = re.compile(r"#*\s*(pos\s+-?\d|v\d|$)")  # where a drawing has it; of which version it is
_DRAWN_COMMENT = re.compile(r'#+\s*comment\("([^"]*)"')  # a text in the drawing


@dataclass(frozen=True, slots=True)
class Statement:
    """A line: its word, values as written, its name, the masses that it joins; comments before and
    after it.
    """

    word: str
    values: tuple[str, ...]
    name: str
    ends: tuple[str, ...]
    line: int
    comments_before: tuple[str, ...] = ()
    comment: str = ""


@dataclass(frozen=True, slots=True)
class Code:
    """A line of Faust, and the comments before it."""

    text: str
    line: int
    comments_before: tuple[str, ...] = ()


@dataclass(slots=True)
class Sheet:
    """The content of a text; `header` are the comments at its beginning, `footer` those
    at its end.
    """

    header: list[str] = field(default_factory=list)
    statements: list[Statement] = field(default_factory=list)
    code: list[Code] = field(default_factory=list)
    footer: list[str] = field(default_factory=list)


def ports(sheet: Sheet) -> list[str]:
    """The names of ports, which files may drive."""
    return [statement.name for statement in sheet.statements if statement.word == "port"]


def parse(text: str) -> Sheet:
    """The statements of a model. Raises ModelError with the line at fault."""
    sheet = Sheet()
    comments: list[str] = []
    lines = _LINE_END.split(text)
    if len(lines) > LINES_MAX:
        raise ModelError(f"it has more than {LINES_MAX:,} lines", LINES_MAX + 1)
    has_begun = False
    lines_by_name: dict[str, int] = {}
    for line_number, line in enumerate(lines, 1):
        if len(line) > _CHARACTERS_MAX:
            raise ModelError(f"a line has at most {_CHARACTERS_MAX:,} characters", line_number)
        code_text, comment = _split_comment(line)
        if not code_text.strip():
            comments += _comment_lines(comment)
            if comments and not comment and not has_begun:  # an empty line ends the head
                sheet.header += [*comments, ""]
                comments = []
            continue
        has_begun = True
        head_match = _STATEMENT_HEAD.match(code_text)
        if head_match and head_match[1] == CODE and head_match[2] == ":":
            sheet.code.append(Code(code_text[head_match.end() :], line_number, tuple(comments)))
            comments = []
            continue
        statement = _parse_statement(
            code_text, line_number, tuple(comments), " ".join(_comment_lines(comment))
        )
        comments = []
        if statement.name in lines_by_name:
            message = (
                f"{quote(statement.name)} is the name of line {lines_by_name[statement.name]} too"
            )
            raise ModelError(message, line_number)
        lines_by_name[statement.name] = line_number
        sheet.statements.append(statement)
    sheet.footer = comments
    if not sheet.statements:
        raise ModelError("it has no statement of Synth-A-Modeler", len(lines))
    return sheet


def _split_comment(sheet_line: str) -> tuple[str, str]:
    """A line's code, and the comment after it; a `#` within quotes does not begin a comment."""
    is_quoted = False
    for letter_index, letter in enumerate(sheet_line):
        if letter == '"':
            is_quoted = not is_quoted
        elif letter == "#" and not is_quoted:
            return sheet_line[:letter_index], sheet_line[letter_index:]
    return sheet_line, ""


def _comment_lines(comment: str) -> list[str]:
    """The lines of a comment that a person wrote, without the layout of a drawing."""
    if drawn_match := _DRAWN_COMMENT.match(comment):
        return [line for line in drawn_match[1].split("|") if line.strip()]
    if not comment or _LAYOUT.match(comment):
        return []
    return [comment.lstrip("#").strip()]


def _parse_statement(
    code_text: str, line: int, comments_before: tuple[str, ...], comment: str
) -> Statement:
    head = _STATEMENT_HEAD.match(code_text)
    word = head[1] if head else code_text.split(None, 1)[0].strip(",;(")
    if word in REFUSED:
        raise ModelError(f"{word}: {REFUSED[word]}", line)
    if word not in WORDS:
        message = f"{quote(word)} is not a word of Synth-A-Modeler"
        raise ModelError(message, line, nearest(word, WORDS))
    if not code_text.rstrip().endswith(";"):
        raise ModelError("a statement ends with a semicolon", line)
    form_error = ModelError(f"{word} is written {usage(word)}", line)
    if head is None or (head[2] == ",") != (word in OUTPUTS) or head[2] == ":":
        raise form_error
    argument_text = code_text.rstrip()[:-1][head.end() :]
    if word in OUTPUTS:
        name, comma, expression = argument_text.partition(",")
        if not comma:
            raise form_error
        return Statement(
            word, (expression.strip(),), _name(name, line), (), line, comments_before, comment
        )
    values_text, is_closed, names_text = _split_at_close(argument_text)
    if not is_closed:
        raise ModelError("a parenthesis is not closed", line)
    values = tuple(_split_values(values_text)) if values_text.strip() else ()
    value_names = MASSES.get(word, LINKS.get(word, ()))
    has_all_values = len(values) == len(value_names)
    if word == "resonators":
        if len(values) == 1:  # a list in parentheses of its own
            content, _, text_after = _split_at_close(values[0].strip()[1:])
            if values[0].strip().startswith("(") and not text_after.strip():
                values = tuple(_split_values(content))
        has_all_values = len(values) > 0 and len(values) % len(value_names) == 0
    n_names = 3 if word in LINKS else 1
    names = names_text.split(",")
    if "(" in names[-1] and has_all_values:
        message = f"the group {names[-1].strip()} says nothing any more; leave it out"
        raise ModelError(message, line)
    if not has_all_values or names[0].strip() or len(names) != n_names + 1:
        raise form_error
    if not all(value.strip() for value in values):
        raise form_error
    name, *end_names = (_name(name_text, line) for name_text in names[1:])
    return Statement(
        word,
        tuple(v.strip() for v in values),
        name,
        tuple(end_names),
        line,
        comments_before,
        comment,
    )


def _name(text: str, line_number: int) -> str:
    stripped_name = text.strip()
    if not _NAME.fullmatch(stripped_name):
        raise ModelError(
            f"{quote(stripped_name)} is not a name: a letter, then letters and digits", line_number
        )
    return stripped_name


def _split_at_close(call_text: str) -> tuple[str, bool, str]:
    """The text before the closing parenthesis, whether there is one, and the text after it."""
    depth = 1
    for letter_index, letter in enumerate(call_text):
        depth += (letter == "(") - (letter == ")")
        if depth == 0:
            return call_text[:letter_index], True, call_text[letter_index + 1 :]
    return call_text, False, ""


def _split_values(values_text: str) -> Iterator[str]:
    """The values between commas, except commas within parentheses."""
    depth, part_start = 0, 0
    for letter_index, letter in enumerate(values_text):
        depth += (letter == "(") - (letter == ")")
        if letter == "," and depth == 0:
            yield values_text[part_start:letter_index]
            part_start = letter_index + 1
    yield values_text[part_start:]
