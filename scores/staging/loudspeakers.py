"""Maps places on an instrument's bench to the loudspeakers of a room."""

from __future__ import annotations

from ergon.instruments.model import Layout, Placing
from ergon.space.directions import Point, equidistant

_DEFAULT_PLACING = Placing(1.0, (0.0, 0.0), None)


class Loudspeakers:
    """Finds the loudspeaker of a room that is nearest to a place on an instrument's bench."""

    def __init__(self, layout: Layout, placing: Placing | None) -> None:
        """Take the room; without `placing` a body of 1 m is 1 m wide, in the middle of the plan."""
        self._placing = placing or _DEFAULT_PLACING
        self._is_in_space = self._placing.height is not None
        self._speakers = layout.speakers
        if not self._is_in_space:
            projection = equidistant if layout.is_equidistant else _top_view
            self._speakers = tuple((*projection(place), 0.0) for place in layout.speakers)

    def nearest(self, place: tuple[float, float]) -> int:
        """The index of the nearest loudspeaker, from 0; the first if several are equally near."""
        placing = self._placing
        x = placing.across * place[0] + placing.at[0]
        y = placing.across * place[1] + placing.at[1]
        z = placing.height or 0.0

        def distance(speaker_index: int) -> float:
            sx, sy, sz = self._speakers[speaker_index]
            return (sx - x) * (sx - x) + (sy - y) * (sy - y) + (sz - z) * (sz - z)

        return min(range(len(self._speakers)), key=distance)


def _top_view(place: Point) -> tuple[float, float]:
    return place[0], place[1]
