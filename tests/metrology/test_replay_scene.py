"""The page of a replay: its curves go where the key and its model went."""

from pathlib import Path

import numpy as np
import pytest

from ergon import _core
from ergon.api.options import FileOptions
from ergon.api.viewing import render_view
from ergon.common.report import Report
from ergon.workshop.metrology.comparison import Replay
from ergon.workshop.metrology.gesture import Gesture
from ergon.workshop.metrology.replay_scene import write_scene

RATE = 44100 / 44
DELAY = 0.5 / 99  # s from a point of a curve to the next


def force(t: np.ndarray) -> np.ndarray:
    return 0.7 * np.sin(9 * t)


def model(t: np.ndarray) -> np.ndarray:
    return 3.1e-3 * np.sin(20 * t) ** 2


def residual(t: np.ndarray) -> np.ndarray:
    return 4e-6 * np.sin(60 * t)


@pytest.mark.usefixtures("work_folder")
def test_replay_scene_curves_equal_measured_motion():
    t = np.arange(1200) / RATE
    counts = np.ones(t.size, bool)
    counts[400:405] = False  # replies that were lost
    start = -2e-3
    read = np.where(counts, start + model(t) + residual(t), 7.0)
    gesture = Gesture(force(t), read, counts, RATE)
    position = t[counts]
    result = Replay(gesture, start + model(t), position, residual(position))
    shown = render_view(
        write_scene(result, Path()), Path(), FileOptions(motion=True, see="all"), Report()
    )
    motion = _core.read_motion(shown.motion)
    # 0.7 N, 3.1 mm and 4 um within 10 cm, by centimetres of 1, 2, 5.
    scales = {"asked": 0.01 / 0.1, "real": 0.01 / 0.5e-3, "model": 0.01 / 0.5e-3}
    scales["residual"] = 0.01 / 0.5e-6
    assert "asked 0.1 N a cm, real and model 0.5 mm a cm, residual 0.5 um a cm" in motion.manifest
    truths = {"asked": force, "model": model, "residual": residual}
    truths["real"] = lambda t: model(t) + residual(t)
    instants = np.array([36, 42, 57]) / 60  # of pictures: between them a page goes straight on
    moved = motion.displacements(instants.tolist())
    for name, truth in truths.items():
        # The scene is computed 8,000 times a second, and a picture shows the frame before it.
        speed = scales[name] * float(np.abs(np.gradient(truth(t), t)).max())
        for late in (0, 7, 99):
            point = motion.names.index(f"replay.{name}.{late}.z")
            wanted = scales[name] * truth(instants - late * DELAY)
            assert np.abs(moved[:, point] - wanted).max() < 1.6 * speed / 8000, (name, late)
