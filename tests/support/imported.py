"""Scores that `ergon import` wrote, played."""

import re
from collections.abc import Sequence

import numpy as np
from oracle import mims
from planned_sound import ready

from ergon import _core
from ergon.scores.staging.drives import input_id


def rendered(
    text: str, seconds: float, inputs: Sequence[tuple[int, str, float]] = ()
) -> np.ndarray:
    """Every channel of a score (n_frames, n_channels); inputs are `inputs` (frame, name, value)."""
    stage = ready(text)
    plan = _core.Plan(stage.network, stage.timeline, method="ca")
    simulation = _core.Simulation(stage.network, stage.timeline, plan=plan, threads=1)
    sound = np.empty((round(seconds * mims.RATE), simulation.n_out))
    position = 0
    for frame, name, value in inputs:
        simulation.process(sound[position:frame])
        assert simulation.tell(input_id(name), value)
        position = frame
    simulation.process(sound[position:])
    names = re.findall(r"^      (\w+): {SO", text.split("    out:\n")[1], flags=re.MULTILINE)
    routes = re.findall(r"- {from: model\.(\w+), to: (\d+)(?:, gain: x([^,}]+))?", text)
    assert [name for name, *_ in routes] == names
    channels = np.zeros((len(sound), max(int(channel) for _, channel, _ in routes)))
    for (_, channel, gain), column in zip(routes, sound.T, strict=True):
        channels[:, int(channel) - 1] += float(gain or 1.0) * column
    return channels
