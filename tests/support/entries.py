"""Entries of parts as a line describes them."""

from ergon.notation.text.edit import EditError
from ergon.notation.text.errors import TextError
from ergon.scores.edits.entries import Entry, entry_of_play
from ergon.scores.pattern import words


def parse_entry(text: str) -> Entry:
    """The entry that the words of a line describe, without its position. Raises EditError."""
    try:
        return entry_of_play(words.parse(text), text)
    except TextError as error:
        raise EditError(error.message) from None
