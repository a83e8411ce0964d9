"""Gains of loudspeakers for a direction: the nearest one alone, or the three around it.

Source: V. Pulkki, "Virtual sound source positioning using vector base amplitude panning",
J. Audio Eng. Soc. 45 (1997), eq. 18 and 19.
"""

from __future__ import annotations

from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from ergon.common.errors import ErgonError

if TYPE_CHECKING:
    from numpy.typing import NDArray

# If no loudspeaker lies within 60° of straight up (or down), an imaginary one there closes the
# hull, as below a dome (Zotter and Frank, J. Audio Eng. Soc. 60, 2012, section 3).
_CLOSED = 0.5  # cosine of that angle
_FLAT = 1e-9  # of a unit: points of one facet lie in one plane
_INSIDE = -1e-9  # least gain of a source on the edge of a triangle
SPEAKERS_MAX = 64  # loudspeakers


class ArrayError(ErgonError, ValueError):
    """No sound can be panned between these loudspeakers."""


def nearest_gains(
    source_directions: NDArray[np.float64], array: NDArray[np.float64]
) -> NDArray[np.float64]:
    """1 for the loudspeaker nearest to each source, (n_sources, n_loudspeakers).

    Both are unit vectors, (n, 3).
    """
    gains = np.zeros((len(source_directions), len(array)))
    gains[np.arange(len(source_directions)), np.argmax(_products(source_directions, array), 1)] = (
        1.0
    )
    return gains


def _products(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """Scalar products of each row of `a` with each of `b`, summed in the same order on every
    machine.
    """
    return a[:, None, 0] * b[:, 0] + a[:, None, 1] * b[:, 1] + a[:, None, 2] * b[:, 2]


def imaginary_speakers(array: NDArray[np.float64]) -> NDArray[np.float64]:
    """Directions of the imaginary loudspeakers that close the hull of an array, (n, 3)."""
    added = [
        (0.0, 0.0, z) for z in (-1.0, 1.0) if not len(array) or (array[:, 2] * z).max() < _CLOSED
    ]
    return np.array(added).reshape(-1, 3)


def triangles(hull_points: NDArray[np.float64]) -> NDArray[np.intp]:
    """Triangles of the convex hull: all triples of points whose plane has no point beyond it, (n,
    3).

    A facet with more than three corners gives all its triangles: they overlap, so that no
    diagonal is preferred. Raises ArrayError if there are too many points, or if no facet has the
    middle of the room on its inner side.
    """
    if len(hull_points) > SPEAKERS_MAX + 2:
        raise ArrayError(f"an array for panning has at most {SPEAKERS_MAX} loudspeakers")
    triples = np.array([*combinations(range(len(hull_points)), 3)], np.intp).reshape(-1, 3)
    a, b, c = (hull_points[triples[:, i]] for i in range(3))
    normals = _cross(b - a, c - a)
    size = np.sqrt((normals * normals).sum(1))
    proper = size > _FLAT
    triples, normals = triples[proper], normals[proper] / size[proper, None]
    distance = (normals * a[proper]).sum(1)
    normals, distance = (
        normals * np.where(distance < 0.0, -1.0, 1.0)[:, None],
        np.abs(distance),
    )
    beyond = _products(normals, hull_points).max(1) > distance + _FLAT
    faces: NDArray[np.intp] = triples[~beyond & (distance > _FLAT)]
    if not len(faces):
        raise ArrayError("these loudspeakers do not surround the middle of the room")
    return faces


def _cross(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.stack(
        [
            a[:, 1] * b[:, 2] - a[:, 2] * b[:, 1],
            a[:, 2] * b[:, 0] - a[:, 0] * b[:, 2],
            a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0],
        ],
        1,
    )


def vbap(
    source_directions: NDArray[np.float64],
    array: NDArray[np.float64],
    *,
    keeps_imaginary: bool = False,
) -> NDArray[np.float64]:
    """Gains of the loudspeakers around each source, (n_sources, n_loudspeakers), of energy 1.

    The gains of imaginary loudspeakers are dropped, and the others scaled to energy 1. With
    `keeps_imaginary` they are not scaled, so that sources fade towards a hole. If a facet has
    more than three corners, the gains of its triangles are averaged. Raises ArrayError.
    """
    hull_points = np.vstack([array, imaginary_speakers(array)])
    corners = triangles(hull_points)
    a, b, c = (hull_points[corners[:, i]] for i in range(3))
    volume = (a * _cross(b, c)).sum(1)
    # Rows of the inverse of (a b c) by Cramer's rule, whose bits do not depend on a library.
    inverse = np.stack([_cross(b, c), _cross(c, a), _cross(a, b)], 1) / volume[:, None, None]
    speaker_gains = np.zeros((len(source_directions), len(hull_points)))
    n_faces = np.zeros(len(source_directions), np.intp)
    for rows, corner in zip(inverse, corners, strict=True):
        g = _products(source_directions, rows)
        inside = g.min(1) >= _INSIDE
        g = np.maximum(g[inside], 0.0)
        g /= np.sqrt((g * g).sum(1))[:, None]
        speaker_gains[np.flatnonzero(inside)[:, None], corner] += g
        n_faces += inside
    if not n_faces.all():
        raise ArrayError("these loudspeakers do not surround the middle of the room")
    speaker_gains = _unit_energy(speaker_gains)
    speaker_gains = speaker_gains[:, : len(array)]
    return speaker_gains if keeps_imaginary else _unit_energy(speaker_gains)


def _unit_energy(gains: NDArray[np.float64]) -> NDArray[np.float64]:
    """Gains scaled to energy 1; a row of zeros stays zero."""
    energy = np.zeros(len(gains))
    for column in gains.T:
        energy += column * column
    return gains / np.where(energy > 0.0, np.sqrt(energy), 1.0)[:, None]
