"""A session for programs and notebooks: every verb of `ergon repl` is a method."""

from __future__ import annotations

import atexit
from pathlib import Path
from typing import TYPE_CHECKING

from ergon.common.report import PrintedReport, Report
from ergon.repl.session.api import SessionProxy

from .local_session import begin
from .options import SessionOptions
from .remote_session import join

if TYPE_CHECKING:
    from ergon.repl.session_protocol import SessionProtocol


class Session(SessionProxy):
    """A score that is played while calls change it. `open_session` opens one."""

    def __init__(self, face: SessionProtocol) -> None:
        """Over an open session, which ends with this process at the latest."""
        super().__init__(face)
        atexit.register(self.close)

    def close(self) -> None:
        """End it; one in a process of its own goes on."""
        atexit.unregister(self.close)
        super().close()


def open_session(
    score: str | Path | None = None,
    options: SessionOptions | None = None,
    *,
    report: Report | None = None,
) -> Session:
    """Open a score as a session, or resume a journal.

    With `socket` in the options the engine is a process of its own: it is joined, or begun where
    none is. `report` hears what a person has to know and do; without one that is printed on
    stderr. Raises ScoreError, OptionError, DeviceError, EngineExitError and FileRefusedError.
    """
    options, report = options or SessionOptions(), report or PrintedReport()
    path = None if score is None else str(score)
    return Session((begin if options.socket is None else join)(path, options, report))
