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
_CHORD_DEGREES = 2.0  # [degrees]
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
        places = np.array([network.position_of(mat) for mat in mats])
        return _path_passes(passing.path, passing.width, places)
    quantity, is_falling = SWEEPS[passing.sweep]
    if quantity == "pitch":
        shares = _scaled_to_unit(_log_frequencies(network, part_names, mats))
    else:
        shares = _sweep_positions(quantity, np.array([network.position_of(mat) for mat in mats]))
    order = [(1.0 - share if is_falling else share, i) for i, share in enumerate(shares)]
    return sorted(order)


def _sweep_positions(quantity: str, member_places: _Floats) -> list[float]:
    """The position of each place along a sweep, from 0 to 1."""
    if quantity == "angle":  # a turn, from the front to the left
        azimuths = (angles((x, y, 0.0))[0] for x, y in member_places.tolist())
        return [azimuth / 360.0 % 1.0 for azimuth in azimuths]
    if quantity == "radius":
        return _scaled_to_unit([sqrt(x * x + y * y) for x, y in member_places.tolist()])
    return _scaled_to_unit(member_places[:, "xy".index(quantity)].tolist())


def _scaled_to_unit(values: Sequence[float]) -> list[float]:
    """Values scaled so that the least is 0 and the greatest 1."""
    low, high = min(values), max(values)
    return [(value - low) / (high - low) if high > low else 0.0 for value in values]


def _log_frequencies(
    network: _core.Network, parts: Sequence[str], mats: Sequence[int]
) -> list[float]:
    """ln(K/M) of each CEL: a linear sweep then passes octaves in equal times."""
    elements = network.elements(parts)
    ties = {
        elements.mats[slot]: (stiffness, elements.masses[slot])
        for kind, slot, stiffness in zip(
            elements.kinds, elements.a.tolist(), elements.stiffness.tolist(), strict=True
        )
        if kind == "CEL"
    }
    pitches = []
    for mat in mats:
        stiffness, tie_mass = ties.get(mat, (0.0, 1.0))
        if not stiffness > 0.0:
            raise TextError(
                f"{network.name_of(mat)} has no pitch, so a sweep by pitch cannot reach it; choose "
                "a sweep by place"
            )
        pitches.append(_core.ln(stiffness / tie_mass))
    return pitches


def _path_passes(
    path: tuple[Point, ...], point_width: float, member_places: _Floats
) -> list[Visit]:
    """Every pass of a member within half the width of the moving point, at its nearest approach."""
    x, y = member_places[:, 0], member_places[:, 1]
    radius_squared = float((x * x + y * y).max())
    scale = 1.0 / sqrt(radius_squared) if radius_squared > 0.0 else 1.0
    x, y = x * scale, y * scale
    reach_squared = point_width * point_width / 4.0
    visits_found: list[Visit] = []
    is_near = np.zeros(len(member_places), bool)
    nearest_squared = np.full(len(member_places), np.inf)
    nearest_share = np.zeros(len(member_places))
    for (t0, x0, y0), (t1, x1, y1) in pairwise(_path_corners(path)):
        _core.poll(_MEMBER_STEPS * len(member_places))
        dx, dy = x1 - x0, y1 - y0
        segment_square = dx * dx + dy * dy
        chord_share = (
            ((x - x0) * dx + (y - y0) * dy) / segment_square
            if segment_square > 0.0
            else np.zeros(len(member_places))
        )
        chord_share = np.minimum(np.maximum(chord_share, 0.0), 1.0)
        away_x, away_y = x - (x0 + chord_share * dx), y - (y0 + chord_share * dy)
        distance_squared = away_x * away_x + away_y * away_y
        is_near_now = distance_squared <= reach_squared
        for member in np.flatnonzero(is_near & ~is_near_now):
            visits_found.append((float(nearest_share[member]), int(member)))
        nearest_squared[~is_near_now] = np.inf
        nearer = is_near_now & (distance_squared < nearest_squared)
        nearest_squared[nearer] = distance_squared[nearer]
        nearest_share[nearer] = (t0 + chord_share * (t1 - t0))[nearer]
        is_near = is_near_now
    visits_found += [
        (float(nearest_share[member]), int(member)) for member in np.flatnonzero(is_near)
    ]
    return sorted(visits_found)


def _path_corners(path: tuple[Point, ...]) -> list[tuple[float, float, float]]:
    """The path as chords: (share of the way, x, y) of each corner."""
    corners = []
    legs = len(path) - 1
    for leg, ((r0, a0), (r1, a1)) in enumerate(pairwise(path)):
        steps = max(1, ceil(abs(a1 - a0) / _CHORD_DEGREES))
        first_step = 0 if leg == 0 else 1
        for step in range(first_step, steps + 1):
            step_part = step / steps
            radius = r0 + step_part * (r1 - r0)
            sine, cosine = sine_cosine(a0 + step_part * (a1 - a0))
            corners.append(((leg + step_part) / legs, 0.0 - radius * sine, radius * cosine))
    return corners
