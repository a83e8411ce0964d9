"""Where azimuths and elevations point, and the plan by which a bench is laid into a dome."""

import numpy as np
import pytest
from domes import dome
from hypothesis import given
from hypothesis import strategies as st

from ergon.space import directions, quality


@pytest.mark.parametrize(
    ("azimuth", "elevation", "place"),
    [
        (0, 0, (0, 2, 0)),
        (90, 0, (-2, 0, 0)),  # to the left
        (-90, 0, (2, 0, 0)),
        (180, 0, (0, -2, 0)),
        (0, 90, (0, 0, 2)),
        (0, -90, (0, 0, -2)),
    ],
)
def test_point_at_quarter_turns_exact(azimuth: float, elevation: float, place: tuple):
    assert directions.point(float(azimuth), float(elevation), 2.0) == place


@given(st.floats(-179.9, 179.9), st.floats(-89.0, 89.0), st.floats(0.1, 50.0))
def test_angles_of_point_round_trip(azimuth: float, elevation: float, distance: float):
    place = directions.point(azimuth, elevation, distance)
    np.testing.assert_allclose(
        directions.angles(place), (azimuth, elevation, distance), rtol=1e-9, atol=1e-9
    )


def test_equidistant_projection_of_elevations():
    """At 3 m the horizon is 3 m from the middle, 35° up 3·55/90 m, the zenith the middle."""
    assert directions.equidistant((0.0, 0.0, 3.0)) == (0.0, 0.0)
    for elevation, radius in ((0.0, 3.0), (35.0, 3.0 * 55 / 90), (70.0, 3.0 * 20 / 90)):
        x, y = directions.equidistant(directions.point(30.0, elevation, 3.0))
        np.testing.assert_allclose((x, y), (-radius / 2, radius * 0.75**0.5), rtol=1e-12)


def test_spread_directions_uniform_on_sphere():
    rows = directions.spread_directions(4000)
    np.testing.assert_allclose((rows**2).sum(1), 1.0, atol=1e-12)
    np.testing.assert_allclose(rows.mean(0), 0.0, atol=1e-3)
    assert (directions.spread_directions(100, height_min=0.0)[:, 2] > 0.0).all()


def test_dome_quality_figures():
    """Figures of a dome 12 + 8 + 4, and of the flat ring, which has a hole overhead."""
    near, vbap, third, fifth = quality.qualities(dome())
    np.testing.assert_allclose(near.angles_off, (13.1, 24.5), atol=0.05)
    np.testing.assert_allclose(vbap.energy_length[0], 0.963, atol=1e-3)
    assert vbap.angles_off[1] < 9.4
    assert third.angles_off[0] < 2.4
    assert fifth.angles_off[0] < 1.5
    assert fifth.energy_length[0] > 0.92
    ring = quality.qualities(dome(((24, 0.0, 0.0),)))
    assert ring[1].angles_off[1] > 80.0


def test_layout_holes_and_symmetry():
    assert quality.holes(dome()) == []
    assert quality.is_symmetric(dome())
    four = dome(((4, 0.0, 45.0),))
    assert [(a, b) for a, b, _ in quality.holes(four)] == [(0, 1), (0, 3), (1, 2), (2, 3)]
    assert all(abs(angle - 90.0) < 1e-6 for *_, angle in quality.holes(four))
    assert not quality.is_symmetric((*four[:3], directions.point(-50.0, 0.0, 3.0)))
