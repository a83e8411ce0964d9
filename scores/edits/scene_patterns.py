"""Writes the patterns of a scene so that they repeat with its bars."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import dropwhile, takewhile

from ergon.notation.clock.meter import SAME
from ergon.notation.text.edit import EditError
from ergon.notation.text.errors import TextError, quote
from ergon.scores.edits.entries import Entry
from ergon.scores.pattern import words
from ergon.scores.pattern.order import REST, Group, Leaf
from ergon.scores.pattern.steps import PlaceBeats
from ergon.scores.pattern.turn_chain import as_turn, is_turn, parse_change
from ergon.scores.pattern.turns import Turn, with_numbers
from ergon.scores.pattern.turns import parse as parse_turns

_STEPS_MAX = 192  # steps of a round that is written out
_PLACES_MAX = 10_000  # of a pattern in a scene
# Fields that a written-out round does not need: its steps say the same.
_PATTERN_FIELDS = dict.fromkeys(("euclid", "chance", "swing", "skip", words.NTH_OPTION))


def repeated_entries(
    pattern_entry: Entry, place_beats: PlaceBeats, n_places: int, round_beats: float
) -> Iterator[tuple[float, Entry]]:
    """The entries that repeat the first `n_places` places of a pattern every `round_beats`.

    Yields each with the first beat on which it plays. Random choices are fixed to those of these
    places. Raises EditError if there are too many places.
    """
    _check_place_count(n_places)
    if not n_places:
        return
    places = place_beats.places
    if places.pattern.chance is None and _is_periodic(place_beats, n_places, round_beats):
        yield place_beats[0], pattern_entry
        return
    turns = _numbered_turns(pattern_entry) if places.pattern.turns else []
    beats_by_transforms: dict[tuple[str, ...], list[tuple[float, str]]] = {}
    for place_index in range(n_places):
        if (played_name := places.played_name(place_index)) is not None:
            transforms = tuple(
                text[transform.offset : transform.offset + transform.length]
                for turn, text in turns
                for transform in places.due_transforms(place_index, (turn,))
                if transform is not None
            )
            beats_by_transforms.setdefault(transforms, []).append(
                (place_beats[place_index], played_name)
            )
    for transforms, named_beats in beats_by_transforms.items():
        constant_transforms = takewhile(
            lambda transform: not is_turn(transform), pattern_entry.transforms
        )
        occurrence_entry = Entry(
            pattern_entry.with_fields(**_PATTERN_FIELDS).fields, (*constant_transforms, *transforms)
        )
        for begin, pattern_text, period in _absolute_patterns(named_beats, round_beats):
            yield begin, occurrence_entry.with_fields(play=pattern_text).with_step(f"{period:.12g}")


def _numbered_turns(pattern_entry: Entry) -> list[tuple[Turn, str]]:
    """The turns of an entry as its reading numbers them, each with its text. Raises EditError."""
    text = pattern_entry.fields.get(words.NTH_OPTION, "")
    turn_pairs = [(turn, text) for turn in parse_turns(text)] if text else []
    later_turns = [*dropwhile(lambda transform: not is_turn(transform), pattern_entry.transforms)]
    for later_turn in later_turns:
        try:
            turn_pairs.append((as_turn(parse_change(later_turn)), later_turn))
        except TextError as error:
            raise EditError(f"{quote(later_turn)} cannot be written out: {error.message}") from None
    turns = with_numbers(turn for turn, _ in turn_pairs)
    return [*zip(turns, (text for _, text in turn_pairs), strict=True)]


def repeated_strikes(
    strike_fields: Mapping[str, object],
    place_beats: PlaceBeats,
    n_places: int,
    round_beats: float,
    notes_by_name: Mapping[str, str],
) -> Iterator[tuple[float, Mapping[str, object]]]:
    """The fields of strikes that repeat the first `n_places` places of a pattern every
    `round_beats`.

    Yields each with the first beat; `notes_by_name` has the pattern's notes as texts, and is empty
    without notes. The random choices of the strikes are drawn again in every round.
    """
    _check_place_count(n_places)
    if not n_places:
        return
    if _is_periodic(place_beats, n_places, round_beats):
        yield place_beats[0], strike_fields
        return
    plain_fields = {
        name: value
        for name, value in strike_fields.items()
        if name not in ("euclid", "swing", "skip")
    }
    places_with_names = (
        (place_beats[place], place_beats.places.name_in_place(place)) for place in range(n_places)
    )
    named_beats = [(beat, name) for beat, name in places_with_names if name is not None]
    if notes_by_name:
        note_beats = [(beat, notes_by_name[name]) for beat, name in named_beats]
        for begin, notes_text, period in _absolute_patterns(note_beats, round_beats):
            yield begin, {**plain_fields, "notes": notes_text, "every": f"{period:.12g}"}
        return
    for begin, _ in named_beats:
        yield begin, {**plain_fields, "every": f"{round_beats:.12g}"}


def _check_place_count(n_places: int) -> None:
    if n_places > _PLACES_MAX:
        raise EditError(
            f"a pattern has {n_places:,} steps in this scene; a scene can repeat at most "
            f"{_PLACES_MAX:,}: make the scene shorter"
        )


def _is_periodic(place_beats: PlaceBeats, n_places: int, beats: float) -> bool:
    """Whether the `n_places` places after the first `n_places` repeat them `beats` later."""
    places = place_beats.places
    return (
        _is_sequential(places.pattern.order)
        and not places.pattern.turns
        and all(
            abs(place_beats.beat(n_places + place) - place_beats[place] - beats) < SAME
            and places.name_in_place(n_places + place) == places.name_in_place(place)
            for place in range(n_places)
        )
    )


def _is_sequential(pattern_item: Leaf | Group) -> bool:
    return isinstance(pattern_item, Leaf) or (
        pattern_item.way == "in turn" and all(map(_is_sequential, pattern_item.items))
    )


def _absolute_patterns(
    named_beats: Sequence[tuple[float, str]], round_beats: float
) -> Iterator[tuple[float, str, float]]:
    """Patterns that play names on given beats, and again every `round_beats`: the first beat, a
    pattern, its step.

    If the names lie on no common grid, each gets a pattern of its own.
    """
    begin_beat = named_beats[0][0] if named_beats else 0.0
    for n_steps in range(len(named_beats), _STEPS_MAX + 1):
        step_positions = [(beat - begin_beat) * n_steps / round_beats for beat, _ in named_beats]
        if all(abs(position - round(position)) < SAME * n_steps for position in step_positions):
            name_by_step = {
                round(position): name
                for position, (_, name) in zip(step_positions, named_beats, strict=True)
            }
            if (
                len(name_by_step) == len(named_beats)
                and max(name_by_step, default=n_steps) < n_steps
            ):
                step_names = [name_by_step.get(step, REST) for step in range(n_steps)]
                yield begin_beat, " ".join(step_names), round_beats / n_steps
                return
    for beat, name in named_beats:
        yield beat, name, round_beats
