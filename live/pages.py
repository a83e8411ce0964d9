"""Pages in browsers that see a performance."""

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
    """A server of pages, and what makes a window of a stage for it."""

    def __init__(
        self,
        server: _core.ViewServer,
        window: Callable[[Stage, _core.Simulation], _core.Window],
    ) -> None:
        """`window` takes a stage and its simulation as it is about to play."""
        self.server, self.window = server, window
        self.remarks: deque[str] = deque()  # what could not be shown, and why
        self._next: tuple[Stage, _core.Performance] | None = None
        self._news = threading.Condition()
        self._is_over = False
        self._thread: threading.Thread | None = None

    def follow(self, stage: Stage, performance: _core.Performance) -> None:
        """Show a stage that takes over in a performance, as soon as its window is made.

        A thread makes it, which can take longer than a line may; of several stages it takes the
        newest.
        """
        with self._news:
            self._next = stage, performance
            self._news.notify()
        if self._thread is None:
            self._thread = threading.Thread(target=self._make, name="ergon pages", daemon=True)
            self._thread.start()

    def _make(self) -> None:
        while True:
            with self._news:
                self._news.wait_for(lambda: self._is_over or self._next is not None)
                if self._is_over or self._next is None:
                    return
                (stage, performance), self._next = self._next, None
            try:
                self.server.show(self.window(stage, stage.simulation), performance)
            except ErgonError as error:
                if not self._is_over:
                    self.remarks.append(f"pages cannot show this version: {error}")

    def close(self) -> None:
        """End the server."""
        with self._news:
            self._is_over = True
            self._news.notify()
        if self._thread is not None:
            self._thread.join()
        self.server.close()
