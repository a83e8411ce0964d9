"""Gains against spaudiopy, which has its hull from Qhull and its harmonics from scipy."""

import numpy as np
import pytest
from domes import Theirs, dome, nudged, spaudiopy, their_energy_vectors, their_harmonics
from sweep import few

from ergon.space import ambisonics, panning, quality
from ergon.space.directions import spread_directions, unit_vectors

ARRAY = nudged(unit_vectors(dome()))
SOURCES = spread_directions(4000, height_min=0.0)


@pytest.fixture(scope="module")
def theirs() -> Theirs:
    return Theirs(ARRAY, panning.imaginary_speakers(ARRAY))


def same_table(ours: np.ndarray, gains: np.ndarray) -> None:
    """rE of every source, and the table made of it."""
    vectors = quality.localisation_vectors(ours, ARRAY)[1]
    np.testing.assert_allclose(vectors, their_energy_vectors(gains, ARRAY), atol=1e-6)
    a, b = (quality.quality("", one, SOURCES, ARRAY) for one in (ours, gains))
    np.testing.assert_allclose(a.energy_length, b.energy_length, atol=1e-6)
    np.testing.assert_allclose(a.velocity_length, b.velocity_length, atol=1e-6)
    np.testing.assert_allclose(a.angles_off, b.angles_off, atol=1e-4)  # degrees


def test_nearest_gains_equal_spaudiopy(theirs: Theirs):
    same_table(panning.nearest_gains(SOURCES, ARRAY), theirs.nearest(SOURCES))


def test_vbap_gains_equal_spaudiopy(theirs: Theirs):
    gains = theirs.vbap(SOURCES)
    ours = panning.vbap(SOURCES, ARRAY, keeps_imaginary=True)
    np.testing.assert_allclose(ours, gains, atol=1e-6)
    same_table(ours, gains)


@pytest.mark.parametrize("order", few([1, 3, 5], 1))
def test_allrad_gains_equal_spaudiopy(theirs: Theirs, order: int):
    gains = theirs.allrad(order, SOURCES)
    decoder = ambisonics.allrad(order, ARRAY, theirs.virtual)
    ours = ambisonics.harmonics(order, SOURCES) @ decoder.T
    np.testing.assert_allclose(
        ours / np.linalg.norm(ours), gains / np.linalg.norm(gains), atol=1e-6
    )
    same_table(ours, gains)


@pytest.mark.parametrize("order", [0, 1, 4, 7])
def test_harmonics_and_weights_equal_spaudiopy(order: int):
    everywhere = spread_directions(500)
    ours = ambisonics.harmonics(order, everywhere)
    np.testing.assert_allclose(ours, their_harmonics(order, everywhere), atol=1e-9)
    weights = spaudiopy().sph.max_rE_weights(order)
    np.testing.assert_allclose(ambisonics.max_re_weights(order), weights, atol=1e-12)
    sn3d = spaudiopy().sph.n3d_to_sn3d(ours.T).T
    np.testing.assert_allclose(ambisonics.encoder(order, everywhere), sn3d, atol=1e-9)


def test_spherical_harmonics_orthonormal():
    even = spread_directions(20_000)
    basis = ambisonics.harmonics(4, even)
    np.testing.assert_allclose(basis.T @ basis / len(even), np.eye(25), atol=2e-3)


def test_vbap_source_at_loudspeaker():
    np.testing.assert_allclose(panning.vbap(ARRAY, ARRAY), np.eye(24), atol=1e-9)


def test_vbap_source_amid_four_corner_facet():
    """A source in the middle of the four of the top is heard from all of them alike."""
    array = unit_vectors(dome())
    gains = panning.vbap(np.array([[0.0, 0.0, 1.0]]), array)[0]
    np.testing.assert_allclose(gains[20:], 0.5, atol=1e-9)
    np.testing.assert_allclose(gains[:20], 0.0, atol=1e-12)


def test_vbap_of_mirrored_source():
    array = unit_vectors(dome())
    mirror = np.array([-1.0, 1.0, 1.0])
    other = [int(np.argmax(array @ (one * mirror))) for one in array]
    gains, mirrored = panning.vbap(SOURCES, array), panning.vbap(SOURCES * mirror, array)
    np.testing.assert_allclose(gains[:, other], mirrored, atol=1e-9)


def test_vbap_energy_below_dome():
    array = unit_vectors(dome())
    gains = panning.vbap(spread_directions(500), array)
    np.testing.assert_allclose((gains**2).sum(1), 1.0, atol=1e-12)
    fading = panning.vbap(np.array([[0.0, 0.0, -1.0]]), array, keeps_imaginary=True)
    assert not fading.any(), "the hole is silent"


def test_vbap_refuses_non_surrounding_layouts():
    with pytest.raises(panning.ArrayError, match="do not surround"):
        panning.triangles(unit_vectors(((0.0, 1.0, 0.0), (1.0, 0.0, 0.0))))
    with pytest.raises(panning.ArrayError, match="do not surround"):
        panning.vbap(SOURCES[:3], unit_vectors(((0.0, 1.0, 0.0), (0.1, 1.0, 0.0))))
    with pytest.raises(panning.ArrayError, match="at most 64"):
        panning.triangles(spread_directions(70))
