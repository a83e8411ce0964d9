"""A session for programs and notebooks: every verb of `ergon repl` is a method."""

from __future__ import annotations

import atexit
from pathlib import Path
from typing import TYPE_CHECKING

from ergon.common.report import PrintedReport, Report
from ergon.repl.session.api import SessionProxy

from .local_session import begin_session
from .options import SessionOptions
from .remote_session import join

if TYPE_CHECKING:
    from ergon.repl.session_protocol import SessionProtocol


class Session(SessionProxy):
    """A score that plays while calls change it; `open_session` opens one."""

    def __init__(self, session: SessionProtocol) -> None:
        """`session` is open already; it ends with this process at the latest."""
        super().__init__(session)
        atexit.register(self.close)

    def close(self) -> None:
        """End the session; the engine of one with a socket goes on."""
        atexit.unregister(self.close)
        super().close()


def open_session(
    score: str | Path | None = None,
    options: SessionOptions | None = None,
    *,
    report: Report | None = None,
) -> Session:
    """Open a score as a session, or resume a journal.

    With `socket` in the options the engine is a process of its own: the call joins it, or begins it
    where none runs. `report` gets the messages for a person; without one they are printed on
    stderr. Raises ScoreError, OptionError, DeviceError, EngineExitError and FileRefusedError.
    """
    options, report = options or SessionOptions(), report or PrintedReport()
    path = None if score is None else str(score)
    return Session((begin_session if options.socket is None else join)(path, options, report))
