"""The words after `do`: transformations of a rhythm, of strikes by the clock and of phrases."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence

from ergon.notation.text.errors import TextError
from ergon.repl.language.values import Completion
from ergon.scores.pattern.cycle_table import FORM_BY_WORD
from ergon.scores.pattern.cycle_transforms import parse_transforms
from ergon.scores.reading.rhythms import compiled_rhythm

_DO_PATTERN = re.compile(r"(?:^|\s)do(?:\s+|$)")


def split_at_transforms(text: str) -> tuple[str, int | None]:
    """The text before the word `do`, and where the transformations begin; None without `do`."""
    do_match = _DO_PATTERN.search(text)
    return (text, None) if do_match is None else (text[: do_match.start()], do_match.end())


def checked_transforms(chain_text: str, chain_start: int, rhythm: str) -> str:
    """Transformations as written, which the rhythm takes; `chain_start` is their place in the line.

    Raises TextError.
    """
    if not chain_text.strip():
        example = "do rev, or do every 4 rev"
        raise TextError(f"a transformation is missing: {example}", offset=max(0, chain_start - 1))
    try:
        parse_transforms(chain_text)
        compiled_rhythm(rhythm, chain_text.strip())
    except TextError as error:
        error.offset += chain_start
        raise
    return chain_text.strip()


def transform_completions(earlier_words: Sequence[str]) -> Iterator[Completion]:
    """Transformations, at the beginning and behind a comma; values behind a transformation."""
    last_form = FORM_BY_WORD.get(earlier_words[-1]) if earlier_words else None
    if not earlier_words or earlier_words[-1].endswith(","):
        yield from (Completion(name, form.description) for name, form in FORM_BY_WORD.items())
    elif last_form is not None:
        transform_words = [
            word
            for readers in last_form.arguments
            for reader in readers[:1]
            for word in reader.known_words
        ]
        for word in dict.fromkeys(transform_words) or last_form.example.split()[1:2]:
            yield Completion(word, f"as in {last_form.example}")
