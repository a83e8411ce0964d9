"""Merges what was typed in a session into files that were edited meanwhile: a three-way merge of
texts.

The unit is a place: a value that is not a mapping, such as a gesture, a parameter, the part of a
player, the tempo. A place that was typed gets the typed value if the files have not changed it;
if they have, the value of the files stays.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import NamedTuple

from ergon.notation.text import edit
from ergon.notation.text.edit import EditError, Tree
from ergon.scores.edits.texts import SECTIONS, Texts


class Spot(NamedTuple):
    """A value of a score: its file, and the names that lead to it."""

    file: str
    path: edit.Path

    def __str__(self) -> str:
        """The place as messages name it."""
        return ".".join(map(str, self.path))


class Missing:
    """The value of a place where nothing is written."""


_MISSING = Missing()
_Value = Tree | Missing


def merged(before: Texts, now: Texts, typed: Texts) -> tuple[Texts, list[Spot]]:
    """The texts `now` with what was typed since `before`, and the places whose typed values are
    dropped.

    Raises EditError if a text cannot be read.
    """
    merge, dropped = _with(before, now, typed, [*changed(before, typed)])
    if merge.load().piece is not None:
        return merge, dropped
    # Some typed value needs something that the files no longer have: find the values that can be
    # kept.
    merge, dropped, left = now, [], [*changed(before, typed)]
    count = -1
    while count != len(left):
        count = len(left)
        for spot in left[:]:
            single, lost = _with(before, merge, typed, [spot])
            if lost or single.load().piece is not None:
                left.remove(spot)
                merge, dropped = (merge, [*dropped, spot]) if lost else (single, dropped)
    return merge, [*dropped, *left]


def changed(before: Texts, after: Texts) -> Iterator[Spot]:
    """The places at which two texts differ."""
    for file in (after.path, *after.overlay):
        old, new = _text(before, file), _text(after, file)
        if old != new:
            paths = _differing(_tree(old, file), _tree(new, file), ())
            yield from (Spot(file, path) for path in paths)


def differ(a: Texts, b: Texts, spot: Spot) -> bool:
    """Whether two texts have different values at a place."""
    return _value_of(a, spot) != _value_of(b, spot)


def _with(before: Texts, now: Texts, typed: Texts, spots: list[Spot]) -> tuple[Texts, list[Spot]]:
    dropped = []
    for spot in spots:
        had, want, there = _value_of(before, spot), _value_of(typed, spot), _value_of(now, spot)
        if there == want:
            continue
        if there != had or _text(now, spot.file) is None:
            dropped.append(spot)
            continue
        try:
            now = _put(now, spot, had, want)
        except EditError:
            dropped.append(spot)
    return now, dropped


def _put(now: Texts, spot: Spot, had: _Value, want: _Value) -> Texts:
    """The texts with a value set at a place; comments are kept if possible. Raises EditError."""
    if isinstance(want, Missing):
        return now.remove(spot.path, file=spot.file)
    if want is None:
        return now.put(spot.path, "[]" if isinstance(had, list) else "{}", spot.file)
    try:
        if isinstance(want, list):
            return _items_put(now, spot, had, want)
        if isinstance(want, str) and "\n" in want and isinstance(had, str):
            return _rows_put(now, spot, edit.rows(had), edit.rows(want))
    except EditError:  # write the whole value instead
        pass
    return now.put(spot.path, edit.flow(want), spot.file)


def _items_put(now: Texts, spot: Spot, had: _Value, want: list[Tree]) -> Texts:
    old = had if isinstance(had, list) else []
    if len(want) < len(old) or (had is not None and not isinstance(had, list)):
        raise EditError("items were removed")
    for number, (was, item) in enumerate(zip(old, want, strict=False)):
        if was != item:
            now = now.put((*spot.path, number), edit.flow(item), spot.file)
    for item in want[len(old) :]:
        text = edit.flow(item)
        now = now.edited(
            spot.path[0],
            partial(edit.append, path=spot.path, text=text, order=SECTIONS),
            spot.file,
        )
    return now


def _rows_put(now: Texts, spot: Spot, had: list[str], want: list[str]) -> Texts:
    if len(want) < len(had):
        raise EditError("lines were removed")
    for number, (was, row) in enumerate(zip(had, want, strict=False)):
        if was != row:
            now = now.edited(
                spot.path[0],
                partial(edit.put_row, path=spot.path, row=number, text=row),
                spot.file,
            )
    for row in want[len(had) :]:
        now = now.edited(spot.path[0], partial(edit.add_row, path=spot.path, text=row), spot.file)
    return now


def _text(texts: Texts, file: str) -> str | None:
    return texts.text if file == texts.path else texts.overlay.get(str(Path(file)))


def _tree(text: str | None, file: str) -> Tree:
    return None if text is None else edit.tree(edit.read(text, file).root)


def _differing(old: _Value, new: _Value, path: edit.Path) -> Iterator[edit.Path]:
    if old == new:
        return
    if isinstance(new, Missing) and path:  # something removed is removed as a whole
        yield path
        return
    mappings = [one for one in (old, new) if isinstance(one, dict)]
    if not mappings or any(isinstance(one, (str, list)) for one in (old, new)):
        yield path
        return
    names = dict.fromkeys(name for one in (new, old) if isinstance(one, dict) for name in one)
    for name in names:
        yield from _differing(_entry(old, name), _entry(new, name), (*path, name))


def _value_of(texts: Texts, spot: Spot) -> _Value:
    spot_value: _Value = _tree(_text(texts, spot.file), spot.file)
    for name in spot.path:
        spot_value = _entry(spot_value, name)
    return spot_value


def _entry(said: _Value, name: str | int) -> _Value:
    return said.get(str(name), _MISSING) if isinstance(said, dict) else _MISSING
