"""What is known of recorded sounds: their figures, and which class a sound is taken for.

`recorded.npz` holds the features (`features.NAMES`, half precision) of 1,390 recorded notes and
strokes; no audio. They were measured from FluidR3 GM (Frank Wen, MIT), the Salamander grand piano
(Alexander Holm, CC BY), AVL Drumkits (Glen MacArthur), and the samples of Sonic Pi.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benches.ear.features import FEATURES, GROUPS, NAMES
from benches.ear.sound import Samples

DATA = Path(__file__).with_name("recorded.npz")
# Classes that no source but one has, or that sources disagree about: nothing is taken for them.
LEFT_OUT = frozenset({"bell tree", "harp, koto, banjo", "hi-hat", "flute, bottle"})
_SHRINKAGE = 0.3  # of the covariance: the best of 0.1, 0.3 and 0.6 on sources that were left out
_SHARPNESS = 0.3  # of the discriminants: figures depend on each other, so they vote too surely
_NEAR = 7  # semitones from the pitch, within which recordings are what a sound is compared with
_FEWEST = 9  # recordings within that; otherwise those of the class
_FEWEST_OF_SOURCE = 3  # recordings of a source that is compared with the others
_FEWEST_OF_OTHERS = 6  # recordings of those
_WITHIN = 0.4  # weight of the variance within classes, as some have few recordings
_FARTHEST = 6.0  # standard deviations that count for a feature
_GROUPS = {g: [i for i, name in enumerate(NAMES) if FEATURES[name].group == g] for g in GROUPS}


@dataclass(frozen=True, slots=True)
class Discriminants:
    """Linear discriminants with a shrunk covariance (Fisher, 1936; Friedman, 1989)."""

    classes: list[str]
    medians: Samples
    mean: Samples
    scale: Samples
    weights: Samples
    offsets: Samples

    def probabilities(self, figures: Samples) -> Samples:
        """Of each class (n_sounds, n_classes) for sounds (n_sounds, n_features)."""
        z = (np.where(np.isnan(figures), self.medians, figures) - self.mean) / self.scale
        scores = _SHARPNESS * (z @ self.weights + self.offsets)
        shares = np.exp(scores - scores.max(axis=1, keepdims=True))
        return np.asarray(shares / shares.sum(axis=1, keepdims=True))


def discriminants(figures: Samples, classes: NDArray[np.str_]) -> Discriminants:
    """Learn classes (n_sounds) from figures (n_sounds, n_features)."""
    medians = np.nanmedian(figures, axis=0)
    filled = np.where(np.isnan(figures), medians, figures)
    mean, scale = filled.mean(axis=0), filled.std(axis=0) + 1e-9
    z = (filled - mean) / scale
    names = sorted(set(classes.tolist()))
    centres = np.array([z[classes == name].mean(axis=0) for name in names])
    within = np.mean([np.cov(z[classes == name].T, bias=True) for name in names], axis=0)
    even = np.trace(within) / len(within) * np.eye(len(within))
    weights = np.linalg.solve((1 - _SHRINKAGE) * within + _SHRINKAGE * even, centres.T)
    return Discriminants(
        names, medians, mean, scale, weights, -0.5 * np.sum(centres * weights.T, axis=1)
    )


@dataclass(frozen=True, slots=True)
class Kin:
    """Recordings of a class near a pitch: which, and mean and spread of each feature."""

    rows: NDArray[np.intp]
    mean: Samples
    spread: Samples

    def deviations(self, figures: Samples) -> Samples:
        """How many standard deviations each feature lies from the mean."""
        return np.asarray((figures - self.mean) / self.spread)


def distance(deviations: Samples) -> float:
    """Root mean square over the groups of features, each the root mean square of its own."""
    squares = []
    for columns in _GROUPS.values():
        z = deviations[columns]
        if np.any(np.isfinite(z)):
            squares.append(float(np.nanmean(np.clip(z, -_FARTHEST, _FARTHEST) ** 2)))
    return math.sqrt(float(np.mean(squares)))


class Recorded:
    """Recorded sounds: figures (n_sounds, n_features), class, source and pitch [MIDI] of each."""

    def __init__(self) -> None:
        """Read the data."""
        with np.load(DATA) as data:
            self.figures = data["figures"].astype(float)
            self.classes = data["classes"]
            self.sources = data["sources"]
            self.pitches = data["pitches"].astype(float)

    @cached_property
    def learnt(self) -> Discriminants:
        """Learnt from all recordings."""
        counted = ~np.isin(self.classes, list(LEFT_OUT))
        return discriminants(self.figures[counted], self.classes[counted])

    @cached_property
    def _within(self) -> Samples:
        """The mean variance of each feature within the classes."""
        columns = []
        for column in self.figures.T:
            each = [column[self.classes == name] for name in sorted(set(self.classes.tolist()))]
            variances = [np.nanvar(part) for part in each if np.sum(np.isfinite(part)) > 5]
            columns.append(float(np.mean(variances)))
        return np.array(columns)

    def kin(self, name: str, pitch: float | None = None) -> Kin:
        """The recordings of a class, near a pitch [MIDI] if there are enough."""
        inside = self.classes == name
        if pitch is not None:
            near = inside & (np.abs(self.pitches - pitch) <= _NEAR)
            inside = near if near.sum() >= _FEWEST else inside
        return self._kin(np.flatnonzero(inside))

    def _kin(self, rows: NDArray[np.intp]) -> Kin:
        figures = self.figures[rows]
        finite = np.isfinite(figures)
        count = np.maximum(finite.sum(axis=0), 1)
        mean = np.where(finite, figures, 0.0).sum(axis=0) / count
        variance = np.where(finite, (figures - mean) ** 2, 0.0).sum(axis=0) / count
        mean = np.where(finite.mean(axis=0) < 0.3, math.nan, mean)
        spread = np.sqrt((1 - _WITHIN) * variance + _WITHIN * self._within)
        return Kin(rows, mean, spread)

    def distances(self, kin: Kin) -> Samples:
        """Of the recordings themselves."""
        return np.array([distance(kin.deviations(self.figures[i])) for i in kin.rows])

    def other_sources(self, kin: Kin) -> dict[str, float]:
        """How far a source's recordings lie from those of the others, in the median; of each source
        that has enough, where the others have.
        """
        distances = {}
        sources = self.sources[kin.rows]
        for source in sorted(set(sources.tolist())):
            rows = kin.rows[sources == source]
            others = kin.rows[sources != source]
            if len(rows) < _FEWEST_OF_SOURCE or len(others) < _FEWEST_OF_OTHERS:
                continue
            deviations = self._kin(others).deviations(self.figures[rows])
            distances[source] = float(np.median([distance(row) for row in deviations]))
        return distances

    def ranks_without_source(self) -> dict[str, list[int]]:
        """The rank of the right class of each recording, by source, where only other sources were
        learnt from: how far the verdict can be trusted.
        """
        counted = ~np.isin(self.classes, list(LEFT_OUT))
        ranks: dict[str, list[int]] = {}
        for source in sorted(set(self.sources.tolist())):
            others = counted & (self.sources != source)
            learnt = discriminants(self.figures[others], self.classes[others])
            wanted = (self.sources == source) & np.isin(self.classes, learnt.classes)
            shares = learnt.probabilities(self.figures[wanted])
            right = [learnt.classes.index(name) for name in self.classes[wanted].tolist()]
            ranks[source] = [
                1 + int(np.sum(row > row[i])) for row, i in zip(shares, right, strict=True)
            ]
        return ranks
