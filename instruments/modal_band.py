"""The modes of a body above those that are known one by one: a band in which they are drawn."""

from __future__ import annotations

import random
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ergon import _core
from ergon.notation.tables import value_kinds
from ergon.notation.tables.compound import ListOf, NamesOf
from ergon.notation.tables.fields import Field, Record, Values
from ergon.notation.tables.shapes import MISSING, Shape

_SCATTER_OCTAVES = 0.5  # octaves that a decay lies above or below the line at most
_LEVEL_RATIO_MIN = 0.5  # smallest drawn level over the written one
_SIGNIFICANT_DIGITS = 6


@dataclass(frozen=True)
class Band:
    """How many modes lie between two frequencies [Hz], their shortest and longest decay [s], and
    how far they move at each place at most. High modes fall soonest.
    """

    count: int
    f: tuple[float, float]
    t60: tuple[float, float]
    levels: Mapping[str, float]
    seed: int

    def draw_modes(
        self, names: Sequence[str]
    ) -> tuple[tuple[float, ...], tuple[float, ...], dict[str, tuple[float, ...]]]:
        """Frequencies, decays, and the levels at each of the places.

        The band is cut into `count` steps of one ratio, and a mode lies anywhere in its step. Its
        decay lies about the line between both ends, evenly within half an octave up and down. A
        level is drawn between half the written level and the written level. Its sign alternates
        with the mode at the second place, with pairs of modes at the third, and so on, and is
        positive at the first. So the places hardly move together at the first instant, as on a
        large body.
        """
        chance = random.Random(self.seed)  # draws are music and need no secure source
        drawn_frequencies, t60 = [], []
        levels_by_place: dict[str, list[float]] = {name: [] for name in names}
        for i in range(self.count):
            share_below = (i + chance.random()) / self.count
            drawn_frequencies.append(_geometric_mean(self.f, share_below))
            decay_factor = _core.pow(2.0, _SCATTER_OCTAVES * (2.0 * chance.random() - 1.0))
            t60.append(_rounded(_geometric_mean(self.t60, 1.0 - share_below) * decay_factor))
            for number, place_name in enumerate(names):
                level_share = _LEVEL_RATIO_MIN + (1.0 - _LEVEL_RATIO_MIN) * chance.random()
                sign = -1.0 if number and (i >> (number - 1)) % 2 else 1.0
                levels_by_place[place_name].append(
                    _rounded(self.levels.get(place_name, 0.0) * level_share * sign)
                )
        return (
            tuple(drawn_frequencies),
            tuple(t60),
            {name: tuple(column) for name, column in levels_by_place.items()},
        )


def _geometric_mean(ends: tuple[float, float], share: float) -> float:
    return _rounded(ends[0] * _core.pow(ends[1] / ends[0], share))


def _rounded(value: float) -> float:
    """A number with few digits, as one would write it in a score."""
    return float(f"{value:.{_SIGNIFICANT_DIGITS}g}")


def _build(values: Values) -> Any:
    names = ("count", "f", "t60", "places", "seed")
    mode_count, f, t60, places, seed = (values[name] for name in names)
    if any(value is None for value in (mode_count, f, t60, places)) or MISSING in places.values():
        return MISSING  # reported already
    return Band(mode_count, f, t60, {name: level[0] for name, level in places.items()}, seed)


def band_record(level_shape: Shape) -> Record:
    """The table of a band; `level_shape` is that of a mode at a place."""
    return Record(
        "band",
        "modes of a body that are drawn between two frequencies",
        (
            Field(
                "count",
                value_kinds.integer(1, _core.MAX_MODAL, "40"),
                "how many modes",
                required=True,
            ),
            Field("f", value_kinds.PITCHES, "between which frequencies", required=True),
            Field("t60", value_kinds.DURATIONS, "decays: low for high f", required=True),
            Field(
                "places",
                NamesOf(ListOf(level_shape, 1, 1, single=True), "place"),
                "how far they move at each place at most",
                required=True,
            ),
            Field("seed", value_kinds.integer(0, 2**31 - 1, "3"), "seed of the draws", 1),
        ),
        build=_build,
    )
