"""A session in virtual time into which lines are typed, and the processor time of each."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Generic, TypeVar

from ergon.repl.session.engine import SteppedEngine
from ergon.repl.session.journal import Journal
from ergon.repl.session.session import Session
from ergon.repl.session.version import Version, piece_of
from ergon.scores.edits.texts import Texts
from ergon.scores.staging.stage import Stage

TICK = 64  # frames

_Engine = TypeVar("_Engine", bound=SteppedEngine)


class TypedSession(Generic[_Engine]):
    """A session of a score, whose `engine` computes frames when its caller asks for them."""

    engine: _Engine

    def __init__(
        self, folder: Path, score: str, engine_type: type[_Engine], *, margin: float
    ) -> None:
        """Begin with a score in a folder; a change reaches the engine within `margin` [s]."""
        path, self.journal = folder / "typed.yaml", folder / "session.jsonl"
        path.write_text(score, encoding="utf-8")
        texts = Texts.read(path)
        version = Version(0, "", texts, piece_of(texts))
        self._engine_type = engine_type
        self.session = Session(version, self._begin, margin=margin, journal=Journal(self.journal))

    def _begin(self, stage: Stage) -> _Engine:
        self.engine = self._engine_type(stage, tick_frames=TICK, highpass=None)
        return self.engine

    def answered(self, line: str) -> float:
        """Type a line; returns the processor time until its answer [ms]."""
        begun = time.thread_time()
        reply = self.session.submit(line)
        spent = 1e3 * (time.thread_time() - begun)
        assert reply.taken, f"{line}: {reply.text}"
        return spent
