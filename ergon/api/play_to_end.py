"""A score played through the loudspeakers, from its first frame to its last."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from pathlib import Path

from ergon.common.errors import ErgonError
from ergon.common.report import Report

from .options import PlayOptions
from .play import begin, prepare, warn_of_scaled_forces

_POLL_SECONDS = 0.05  # [s] between two looks whether it has ended, or Ctrl-C was pressed
_DRAIN_SECONDS_MAX = 10.0  # [s] that the sound in the ring buffer may take to be heard


@dataclass(frozen=True, slots=True)
class Played:
    """What was played: its duration [s], ticks of the physics, those that were late, and gaps in
    the sound.
    """

    seconds: float
    ticks: int
    late: int
    gaps: int


def play(
    score: str | Path, options: PlayOptions | None = None, *, report: Report | None = None
) -> Played:
    """Play a score, and return when it has ended; Ctrl-C (KeyboardInterrupt) ends it at once.

    However it ends, no force is left on a hand and nothing sounds. Raises ScoreError, OptionError
    and DeviceError.
    """
    from ergon import _core
    from ergon.live.trouble import gap_count

    report = report or Report()
    prepared = prepare(score, options or PlayOptions(), report)
    try:
        performance = begin(prepared.stage, prepared.config, report)
        try:
            warn_of_scaled_forces(performance, prepared.stage, report)
            if prepared.osc is not None:
                prepared.osc.begin(
                    performance, prepared.stage, prepared.config.gain, prepared.config.start_frame
                )
            while not performance.wait(_POLL_SECONDS):
                pass
            status = performance.status()
        except BaseException:
            performance.panic()
            performance.stop()
            with contextlib.suppress(_core.EngineError):
                performance.close(_POLL_SECONDS)
            raise
        finally:
            if prepared.osc is not None:
                prepared.osc.stop_serving()
        performance.close(_DRAIN_SECONDS_MAX)
    except _core.EngineError as error:
        raise ErgonError(str(error)) from None
    finally:
        prepared.close()
    seconds = status.frame / prepared.stage.rate
    return Played(seconds, status.ticks, status.late, gap_count(status))
