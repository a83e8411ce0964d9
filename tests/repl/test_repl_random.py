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


class Kept:
    """A random session: what was typed and answered, over all its resumes."""

    def __init__(self, folder: Path, seed: int) -> None:
        self.folder = folder
        self.draws = Player(seed)
        self.said: list[str] = []
        self.seconds = 0.0
        self.at = Stepped(self.draws.one(SCORE, TABLE), folder)

    def run(self, seconds: float) -> None:
        self.at.run(seconds)
        self.seconds += seconds

    def type(self, line: str) -> None:
        self.said.append(line)
        reply = self.at.type(line)
        self.tells(reply.text, *reply.lines)

    def tells(self, *texts: str) -> None:
        """Note what the session says: nothing of it stands for a fault of the program."""
        self.said += (f"    {text}" for text in texts)
        for text in texts:
            assert not BROKEN.search(text), self.story()
            assert "Error" not in text or "your Python" in text, self.story()

    def step(self) -> None:
        """One line, message of MIDI, edit of the file, resume or kill."""
        chance = self.draws.draw.random()
        if chance < 0.04:
            self.at.close()
            same(self.at, self)
            rows = self.at.ok("history").lines
            self.resume("(resumed)")
            assert self.at.ok("history").lines == rows, [rows, self.at.ok("history").lines]
        elif chance < 0.08:
            self.kill()
        elif chance < 0.14:
            self.draws.edit(self.folder)
            self.said.append("(edited)")
        elif chance < 0.24:
            packet = self.draws.packet()
            self.said.append(f"(MIDI {packet.hex()})")
            self.at.session.midi.receive(packet, self.seconds)
        else:
            line = self.draws.line()
            if line.startswith("load ") and "/dev" not in line:
                line = line.replace("load ", f"load {self.folder}/")
            self.type(line)
        self.run(self.draws.draw.choice([0.002, 0.01, 0.2, 0.5, 1.3]))
        self.tells(*self.at.session.messages())

    def resume(self, how: str) -> None:
        self.said.append(how)
        self.at = Stepped.resumed(self.at.journal)
        self.run(0.002)

    def kill(self) -> None:
        """End as `kill -9` does: what the journal holds at this instant is all that is left."""
        written = self.at.journal.read_bytes()
        if self.draws.draw.random() < 0.5:  # in the middle of its last line
            last = len(written) - written.rstrip(b"\n").rfind(b"\n") - 1
            if last < len(written):
                written = written[: len(written) - self.draws.draw.randrange(1, last)]
        self.at.close()
        self.at.journal.write_bytes(written)
        same(self.at, self, is_killed=True)
        self.resume("(killed and resumed)")

    def story(self) -> str:
        return "\n".join(self.said)


def played(folder: Path, seed: int, n_lines: int) -> None:
    """Play one session, over all its resumes, and hold each journal against what was heard."""
    folder.mkdir()
    mine = folder / "mine"
    mine.mkdir()
    for name, text in SCENES.items():
        (mine / f"{name}.yaml").write_text(text)
    single = Kept(mine, seed)
    counted = SimpleNamespace(monotonic=lambda: single.seconds)
    try:
        with mock.patch.object(session_commands, "time", counted), written_outside(mine) as outside:
            single.run(0.002)
            if single.draws.draw.random() < 0.7:
                single.type("play")
            for _ in range(n_lines):
                single.step()
            single.at.close()
        same(single.at, single)
    finally:
        single.at.close()
    assert not outside, [outside, single.story()]
    assert [path.name for path in folder.iterdir()] == ["mine"]


def same(at: Stepped, own: Kept, *, is_killed: bool = False) -> None:
    """The journal renders what was heard, at every frame; one of a kill up to its last event."""
    sound, again = at.sound, at.again()
    differ = np.flatnonzero(np.any(again != sound[: len(again)], axis=1))
    assert not differ.size, [own.story(), f"from frame {differ[0]} of {len(again)}"]
    assert len(again) == len(sound) or (is_killed and len(again) < len(sound))


def sessions(n: int):
    return settings(
        max_examples=n,
        derandomize=True,
        database=None,
        suppress_health_check=list(HealthCheck),
    )


@sessions(12)
@given(seed=st.integers(0, 2**32 - 1))
def test_a_random_session_is_its_journal(seed: int, tmp_path_factory: pytest.TempPathFactory):
    played(tmp_path_factory.mktemp("random") / "session", seed, 20)


@pytest.mark.slow
@sessions(500)
@given(seed=st.integers(0, 2**32 - 1))
def test_five_hundred_random_sessions_are_their_journals(
    seed: int, tmp_path_factory: pytest.TempPathFactory
):
    played(tmp_path_factory.mktemp("random") / "session", seed, 40)
