"""Arrays of loudspeakers for tests of space, and the same arrays in spaudiopy."""

import warnings
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from ergon.space.directions import Point, point

RINGS = ((12, 0.0, 0.0), (8, 35.0, 22.5), (4, 70.0, 45.0))


@cache
def spaudiopy() -> Any:
    """The package, which takes a second to import: the tests that compare with it wait alone.

    spaudiopy 0.2 calls scipy's `sph_harm`, which scipy 1.17 names `sph_harm_y`; it also warns if it
    cannot play.
    """
    import scipy.special

    if not hasattr(scipy.special, "sph_harm"):
        scipy.special.sph_harm = lambda m, n, azimuth, zenith: scipy.special.sph_harm_y(
            n, m, zenith, azimuth
        )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import spaudiopy
    return spaudiopy


def dome(rings=RINGS, distance: float = 3.0) -> tuple[Point, ...]:
    """Rings of (how many, elevation, azimuth of the first [degrees])."""
    return tuple(
        point(first + 360.0 * k / n, elevation, distance)
        for n, elevation, first in rings
        for k in range(n)
    )


def nudged(array: np.ndarray, by: float = 1e-3) -> np.ndarray:
    """Each loudspeaker displaced a little, above the horizon, so that no four lie in one plane."""
    rows = array + np.random.default_rng(5).normal(size=array.shape) * by
    rows[:, 2] = np.abs(rows[:, 2])
    return rows / np.linalg.norm(rows, axis=1)[:, None]


class Theirs:
    """An array closed by imaginary loudspeakers, panned and decoded by spaudiopy."""

    def __init__(self, array: np.ndarray, imaginary: np.ndarray) -> None:
        self._setup = self._quietly(spaudiopy().decoder.LoudspeakerSetup, *array.T)
        self._quietly(
            self._setup.ambisonics_setup,
            update_hull=True,
            imaginary_ls=imaginary,
            characteristic_order=5,
        )
        self.virtual = self._setup.kernel_hull.points
        self._closed = self._setup.ambisonics_hull
        self._n = len(array)

    def _quietly(self, call: Callable, *values, **named):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return call(*values, **named)

    def nearest(self, sources: np.ndarray) -> np.ndarray:
        return spaudiopy().decoder.nearest_loudspeaker(sources, self._setup)

    def vbap(self, sources: np.ndarray) -> np.ndarray:
        """Gains without those of imaginary loudspeakers."""
        return spaudiopy().decoder.vbap(sources, self._closed)[:, : self._n]

    def allrad(self, order: int, sources: np.ndarray) -> np.ndarray:
        # In spaudiopy's axes, which it also uses for its virtual sources.
        harmonics = their_harmonics(order, sources @ np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1]]))
        played = self._quietly(spaudiopy().decoder.allrad, harmonics.T, self._setup, N_sph=order)
        return played.T


def their_harmonics(order: int, sources: np.ndarray) -> np.ndarray:
    """N3D, with sources whose x is to the right; in AmbiX x is to the front."""
    front, left, up = sources[:, 1], -sources[:, 0], sources[:, 2]
    azimuth, zenith = np.arctan2(left, front), np.arccos(np.clip(up, -1.0, 1.0))
    return spaudiopy().sph.sh_matrix(order, azimuth, zenith) * np.sqrt(4.0 * np.pi)


def their_energy_vectors(gains: np.ndarray, array: np.ndarray) -> np.ndarray:
    return spaudiopy().sph.r_E(array, gains)[0]
