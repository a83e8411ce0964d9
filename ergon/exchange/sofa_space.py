"""Where sources are as a head of a SOFA file hears them (AES69): by its place and its view."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ergon.common.errors import ErgonError
from ergon.common.terminal import printable

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

LISTENER, VIEW, UP, EARS = "ListenerPosition", "ListenerView", "ListenerUp", "ReceiverPosition"
_DEFAULT_PLACES = {LISTENER: (0.0, 0.0, 0.0), VIEW: (1.0, 0.0, 0.0), UP: (0.0, 0.0, 1.0)}  # AES69
_AZIMUTH_MAX, _ELEVATION_MAX = 360.0 + 1e-6, 90.0 + 1e-6  # degrees
_DEGREES_PER_UNIT = {"deg": 1.0, "degree": 1.0, "rad": 180.0 / math.pi, "radian": 180.0 / math.pi}
_METRES_PER_UNIT = {
    prefix + unit: scale
    for prefix, scale in (("", 1.0), ("centi", 1e-2), ("milli", 1e-3))
    for unit in ("metre", "meter")
} | {"m": 1.0, "cm": 1e-2, "mm": 1e-3}


class SofaSpaceError(ErgonError, ValueError):
    """The places of a file cannot be those of a head and sources around it."""


@dataclass(frozen=True, slots=True)
class Places:
    """Rows (n, 3) or (n, 3, m) of three numbers, and what they are: `spherical` (azimuth,
    elevation [degrees], distance [m]) or `cartesian` (x to the front, y to the left, z up [m]).
    """

    rows: NDArray[np.float64]
    kind: str

    def points(self, name: str) -> NDArray[np.float64]:
        """As cartesian places. Raises SofaSpaceError."""
        import numpy as np

        if not np.isfinite(self.rows).all():
            raise SofaSpaceError(f"{name} is not finite")
        if self.kind != "spherical":
            return self.rows
        azimuth, elevation, r = self.rows.swapaxes(0, 1)
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


def read_places(
    name: str, rows: NDArray[np.float64], kind_text: str, units_text: str, usual_kind: str
) -> Places:
    """A coordinate variable, in degrees and metres, by its attributes `Type` and `Units`.

    Units tell the kind where there is no type; `usual_kind` counts where there is neither, and ""
    refuses that. Raises SofaSpaceError.
    """
    import numpy as np

    if rows.ndim not in (2, 3) or rows.shape[1] != 3:
        sizes_text = " by ".join(map(str, rows.shape))
        raise SofaSpaceError(f"{name} is {sizes_text}; expected rows of 3 numbers")
    units = [unit.rstrip("s") for unit in re.split(r"[\s,;]+", units_text.lower()) if unit]
    if unknown_unit := next((unit for unit in units if _quantity(unit) is None), None):
        raise SofaSpaceError(
            f"{name} is in {printable(unknown_unit)!r}; degrees, radians, metres, centimetres and "
            "millimetres are read: correct its attribute Units"
        )
    quantities = [_quantity(unit) for unit in units]
    kind = kind_text.lower() or usual_kind
    if not kind_text and units:
        kind = "spherical" if "angle" in quantities else "cartesian"
    if kind not in ("spherical", "cartesian"):
        kind_words = printable(kind) or "not said to be either"
        raise SofaSpaceError(f"{name} is {kind_words}, not spherical or cartesian: give its Type")
    if kind == "cartesian" and not rows.any():
        return Places(rows, kind)  # the origin has no unit
    if kind == "cartesian":
        expected, complete_units = ["length"] * 3, units * (3 if len(units) == 1 else 1)
    else:
        expected = ["angle", "angle", "length"]
        complete_units = units * 2 if len(units) == 1 else units
        complete_units = [*complete_units, "m"] if len(complete_units) == 2 else complete_units
    if units and [_quantity(unit) for unit in complete_units] != expected:
        raise SofaSpaceError(
            f"{name} is {kind}, in {printable(units_text)}: one of both is wrong; correct its Type "
            "or its Units"
        )
    scales = [_DEGREES_PER_UNIT.get(unit) or _METRES_PER_UNIT[unit] for unit in complete_units]
    axis_scales = np.array(scales or [1.0] * 3).reshape(3, *[1] * (rows.ndim - 2))
    with np.errstate(over="ignore"):  # of a damaged file; what is not finite is refused later
        return Places(rows * axis_scales, kind)


def _quantity(unit: str) -> str | None:
    """What a unit measures: an angle, a length; None for another."""
    if unit in _DEGREES_PER_UNIT:
        return "angle"
    return "length" if unit in _METRES_PER_UNIT else None


def directions(source: Places, head: Mapping[str, Places]) -> NDArray[np.float64]:
    """Azimuth and elevation [degrees] of each source from the head. Raises SofaSpaceError."""
    import numpy as np

    rows = source.rows
    if source.kind == "spherical":
        if not (np.abs(rows[:, 0]) <= _AZIMUTH_MAX).all():
            raise SofaSpaceError("an azimuth is beyond 360°")
        if not (np.abs(rows[:, 1]) <= _ELEVATION_MAX).all():
            raise SofaSpaceError("an elevation is beyond 90°")
    place, view, up = (_head_places(name, head, len(rows)) for name in _DEFAULT_PLACES)
    is_usual = not place.any() and not view[:, 1:].any() and (view[:, 0] > 0.0).all()
    if is_usual and not up[:, 1].any() and (up[:, 2] > 0.0).all() and source.kind == "spherical":
        return rows[:, :2]
    forwards = view / np.linalg.norm(view, axis=1, keepdims=True)
    upwards = up - forwards * (forwards * up).sum(axis=1, keepdims=True)
    height = np.linalg.norm(upwards, axis=1, keepdims=True)
    if not (height > 1e-6 * np.linalg.norm(up, axis=1, keepdims=True)).all():
        raise SofaSpaceError(f"{UP} points where {VIEW} does")
    upwards /= height
    source_vectors = source.points("SourcePosition") - place
    if not source_vectors.any(axis=1).all():
        raise SofaSpaceError("a direction is the place of the head itself")
    leftwards = np.cross(upwards, forwards)
    x, y, z = ((source_vectors * axis).sum(axis=1) for axis in (forwards, leftwards, upwards))
    radians = np.stack([np.arctan2(y, x), np.arctan2(z, np.hypot(x, y))], axis=1)
    return radians * (180.0 / np.pi)


def _head_places(name: str, head: Mapping[str, Places], n: int) -> NDArray[np.float64]:
    """A row of the head, or one for each of `n` sources; the usual one where it is not said."""
    import numpy as np

    default_place = np.array([_DEFAULT_PLACES[name]])
    if name not in head:
        return default_place
    if head[name].rows.shape not in ((1, 3), (n, 3)):
        sizes = " by ".join(map(str, head[name].rows.shape))
        raise SofaSpaceError(f"{name} is {sizes}; expected 1 or {n} by 3")
    points = head[name].points(name)
    is_stated = points.any(axis=1, keepdims=True)
    if name != LISTENER and (head[name].rows.any(axis=1, keepdims=True) & ~is_stated).any():
        raise SofaSpaceError(f"{name} has angles at the distance 0, which is no direction")
    return np.where(is_stated, points, default_place)


def is_right_first(ears: Places | None) -> bool:
    """Whether the first of two ears is the right one. Raises SofaSpaceError."""
    if ears is None:
        return False
    if len(ears.rows) != 2:
        raise SofaSpaceError(f"{EARS} has {len(ears.rows)} rows; expected one for each of 2 ears")
    first, second = ears.points(EARS)[:, 1]
    if (first >= second).all():
        return False
    if (first < second).all():
        return True
    raise SofaSpaceError(f"its ears ({EARS}) change sides")
