"""A phrase is renamed wherever the score names it, and what is struck stays the same."""

from __future__ import annotations

import pytest

from ergon.notation.text.edit import EditError
from ergon.scores.edits.renaming import rename
from ergon.scores.edits.texts import Texts
from ergon.scores.reading.digest import digest_of

SCORE = """\
ergon: 1
instruments:
  cell: {CEL: {M: 1g, f: A4, t60: 2s}, notes: C3..C5, play: {strike: {impulse: 0.1mNs..2mNs}}, out: {SOX: cell}}
  turn: {CEL: {M: 1g, f: A4, t60: 2s}, play: {strike: {impulse: 0.1mNs..2mNs}}, out: {SOX: turn}}
phrases:
  a: {to: cell, entries: [{at: 0, what: C4}, {at: 1, what: [E4, G4]}, {at: 2, what: turn}]}
  b: {like: a, do: [reverse]}
  c:
    to: cell
    entries: |
      0   a
      3   C4 E4  mf
      4   b   p
      7   turn
  d: {to: cell, entries: [{at: 0, what: [c]}, {at: 9, what: a}]}
strikes:
  s: {play: d, at: 1|1}
"""  # noqa: E501


@pytest.mark.parametrize("old", ["a", "b", "c", "d"])
def test_rename_phrase_keeps_digest(old):
    texts = Texts("s.yaml", SCORE)
    piece = texts.load().piece
    assert piece is not None
    changed = rename(texts, piece, old, "gruppetto")
    after = changed.load().piece
    assert after is not None
    assert digest_of(after) == digest_of(piece)
    assert set(after.phrases) == {*piece.phrases, "gruppetto"} - {old}


def test_rename_phrase_to_ambiguous_name_is_refused():
    """In an entry the name of a phrase hides that of an instrument."""
    texts = Texts("s.yaml", SCORE)
    piece = texts.load().piece
    assert piece is not None
    with pytest.raises(EditError, match="cannot find every use of b"):
        rename(texts, piece, "b", "turn")
