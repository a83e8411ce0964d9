"""Scores that `ergon import` wrote, played."""

from collections.abc import Sequence

import numpy as np
from oracle import mims
from planned_sound import ready

from ergon import _core


def rendered(text: str, seconds: float) -> np.ndarray:
    """Every channel of a score (n_frames, n_channels)."""
    stage = ready(text)
    plan = _core.Plan(stage.network, stage.timeline, method="ca")
    simulation = _core.Simulation(stage.network, stage.timeline, plan=plan, threads=1)
    sound = np.empty((round(seconds * mims.RATE), simulation.n_out))
    simulation.process(sound)
    names = [line.split(":")[0].strip() for line in _outs(text)]
    channels = np.zeros((len(sound), max(_channel(name) for name in names)))
    for name, column in zip(names, sound.T, strict=True):
        channels[:, _channel(name) - 1] += column
    return channels


def _outs(text: str) -> Sequence[str]:
    return text.split("    out:\n")[1].split("mix:\n")[0].splitlines()


def _channel(name: str) -> int:
    return int(name.removeprefix("out").split("_")[0])
