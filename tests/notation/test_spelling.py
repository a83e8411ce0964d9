"""Spelling: words that are one slip of the keys away."""

import itertools

from ergon.notation.text.spelling import is_one_slip


def _distance(a: str, b: str) -> int:
    """Edits of one letter and swaps of neighbours, by the table of all beginnings."""
    table = {(i, 0): i for i in range(len(a) + 1)} | {(0, j): j for j in range(len(b) + 1)}
    for i, j in itertools.product(range(1, len(a) + 1), range(1, len(b) + 1)):
        differs = a[i - 1] != b[j - 1]
        table[i, j] = min(table[i - 1, j] + 1, table[i, j - 1] + 1, table[i - 1, j - 1] + differs)
        if i > 1 and j > 1 and a[i - 2 : i] == b[j - 2 : j][::-1]:
            table[i, j] = min(table[i, j], table[i - 2, j - 2] + 1)
    return table[len(a), len(b)]


def test_is_one_slip_with_random_words():
    words = ["".join(word) for n in range(5) for word in itertools.product("abc", repeat=n)]
    pairs = [*itertools.product(words, words)]
    assert sum(_distance(a, b) == 1 for a, b in pairs) > 500
    assert [(a, b) for a, b in pairs if is_one_slip(a, b) is not (_distance(a, b) <= 1)] == []
