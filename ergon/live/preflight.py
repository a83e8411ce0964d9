"""The playback gain of a piece, found by computing its beginning unheard."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ergon import _core
from ergon.rendering.job import BLOCK_FRAMES
from ergon.rendering.measured_level import MeasuredLevel
from ergon.rendering.render import frames_of

if TYPE_CHECKING:
    from ergon.exchange.frozen import VerifiedStem
    from ergon.rendering.level import Level
    from ergon.scores.staging.stage import Stage

# The most work to spend on finding the gain [s], by the table of costs; a listener has to wait for
# it.
_WORK_SECONDS_MAX = 5.0
# The part that was not computed may be louder: the gain leaves this much room for it [dB].
_HEADROOM_DB = -6.0


@dataclass(frozen=True, slots=True)
class PreflightGain:
    """A gain as a ratio; `seconds` is the computed length, None if the whole piece was computed."""

    gain: float
    seconds: float | None


def preflight_frames(stage: Stage) -> int:
    """The number of frames to compute: all, or as many as `_WORK_SECONDS_MAX` allows."""
    from ergon.scores.staging.planning import plan_cost

    cost_share = 0.0 if stage.plan is None else plan_cost(stage.plan)
    is_long = cost_share * stage.n_frames > _WORK_SECONDS_MAX * stage.rate
    return int(_WORK_SECONDS_MAX / cost_share * stage.rate) if is_long else stage.n_frames


def find_gain(
    stage: Stage,
    target_level: Level,
    frozen_stems: Sequence[VerifiedStem],
    progress: Callable[[int], None],
) -> PreflightGain:
    """The gain that brings the mix to the peak or loudness of `target_level`; the stage itself does
    not advance.

    Stand-ins play for real hands; `frozen_stems` parts are included. `progress` is called with the
    number of frames done.
    """
    import numpy as np

    n_frames = preflight_frames(stage)
    mixer = stage.mixer(highpass=target_level.highpass, reference=target_level.reference)
    level_meter = MeasuredLevel(target_level, stage.rate, stage.n_channels)
    simulation = stage.simulation
    start_snapshot = simulation.snapshot()
    frame_count = 0
    for computed_frames in frames_of(simulation, n_frames, BLOCK_FRAMES):
        for stem in frozen_stems:
            stem.copy_into(computed_frames, frame_count)
        mix = np.zeros((len(computed_frames), stage.n_channels))
        mixer.process(computed_frames, mix)
        level_meter.take(mix)
        frame_count += len(computed_frames)
        progress(frame_count)
    simulation.restore(start_snapshot)
    if n_frames == stage.n_frames:
        return PreflightGain(level_meter.gain(), None)
    return PreflightGain(level_meter.gain() * _core.decibels(_HEADROOM_DB), n_frames / stage.rate)
