"""Where sources are as a head of a SOFA file hears them (AES69): by its place and its view."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ergon.common.errors import ErgonError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

LISTENER, VIEW, UP, EARS = "ListenerPosition", "ListenerView", "ListenerUp", "ReceiverPosition"
_DEFAULT_PLACES = {LISTENER: (0.0, 0.0, 0.0), VIEW: (1.0, 0.0, 0.0), UP: (0.0, 0.0, 1.0)}  # AES69
_AZIMUTH_MAX, _ELEVATION_MAX = 360.0, 90.0 + 1e-6  # degrees


class SofaSpaceError(ErgonError, ValueError):
    """The places of a file cannot be those of a head and sources around it."""


@dataclass(frozen=True, slots=True)
class Places:
    """Rows of three numbers, and what they are: `spherical` (azimuth, elevation [degrees], r) or
    `cartesian` (x to the front, y to the left, z up).
    """

    rows: NDArray[np.float64]
    kind: str

    def to_cartesian(self, label: str) -> NDArray[np.float64]:
        """As cartesian places. Raises SofaSpaceError."""
        import numpy as np

        if not np.isfinite(self.rows).all():
            raise SofaSpaceError(f"{label} is not finite")
        if self.kind != "spherical":
            return self.rows
        azimuth, elevation, r = self.rows.T
        azimuth, elevation = np.radians(azimuth), np.radians(elevation)
        horizontal_length = r * np.cos(elevation)
        return np.stack(
            [
                horizontal_length * np.cos(azimuth),
                horizontal_length * np.sin(azimuth),
                r * np.sin(elevation),
            ],
            1,
        )


def directions(source: Places, head: Mapping[str, Places]) -> NDArray[np.float64]:
    """Azimuth and elevation [degrees] of each source from the head. Raises SofaSpaceError."""
    import numpy as np

    rows = source.rows
    if source.kind == "spherical":
        if not (np.abs(rows[:, 0]) <= _AZIMUTH_MAX).all():
            raise SofaSpaceError("an azimuth is beyond 360°")
        if not (np.abs(rows[:, 1]) <= _ELEVATION_MAX).all():
            raise SofaSpaceError("an elevation is beyond 90°")
    head_position, view_vectors, up_vectors = (
        _head_places(name, head, len(rows)) for name in _DEFAULT_PLACES
    )
    is_default_head = (
        not head_position.any()
        and not view_vectors[:, 1:].any()
        and (view_vectors[:, 0] > 0.0).all()
    )
    if (
        is_default_head
        and not up_vectors[:, 1].any()
        and (up_vectors[:, 2] > 0.0).all()
        and source.kind == "spherical"
    ):
        return rows[:, :2]
    forwards = view_vectors / np.linalg.norm(view_vectors, axis=1, keepdims=True)
    upwards = up_vectors - forwards * (forwards * up_vectors).sum(axis=1, keepdims=True)
    upward_length = np.linalg.norm(upwards, axis=1, keepdims=True)
    if not (upward_length > 1e-6 * np.linalg.norm(up_vectors, axis=1, keepdims=True)).all():
        raise SofaSpaceError(f"{UP} points where {VIEW} does")
    upwards /= upward_length
    source_vectors = source.to_cartesian("SourcePosition") - head_position
    if not source_vectors.any(axis=1).all():
        raise SofaSpaceError("a direction is the place of the head itself")
    leftwards = np.cross(upwards, forwards)
    x, y, z = ((source_vectors * axis).sum(axis=1) for axis in (forwards, leftwards, upwards))
    radians = np.stack([np.arctan2(y, x), np.arctan2(z, np.hypot(x, y))], axis=1)
    return radians * (180.0 / np.pi)


def _head_places(name: str, head: Mapping[str, Places], n_sources: int) -> NDArray[np.float64]:
    """A row of the head, or one for each of `n_sources` sources; the usual one where it is not
    said.
    """
    import numpy as np

    default_place = np.array([_DEFAULT_PLACES[name]])
    if name not in head:
        return default_place
    if head[name].rows.shape not in ((1, 3), (n_sources, 3)):
        sizes = " by ".join(map(str, head[name].rows.shape))
        raise SofaSpaceError(f"{name} is {sizes}; expected 1 or {n_sources} by 3")
    points = head[name].to_cartesian(name)
    is_stated = points.any(axis=1, keepdims=True)
    return np.where(is_stated, points, default_place)


def is_right_first(ears: Places | None) -> bool:
    """Whether the first of two ears is the right one. Raises SofaSpaceError."""
    if ears is None or ears.rows.ndim < 2 or ears.rows.shape[:2] != (2, 3):
        return False
    first_y, second_y = (
        Places(ear.reshape(3, -1).T, ears.kind).to_cartesian(EARS)[:, 1] for ear in ears.rows
    )
    if (first_y >= second_y).all():
        return False
    if (first_y < second_y).all():
        return True
    raise SofaSpaceError(f"its ears ({EARS}) change sides")
