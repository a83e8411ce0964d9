"""The requested forces, the motion of a key and of its model, and the residual, as an SVG
picture.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ergon.view.curve import Curve
from ergon.view.svg import panels

if TYPE_CHECKING:
    from .comparison import Replay
    from .gesture import Floats

_COLUMNS = 700  # columns of a picture, with two points in each


def picture(fitted_replay: Replay, title: str, first_replay: Replay | None = None) -> str:
    """An SVG of the forces, of the real key and its model, and of their difference.

    `first_replay` is the replay of a model with fewer parts.
    """
    drawn = rows(fitted_replay)
    if first_replay is not None:
        residual_curve = _curve("residual", first_replay.t, first_replay.residual * 1e6)
        drawn.insert(2, ("M K Z alone [um]", [residual_curve]))
    return panels(drawn, title=title)


def rows(motion_comparison: Replay) -> list[tuple[str, list[Curve]]]:
    """The panels of a replay: the label of each, and its curves."""
    rate = motion_comparison.gesture.rate
    t = np.arange(motion_comparison.gesture.force.size) / rate
    measured_position = np.where(
        motion_comparison.gesture.counts, motion_comparison.gesture.position, np.nan
    )
    return [
        ("force [N]", [_curve("asked", t, motion_comparison.gesture.force)]),
        (
            "position [mm]",
            [
                _curve("real", t, measured_position * 1e3),
                _curve("model", t, motion_comparison.model * 1e3),
            ],
        ),
        (
            "residual [um]",
            [_curve("residual", motion_comparison.t, motion_comparison.residual * 1e6)],
        ),
    ]


def _curve(curve_name: str, t: Floats, x: Floats) -> Curve:
    """A curve with its least and greatest value in each column of a picture."""
    column_step = max(1, len(t) // _COLUMNS)
    if column_step == 1:
        return Curve(curve_name, t.tolist(), x.tolist())
    n = len(t) // column_step
    column_parts, column_begins = (
        x[: n * column_step].reshape(n, column_step),
        np.arange(n) * column_step,
    )
    lowest_indices, highest_indices = (
        column_begins + np.argmin(np.nan_to_num(column_parts, nan=np.inf), axis=1),
        column_begins + np.argmax(np.nan_to_num(column_parts, nan=-np.inf), axis=1),
    )
    point_indices = np.sort(np.stack([lowest_indices, highest_indices], 1), axis=1).ravel()
    return Curve(curve_name, t[point_indices].tolist(), x[point_indices].tolist())
