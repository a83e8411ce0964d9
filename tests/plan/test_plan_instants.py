"""Events act at the same instants however often a plan steps a frame."""

import numpy as np
import pytest
from oracle.key import KEYS, RATE, lone, moved

from ergon import _core

T = [0.1, 0.1733, 0.29, 0.3501, 0.5]  # between frames
X = [0.0, 6e-3, 0.0, -4e-3, 1e-3]
FRAMES = np.floor(np.array(T) * RATE + 0.5).astype(int)


def played(oversampling: int, curves: list[str], rate: float = RATE, **manner: float) -> np.ndarray:
    """Positions of a key (n_frames,) whose steps are so many in a frame."""
    network, timeline, key = lone(rate, **KEYS["light"])
    timeline.gesture(key, T, X, curves, **manner)
    return pinned(network, timeline, oversampling, 0.8)


def pinned(network, timeline, oversampling: int, seconds: float) -> np.ndarray:
    modules = network.n_mat + network.n_lia
    plan = _core.Plan(
        network, timeline, error_db=-40.0, pins=[(modules, oversampling, 1, [], None, 4)]
    )
    assert plan.rows()[0].oversampling == oversampling
    return moved(network, timeline, seconds, plan=plan)[0]


@pytest.mark.parametrize("oversampling", [1, 2, 4])
def test_throw_lands_at_score_frame_when_oversampled(oversampling: int):
    x = played(oversampling, ["throw"] * 5)
    assert np.abs(x[FRAMES] - X).max() < 1e-9


@pytest.mark.parametrize("oversampling", [2, 4, 8])
@pytest.mark.parametrize("rate", [8820.0, RATE])
@pytest.mark.parametrize(
    ("curves", "manner", "limit"),
    [
        (["throw"] * 5, {}, 1e-8),
        (["smooth", "smooth", "throw", "throw", "smooth"], {}, 1e-6),
        (["smooth"] * 5, {"grain": 0.01}, 1e-8),
        (["smooth"] * 5, {"grain": 1e-5}, 1e-6),
    ],
    ids=["throws", "throws-and-paths", "grains", "grains-every-frame"],
)
def test_key_path_same_at_every_oversampling(
    oversampling: int, rate: float, curves: list[str], manner: dict[str, float], limit: float
):
    once = played(1, curves, rate, **manner)
    assert np.abs(played(oversampling, curves, rate, **manner) - once).max() < limit * RATE / rate


@pytest.mark.parametrize("oversampling", [1, 2, 4])
@pytest.mark.parametrize("event", ["strike", "ergon"])
def test_key_impulse_at_score_frame_when_oversampled(oversampling: int, event: str):
    network, timeline, _ = lone(M=0.3)
    if event == "strike":
        timeline.strike(0, 100.4 / RATE, impulse=1e-3)
    else:  # leaves 2·m·M/(m + M)·v
        timeline.strike(0, 100.4 / RATE, mass=0.1, speed=1e-3 / 0.15)
    x = pinned(network, timeline, oversampling, 0.01)
    assert x[:101] == pytest.approx(0.0, abs=1e-18)
    assert x[100:] == pytest.approx(np.arange(len(x) - 100) / RATE * 1e-3 / 0.3, rel=1e-9)
