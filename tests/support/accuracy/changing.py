"""Numbers of a scene that change in time, and points between masses: as rows of numbers, and as the
reference computes them at an instant.

A value of a link, a mass or a body glides from one value to another, or follows the position of a
mass. A proxy lies between two neighbours of a row of masses, at a fixed place or where a mass leads
it.
"""

from dataclasses import dataclass, field

import numba as nb
import numpy as np

# What a row of changes sets.
LINK, GROUND, MASS, CELL_PITCH, LINK_PITCH, FOLLOWING_LINK, FOLLOWING_MASS = range(7)
CHANGE_NUMBERS, PROXY_NUMBERS = 11, 7  # of a row
# How a value goes from the first to the last.
LINE, SMOOTH, FADE = range(3)
SHAPES = {"line": LINE, "smooth": SMOOTH}
_GRID_FRAMES = 64  # couplings begin and end to fade at multiples of it (docs/numerics.md)
_FADE_SECONDS = 0.02


@dataclass
class Glide:
    """From `begin` to `end` [s]; before it there is the first value only where no other glide of
    the same number comes earlier (`is_first`).
    """

    begin: float
    end: float
    shape: int = LINE
    is_first: bool = True

    def row(
        self,
        what: int,
        index: int,
        column: float,
        values: tuple[float, float],
        sigmas: tuple[float, float] = (0.0, 0.0),
    ) -> list[float]:
        """A row of changes; for a pitch `column` is the weight of its K and Z, and `values` are
        frequencies [Hz].
        """
        times = [self.begin, self.end, float(self.shape)]
        return [float(what), float(index), column, *times, *values, *sigmas, float(self.is_first)]


def following_row(
    what: int,
    index: int,
    column: int,
    guide: int,
    offset: float,
    span: float,
    first: float,
    last: float,
) -> list[float]:
    """A row of changes: at -offset of its guide the number is `first`, `span` further on `last`."""
    place = [float(guide), offset, span]
    return [float(what), float(index), float(column), *place, first, last, 0.0, 0.0, 1.0]


def coupling_rows(link: int, spring: tuple[float, float], begin: float, end: float, rate: float):
    """Rows of a coupling of K and Z that fades in at `begin` and out at `end` [s]."""
    fade = -(-int(_FADE_SECONDS * rate) // _GRID_FRAMES) * _GRID_FRAMES / rate
    rows = []
    for instant, is_first in ((begin, True), (end, False)):
        if not np.isfinite(instant) or (is_first and instant <= 0.0):
            continue
        start = np.ceil(round(instant * rate, 6) / _GRID_FRAMES) * _GRID_FRAMES / rate
        glide = Glide(start, start + fade, FADE, is_first)
        for column, value in zip((0, 3), spring, strict=True):
            values = (0.0, value) if is_first else (value, 0.0)
            rows.append(glide.row(LINK, link, float(column), values))
    return rows


@dataclass
class Proxies:
    """Points between masses: for each its index, its guide (-1: none), offset and span [m] or its
    place, and the range of its row in `members`.
    """

    rows: list[list[float]] = field(default_factory=list)
    members: list[int] = field(default_factory=list)

    def add(
        self, point: int, members: list[int], guide: int, offset: float, span: float, place: float
    ) -> None:
        begin = len(self.members)
        self.members += members
        end = len(self.members)
        self.rows.append([float(v) for v in (point, guide, offset, span, place, begin, end)])


@nb.njit(cache=True)
def set_changing(t, y, inverse, ground, numbers, changes):
    """Set what changes in `inverse`, `ground` and `numbers` to its values at t [s]."""
    for row in changes:
        what, index, column = int(row[0]), int(row[1]), row[2]
        if what >= FOLLOWING_LINK:
            share = min(1.0, max(0.0, (y[int(row[3])] + row[4]) / row[5]))
        else:
            if t < row[3] and row[10] == 0.0:
                continue
            share = min(1.0, max(0.0, (t - row[3]) / (row[4] - row[3])))
            if row[5] == SMOOTH:
                share = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
            elif row[5] == FADE:
                share = share**2 * (3.0 - 2.0 * share)
        value = row[6] + (row[7] - row[6]) * share
        if what in (LINK, FOLLOWING_LINK):
            numbers[index, int(column)] = value
        elif what == GROUND:
            ground[index, int(column)] = value
        elif what in (MASS, FOLLOWING_MASS):
            inverse[index] = 1.0 / value
        else:
            omega = 2.0 * np.pi * row[6] * (row[7] / row[6]) ** share
            sigma = row[8] + (row[9] - row[8]) * share
            k, z = column * (omega**2 + sigma**2), column * 2.0 * sigma
            if what == CELL_PITCH:
                ground[index, 0], ground[index, 1] = k, z
            else:
                numbers[index, 0], numbers[index, 3] = k, z


@nb.njit(cache=True)
def _place(row, members, y, n):
    """The mass before a proxy among its members, the share of the next one, and its rate [1/s]."""
    begin, last = int(row[5]), row[6] - row[5] - 1.0
    place, rate = row[4], 0.0
    if row[1] >= 0.0:
        guide = int(row[1])
        fraction = (y[guide] + row[2]) / row[3]
        place = min(1.0, max(0.0, fraction)) * last
        rate = y[n + guide] / row[3] * last if 0.0 < fraction < 1.0 else 0.0
    before = min(int(place), int(last) - 1)
    return begin + before, place - before, rate


@nb.njit(cache=True)
def set_proxies(y, n, proxies, members):
    """Set positions and velocities of proxies in y to those between their masses."""
    for row in proxies:
        i, share, rate = _place(row, members, y, n)
        point, a, b = int(row[0]), members[i], members[i + 1]
        y[point] = (1.0 - share) * y[a] + share * y[b]
        y[n + point] = (1.0 - share) * y[n + a] + share * y[n + b] + rate * (y[b] - y[a])


@nb.njit(cache=True)
def spread_forces(y, dy, n, proxies, members):
    """Divide the forces on proxies in dy among their masses."""
    for row in proxies:
        i, share, _ = _place(row, members, y, n)
        point, a, b = int(row[0]), members[i], members[i + 1]
        force = dy[n + point]
        dy[n + a] += (1.0 - share) * force
        dy[n + b] += share * force
        dy[point], dy[n + point] = 0.0, 0.0
