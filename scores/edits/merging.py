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


class ValuePlace(NamedTuple):
    """A value of a score: its file, and the names that lead to it."""

    file: str
    path: edit.Path

    def __str__(self) -> str:
        """The place as messages name it."""
        return ".".join(map(str, self.path))


class MissingValue:
    """The value of a place where nothing is written."""


_MISSING_VALUE = MissingValue()
_Value = Tree | MissingValue


def merged_texts(
    texts_before: Texts, texts_now: Texts, typed: Texts
) -> tuple[Texts, list[ValuePlace]]:
    """The texts `texts_now` with what was typed since `texts_before`, and the places whose typed
    values are dropped.

    Raises EditError if a text cannot be read.
    """
    merge, dropped = _with_values_at(
        texts_before, texts_now, typed, [*changed_places(texts_before, typed)]
    )
    if merge.load().piece is not None:
        return merge, dropped
    # Some typed value needs something that the files no longer have: find the values that can be
    # kept.
    merge, dropped, spots_left = texts_now, [], [*changed_places(texts_before, typed)]
    count = -1
    while count != len(spots_left):
        count = len(spots_left)
        for place in spots_left[:]:
            merged_text, lost = _with_values_at(texts_before, merge, typed, [place])
            if lost or merged_text.load().piece is not None:
                spots_left.remove(place)
                merge, dropped = (merge, [*dropped, place]) if lost else (merged_text, dropped)
    return merge, [*dropped, *spots_left]


def changed_places(texts_before: Texts, texts_after: Texts) -> Iterator[ValuePlace]:
    """The places at which two texts differ."""
    for file_name in (texts_after.path, *texts_after.overlay):
        text_before, text_after = (
            _text_of_file(texts_before, file_name),
            _text_of_file(texts_after, file_name),
        )
        if text_before != text_after:
            paths = _differing_places(
                _tree_of_text(text_before, file_name), _tree_of_text(text_after, file_name), ()
            )
            yield from (ValuePlace(file_name, path) for path in paths)


def differ(a: Texts, b: Texts, spot: ValuePlace) -> bool:
    """Whether two texts have different values at a place."""
    return _value_of(a, spot) != _value_of(b, spot)


def _with_values_at(
    texts_before: Texts, texts_now: Texts, typed: Texts, spots: list[ValuePlace]
) -> tuple[Texts, list[ValuePlace]]:
    lost_places = []
    for spot in spots:
        value_before, typed_value, value_now = (
            _value_of(texts_before, spot),
            _value_of(typed, spot),
            _value_of(texts_now, spot),
        )
        if value_now == typed_value:
            continue
        if value_now != value_before or _text_of_file(texts_now, spot.file) is None:
            lost_places.append(spot)
            continue
        try:
            texts_now = _with_value(texts_now, spot, value_before, typed_value)
        except EditError:
            lost_places.append(spot)
    return texts_now, lost_places


def _with_value(
    texts_now: Texts, spot: ValuePlace, value_before: _Value, typed_value: _Value
) -> Texts:
    """The texts with a value set at a place; comments are kept if possible. Raises EditError."""
    if isinstance(typed_value, MissingValue):
        return texts_now.remove(spot.path, file=spot.file)
    if typed_value is None:
        return texts_now.put(spot.path, "[]" if isinstance(value_before, list) else "{}", spot.file)
    try:
        if isinstance(typed_value, list):
            return _with_items(texts_now, spot, value_before, typed_value)
        if isinstance(typed_value, str) and "\n" in typed_value and isinstance(value_before, str):
            return _with_rows(texts_now, spot, edit.rows(value_before), edit.rows(typed_value))
    except EditError:  # write the whole value instead
        pass
    return texts_now.put(spot.path, edit.flow(typed_value), spot.file)


def _with_items(
    texts_now: Texts, spot: ValuePlace, value_before: _Value, typed_items: list[Tree]
) -> Texts:
    items_before = value_before if isinstance(value_before, list) else []
    if len(typed_items) < len(items_before) or (
        value_before is not None and not isinstance(value_before, list)
    ):
        raise EditError("items were removed")
    for item_index, (item_before, typed_item) in enumerate(
        zip(items_before, typed_items, strict=False)
    ):
        if item_before != typed_item:
            texts_now = texts_now.put((*spot.path, item_index), edit.flow(typed_item), spot.file)
    for typed_item in typed_items[len(items_before) :]:
        item_text = edit.flow(typed_item)
        texts_now = texts_now.edited(
            spot.path[0],
            partial(edit.append, path=spot.path, text=item_text, order=SECTIONS),
            spot.file,
        )
    return texts_now


def _with_rows(
    texts_now: Texts, spot: ValuePlace, rows_before: list[str], typed_rows: list[str]
) -> Texts:
    if len(typed_rows) < len(rows_before):
        raise EditError("lines were removed")
    for row_index, (row_before, typed_row) in enumerate(zip(rows_before, typed_rows, strict=False)):
        if row_before != typed_row:
            texts_now = texts_now.edited(
                spot.path[0],
                partial(edit.put_row, path=spot.path, row=row_index, text=typed_row),
                spot.file,
            )
    for typed_row in typed_rows[len(rows_before) :]:
        texts_now = texts_now.edited(
            spot.path[0], partial(edit.add_row, path=spot.path, text=typed_row), spot.file
        )
    return texts_now


def _text_of_file(texts: Texts, file: str) -> str | None:
    return texts.text if file == texts.path else texts.overlay.get(str(Path(file)))


def _tree_of_text(text: str | None, file: str) -> Tree:
    return None if text is None else edit.tree(edit.read(text, file).root)


def _differing_places(
    value_before: _Value, value_after: _Value, path: edit.Path
) -> Iterator[edit.Path]:
    if value_before == value_after:
        return
    if isinstance(value_after, MissingValue) and path:  # something removed is removed as a whole
        yield path
        return
    mappings = [
        tree_value for tree_value in (value_before, value_after) if isinstance(tree_value, dict)
    ]
    if not mappings or any(
        isinstance(tree_value, (str, list)) for tree_value in (value_before, value_after)
    ):
        yield path
        return
    differing_names = dict.fromkeys(
        name
        for tree_value in (value_after, value_before)
        if isinstance(tree_value, dict)
        for name in tree_value
    )
    for name in differing_names:
        yield from _differing_places(
            _child_value(value_before, name), _child_value(value_after, name), (*path, name)
        )


def _value_of(texts: Texts, spot: ValuePlace) -> _Value:
    spot_value: _Value = _tree_of_text(_text_of_file(texts, spot.file), spot.file)
    for name in spot.path:
        spot_value = _child_value(spot_value, name)
    return spot_value


def _child_value(tree_value: _Value, name: str | int) -> _Value:
    return (
        tree_value.get(str(name), _MISSING_VALUE)
        if isinstance(tree_value, dict)
        else _MISSING_VALUE
    )
