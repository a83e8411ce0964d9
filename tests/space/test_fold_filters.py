"""From one field to another: energies, channels, and where a source is heard after it."""

import numpy as np
import pytest
from domes import dome

from ergon.space import fold_filters
from ergon.space.ambisonics import encoder
from ergon.space.directions import point, spread_directions, unit_vectors
from ergon.space.panning import ArrayError
from ergon.space.quality import localisation_vectors, quality

DOME = fold_filters.Field(dome())
RING = fold_filters.Field(dome(((24, 0.0, 0.0),)))
ARRAY = unit_vectors(DOME.speakers)


def test_fold_to_same_layout_is_identity():
    np.testing.assert_array_equal(fold_filters.to_field(DOME, DOME)[:, :, 0], np.eye(24))


def test_fold_to_stereo_constant_power():
    gains = fold_filters.to_stereo(DOME)[:, :, 0]
    np.testing.assert_allclose((gains**2).sum(1), 1.0, atol=1e-12)
    np.testing.assert_allclose(gains[0], np.sqrt(0.5), atol=1e-12)
    np.testing.assert_allclose(gains[3], (1.0, 0.0), atol=1e-12)  # 90° to the left


@pytest.mark.parametrize("azimuth", [30.0, 45.0, 90.0, 110.0])
def test_fold_stereo_pair_to_stereo_is_identity(azimuth: float):
    left, right = point(azimuth, 0.0, 2.0), point(-azimuth, 0.0, 2.0)
    gains = fold_filters.to_stereo(fold_filters.Field((left, right)))[:, :, 0]
    np.testing.assert_array_equal(gains, np.eye(2))
    crossed = fold_filters.to_stereo(fold_filters.Field((right, left)))[:, :, 0]
    np.testing.assert_array_equal(crossed, np.eye(2)[::-1])


def test_fold_to_other_layout_preserves_energy():
    gains = fold_filters.to_field(DOME, RING)[:, :, 0]
    np.testing.assert_allclose((gains**2).sum(1), 1.0, atol=1e-12)
    np.testing.assert_allclose(gains[1], np.eye(24)[2], atol=1e-9)


def test_fold_ambisonics_encoding_and_decoding_errors():
    """As measured: order 5 and back, 2.5° off on average and loudness within 1.5 dB."""
    there = fold_filters.to_field(DOME, fold_filters.Field(order=5))
    assert there.shape == (24, 36, 1)
    np.testing.assert_allclose(there[:, :, 0], encoder(5, ARRAY))
    back = fold_filters.to_field(fold_filters.Field(order=5), DOME)
    assert back.shape == (36, 24, 1)
    result = quality("", there[:, :, 0] @ back[:, :, 0], ARRAY, ARRAY)
    assert result.angles_off[0] < 2.6
    assert -1.5 < result.loudness[0] < result.loudness[1] < 1.5


def test_fold_decoded_ambisonics_loudness():
    up = spread_directions(500, height_min=0.0)
    for order in (1, 3, 5):
        gains = (
            encoder(order, up)
            @ fold_filters.to_field(fold_filters.Field(order=order), DOME)[:, :, 0]
        )
        energy = localisation_vectors(gains, ARRAY)[2]
        assert abs(10.0 * np.log10(energy.mean())) < 0.5, order


def test_fold_between_ambisonic_orders():
    gains = fold_filters.to_field(fold_filters.Field(order=3), fold_filters.Field(order=1))[:, :, 0]
    np.testing.assert_array_equal(gains, np.eye(16, 4))
    gains = fold_filters.to_field(fold_filters.Field(order=1), fold_filters.Field(order=3))[:, :, 0]
    np.testing.assert_array_equal(gains, np.eye(4, 16))


def test_fold_ambisonics_to_stereo_sides():
    left = encoder(5, unit_vectors((point(90.0, 0.0, 1.0),)))
    gains = (left @ fold_filters.to_stereo(fold_filters.Field(order=5))[:, :, 0])[0]
    assert gains[0] > 3.0 * abs(gains[1])


def test_fold_to_non_surrounding_layout_is_refused():
    pair = fold_filters.Field((point(30.0, 0.0, 1.0), point(-30.0, 0.0, 1.0)))
    with pytest.raises(ArrayError, match="surround"):
        fold_filters.to_field(DOME, pair)
