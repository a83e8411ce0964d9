"""Did you mean: the known word that a composer most likely meant."""

from collections.abc import Iterable
from difflib import get_close_matches

LONGEST_WORD = 64  # difflib is quadratic, and nobody mistypes a word longer than this


def is_misspelt(word: str, name: str) -> bool:
    """Whether a word differs from a name by a letter or two."""
    return bool(get_close_matches(word.lower(), [name.lower()], n=1, cutoff=0.8))


def is_one_slip(typed_word: str, known_name: str) -> bool:
    """Whether a word is a name but for one letter that is missing, too many, another one, or in
    the wrong order (a distance of 1: Damerau, Communications of the ACM 7, 1964).
    """
    if abs(len(typed_word) - len(known_name)) > 1:
        return False
    first_difference = next(
        (i for i, (a, b) in enumerate(zip(typed_word, known_name, strict=False)) if a != b), None
    )
    if first_difference is None:  # one word begins with the other
        return True
    a, b = typed_word[first_difference:], known_name[first_difference:]
    is_swapped = a[:2] == b[1::-1] and a[2:] == b[2:]
    return a[1:] == b[1:] or a[1:] == b or a == b[1:] or is_swapped


def nearest(typed_word: str, known_names: Iterable[str]) -> str | None:
    """Return the known word that `typed_word` begins or resembles, None when nothing is near."""
    if not typed_word or len(typed_word) > LONGEST_WORD:
        return None
    lowercase_word = typed_word.lower()
    candidates = {name.lower(): name for name in known_names}
    with_prefix = [name for name in candidates if name.startswith(lowercase_word)]
    if len(with_prefix) == 1:
        return candidates[with_prefix[0]]
    close_matches = get_close_matches(lowercase_word, candidates, n=1, cutoff=0.6)
    return candidates[close_matches[0]] if close_matches else None
