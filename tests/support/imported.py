"""Scores that `ergon import` wrote, played."""

import re

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
    names = re.findall(r"^      (\w+): {SO", text.split("    out:\n")[1], flags=re.MULTILINE)
    routes = re.findall(r"- {from: model\.(\w+), to: (\d+)(?:, gain: x([^,}]+))?", text)
    assert [name for name, *_ in routes] == names
    channels = np.zeros((len(sound), max(int(channel) for _, channel, _ in routes)))
    for (_, channel, gain), column in zip(routes, sound.T, strict=True):
        channels[:, int(channel) - 1] += float(gain or 1.0) * column
    return channels
