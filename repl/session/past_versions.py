"""Earlier versions by number, each text kept as its difference from the one kept before it.

A score grows by each line, so that whole texts would take memory in proportion to the square of
their number.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterator, MutableMapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ergon.repl.session.version import PastVersion
    from ergon.scores.edits.texts import Texts

# A whole text is kept after this many differences: 32 of them are put together in a millisecond.
_DIFFERENCES_MAX = 32


@dataclass(frozen=True, slots=True)
class _PackedText:
    """A text: the whole one, `compressed`, or that of `previous` with its characters from
    `start` to `end` replaced by `replacement`.
    """

    n_differences: int  # number of differences since a complete text
    compressed: bytes = b""
    previous: _PackedText | None = None
    start: int = 0
    end: int = 0
    replacement: str = ""

    def unpacked(self) -> str:
        """The text."""
        if self.previous is None:
            return zlib.decompress(self.compressed).decode()
        text = self.previous.unpacked()
        return text[: self.start] + self.replacement + text[self.end :]


class PastVersionStore(MutableMapping[int, "PastVersion"]):
    """What is needed to restore each earlier version, by its number."""

    def __init__(self) -> None:
        """Begin without versions."""
        self._versions: dict[int, tuple[PastVersion, _PackedText]] = {}
        self._last_packed: tuple[Texts, _PackedText] | None = None

    def __getitem__(self, number: int) -> PastVersion:
        """A version with its texts."""
        version, packed_text = self._versions[number]
        return replace(version, texts=replace(version.texts, text=packed_text.unpacked()))

    def __setitem__(self, version_number: int, version: PastVersion) -> None:
        """Keep a version."""
        score_texts = version.texts
        packed_text = self._pack_text(score_texts)
        self._last_packed = score_texts, packed_text
        self._versions[version_number] = (
            replace(version, texts=replace(score_texts, text="")),
            packed_text,
        )

    def __delitem__(self, number: int) -> None:
        """Remove a version; others may still need its text."""
        del self._versions[number]

    def __iter__(self) -> Iterator[int]:
        """The numbers, in the order in which the versions were first kept."""
        return iter(self._versions)

    def __len__(self) -> int:
        """The number of versions."""
        return len(self._versions)

    def rebase(self, base: Texts) -> None:
        """Note that the files hold these texts now."""
        self._versions = {
            number: (replace(version, file_texts=base, renames=()), packed_text)
            for number, (version, packed_text) in self._versions.items()
        }

    def _pack_text(self, texts: Texts) -> _PackedText:
        if self._last_packed is None:
            return _compressed_text(texts.text)
        texts_before, packed_text = self._last_packed
        if texts_before.text == texts.text:
            return packed_text
        if packed_text.n_differences >= _DIFFERENCES_MAX:
            return _compressed_text(texts.text)
        start_index, end_index, replacement = difference(texts_before.text, texts.text)
        return _PackedText(
            packed_text.n_differences + 1, b"", packed_text, start_index, end_index, replacement
        )


def _compressed_text(text: str) -> _PackedText:
    return _PackedText(0, zlib.compress(text.encode(), 1))


def difference(old_text: str, new_text: str) -> tuple[int, int, str]:
    """The characters from one index to another that become a text, so that a text becomes
    `new_text`.
    """
    shared_count = min(len(old_text), len(new_text))
    start_index = _n_equal(shared_count, lambda a, b: old_text[a:b] == new_text[a:b])
    old_length, new_length = len(old_text), len(new_text)
    n_equal_end = _n_equal(
        shared_count - start_index,
        lambda a, b: (
            old_text[old_length - b : old_length - a] == new_text[new_length - b : new_length - a]
        ),
    )
    return start_index, old_length - n_equal_end, new_text[start_index : new_length - n_equal_end]


def _n_equal(count: int, is_equal: Callable[[int, int], bool]) -> int:
    """The number of characters, of at most `count`, up to which two texts are equal."""
    low, high = 0, count  # the texts are equal up to `low`
    while low < high:
        middle = (low + high + 1) // 2
        if is_equal(low, middle):
            low = middle
        else:
            high = middle - 1
    return low
