"""How well an array places sound: vectors of velocity and energy, and where it has holes.

Source: M. A. Gerzon, "General metatheory of auditory localisation", AES preprint 3306 (1992):
the velocity vector rV describes localisation at low frequencies, the energy vector rE at high
ones; a single loudspeaker gives length 1.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from .ambisonics import allrad, harmonics
from .directions import spread_directions, unit_vectors
from .panning import ArrayError, imaginary_speakers, nearest_gains, triangles, vbap

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from .directions import Point

_N_DIRECTIONS = 4000  # directions of the upper half
_HOLE_DEGREES = 75.0  # [degrees]: loudspeakers farther apart leave a hole between them
_MIRROR_TOLERANCE = 1e-6


@dataclass(frozen=True, slots=True)
class Quality:
    """How one way of panning places sound, over the upper half of the sphere.

    Lengths of rE and rV; the angle between rE and the source [degrees]; loudness relative to its
    mean [dB].
    """

    name: str
    energy_length: tuple[float, float]  # mean and minimum
    velocity_length: float  # mean
    angles_off: tuple[float, float]  # mean and maximum [degrees]
    loudness: tuple[float, float]  # minimum and maximum [dB]


def localisation_vectors(
    gains: NDArray[np.float64], array: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """rV and rE (n_sources, 3), and energies (n_sources,), of gains (n_sources, n_loudspeakers)."""
    squared_gains = gains * gains
    energy, amplitude = squared_gains.sum(1), gains.sum(1)
    velocity = (gains @ array) / np.where(amplitude == 0.0, 1.0, amplitude)[:, None]
    return velocity, (squared_gains @ array) / np.where(energy == 0.0, 1.0, energy)[:, None], energy


def qualities(places: tuple[Point, ...]) -> list[Quality]:
    """What an array of loudspeakers can do by each way of panning.

    If the loudspeakers do not surround the middle of the room, only the nearest one can be used.
    """
    array = unit_vectors(places)
    source_directions = spread_directions(_N_DIRECTIONS, height_min=0.0)
    gains_by_method: dict[str, Callable[[], NDArray[np.float64]]] = {
        "nearest": lambda: nearest_gains(source_directions, array),
        "VBAP": lambda: vbap(source_directions, array),
        "AllRAD 3": lambda: harmonics(3, source_directions) @ allrad(3, array).T,
        "AllRAD 5": lambda: harmonics(5, source_directions) @ allrad(5, array).T,
    }
    result_rows = []
    for name, compute_gains in gains_by_method.items():
        try:
            result_rows.append(quality(name, compute_gains(), source_directions, array))
        except ArrayError:
            break
    return result_rows


def quality(
    quality_name: str,
    gains: NDArray[np.float64],
    sources: NDArray[np.float64],
    array: NDArray[np.float64],
) -> Quality:
    """How gains (n_sources, n_loudspeakers) place sources."""
    velocity_vectors, energy_vectors, energy = localisation_vectors(gains, array)
    vector_lengths = np.linalg.norm(energy_vectors, axis=1)
    energy_directions = (
        energy_vectors / np.where(vector_lengths == 0.0, 1.0, vector_lengths)[:, None]
    )
    angles_off = np.degrees(np.arccos(np.clip((energy_directions * sources).sum(1), -1.0, 1.0)))
    energy_level = 10.0 * np.log10(np.maximum(energy, 1e-12) / energy.mean())
    return Quality(
        quality_name,
        (float(vector_lengths.mean()), float(vector_lengths.min())),
        float(np.linalg.norm(velocity_vectors, axis=1).mean()),
        (float(angles_off.mean()), float(angles_off.max())),
        (float(energy_level.min()), float(energy_level.max())),
    )


def holes(places: tuple[Point, ...]) -> list[tuple[int, int, float]]:
    """Neighbours at or above the horizon that are far apart: (index, index, angle [degrees])."""
    array = unit_vectors(places)
    hull_points = np.vstack([array, imaginary_speakers(array)])
    try:
        corners_of_all = triangles(hull_points).tolist()
    except ArrayError:
        return []
    pairs = {
        (min(first_speaker, second_speaker), max(first_speaker, second_speaker))
        for corners in corners_of_all
        for first_speaker, second_speaker in zip(corners, corners[1:] + corners[:1], strict=True)
        if max(first_speaker, second_speaker) < len(array)
        and hull_points[first_speaker][2] > -_MIRROR_TOLERANCE
        and hull_points[second_speaker][2] > -_MIRROR_TOLERANCE
    }
    wide_gaps = []
    for first_speaker, second_speaker in sorted(pairs):
        angle = float(
            np.degrees(
                np.arccos(
                    np.clip(hull_points[first_speaker] @ hull_points[second_speaker], -1.0, 1.0)
                )
            )
        )
        if angle > _HOLE_DEGREES:
            wide_gaps.append((first_speaker, second_speaker, angle))
    return wide_gaps


def is_open_above(places: tuple[Point, ...]) -> bool:
    """Whether no loudspeaker lies within 60° of the zenith."""
    return bool((imaginary_speakers(unit_vectors(places))[:, 2] > 0.0).any())


def is_symmetric(places: tuple[Point, ...]) -> bool:
    """Whether each loudspeaker has a counterpart mirrored from left to right, within 1 mm."""
    points = np.array(places)
    mirrored_points = points * (-1.0, 1.0, 1.0)
    mirror_distances = np.abs(points[:, None] - mirrored_points[None]).max(2)
    return bool((mirror_distances.min(1) < 1e-3 + _MIRROR_TOLERANCE).all())
