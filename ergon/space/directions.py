"""Directions seen from the middle of a room: x to the right, y to the front, z up.

Azimuths run from the front to the left, elevations from the horizon up, in degrees, as in ADM
(ITU-R BS.2076) and AmbiX. Sines are the engine's own: directions decide which loudspeaker is heard.
"""

from __future__ import annotations

from math import pi, sqrt
from typing import TYPE_CHECKING

from ergon import _core

if TYPE_CHECKING:
    from collections.abc import Iterable

    import numpy as np
    from numpy.typing import NDArray

Point = tuple[float, float, float]  # (x, y, z) [m]
Angles = tuple[float, float, float]  # azimuth, elevation [degrees], distance [m]
_GOLDEN_ANGLE = pi * (3.0 - sqrt(5.0))
_EXACT_SINES = {-270.0: (1.0, 0.0), -180.0: (0.0, -1.0), -90.0: (-1.0, 0.0), 0.0: (0.0, 1.0)} | {
    90.0: (1.0, 0.0),
    180.0: (0.0, -1.0),
    270.0: (-1.0, 0.0),
}


def sine_cosine(degrees: float) -> tuple[float, float]:
    """Sine and cosine of an angle in degrees; exact for quarter turns."""
    if degrees in _EXACT_SINES:
        return _EXACT_SINES[degrees]
    angle = degrees * pi / 180.0
    return _core.sin(angle), _core.cos(angle)


def point(azimuth: float, elevation: float, distance: float) -> Point:
    """The point in a direction [degrees] at a distance [m]."""
    (left_share, front_share), (upward_share, horizontal_share) = (
        sine_cosine(azimuth),
        sine_cosine(elevation),
    )
    return (
        0.0 - distance * horizontal_share * left_share,
        distance * horizontal_share * front_share,
        distance * upward_share,
    )


def angles(place: Point) -> Angles:
    """Azimuth and elevation [degrees] and distance [m] of a point; (0, 0, 0) for the middle."""
    x, y, z = place
    horizontal_length = sqrt(x * x + y * y)
    degrees_per_radian = 180.0 / pi
    azimuth = _core.atan2(-x, y) * degrees_per_radian if horizontal_length else 0.0
    elevation = (
        _core.atan2(z, horizontal_length) * degrees_per_radian if horizontal_length or z else 0.0
    )
    return azimuth + 0.0, elevation, sqrt(horizontal_length * horizontal_length + z * z)


def equidistant(point_in_room: Point) -> tuple[float, float]:
    """(x, y) [m] of a point in a plan whose radius grows in proportion to the angle from the
    zenith.

    The zenith is the middle; a point at the horizon is drawn at its own distance.
    """
    x, y, _ = point_in_room
    horizontal_length = sqrt(x * x + y * y)
    if not horizontal_length:
        return 0.0, 0.0
    _, elevation, distance = angles(point_in_room)
    scale = distance * (1.0 - elevation / 90.0) / horizontal_length
    return x * scale, y * scale


def unit_vectors(places: Iterable[Point]) -> NDArray[np.float64]:
    """Directions of points as unit vectors, (n, 3); the middle itself counts as the front."""
    import numpy as np

    vectors = np.array([*places], np.float64).reshape(-1, 3)
    lengths = np.sqrt((vectors * vectors).sum(1))
    vectors[lengths == 0.0] = 0.0, 1.0, 0.0
    return vectors / np.where(lengths == 0.0, 1.0, lengths)[:, None]


def spread_directions(direction_count: int, height_min: float = -1.0) -> NDArray[np.float64]:
    """`direction_count` directions that fill the sphere evenly above the height `height_min` (z),
    (direction_count, 3).

    On a spiral by the golden angle (R. Swinbank, R. J. Purser, Q. J. R. Meteorol. Soc. 132, 2006).
    """
    import numpy as np

    directions = []
    for direction_index in range(direction_count):
        z = 1.0 - (1.0 - height_min) * (direction_index + 0.5) / direction_count
        horizontal_length = sqrt(1.0 - z * z)
        turn = _GOLDEN_ANGLE * direction_index
        directions.append(
            (horizontal_length * _core.cos(turn), horizontal_length * _core.sin(turn), z)
        )
    return np.array(directions)
