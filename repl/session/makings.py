"""Running versions that the engine can play, made of lines."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from ergon.repl.session.version import NotTakenError
from ergon.repl.session.waiting_lines import REFUSALS, WaitingLine

if TYPE_CHECKING:
    from ergon.repl.session.engine import Engine
    from ergon.repl.session.running import RunningVersion
    from ergon.repl.session.takeover import Takeovers


class VersionMaker:
    """Makes running versions and checks them; `latest_beat` is the beat on which nothing begins any
    more.
    """

    def __init__(self, engine: Engine, takeovers: Takeovers) -> None:
        """Make versions for an engine."""
        self.latest_beat = math.inf
        self._engine, self._takeovers = engine, takeovers

    def staged(self, running: RunningVersion, lines: Sequence[WaitingLine]) -> RunningVersion:
        """The version after lines that take over together. Raises one of `REFUSALS`."""
        return self._with_force_bounds(
            running, self._takeovers.staged(running, lines, self.latest_beat)
        )

    def cut_version(self, running: RunningVersion, lines: Sequence[WaitingLine]) -> RunningVersion:
        """The version after lines that only end what plays; it takes no time to make.

        Raises one of `REFUSALS`.
        """
        return self._with_force_bounds(running, self._takeovers.cut_version(running, lines))

    def extended(self, running: RunningVersion, start: int) -> RunningVersion:
        """A version whose timeline goes on from frame `start`. Raises one of `REFUSALS`."""
        return self._with_force_bounds(
            running, self._takeovers.extended(running, start, self.latest_beat)
        )

    def first_failing(
        self, running: RunningVersion, line_group: Sequence[WaitingLine]
    ) -> tuple[WaitingLine, str]:
        """The first line of a group that cannot be made after those before it, and why."""
        for n_tried in range(1, len(line_group) + 1):
            try:
                self.staged(running, line_group[:n_tried])
            except REFUSALS as error:
                return line_group[n_tried - 1], str(error)
        return line_group[-1], "it could not be made together with those before it"

    def _with_force_bounds(self, running: RunningVersion, result: RunningVersion) -> RunningVersion:
        """A version with the bounds of its forces. Raises NotTakenError if it cannot be played."""
        for quantity, present_value, asked_value in (
            ("number of channels", self._engine.n_channels, result.stage.n_channels),
            ("rate", running.stage.rate, result.stage.rate),
        ):
            if present_value != asked_value:
                raise NotTakenError(
                    f"the {quantity} of a session cannot change: this session plays "
                    f"{present_value:g}, "
                    "and "
                    f"the score has {asked_value:g}; play that score in a session of its own"
                )
        # Every version passes here, so none plays that a real hand's key cannot bear.
        bounds = self._engine.force_bounds(
            result.stage, result.start_frame, result.glides, running.force_bounds
        )
        return replace(result, force_bounds=bounds)
