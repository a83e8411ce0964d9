"""Texts by chance: a whole one with damage, words in no order, trees of the score's own words."""

from __future__ import annotations

import random
from collections.abc import Sequence

NUMBERS = (
    *("0", "-1", "1e-9", "1e9", "1e18", "1e308", "1e999", "-0", "nan", "inf", "1/0", "1/3"),
    *("9" * 30, "0.0001", "3600", "86399", "1e-400", "1_0", "0x10", "+1", "007"),
)
CHARACTERS = " \t\n\r\0:;,.|@+-*/=()[]{}#&!%<>\\\"'?~`^$_09aeEnZµé–名😀\u2028\u202e\x1b\x85\xa0"


def damaged(text: str, chance: random.Random, words: Sequence[str] = ()) -> str:
    """A text with one to four damages: cut, doubled, moved, or with words and numbers in it."""
    for _ in range(chance.choice((1, 1, 2, 4))):
        start = chance.randrange(len(text) + 1)
        stop = min(len(text), start + chance.choice((0, 0, 1, 2, 8, 40)))
        kind = chance.randrange(8)
        new = ""
        if kind <= 1:
            new = chance.choice(NUMBERS)
        elif kind == 2:
            new = "".join(chance.choices(CHARACTERS, k=chance.randrange(1, 5)))
        elif kind == 3 and words:
            new = f" {chance.choice(words)} "
        elif kind == 4:
            new = text[start:stop] * chance.choice((2, 3, 20))
        elif kind == 5:
            other = chance.randrange(len(text) + 1)
            new = text[other : other + chance.choice((3, 20, 100))]
        elif kind == 6:  # whole lines change their places
            rows = text.splitlines(keepends=True)
            if len(rows) > 1:
                row = rows.pop(chance.randrange(len(rows)))
                rows.insert(chance.randrange(len(rows) + 1), row)
                text = "".join(rows)
                continue
        text = text[:start] + new + text[stop:]
    return text


def soup(chance: random.Random, words: Sequence[str], most: int = 16, between: str = " ") -> str:
    """Words in no order."""
    return between.join(chance.choices((*words, *NUMBERS), k=chance.randrange(most)))


def tree(chance: random.Random, words: Sequence[str], depth: int = 3) -> str:
    """A value in YAML's flow form: a mapping, a list or a word."""
    kind = chance.randrange(4) if depth else 3
    inner = [tree(chance, words, depth - 1) for _ in range(chance.randrange(4) if depth else 0)]
    if kind <= 1:
        return "{" + ", ".join(f"{chance.choice(words)}: {value}" for value in inner) + "}"
    if kind == 2:
        return "[" + ", ".join(inner) + "]"
    return "'" + chance.choice((*words, *NUMBERS)).replace("'", "") + "'"
