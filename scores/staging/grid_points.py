"""Points between which the engine goes along chords, moved so that the mean of a path stays.

A pitch that is slightly too high all the way would end with a wrong phase.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Container, Iterable

from ergon.scores.staging.parameter_values import Points

_GRID_DIGITS = 6  # an instant so near to one of the grid, in steps of it, is on it


def keep_means(
    path_points: Points,
    curved_instants: Container[float],
    corner_instants: Iterable[float],
    grid_step: float,
) -> Points:
    """The points of a path through which the engine goes with the mean of the path.

    The path is curved about the points at `curved_instants`, and turns at `corner_instants`; the
    grid of the engine has steps of `grid_step` [s].
    """
    if curved_instants:
        path_points = _with_chord_means(path_points, curved_instants)
    if corner_instants:
        path_points = _with_corner_means(path_points, corner_instants, grid_step)
    return path_points


def _with_chord_means(path_points: Points, curved_instants: Container[float]) -> Points:
    """Points moved so that their chords have the same means as the curve through them, to fourth
    order.
    """
    corrected_points = list(path_points)
    for point_index in range(1, len(path_points) - 1):
        ((instant_before, *values_before), (instant, *values), (instant_after, *values_after)) = (
            path_points[point_index - 1 : point_index + 2]
        )
        if (
            instant in curved_instants
            and abs((instant - instant_before) - (instant_after - instant)) < 1e-9
        ):
            corrections = (
                value_before - 2.0 * value + value_after
                for value_before, value, value_after in zip(
                    values_before, values, values_after, strict=True
                )
            )
            corrected_points[point_index] = (
                instant,
                *(
                    value - correction / 12.0
                    for value, correction in zip(values, corrections, strict=True)
                ),
            )
    return corrected_points


def _with_corner_means(
    path_points: Points, corner_instants: Iterable[float], grid_step: float
) -> Points:
    """Points of a path that turns at instants between those of the engine's grid.

    The engine goes along the chord from the point of the grid before such a corner to the one after
    it. On the side where the path moves, the point is shifted so that the mean of the path stays.
    """
    # The engine moves a point to the next instant of its grid; of points on one, the last counts.
    last_points = {
        math.ceil(round(point[0] / grid_step, _GRID_DIGITS)): number
        for number, point in enumerate(path_points)
    }
    grid_indices = list(last_points)
    values_on_grid = [path_points[number][1:] for number in last_points.values()]
    still = [0.0] * len(values_on_grid[0])

    def slopes(first: int, last: int) -> list[float]:
        """The slopes between two points; zero before the first point and after the last."""
        if first < 0 or last == len(grid_indices):
            return still
        n_steps = grid_indices[last] - grid_indices[first]
        value_pairs = zip(values_on_grid[first], values_on_grid[last], strict=True)
        return [(after - before) / n_steps for before, after in value_pairs]

    corrected_points = [*path_points]
    for corner_instant in corner_instants:
        corner = round(corner_instant / grid_step, _GRID_DIGITS)
        index_before = math.floor(corner)
        if not (corner > index_before and {index_before, index_before + 1} <= last_points.keys()):
            continue
        before = bisect_left(grid_indices, index_before)
        area_per_turn = (corner - index_before) * (index_before + 1 - corner)
        slope_pairs = zip(slopes(before - 1, before), slopes(before + 1, before + 2), strict=True)
        for column, (slope_before, slope_after) in enumerate(slope_pairs, 1):
            shifted = before + (abs(slope_after) >= abs(slope_before))
            span = grid_indices[min(shifted + 1, len(grid_indices) - 1)]
            span -= grid_indices[max(shifted - 1, 0)]
            number = last_points[grid_indices[shifted]]
            point = [*corrected_points[number]]
            point[column] -= area_per_turn * (slope_after - slope_before) / span
            corrected_points[number] = tuple(point)
    return corrected_points
