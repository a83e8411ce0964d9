"""Completion: words that would be accepted next, each with a hint."""

from __future__ import annotations

import re

from ergon.notation.text.errors import TextError
from ergon.repl.language.grammar import Hints, read_command
from ergon.repl.language.lines import MAX_LINE, Line, comment_start, is_continued, submitted_lines
from ergon.repl.language.scope import Scope
from ergon.repl.session_protocol import Suggestion

MAX_SUGGESTIONS = 200  # entries of a menu

_SEPARATOR_PATTERN = re.compile(r"[\s,(?]")  # a comma, a bracket and a question mark separate words


def complete(text: str, cursor: int, scope: Scope) -> list[Suggestion]:
    """Completions of the word before the cursor. Raises nothing."""
    text_before = text[:cursor]
    statement_start = _statement_start(text_before)
    if len(text_before) - statement_start > MAX_LINE or _is_in_comment(text_before):
        return []
    word_start = max(
        (match.end() for match in _SEPARATOR_PATTERN.finditer(text_before, statement_start)),
        default=statement_start,
    )
    hints = Hints(text_before[word_start:])
    try:
        line = next(submitted_lines(text_before[statement_start:word_start]), Line("", 0))
        read_command(line, scope, hints)
    except TextError:
        pass  # offer what was found before the mistake
    typed_beginning = hints.typed.lower()
    suggestions: dict[str, Suggestion] = {}
    for completion in hints.completions:
        if completion.text.lower().startswith(typed_beginning) and completion.text != hints.typed:
            suggestions.setdefault(
                completion.text, Suggestion(completion.text, word_start, completion.hint)
            )
    return list(suggestions.values())[:MAX_SUGGESTIONS]


def _statement_start(text_before: str) -> int:
    """The beginning of the line at the cursor, together with the lines above that continue into
    it.
    """
    line_start = text_before.rfind("\n") + 1
    while line_start > 0 and len(text_before) - line_start <= MAX_LINE:
        line_above_start = text_before.rfind("\n", 0, line_start - 1) + 1
        if not is_continued(text_before[line_above_start : line_start - 1]):
            break
        line_start = line_above_start
    return line_start


def _is_in_comment(line_head: str) -> bool:
    line = line_head[line_head.rfind("\n") + 1 :]
    return comment_start(line) < len(line)
