"""The fields of strikes by a sweep over an instrument, or along a path, as written.

Which members they strike, and when, is computed by `scores/staging/sweep_members.py`.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from math import ceil
from typing import Any

from ergon.notation.tables import quantities, value_kinds
from ergon.notation.tables.fields import Field, Values
from ergon.notation.tables.shapes import Text, choice
from ergon.notation.text.errors import TextError, quote

# By the word for a direction: the coordinate that the front moves along, and whether it falls.
SWEEPS = {
    "outward": ("radius", False),
    "inward": ("radius", True),
    "anticlockwise": ("angle", False),
    "clockwise": ("angle", True),
    "rightward": ("x", False),
    "leftward": ("x", True),
    "forward": ("y", False),
    "backward": ("y", True),
    "upward": ("pitch", False),
    "downward": ("pitch", True),
}
MAX_POINTS = 1000  # points of a path
MAX_TURNS = 100.0  # turns of a path, each of 180 steps
DEFAULT_PATH_WIDTH = 0.05
_PATH_SEPARATOR = "->"

Point = tuple[float, float]  # radius (1: the farthest member), azimuth [degrees]


@dataclass(frozen=True, slots=True)
class Passing:
    """A sweep over an instrument, or a path across it, which lasts `length`; members are struck as
    they are passed.

    Either a front moves along `sweep`, a word of SWEEPS; or a point moves along `path`, linearly
    from point to point in radius and azimuth, and passes the members that come nearer than
    `width` / 2. A passed member is struck with the probability `chance`.
    """

    sweep: str | None
    path: tuple[Point, ...]
    width: float
    chance: float

    @property
    def is_by_pitch(self) -> bool:
        """Whether members are passed in the order of their frequencies."""
        return self.sweep is not None and SWEEPS[self.sweep][0] == "pitch"

    @property
    def visits_max(self) -> int:
        """The largest number of times that one member is passed."""
        return 1 if self.sweep is not None else ceil(_path_turns(self.path)) + 1


def _path_turns(path: tuple[Point, ...]) -> float:
    """The number of turns of a path round the middle, plus the points at which it may turn back."""
    return sum(abs(b - a) for (_, a), (_, b) in pairwise(path)) / 360.0 + len(path) - 2


def _parse_point(point_text: str) -> Point:
    point_words = point_text.split()
    if len(point_words) != 2:
        message = f"{quote(point_text.strip())} is not a radius and an angle such as 0.3 1080deg"
        raise TextError(message, length=max(1, len(point_text)), code="E201")
    radius = quantities.quantity(point_words[0], quantities.RADIUS)
    try:
        return radius, quantities.quantity(point_words[1], quantities.PATH_AZIMUTH)
    except TextError as error:
        error.offset += point_text.index(
            point_words[1], point_text.index(point_words[0]) + len(point_words[0])
        )
        raise


def parse_path(path_text: str) -> tuple[Point, ...]:
    """`1 0deg -> 0.3 1080deg` as points (radius, azimuth [degrees]). Raises TextError."""
    points: list[Point] = []
    point_offset = 0
    for point_text in path_text.split(_PATH_SEPARATOR):
        try:
            points.append(_parse_point(point_text))
        except TextError as error:
            error.offset += point_offset
            raise
        point_offset += len(point_text) + len(_PATH_SEPARATOR)
    if not 2 <= len(points) <= MAX_POINTS:
        message = f"a path has 2 to {MAX_POINTS:,} points, with {_PATH_SEPARATOR} between them"
        raise TextError(message, length=max(1, len(path_text)), code="E106")
    if sum(abs(b - a) for (_, a), (_, b) in pairwise(points)) > 360.0 * MAX_TURNS:
        message = f"the path goes round more than {MAX_TURNS:.0f} times"
        raise TextError(message, length=len(path_text), code="E202")
    return tuple(points)


PATH_SHAPE = Text(
    parse_path,
    "radius and angle from point to point, such as 1 0deg -> 0.3 1080deg",
    has_values=True,
)
PASSING_FIELDS = (
    Field(
        "sweep", choice(*SWEEPS), "a sweep that strikes each member that it passes, once in `for`"
    ),
    Field(
        "path", PATH_SHAPE, "the path of a point that strikes each member it passes, once in `for`"
    ),
    Field(
        "width",
        value_kinds.WIDTH,
        "how wide that point is; the instrument's radius is 1",
        DEFAULT_PATH_WIDTH,
    ),
)


def read_passing(sweep_values: Values) -> Passing:
    """The sweep or path of strikes with `sweep` or `path`."""
    chance: Any = sweep_values["chance"]
    return Passing(
        sweep_values["sweep"],
        sweep_values["path"] or (),
        sweep_values["width"],
        1.0 if chance is None else chance,
    )
