"""Sessions whose engine the test steps: lines act at exact frames, every sample is kept."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np

from ergon.exchange import frozen as exchange
from ergon.repl.session.clock import Clock
from ergon.repl.session.engine import SteppedEngine
from ergon.repl.session.frozen_parts import frozen_folder, load_frozen
from ergon.repl.session.journal import Journal, free_path
from ergon.repl.session.journal_content import SessionStart, read_journal
from ergon.repl.session.replay import ReplayedSession, resumed_state
from ergon.repl.session.session import Session
from ergon.repl.session.version import Version, piece_of
from ergon.repl.session_protocol import Reply
from ergon.scores.edits.texts import Texts
from ergon.scores.staging.built_network import build_network

EVERY = 64
_BLOCK = 1 << 16  # frames
_LOOK = 0.06  # seconds between two looks of the session at its engine


class Stepped:
    """A session on a score's text; `sound` (n_frames, n_channels) is what it has played."""

    def __init__(
        self,
        text: str,
        folder: Path,
        *,
        name: str = "score.yaml",
        journal: bool = True,
        keeps: bool = True,
        frozen: Path | None = None,
        is_seen: bool = False,
    ) -> None:
        path = folder / name
        path.write_text(text, encoding="utf-8")
        texts = Texts.read(path)
        version = Version(0, "", texts, piece_of(texts))
        player_session = folder / "session.jsonl"
        if frozen is not None:
            result = exchange.read(frozen)
            listening = build_network(version.piece, frozenset(result.parts)).listening
            frozen = frozen_folder(frozen, result, version.piece, listening)
        self._open(player_session, version, Clock(), None, None, journal, keeps, frozen, is_seen)

    @classmethod
    def resumed(cls, journal: Path) -> Stepped:
        """A session that continues where a journal ends, with its own journal beside it."""
        result = read_journal(journal, resumes=True)
        version, clock, past = resumed_state(result)
        single = cls.__new__(cls)
        folder = result.session_start.frozen
        single._open(free_path(journal), version, clock, past, result.disk, True, True, folder)
        return single

    def _open(
        self, path, version, clock, past, disk, journal, keeps, frozen, is_seen=False
    ) -> None:
        self.journal = path
        written = Journal(path) if journal else None
        self.session = Session(
            version,
            self._begin,
            margin=0.0,
            journal=written,
            clock=clock,
            past=past,
            disk=disk,
            frozen=() if frozen is None else load_frozen(frozen, version, {}),
            is_seen=is_seen,
        )
        if written is not None:
            listened = 1.0, 1.0, None, past, version.file_texts
            beside = {"maps": version.maps, "rules": version.rules}
            beside["sounds_as"] = version.sounds_as
            beside["strike_levels"] = version.strike_levels
            beside["is_seen"] = is_seen
            beside["frozen"] = None if frozen is None else frozen.relative_to(path)
            opening = SessionStart(
                version.texts, clock.stopped_beat, version.faders, EVERY, *listened, **beside
            )
            known = self.session.disk.hashes_by_name(version.texts)
            written.append("session", **opening.fields(), disk=known)
        self._sound: list[np.ndarray] = []
        self._keeps = keeps
        self.hash = hashlib.sha256()

    def _begin(self, stage):
        self.engine = SteppedEngine(stage, tick_frames=EVERY, highpass=None)
        return self.engine

    @property
    def sound(self) -> np.ndarray:
        return np.concatenate(self._sound)

    @property
    def rate(self) -> float:
        return self.session.schedule.rate

    @property
    def where(self) -> str:
        state = self.session.state()
        return f"{state.bar}|{state.beat:.3g}"

    def type(self, line: str) -> Reply:
        return self.session.submit(line)

    def ok(self, line: str) -> Reply:
        reply = self.type(line)
        assert reply.taken, f"{line}: {reply.text}"
        return reply

    def run(self, seconds: float) -> None:
        left = int(seconds * self.rate)
        while left > 0:
            n = min(left, int(_LOOK * self.rate) // EVERY * EVERY)
            self.session.do_once()
            self._process(n)
            left -= n
        self.session.do_once()

    def tick(self) -> None:
        """Play a tick in which no line is computed, as when a note comes and its line later."""
        self._process(EVERY)

    def _process(self, n_frames: int) -> None:
        block = self.engine.process(n_frames)
        self.hash.update(block)
        if self._keeps:
            self._sound.append(block)

    def close(self) -> None:
        self.session.close()

    def again(self) -> np.ndarray:
        """The journal, rendered anew."""
        none = np.zeros((0, self.engine.n_channels))  # a session that was killed at once
        return np.concatenate([none, *self._blocks()])

    def hash_again(self) -> str:
        """The hash of all samples of the journal, computed anew."""
        hashed = hashlib.sha256()
        for block in self._blocks():
            hashed.update(block)
        return hashed.hexdigest()

    def _blocks(self):
        again = ReplayedSession(read_journal(self.journal))
        for index in range(0, again.n_frames, _BLOCK):
            out = np.zeros((min(_BLOCK, again.n_frames - index), again.n_channels))
            again.process(out)
            yield out
