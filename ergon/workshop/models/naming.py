"""Names and values of a model as a score writes them."""

from __future__ import annotations

import re
from collections.abc import Iterable

from ergon.notation.tables.expressions import UNITS, looks_like

_WORD = re.compile(r"(?<![\w.])[A-Za-z_]\w*")
_PLAIN_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,3})?")
_RATIO = re.compile(r"[+-]?\d+/\d+")  # which a score reads as a number
NAME_MAX = 64  # characters


class Names:
    """Gives each thing a unique name."""

    def __init__(self, used_names: Iterable[str] = ()) -> None:
        """`used_names`: names that cannot be given."""
        self.used_names = set(used_names)

    def new(self, wanted_name: str) -> str:
        """The name, or the first free one with a number appended."""
        stem = wanted_name[: NAME_MAX - 8].lstrip("_") or "m"
        free_name, suffix = stem, 2
        while free_name in self.used_names:
            free_name, suffix = f"{stem}_{suffix}", suffix + 1
        self.used_names.add(free_name)
        return free_name


class Params:
    """Parameters as names of `let:`, which begin with a small letter and are no units."""

    def __init__(self, names: Iterable[str]) -> None:
        """`names`: those of the model."""
        unique_names = Names(UNITS)
        self.names_in_score = {
            name: unique_names.new(name[:1].lower() + name[1:]) for name in names
        }

    def translated(self, expression: str) -> str:
        """An expression of the model as one of the score."""
        text = _WORD.sub(lambda word: self.names_in_score.get(word[0], word[0]), expression)
        return " ".join(text.split())


def is_read_alike(score_text: str) -> bool:
    """Whether a score reads a text without names as a number or an expression, and not as a number
    with a unit, as `0.2/4`.
    """
    is_number = _PLAIN_NUMBER.fullmatch(score_text) or _RATIO.fullmatch(score_text)
    return is_number is not None or looks_like(score_text, {})


def length_text(expression: str) -> str:
    """A length of one metre for each 1 of an expression."""
    if _PLAIN_NUMBER.fullmatch(expression):
        return f"{expression}m"
    return f"({expression})*1m"


def product_text(multiplier: int, expression: str) -> str:
    """`multiplier` times the value of an expression."""
    return (
        f"{multiplier}*{expression}"
        if re.fullmatch(r"[\w.]+", expression)
        else f"{multiplier}*({expression})"
    )
