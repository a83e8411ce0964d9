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

_N_COLUMNS = 700  # columns of a picture, with two points in each


def picture(replay: Replay, title: str, simple_replay: Replay | None = None) -> str:
    """An SVG of the forces, of the real key and its model, and of their difference.

    `simple_replay` is the replay of a model with fewer parts.
    """
    panel_rows = replay_panels(replay)
    if simple_replay is not None:
        residual_curve = _curve("residual", simple_replay.instants, simple_replay.residual * 1e6)
        panel_rows.insert(2, ("M K Z alone [um]", [residual_curve]))
    return panels(panel_rows, title=title)


def replay_panels(replay: Replay) -> list[tuple[str, list[Curve]]]:
    """The panels of a replay: the label of each, and its curves."""
    rate = replay.gesture.rate
    t = np.arange(replay.gesture.force.size) / rate
    position = np.where(replay.gesture.is_compared, replay.gesture.position, np.nan)
    return [
        ("force [N]", [_curve("asked", t, replay.gesture.force)]),
        (
            "position [mm]",
            [_curve("real", t, position * 1e3), _curve("model", t, replay.model_position * 1e3)],
        ),
        ("residual [um]", [_curve("residual", replay.instants, replay.residual * 1e6)]),
    ]


def _curve(name: str, t: Floats, values: Floats) -> Curve:
    """A curve with its least and greatest value in each column of a picture."""
    stride = max(1, len(t) // _N_COLUMNS)
    if stride == 1:
        return Curve(name, t.tolist(), values.tolist())
    n_blocks = len(t) // stride
    blocks, block_begins = (
        values[: n_blocks * stride].reshape(n_blocks, stride),
        np.arange(n_blocks) * stride,
    )
    lowest_indices, highest_indices = (
        block_begins + np.argmin(np.nan_to_num(blocks, nan=np.inf), axis=1),
        block_begins + np.argmax(np.nan_to_num(blocks, nan=-np.inf), axis=1),
    )
    indices = np.sort(np.stack([lowest_indices, highest_indices], 1), axis=1).ravel()
    return Curve(name, t[indices].tolist(), values[indices].tolist())
