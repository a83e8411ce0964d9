"""Browser pages that show a performance."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from typing import TYPE_CHECKING

from ergon.common.errors import ErgonError

if TYPE_CHECKING:
    from ergon import _core
    from ergon.scores.staging.stage import Stage


class Pages:
    """A server of pages, and the function that makes the window of a stage for it."""

    def __init__(
        self,
        server: _core.ViewServer,
        make_window: Callable[[Stage, _core.Simulation], _core.Window],
    ) -> None:
        """Keep `make_window`, which is called with a stage and its simulation before it plays."""
        self.server, self.make_window = server, make_window
        self.remarks: deque[str] = deque()  # what could not be shown, with the reason
        self._next_stage: tuple[Stage, _core.Performance] | None = None
        self._condition = threading.Condition()
        self._is_over = False
        self._thread: threading.Thread | None = None

    def follow(self, stage: Stage, performance: _core.Performance) -> None:
        """Show a stage that takes over in a performance, as soon as its window is made.

        A thread makes the window, because that can take longer than a line may. Of several
        waiting stages only the newest is shown.
        """
        with self._condition:
            self._next_stage = stage, performance
            self._condition.notify()
        if self._thread is None:
            self._thread = threading.Thread(
                target=self._make_windows, name="ergon pages", daemon=True
            )
            self._thread.start()

    def _make_windows(self) -> None:
        while True:
            with self._condition:
                self._condition.wait_for(lambda: self._is_over or self._next_stage is not None)
                if self._is_over or self._next_stage is None:
                    return
                (stage, performance), self._next_stage = self._next_stage, None
            try:
                self.server.show(self.make_window(stage, stage.simulation), performance)
            except ErgonError as error:
                if not self._is_over:
                    self.remarks.append(f"pages cannot show this version: {error}")

    def close(self) -> None:
        """End the server."""
        with self._condition:
            self._is_over = True
            self._condition.notify()
        if self._thread is not None:
            self._thread.join()
        self.server.close()
