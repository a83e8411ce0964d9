"""What an instrument is taken for, and how far it lies from recordings of its class."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from benches.ear.features import FEATURES, NAMES
from benches.ear.partials import measure
from benches.ear.recorded import Kin, Recorded, distance
from benches.ear.sound import Samples
from benches.voice_plans import stated_cost
from benches.voice_scores import Instrument
from docs.generators.cards import play, score
from ergon import _core

_TAIL = 2.5  # s that are heard after a strike
_RUBBED = 3.0  # s that a bow moves
_N_OFF = 3  # features that are named


@dataclass(frozen=True, slots=True)
class Verdict:
    """Of an instrument at three strengths.

    `wanted` is the class that it is meant to be. `figures` are (3, n_features), `levels` the
    loudest 400 ms of each stroke [LUFS], `cost` a share of a core. `distance_95` is that within
    which 95 % of the recordings of its class lie, `distances_of_sources` how far each of its
    sources lies from the others; none where the class has one.
    """

    family: str
    name: str
    wanted: str
    taken_for: str
    rank: int
    distance: float
    distance_95: float
    cost: float
    levels: tuple[float, ...]
    figures: Samples
    off: tuple[str, ...] = field(default=())
    distances_of_sources: tuple[float, ...] = field(default=())

    @property
    def within(self) -> bool:
        """Whether it lies as near as another source of recordings, or 95 % where there is none."""
        return self.distance <= max(self.distances_of_sources, default=self.distance_95)

    def column(self, feature: str) -> list[float]:
        """A feature at three strengths, in the unit of its words."""
        i = NAMES.index(feature)
        return [FEATURES[feature].plain(float(value)) for value in self.figures[:, i]]


def sounds(family: str, name: str, card: Mapping[str, Any]) -> tuple[Samples, float]:
    """An instrument soft, middle and hard (3, n_frames), and the rate [Hz]."""
    text = score(family, name, dict(card), tail=_TAIL, rubbed=_RUBBED)
    return play(text, max(_TAIL, _RUBBED) + 0.1)


def judge(recorded: Recorded, family: str, name: str, card: Mapping[str, Any]) -> Verdict:
    """Play an instrument as its card says, and compare it with recordings of `card["ear"]`."""
    samples, rate = sounds(family, name, card)
    figures = np.array([measure(stroke, rate) for stroke in samples])
    wanted, pitch = card["ear"]["class"], card["ear"].get("pitch")
    shares = recorded.learnt.probabilities(figures).mean(axis=0)
    right = shares[recorded.learnt.classes.index(wanted)]
    kin = recorded.kin(wanted, pitch)
    deviations = kin.deviations(figures)
    return Verdict(
        family,
        name,
        wanted,
        recorded.learnt.classes[int(np.argmax(shares))],
        1 + int(np.sum(shares > right)),
        float(np.mean([distance(row) for row in deviations])),
        float(np.percentile(recorded.distances(kin), 95)),
        stated_cost(Instrument(family, name, card)),
        tuple(_loudest(stroke, rate) for stroke in samples),
        figures,
        _off(figures, kin),
        tuple(sorted(recorded.other_sources(kin).values())),
    )


def _off(figures: Samples, kin: Kin) -> tuple[str, ...]:
    """The features that are most off, in words; of alike ones the first."""
    deviations = np.array([_mean(column) for column in kin.deviations(figures).T])
    texts: dict[str, str] = {}
    for i in np.argsort(-np.abs(np.nan_to_num(deviations))):
        name = NAMES[i]
        alike = name[2:] if name[:2] in ("a_", "b_", "c_") else name.split("_")[0]
        if alike in texts or math.isnan(deviations[i]):
            continue
        feature = FEATURES[name]
        here, there = feature.plain(_mean(figures[:, i])), feature.plain(kin.mean[i])
        texts[alike] = f"{feature.words} {here:.3g}, recorded {there:.3g}"
        if len(texts) == _N_OFF:
            break
    return tuple(texts.values())


def _mean(values: Samples) -> float:
    """Of those that are finite, nan if none is."""
    finite = values[np.isfinite(values)]
    return float(np.mean(finite)) if len(finite) else math.nan


def _loudest(stroke: Samples, rate: float) -> float:
    """The loudest 400 ms of a sound [LUFS]."""
    meter, loudest = _core.Meter(rate, 1), -math.inf
    step = int(0.05 * rate)
    for begin in range(0, len(stroke) - step + 1, step):
        meter.process(np.ascontiguousarray(stroke[begin : begin + step, None]))
        loudest = max(loudest, meter.momentary)
    return loudest
