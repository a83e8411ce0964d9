"""Transformations of some rounds only: `4th do mirror`, `3rd do scale 0.5, reverse`."""

from __future__ import annotations

import re
from dataclasses import dataclass

from ergon.notation.text.errors import TextError
from ergon.scores.gesture.transforms import ARITY, Transform, parse_do

ORDINAL = re.compile(r"([0-9]{1,4})(?:st|nd|rd|th)")
_CLAUSE = re.compile(rf"\s*+(?:{ORDINAL.pattern})\s++do(?:\s++|$)")
_NEXT = re.compile(rf"(?<=\s)every\s+(?={ORDINAL.pattern}(?:\s|$))")
# One transformation: from its word up to a comma or to the word of the next transformation.
_WORDS = "|".join(ARITY)
_ONE = re.compile(rf"[^\s,]+(?:\s+(?!(?:{_WORDS})(?:[\s,]|$))[^\s,]+)*")


@dataclass(frozen=True, slots=True)
class Turn:
    """Transformations of every nth round: `every 4th do mirror`."""

    nth: int
    do: tuple[Transform, ...]


def parse(text: str, start: int = 0) -> tuple[Turn, ...]:
    """Read `4th do mirror`, and further clauses that begin with `every`.

    Raises TextError with offsets into the text plus `start`.
    """
    turns = []
    offset = 0
    for more in (*_NEXT.finditer(text), None):
        clause = text[offset : more.start() if more else len(text)]
        turns.append(_clause(clause, start + offset))
        offset = more.end() if more else 0
    return tuple(turns)


def _clause(text: str, start: int) -> Turn:
    match = _CLAUSE.match(text)
    if match is None or int(match[1]) == 0:
        message = f"'{text.strip()[:40]}' is not written like 4th do mirror"
        raise TextError(message, offset=start, length=max(1, len(text.strip())))
    chain = []
    for one in _ONE.finditer(text, match.end()):
        chain.append(parse_do(one.group(), start + one.start()))
    if not chain or text.rstrip().endswith(","):
        raise TextError("'do' needs a transformation: 4th do mirror", offset=start + len(text) - 1)
    return Turn(int(match[1]), tuple(chain))
