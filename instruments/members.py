"""Reads the choice of members of a generator: `12`, `3..8`, `3..last`, `all`, `last`, `centre`."""

from __future__ import annotations

import re
from typing import Literal

from ergon.notation.text.errors import TextError, quote

PATTERN = r"(?:[0-9]{1,9}(?:\.\.(?:[0-9]{1,9}|last))?|all|last|centre)"
_MEMBERS = re.compile(PATTERN)


def members(text: str, count: int, called: str) -> tuple[int | Literal["centre"], int]:
    """The first member that `text` names, and their number; `called` has `count` members.

    Raises TextError.
    """
    words: dict[str, tuple[int | Literal["centre"], int]] = {
        "all": (0, count),
        "last": (count - 1, 1),
        "centre": ("centre", 1),
    }
    if text in words:
        return words[text]
    if not _MEMBERS.fullmatch(text):
        raise TextError(
            f"{quote(text)} is not a choice of members; write 3, 3..8, 3..last, all, last or centre"
        )
    low, _, high = text.partition("..")
    first = int(low)
    last = count - 1 if high == "last" else int(high or low)
    if max(first, last) >= count:
        raise TextError(f"{called} has members 0 to {count - 1:,}")
    if last < first:
        raise TextError(f"{text} runs downwards; write the lower number first")
    return first, last - first + 1
