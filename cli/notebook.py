"""`ergon.Session`: what `ergon repl` opens, for programs and notebooks."""

from __future__ import annotations

import atexit
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ergon.repl.session.api import Typed

from .apart import joined
from .console import Console
from .outcome import Outcome
from .performing import Wishes, begun

if TYPE_CHECKING:
    from ergon.repl.face import Face

_PATHS = ("journal", "resume")


class Session(Typed):
    """A score that is played while calls change it."""

    def __init__(self, score: str | Path | None = None, **options: Any) -> None:
        """Open as `ergon repl` does: options are those of the command (`audio="null"`).

        With `socket=""` or `socket=PATH` the engine is a process of its own: it is joined, or
        begun where none is. Raises Outcome where it does not begin.
        """
        paths = {name: Path(options[name]) for name in _PATHS if options.get(name) is not None}
        super().__init__(_open(None if score is None else str(score), Wishes(**options | paths)))
        atexit.register(self.close)

    def close(self) -> None:
        """End it; one in a process of its own goes on."""
        atexit.unregister(self.close)
        super().close()


def _open(path: str | None, wishes: Wishes) -> Face:
    console = Console()
    try:
        if wishes.socket is not None:
            return joined(console, path, wishes)
        return begun(console, path, wishes)
    except Outcome as outcome:
        if outcome.message:
            raise
        raise type(outcome)("it did not begin; why is told above") from None
