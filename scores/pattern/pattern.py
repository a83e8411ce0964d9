"""A pattern with its rhythm and its chance, and what it plays in each of its places."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from typing import NamedTuple

from ergon.scores.gesture.transforms import Transform
from ergon.scores.pattern.draws import Draws
from ergon.scores.pattern.order import Group, Leaf
from ergon.scores.pattern.rhythm import EVEN_SWING, Euclid, swung_position
from ergon.scores.pattern.turns import Occasion, Turn, due_transforms, iterations

_ROUNDS_CACHED = 1024  # kept for each line


@dataclass(frozen=True, slots=True)
class Pattern:
    """What a line plays step by step; the first `skip` places are left out.

    `swing` is the share of two steps that the first one takes, `chance` the probability that a
    place is played (None: every place is).
    """

    order: Group
    euclid: Euclid | None = None
    swing: float = EVEN_SWING
    chance: float | None = None
    turns: tuple[Turn, ...] = ()
    skip: int = 0

    def leaves(self) -> Iterator[Leaf]:
        """All names that may be played, in the order written."""
        return self.order.leaves()

    @property
    def is_plain(self) -> bool:
        """Whether the pattern is one name without options."""
        is_single = self.order.way == "in turn" and len(self.order.items) == 1
        item = self.order.items[0]
        is_name = is_single and isinstance(item, Leaf) and item.name is not None
        return is_name and Pattern(self.order) == self


def iteration_mistake(pattern: Pattern) -> str | None:
    """What is wrong with `iter` of a pattern; None if nothing is, or it is not written."""
    pattern_order = pattern.order
    for n_shares in iterations(pattern.turns):
        if pattern.euclid is not None:
            return "with `euclid` names go on from pulse to pulse by themselves; remove `iter`"
        if pattern_order.way != "in turn" or any(
            isinstance(item, Group) for item in pattern_order.items
        ):
            return "`iter` takes names and rests one after another, without groups and choices"
        if pattern_order.places == 1:
            return "`iter` needs several names, such as knock lean"
        if pattern_order.places % n_shares:
            message = (
                f"`iter {n_shares}` divides the names into {n_shares} equal shares, and there "
            )
            return f"{message}are {pattern_order.places}; write iter {pattern_order.places}"
    return None


class Place(NamedTuple):
    """Where an item of a round begins, in steps from the round's beginning; the name of a rest is
    None.
    """

    at: Fraction
    name: str | None = None


class PlaceSequence:
    """The places of a pattern, numbered from 0, without end.

    What happens in a place depends on the pattern, the draws and the place's number alone.
    """

    def __init__(self, pattern: Pattern, draws: Draws) -> None:
        """Take the pattern, and the draws of its line."""
        self.pattern = pattern
        self.draws = draws
        self._round_places = lru_cache(_ROUNDS_CACHED)(self._places_of_round)
        self._names = lru_cache(_ROUNDS_CACHED)(self._names_of_round)
        pattern_order = pattern.order
        self._steps = lru_cache(_ROUNDS_CACHED)(self._steps_of_round)
        # By how many names each round begins later than the round before.
        self.shift_per_round = sum(
            pattern_order.places // shares for shares in iterations(pattern.turns)
        )
        self._steady_steps = (
            _steps_of_places(_places_of_order(pattern_order, None, 0))
            if pattern_order.is_steady
            else None
        )

    def step(self, place: int) -> tuple[int, float]:
        """The step of the line in which a place is, and how far into the step."""
        round_index, place_in_round = divmod(place + self.pattern.skip, self.pattern.order.places)
        steady_steps = self._steady_steps
        step, step_fraction = (
            steady_steps[place_in_round]
            if steady_steps is not None
            else self._steps(round_index)[place_in_round]
        )
        return round_index * self.pattern.order.steps + step, step_fraction

    def position(self, place: int) -> float:
        """Where a place begins, in steps from the beginning of the pattern, swing included."""
        pattern_step, step_fraction = self.step(place)
        euclid = self.pattern.euclid
        if euclid is not None:
            cycle, pulse = divmod(pattern_step, euclid.pulses)
            pattern_step = cycle * euclid.steps + euclid.positions()[pulse]
        return swung_position(pattern_step, step_fraction, self.pattern.swing)

    def round_index(self, place_index: int) -> int:
        """The round in which a place is: of the Euclidean rhythm if there is one, else of the
        names.
        """
        if self.pattern.euclid is not None:
            return self.step(place_index)[0] // self.pattern.euclid.pulses
        return (place_index + self.pattern.skip) // self.pattern.order.places

    def place_count(self, rounds: int) -> int:
        """The number of places in `rounds` rounds, without skipped ones."""
        pattern_order, euclid = self.pattern.order, self.pattern.euclid
        if euclid is None:
            return rounds * pattern_order.places - self.pattern.skip
        n_rounds, remaining_steps = divmod(rounds * euclid.pulses, pattern_order.steps)
        places_in_part = (
            sum(place.at < remaining_steps for place in self._round_places(n_rounds))
            if remaining_steps
            else 0
        )
        return n_rounds * pattern_order.places + places_in_part - self.pattern.skip

    def played_name(self, place: int) -> str | None:
        """The name that is played in a place; None for a rest."""
        played_name, number = self.name_in_place(place), place + self.pattern.skip
        chance = self.pattern.chance
        if played_name is None or (chance is not None and not self.draws.happens(chance, number)):
            return None
        return None if None in self.due_transforms(place, self.pattern.turns) else played_name

    def name_in_place(self, place: int) -> str | None:
        """The name in a place, whether chance lets it be played or not; None for a rest."""
        round_index, place_in_round = divmod(place + self.pattern.skip, self.pattern.order.places)
        return self._names(round_index)[
            (place_in_round + round_index * self.shift_per_round) % self.pattern.order.places
        ]

    def transforms(self, place: int) -> tuple[Transform, ...]:
        """The transformations of a place, besides those of the whole line."""
        return tuple(
            transform
            for transform in self.due_transforms(place, self.pattern.turns)
            if transform is not None
        )

    def due_transforms(self, place: int, turns: tuple[Turn, ...]) -> tuple[Transform | None, ...]:
        """What turns do in a place; None where one leaves it out."""
        if not turns:
            return ()
        draw_number = place + self.pattern.skip

        def draw(rule: int, probability: float) -> bool:
            return self.draws.changes(probability, draw_number, rule)

        return tuple(
            due_transforms(
                turns, Occasion(self.round_index(place), self._share_of_round(place), draw)
            )
        )

    def _share_of_round(self, place: int) -> float:
        """How much of its round is over where a place begins, from 0 to 1."""
        pattern_step, step_fraction = self.step(place)
        euclid = self.pattern.euclid
        if euclid is not None:
            return euclid.positions()[pattern_step % euclid.pulses] / euclid.steps
        return (pattern_step % self.pattern.order.steps + step_fraction) / self.pattern.order.steps

    def _names_of_round(self, round_index: int) -> Sequence[str | None]:
        return tuple(_names(self.pattern.order, self.draws, round_index))

    def _steps_of_round(self, round_index: int) -> Sequence[tuple[int, float]]:
        return _steps_of_places(self._round_places(round_index))

    def _places_of_round(self, round_index: int) -> Sequence[Place]:
        return tuple(_places_of_order(self.pattern.order, self.draws, round_index))


def _steps_of_places(places: Iterable[Place]) -> Sequence[tuple[int, float]]:
    """The step of a round in which each place is, and how far into the step."""
    return tuple((int(place.at), float(place.at - int(place.at))) for place in places)


def _names(order_item: Leaf | Group, draws: Draws, round_index: int) -> Iterator[str | None]:
    """The names of a round, in the order of its places."""
    if isinstance(order_item, Leaf):
        yield order_item.name
        return
    n_choices = len(order_item.items)
    if order_item.way in ("choose", "walk"):
        draw = draws.choose if order_item.way == "choose" else draws.walk_position
        chosen = order_item.items[draw(order_item.site, round_index, n_choices)]
        yield from _names(chosen, draws, round_index)
        yield from (None for _ in range(order_item.places - chosen.places))
        return
    is_drawn = order_item.way == "shuffle"
    for item_index in (
        draws.shuffle(order_item.site, round_index, n_choices) if is_drawn else range(n_choices)
    ):
        yield from _names(order_item.items[item_index], draws, round_index)


def _places_of_order(order: Group, draws: Draws | None, round_index: int) -> Iterator[Place]:
    """Every place of a round; without draws only the instants are valid, not the names."""
    return _places_of_item(order, Fraction(0), Fraction(order.steps), draws, round_index)


def _places_of_item(
    order_item: Leaf | Group,
    begin_step: Fraction,
    width: Fraction,
    draws: Draws | None,
    round_index: int,
) -> Iterator[Place]:
    """The places of an item that begins at step `begin_step` and lasts for `width` steps."""
    if isinstance(order_item, Leaf):
        yield Place(begin_step, order_item.name)
        return
    if order_item.way in ("choose", "walk"):
        choice_index = 0
        if draws is not None:
            draw = draws.choose if order_item.way == "choose" else draws.walk_position
            choice_index = draw(order_item.site, round_index, len(order_item.items))
        last_start = begin_step
        chosen = order_item.items[choice_index]
        for place in _places_of_item(chosen, begin_step, width, draws, round_index):
            last_start = place.at
            yield place
        # Every round has the same number of places: those that a longer item would need are rests.
        yield from (Place(last_start, None) for _ in range(order_item.places - chosen.places))
        return
    item_indices = range(len(order_item.items))
    if order_item.way == "shuffle" and draws is not None:
        item_order: Sequence[int] = draws.shuffle(
            order_item.site, round_index, len(order_item.items)
        )
    else:
        item_order = item_indices
    step_width = width / order_item.steps
    for item_index in item_order:
        child = order_item.items[item_index]
        yield from _places_of_item(child, begin_step, step_width * child.span, draws, round_index)
        begin_step += step_width * child.span
