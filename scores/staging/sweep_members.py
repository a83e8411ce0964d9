"""Computes which members of an instrument a sweep or a path passes, and when."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from math import ceil, sqrt
from typing import TYPE_CHECKING

import numpy as np

from ergon import _core
from ergon.notation.text.errors import TextError
from ergon.scores.reading.sweep_fields import SWEEPS, Passing, Point
from ergon.space.directions import angles, sine_cosine

if TYPE_CHECKING:
    from numpy.typing import NDArray

    _Floats = NDArray[np.float64]

# The length of a chord of a path: with 2° it leaves the circle by 1.5e-4 of its radius.
_CHORD_ANGLE = 2.0  # [degrees]
_MEMBER_STEPS = 20  # steps of work for a member that is visited

Visit = tuple[float, int]  # share of the way, from 0 to 1, and index of the member


def member_visits(
    passing: Passing, network: _core.Network, part_names: Sequence[str], mats: Sequence[int]
) -> list[Visit]:
    """The instants at which the MATs of some parts are passed, in order of time, then of the MATs.

    Positions count from the middle of the bench. Raises TextError if a sweep goes by pitch and a
    MAT has none.
    """
    if not mats:
        return []
    if passing.sweep is None:
        positions = np.array([network.position_of(mat) for mat in mats])
        return _path_passes(passing.path, passing.width, positions)
    coordinate, is_falling = SWEEPS[passing.sweep]
    if coordinate == "pitch":
        fractions = _scaled_to_unit(_log_frequencies(network, part_names, mats))
    else:
        fractions = _sweep_positions(
            coordinate, np.array([network.position_of(mat) for mat in mats])
        )
    visits = [(1.0 - share if is_falling else share, i) for i, share in enumerate(fractions)]
    return sorted(visits)


def _sweep_positions(coordinate: str, positions: _Floats) -> list[float]:
    """The position of each place along a sweep, from 0 to 1."""
    if coordinate == "angle":  # a turn, from the front to the left
        azimuths = (angles((x, y, 0.0))[0] for x, y in positions.tolist())
        return [azimuth / 360.0 % 1.0 for azimuth in azimuths]
    if coordinate == "radius":
        return _scaled_to_unit([sqrt(x * x + y * y) for x, y in positions.tolist()])
    return _scaled_to_unit(positions[:, "xy".index(coordinate)].tolist())


def _scaled_to_unit(values: Sequence[float]) -> list[float]:
    """Values scaled so that the least is 0 and the greatest 1."""
    low, high = min(values), max(values)
    return [(value - low) / (high - low) if high > low else 0.0 for value in values]


def _log_frequencies(
    network: _core.Network, parts: Sequence[str], mats: Sequence[int]
) -> list[float]:
    """ln(K/M) of each CEL: a linear sweep then passes octaves in equal times."""
    elements = network.elements(parts)
    constants_by_mat = {
        elements.mats[row]: (stiffness, elements.masses[row])
        for kind, row, stiffness in zip(
            elements.kinds, elements.a.tolist(), elements.stiffness.tolist(), strict=True
        )
        if kind == "CEL"
    }
    log_frequencies = []
    for mat in mats:
        stiffness, mass = constants_by_mat.get(mat, (0.0, 1.0))
        if not stiffness > 0.0:
            raise TextError(
                f"{network.name_of(mat)} has no pitch, so a sweep by pitch cannot reach it; choose "
                "a sweep by place"
            )
        log_frequencies.append(_core.ln(stiffness / mass))
    return log_frequencies


def _path_passes(path: tuple[Point, ...], width: float, positions: _Floats) -> list[Visit]:
    """Every pass of a member within half the width of the moving point, at its nearest approach."""
    x, y = positions[:, 0], positions[:, 1]
    radius_squared = float((x * x + y * y).max())
    scale = 1.0 / sqrt(radius_squared) if radius_squared > 0.0 else 1.0
    x, y = x * scale, y * scale
    radius_squared_max = width * width / 4.0
    visits: list[Visit] = []
    is_near = np.zeros(len(positions), bool)
    nearest_squared = np.full(len(positions), np.inf)
    nearest_fractions = np.zeros(len(positions))
    for (begin_share, x0, y0), (end_share, x1, y1) in pairwise(_path_corners(path)):
        _core.poll(_MEMBER_STEPS * len(positions))
        dx, dy = x1 - x0, y1 - y0
        chord_squared = dx * dx + dy * dy
        chord_fractions = (
            ((x - x0) * dx + (y - y0) * dy) / chord_squared
            if chord_squared > 0.0
            else np.zeros(len(positions))
        )
        chord_fractions = np.minimum(np.maximum(chord_fractions, 0.0), 1.0)
        away_x, away_y = x - (x0 + chord_fractions * dx), y - (y0 + chord_fractions * dy)
        distance_squared = away_x * away_x + away_y * away_y
        is_near_chord = distance_squared <= radius_squared_max
        for member in np.flatnonzero(is_near & ~is_near_chord):
            visits.append((float(nearest_fractions[member]), int(member)))
        nearest_squared[~is_near_chord] = np.inf
        is_nearer = is_near_chord & (distance_squared < nearest_squared)
        nearest_squared[is_nearer] = distance_squared[is_nearer]
        nearest_fractions[is_nearer] = (begin_share + chord_fractions * (end_share - begin_share))[
            is_nearer
        ]
        is_near = is_near_chord
    visits += [
        (float(nearest_fractions[member]), int(member)) for member in np.flatnonzero(is_near)
    ]
    return sorted(visits)


def _path_corners(path: tuple[Point, ...]) -> list[tuple[float, float, float]]:
    """The path as chords: (share of the way, x, y) of each corner."""
    corners = []
    n_legs = len(path) - 1
    for leg, ((r0, a0), (r1, a1)) in enumerate(pairwise(path)):
        n_steps = max(1, ceil(abs(a1 - a0) / _CHORD_ANGLE))
        first_step = 0 if leg == 0 else 1
        for step in range(first_step, n_steps + 1):
            fraction = step / n_steps
            radius = r0 + fraction * (r1 - r0)
            sine, cosine = sine_cosine(a0 + fraction * (a1 - a0))
            corners.append(((leg + fraction) / n_legs, 0.0 - radius * sine, radius * cosine))
    return corners
