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
    old_texts: Texts, current_texts: Texts, typed_texts: Texts
) -> tuple[Texts, list[ValuePlace]]:
    """The texts `current_texts` with what was typed since `old_texts`, and the places whose typed
    values are dropped.

    Raises EditError if a text cannot be read.
    """
    merged, dropped_places = _with_typed_values(
        old_texts, current_texts, typed_texts, [*changed_places(old_texts, typed_texts)]
    )
    if merged.load().piece is not None:
        return merged, dropped_places
    # Some typed value needs something that the files no longer have: find the values that can be
    # kept.
    merged, dropped_places, places_left = (
        current_texts,
        [],
        [*changed_places(old_texts, typed_texts)],
    )
    n_places_before = -1
    while n_places_before != len(places_left):
        n_places_before = len(places_left)
        for place in places_left[:]:
            trial_texts, lost_places = _with_typed_values(old_texts, merged, typed_texts, [place])
            if lost_places or trial_texts.load().piece is not None:
                places_left.remove(place)
                merged, dropped_places = (
                    (merged, [*dropped_places, place])
                    if lost_places
                    else (trial_texts, dropped_places)
                )
    return merged, [*dropped_places, *places_left]


def changed_places(old_texts: Texts, new_texts: Texts) -> Iterator[ValuePlace]:
    """The places at which two texts differ."""
    for file_name in (new_texts.path, *new_texts.overlay):
        old_text, new_text = (
            _text_of_file(old_texts, file_name),
            _text_of_file(new_texts, file_name),
        )
        if old_text != new_text:
            paths = _differing_places(
                _tree_of_text(old_text, file_name), _tree_of_text(new_text, file_name), ()
            )
            yield from (ValuePlace(file_name, path) for path in paths)


def is_different(first_texts: Texts, second_texts: Texts, place: ValuePlace) -> bool:
    """Whether two texts have different values at a place."""
    return _value_of(first_texts, place) != _value_of(second_texts, place)


def _with_typed_values(
    old_texts: Texts, current_texts: Texts, typed_texts: Texts, places: list[ValuePlace]
) -> tuple[Texts, list[ValuePlace]]:
    lost_places = []
    for place in places:
        old_value, typed_value, current_value = (
            _value_of(old_texts, place),
            _value_of(typed_texts, place),
            _value_of(current_texts, place),
        )
        if current_value == typed_value:
            continue
        if current_value != old_value or _text_of_file(current_texts, place.file) is None:
            lost_places.append(place)
            continue
        try:
            current_texts = _with_value(current_texts, place, old_value, typed_value)
        except EditError:
            lost_places.append(place)
    return current_texts, lost_places


def _with_value(
    current_texts: Texts, place: ValuePlace, old_value: _Value, typed_value: _Value
) -> Texts:
    """The texts with a value set at a place; comments are kept if possible. Raises EditError."""
    if isinstance(typed_value, MissingValue):
        return current_texts.remove(place.path, file=place.file)
    if typed_value is None:
        return current_texts.put(
            place.path, "[]" if isinstance(old_value, list) else "{}", place.file
        )
    try:
        if isinstance(typed_value, list):
            return _with_items(current_texts, place, old_value, typed_value)
        if isinstance(typed_value, str) and "\n" in typed_value and isinstance(old_value, str):
            return _with_rows(current_texts, place, edit.rows(old_value), edit.rows(typed_value))
    except EditError:  # write the whole value instead
        pass
    return current_texts.put(place.path, edit.flow(typed_value), place.file)


def _with_items(
    current_texts: Texts, place: ValuePlace, old_value: _Value, typed_items: list[Tree]
) -> Texts:
    old_items = old_value if isinstance(old_value, list) else []
    if len(typed_items) < len(old_items) or (
        old_value is not None and not isinstance(old_value, list)
    ):
        raise EditError("items were removed")
    for item_index, (old_item, typed_item) in enumerate(zip(old_items, typed_items, strict=False)):
        if old_item != typed_item:
            current_texts = current_texts.put(
                (*place.path, item_index), edit.flow(typed_item), place.file
            )
    for typed_item in typed_items[len(old_items) :]:
        item_text = edit.flow(typed_item)
        current_texts = current_texts.edited(
            place.path[0],
            partial(edit.append, path=place.path, text=item_text, order=SECTIONS),
            place.file,
        )
    return current_texts


def _with_rows(
    current_texts: Texts, place: ValuePlace, old_rows: list[str], typed_rows: list[str]
) -> Texts:
    if len(typed_rows) < len(old_rows):
        raise EditError("lines were removed")
    for row_index, (old_row, typed_row) in enumerate(zip(old_rows, typed_rows, strict=False)):
        if old_row != typed_row:
            current_texts = current_texts.edited(
                place.path[0],
                partial(edit.put_row, path=place.path, row=row_index, text=typed_row),
                place.file,
            )
    for typed_row in typed_rows[len(old_rows) :]:
        current_texts = current_texts.edited(
            place.path[0], partial(edit.add_row, path=place.path, text=typed_row), place.file
        )
    return current_texts


def _text_of_file(texts: Texts, file: str) -> str | None:
    return texts.text if file == texts.path else texts.overlay.get(str(Path(file)))


def _tree_of_text(text: str | None, file: str) -> Tree:
    return None if text is None else edit.tree(edit.read(text, file).root)


def _differing_places(old_value: _Value, new_value: _Value, path: edit.Path) -> Iterator[edit.Path]:
    if old_value == new_value:
        return
    if isinstance(new_value, MissingValue) and path:  # something removed is removed as a whole
        yield path
        return
    trees = [tree_value for tree_value in (old_value, new_value) if isinstance(tree_value, dict)]
    if not trees or any(
        isinstance(tree_value, (str, list)) for tree_value in (old_value, new_value)
    ):
        yield path
        return
    differing_names = dict.fromkeys(
        name
        for tree_value in (new_value, old_value)
        if isinstance(tree_value, dict)
        for name in tree_value
    )
    for name in differing_names:
        yield from _differing_places(
            _child_value(old_value, name), _child_value(new_value, name), (*path, name)
        )


def _value_of(texts: Texts, place: ValuePlace) -> _Value:
    place_value: _Value = _tree_of_text(_text_of_file(texts, place.file), place.file)
    for name in place.path:
        place_value = _child_value(place_value, name)
    return place_value


def _child_value(tree_value: _Value, name: str | int) -> _Value:
    return (
        tree_value.get(str(name), _MISSING_VALUE)
        if isinstance(tree_value, dict)
        else _MISSING_VALUE
    )
