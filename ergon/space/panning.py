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
_CLOSED_COSINE = 0.5  # cosine of that angle
_FACET_TOLERANCE = 1e-9  # tolerance for points of one facet, on the unit sphere
_GAIN_MIN = -1e-9  # least gain of a source on the edge of a triangle
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


def _products(
    first_vectors: NDArray[np.float64], second_vectors: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Scalar products of each row of `first_vectors` with each of `second_vectors`, summed in the
    same order on every machine.
    """
    return (
        first_vectors[:, None, 0] * second_vectors[:, 0]
        + first_vectors[:, None, 1] * second_vectors[:, 1]
        + first_vectors[:, None, 2] * second_vectors[:, 2]
    )


def imaginary_speakers(array: NDArray[np.float64]) -> NDArray[np.float64]:
    """Directions of the imaginary loudspeakers that close the hull of an array, (n, 3)."""
    added_speakers = [
        (0.0, 0.0, z)
        for z in (-1.0, 1.0)
        if not len(array) or (array[:, 2] * z).max() < _CLOSED_COSINE
    ]
    return np.array(added_speakers).reshape(-1, 3)


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
    first_corners, b, c = (hull_points[triples[:, i]] for i in range(3))
    normals = _cross(b - first_corners, c - first_corners)
    doubled_areas = np.sqrt((normals * normals).sum(1))
    is_proper = doubled_areas > _FACET_TOLERANCE
    triples, normals = triples[is_proper], normals[is_proper] / doubled_areas[is_proper, None]
    distances = (normals * first_corners[is_proper]).sum(1)
    normals, distances = (
        normals * np.where(distances < 0.0, -1.0, 1.0)[:, None],
        np.abs(distances),
    )
    has_points_beyond = _products(normals, hull_points).max(1) > distances + _FACET_TOLERANCE
    faces: NDArray[np.intp] = triples[~has_points_beyond & (distances > _FACET_TOLERANCE)]
    if not len(faces):
        raise ArrayError("these loudspeakers do not surround the middle of the room")
    return faces


def _cross(
    first_vectors: NDArray[np.float64], second_vectors: NDArray[np.float64]
) -> NDArray[np.float64]:
    return np.stack(
        [
            first_vectors[:, 1] * second_vectors[:, 2] - first_vectors[:, 2] * second_vectors[:, 1],
            first_vectors[:, 2] * second_vectors[:, 0] - first_vectors[:, 0] * second_vectors[:, 2],
            first_vectors[:, 0] * second_vectors[:, 1] - first_vectors[:, 1] * second_vectors[:, 0],
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
    first_corners, second_corners, third_corners = (hull_points[corners[:, i]] for i in range(3))
    sixfold_volumes = (first_corners * _cross(second_corners, third_corners)).sum(1)
    # Rows of the inverse of (a b c) by Cramer's rule, whose bits do not depend on a library.
    inverse_matrices = (
        np.stack(
            [
                _cross(second_corners, third_corners),
                _cross(third_corners, first_corners),
                _cross(first_corners, second_corners),
            ],
            1,
        )
        / sixfold_volumes[:, None, None]
    )
    speaker_gains = np.zeros((len(source_directions), len(hull_points)))
    n_faces = np.zeros(len(source_directions), np.intp)
    for rows, corner in zip(inverse_matrices, corners, strict=True):
        corner_gains = _products(source_directions, rows)
        is_inside = corner_gains.min(1) >= _GAIN_MIN
        corner_gains = np.maximum(corner_gains[is_inside], 0.0)
        corner_gains /= np.sqrt((corner_gains * corner_gains).sum(1))[:, None]
        speaker_gains[np.flatnonzero(is_inside)[:, None], corner] += corner_gains
        n_faces += is_inside
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
