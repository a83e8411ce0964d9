"""Recording of hands on devices, without any force and without a score."""

from __future__ import annotations

import json
import time
from collections.abc import Sequence
from pathlib import Path

from ergon import _core

from .boards import Board
from .calibration import axis_header

_RATE = 44100


def capture(
    boards: Sequence[Board], path: Path, *, tick_rate: float, record_seconds: float | None
) -> _core.Performance:
    """Begin to record hands at `tick_rate` [Hz]; nothing pushes them. Raises EngineError.

    The performed piece consists of keys that nothing touches, so that no force arises.
    """
    import numpy as np

    tick_frames = max(1, round(_RATE / tick_rate))
    network = _core.Network()
    network.part("hands")
    recorded_axes = [(board, number, player) for board in boards for number, player in board.axes]
    mats = [network.mas(player, M=1.0) for _, _, player in recorded_axes]
    timeline = _core.Timeline(network, _RATE)
    rest_positions = np.zeros(1)
    for mat in mats:
        timeline.hand(mat, tick_frames, positions=rest_positions)
    hand_by_player = {player: hand for hand, (_, _, player) in enumerate(recorded_axes)}
    description = {
        "made": f"by ergon {_core.__version__}",
        "day": time.strftime("%Y-%m-%d %H:%M:%S"),
        "axes": [axis_header(board, number) for board, number, _ in recorded_axes],
    }
    return _core.Performance(
        _core.Simulation(network, timeline),
        _core.Mixer(_RATE, 0, 1),
        tick_frames=tick_frames,
        audio="null",
        n_frames=None
        if record_seconds is None
        else max(1, round(record_seconds * _RATE / tick_frames)) * tick_frames,
        hands=[
            _core.LiveHand(rest_positions, 1.0, None, np.zeros(0), None, np.zeros(0))
            for _ in recorded_axes
        ],
        boards=[
            _core.LiveBoard(
                board.url,
                [(number, hand_by_player[player]) for number, player in board.axes],
                0.0,
                [axis.for_core(number) for number, axis in board.calibrations.items()],
            )
            for board in boards
        ],
        record=_core.RecordTarget(
            path, [(player, "") for _, _, player in recorded_axes], json.dumps(description)
        ),
    )
