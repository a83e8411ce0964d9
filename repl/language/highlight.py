"""The kind of each word of a line, for colours; no meaning depends on a colour alone."""

from __future__ import annotations

import re
from collections.abc import Iterator

from ergon.repl.language import verbs
from ergon.repl.language.lines import MAX_LINE, comment_start
from ergon.repl.language.parse import first_error
from ergon.repl.language.scope import Scope
from ergon.repl.language.values import RESERVED
from ergon.scores.gesture.points import CURVES

Token = tuple[int, int, str]  # start, end, kind

_WORD = re.compile(r"[^\s,]+")
_NUMBER = re.compile(
    r"(?P<number>(?:(?<![\w.])|(?<=\bx))[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?(?:/\d+)?)"
    r"(?P<unit>[^\W\d_][\w/%]*)?"
)
_PARTS = (
    *("players", "gestures", "takes", "keys", "marks", "instruments", "targets", "blocks"),
    *("available", "families"),
)


def tokens(text: str, scope: Scope) -> list[Token]:
    """Spans and their kinds, in order and without overlap.

    Kinds are verb, name, option, curve, number, unit, comment, and unknown for what would be
    refused. Raises nothing.
    """
    if len(text) > MAX_LINE:
        return []
    lexical = list(_lexical(text, scope))
    error = first_error(text, scope)
    if error is not None and text[error.offset : error.offset + error.length].strip():
        start, end = error.offset, error.offset + error.length
        lexical = [t for t in lexical if t[1] <= start or t[0] >= end]
        lexical.append((start, end, "unknown"))
    return sorted(lexical)


def _lexical(text: str, scope: Scope) -> Iterator[Token]:
    offset = 0
    for line in text.split("\n"):
        end = comment_start(line)
        words = list(_WORD.finditer(line, 0, end))
        verb = _verb(words, scope)
        for i, word in enumerate(words):
            if i == verb:
                yield offset + word.start(), offset + word.end(), "verb"
            elif verb == 0 and words[0].group() == "py":
                break
            else:
                for start, stop, kind in _kinds(word.group(), scope):
                    yield offset + word.start() + start, offset + word.start() + stop, kind
        if end < len(line):
            yield offset + end, offset + len(line), "comment"
        offset += len(line) + 1


def _verb(words: list[re.Match[str]], scope: Scope) -> int:
    """The index of the verb; -1 if there is none yet."""
    if not words:
        return -1
    first, second = words[0].group(), words[1].group() if len(words) > 1 else ""
    if second == "=" or (
        first in scope.players and verbs.verbs_matching(second, verbs.SUBJECT_VERBS)
    ):
        return 1
    return 0 if len(verbs.verbs_matching(first, verbs.VERBS)) == 1 else -1


def _kinds(word: str, scope: Scope) -> Iterator[Token]:
    if word in CURVES:
        yield 0, len(word), "curve"
    elif any(word in getattr(scope, part) for part in _PARTS):
        yield 0, len(word), "name"
    elif word in RESERVED:
        yield 0, len(word), "option"
    else:
        for match in _NUMBER.finditer(word):
            yield match.start("number"), match.end("number"), "number"
            if match["unit"]:
                yield match.start("unit"), match.end("unit"), "unit"
