"""Pages in browsers that see a performance."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ergon import _core
    from ergon.scores.staging.stage import Stage


@dataclass(frozen=True, slots=True)
class Pages:
    """The server of pages, and what makes a window of a stage whose simulation is about to play."""

    server: _core.ViewServer
    window: Callable[[Stage, _core.Simulation], _core.Window]

    def close(self) -> None:
        """End the server."""
        self.server.close()
