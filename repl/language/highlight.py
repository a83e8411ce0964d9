"""The kind of each word of a line, for colours; no meaning depends on a colour alone."""

from __future__ import annotations

import re
from collections.abc import Iterator

from ergon.repl.language import verbs
from ergon.repl.language.lines import MAX_LINE, comment_start
from ergon.repl.language.parse import first_error
from ergon.repl.language.scope import Scope
from ergon.repl.language.values import RESERVED_WORDS
from ergon.scores.gesture.points import CURVES

Token = tuple[int, int, str]  # start, end, kind

_WORD_PATTERN = re.compile(r"[^\s,]+")
_NUMBER_PATTERN = re.compile(
    r"(?P<number>(?:(?<![\w.])|(?<=\bx))[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?(?:/\d+)?)"
    r"(?P<unit>[^\W\d_][\w/%]*)?"
)
_SCOPE_FIELDS = (
    *("players", "gestures", "takes", "keys", "marks", "instruments", "targets", "blocks"),
    *("available", "families"),
)


def highlighted_tokens(submitted_text: str, scope: Scope) -> list[Token]:
    """Spans and their kinds, in order and without overlap.

    Kinds are verb, name, option, curve, number, unit, comment, and unknown for what would be
    refused. Raises nothing.
    """
    if len(submitted_text) > MAX_LINE:
        return []
    lexical_tokens = list(_lexical_tokens(submitted_text, scope))
    error = first_error(submitted_text, scope)
    if error is not None and submitted_text[error.offset : error.offset + error.length].strip():
        error_start, error_end = error.offset, error.offset + error.length
        lexical_tokens = [
            token for token in lexical_tokens if token[1] <= error_start or token[0] >= error_end
        ]
        lexical_tokens.append((error_start, error_end, "unknown"))
    return sorted(lexical_tokens)


def _lexical_tokens(text: str, scope: Scope) -> Iterator[Token]:
    line_offset = 0
    for text_line in text.split("\n"):
        code_end = comment_start(text_line)
        word_matches = list(_WORD_PATTERN.finditer(text_line, 0, code_end))
        verb_index = _verb_index(word_matches, scope)
        for word_index, word_match in enumerate(word_matches):
            if word_index == verb_index:
                yield line_offset + word_match.start(), line_offset + word_match.end(), "verb"
            elif verb_index == 0 and word_matches[0].group() == "py":
                break
            else:
                for word_start, word_end, token_kind in _word_tokens(word_match.group(), scope):
                    yield (
                        line_offset + word_match.start() + word_start,
                        line_offset + word_match.start() + word_end,
                        token_kind,
                    )
        if code_end < len(text_line):
            yield line_offset + code_end, line_offset + len(text_line), "comment"
        line_offset += len(text_line) + 1


def _verb_index(word_matches: list[re.Match[str]], scope: Scope) -> int:
    """The index of the verb; -1 if there is none yet."""
    if not word_matches:
        return -1
    first_word, second_word = (
        word_matches[0].group(),
        word_matches[1].group() if len(word_matches) > 1 else "",
    )
    if second_word == "=" or (
        first_word in scope.players and verbs.verbs_matching(second_word, verbs.SUBJECT_VERBS)
    ):
        return 1
    return 0 if len(verbs.verbs_matching(first_word, verbs.LEADING_VERBS)) == 1 else -1


def _word_tokens(line_word: str, scope: Scope) -> Iterator[Token]:
    if line_word in CURVES:
        yield 0, len(line_word), "curve"
    elif any(line_word in getattr(scope, section_name) for section_name in _SCOPE_FIELDS):
        yield 0, len(line_word), "name"
    elif line_word in RESERVED_WORDS:
        yield 0, len(line_word), "option"
    else:
        for word_match in _NUMBER_PATTERN.finditer(line_word):
            yield word_match.start("number"), word_match.end("number"), "number"
            if word_match["unit"]:
                yield word_match.start("unit"), word_match.end("unit"), "unit"
