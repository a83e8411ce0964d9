"""Random sessions of all verbs, MIDI, jumps, edited files, kills and resumes.

A journal renders what was heard, nothing is written elsewhere, and no answer speaks of a fault.

The engine is stepped, so that time is counted and every session can be done again from its seed.
"""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from unittest import mock

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from random_sessions import SCENES, TABLE, Player
from sessions import Stepped
from written_files import written_outside

from ergon.repl.session import session_commands
from tests.fuzz.harness import BROKEN
from tests.repl.test_repl_session import SCORE


class RandomSession:
    """A random session: what was typed and answered, over all its resumes."""

    def __init__(self, folder: Path, seed: int) -> None:
        self.folder = folder
        self.draws = Player(seed)
        self.transcript: list[str] = []
        self.seconds = 0.0
        self.stepped = Stepped(self.draws.choose(SCORE, TABLE), folder)

    def run(self, seconds: float) -> None:
        self.stepped.run(seconds)
        self.seconds += seconds

    def type(self, line: str) -> None:
        self.transcript.append(line)
        reply = self.stepped.type(line)
        self.tells(reply.text, *reply.lines)

    def tells(self, *texts: str) -> None:
        """Note what the session says: nothing of it stands for a fault of the program."""
        self.transcript += (f"    {text}" for text in texts)
        for text in texts:
            assert not BROKEN.search(text), self.story()
            assert "Error" not in text or "your Python" in text, self.story()

    def step(self) -> None:
        """One line, message of MIDI, edit of the file, resume or kill."""
        chance = self.draws.draw.random()
        if chance < 0.04:
            self.stepped.close()
            same(self.stepped, self)
            rows = self.stepped.ok("history").lines
            self.resume("(resumed)")
            assert self.stepped.ok("history").lines == rows, [
                rows,
                self.stepped.ok("history").lines,
            ]
        elif chance < 0.08:
            self.kill()
        elif chance < 0.14:
            self.draws.edit(self.folder)
            self.transcript.append("(edited)")
        elif chance < 0.24:
            packet = self.draws.packet()
            self.transcript.append(f"(MIDI {packet.hex()})")
            self.stepped.session.midi.receive(packet, self.seconds)
        else:
            line = self.draws.line()
            if line.startswith("load ") and "/dev" not in line:
                line = line.replace("load ", f"load {self.folder}/")
            self.type(line)
        self.run(self.draws.draw.choice([0.002, 0.01, 0.2, 0.5, 1.3]))
        self.tells(*self.stepped.session.messages())

    def resume(self, how: str) -> None:
        self.transcript.append(how)
        self.stepped = Stepped.resumed(self.stepped.journal)
        self.run(0.002)

    def kill(self) -> None:
        """End as `kill -9` does: what the journal holds at this instant is all that is left."""
        written = self.stepped.journal.read_bytes()
        if self.draws.draw.random() < 0.5:  # in the middle of its last line
            last = len(written) - written.rstrip(b"\n").rfind(b"\n") - 1
            if last < len(written):
                written = written[: len(written) - self.draws.draw.randrange(1, last)]
        self.stepped.close()
        self.stepped.journal.write_bytes(written)
        same(self.stepped, self, is_killed=True)
        self.resume("(killed and resumed)")

    def story(self) -> str:
        return "\n".join(self.transcript)


def played(folder: Path, seed: int, n_lines: int) -> None:
    """Play one session, over all its resumes, and hold each journal against what was heard."""
    folder.mkdir()
    mine = folder / "mine"
    mine.mkdir()
    for name, text in SCENES.items():
        (mine / f"{name}.yaml").write_text(text)
    single = RandomSession(mine, seed)
    counted = SimpleNamespace(monotonic=lambda: single.seconds)
    try:
        with mock.patch.object(session_commands, "time", counted), written_outside(mine) as outside:
            single.run(0.002)
            if single.draws.draw.random() < 0.7:
                single.type("play")
            for _ in range(n_lines):
                single.step()
            single.stepped.close()
        same(single.stepped, single)
    finally:
        single.stepped.close()
    assert not outside, [outside, single.story()]
    assert [path.name for path in folder.iterdir()] == ["mine"]


def same(stepped: Stepped, random_session: RandomSession, *, is_killed: bool = False) -> None:
    """The journal renders what was heard, at every frame; one of a kill up to its last event."""
    sound, again = stepped.sound, stepped.again()
    differ = np.flatnonzero(np.any(again != sound[: len(again)], axis=1))
    assert not differ.size, [random_session.story(), f"from frame {differ[0]} of {len(again)}"]
    assert len(again) == len(sound) or (is_killed and len(again) < len(sound))


def sessions(n: int):
    return settings(
        max_examples=n,
        derandomize=True,
        database=None,
        suppress_health_check=list(HealthCheck),
    )


@sessions(6)
@given(seed=st.integers(0, 2**32 - 1))
def test_journal_of_random_session(seed: int, tmp_path_factory: pytest.TempPathFactory):
    played(tmp_path_factory.mktemp("random") / "session", seed, 20)


@pytest.mark.slow
@sessions(500)
@given(seed=st.integers(0, 2**32 - 1))
def test_journals_of_five_hundred_random_sessions(
    seed: int, tmp_path_factory: pytest.TempPathFactory
):
    played(tmp_path_factory.mktemp("random") / "session", seed, 40)
