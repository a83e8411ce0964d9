"""Whether bows stick, in a piece that is played to its end."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from ergon.scores.staging.probes import ProbedLink

_STICK_SECONDS_MIN = 5e-4  # [s] that ends must stay together to count as sticking
_SEARCH_SPEED_MAX = 10.0  # [m/s] up to which friction is examined
_N_SEARCHED_SPEEDS = 20_001
_FALLING_FRICTION_RATIO = 0.95  # a bow's friction falls below this share of its maximum


@dataclass(slots=True)
class StickDetector:
    """Whether a bow stuck after it had first slipped: it sticks at speeds between `low_speed` and
    `high_speed` [m/s].
    """

    friction_link: ProbedLink
    low_speed: float
    high_speed: float
    has_slipped: bool = False
    has_stuck: bool = False
    _last_elongation: float | None = None
    _n_sticking_frames: int = 0

    def take(self, frames: NDArray[np.float64], rate: float) -> None:
        """Go on with positions (n_frames, n_points)."""
        import numpy as np

        elongations = (
            frames[:, self.friction_link.b.output_number]
            - frames[:, self.friction_link.a.output_number]
        )
        first_elongation = (
            elongations[0] if self._last_elongation is None else self._last_elongation
        )
        speeds = np.diff(elongations, prepend=first_elongation) * rate
        self._last_elongation = float(elongations[-1])
        frames_min = max(1, int(_STICK_SECONDS_MIN * rate))
        for is_sticking in ((speeds > self.low_speed) & (speeds < self.high_speed)).tolist():
            if not is_sticking:
                self.has_slipped, self._n_sticking_frames = True, 0
            elif self.has_slipped:
                self._n_sticking_frames += 1
                self.has_stuck = self.has_stuck or self._n_sticking_frames >= frames_min


def sticking_detector(friction_link: ProbedLink) -> StickDetector | None:
    """A detector for a link whose friction falls beyond a maximum, as a bow's does; None for other
    links.
    """
    sticking_speeds = friction_extremes(friction_link.module.fields)
    return None if sticking_speeds is None else StickDetector(friction_link, *sticking_speeds)


def friction_extremes(law_fields: Any) -> tuple[float, float] | None:
    """The speeds [m/s] of the lowest and the highest friction, if friction falls beyond both."""
    import numpy as np

    from ergon import _core

    if not law_fields.get("damping"):
        return None
    try:
        law = _core.Law(None, law_fields["damping"], law_fields.get("constants") or {})
    except (ValueError, _core.LawError):
        return None
    speeds = np.linspace(-_SEARCH_SPEED_MAX, _SEARCH_SPEED_MAX, _N_SEARCHED_SPEEDS)
    friction_forces = np.zeros(_N_SEARCHED_SPEEDS)
    law.forces(np.zeros(_N_SEARCHED_SPEEDS), speeds, friction_forces)
    if not np.isfinite(friction_forces).all():
        return None
    lowest_index, highest_index = int(np.argmin(friction_forces)), int(np.argmax(friction_forces))
    is_falling = (
        friction_forces[-1] < _FALLING_FRICTION_RATIO * friction_forces[highest_index]
        and friction_forces[0] > _FALLING_FRICTION_RATIO * friction_forces[lowest_index]
    )
    if not (
        lowest_index < highest_index
        and friction_forces[highest_index] > 0.0 > friction_forces[lowest_index]
        and is_falling
    ):
        return None
    return float(speeds[lowest_index]), float(speeds[highest_index])
