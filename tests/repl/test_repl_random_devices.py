"""Random sessions of all verbs with two keys that vanish and come back at any moment.

A journal renders what was heard, but for the first moments of a panic and the end. The boards are
in lockstep, so that a line is typed at one tick.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from paced_board import Paced
from random_sessions import SCENES, Player

from tests.fuzz.harness import BROKEN
from tests.repl.test_journal_hands import SCORE as HANDS
from tests.repl.test_journal_hands import Played, playing, rendered, sound
from tests.repl.test_repl_random import sessions

SCORE = (
    HANDS.replace("  k2:", "  k4: {like: k1}\n  k2:", 1)
    .replace("players:\n", "players:\n  leo: {key: k4}\n", 1)
    .replace("players:", "  knock: 0mm@0 smooth 6mm@1/8 smooth 0mm@1/4\nplayers:", 1)
)
_FALLS = 442  # frames in which a panic falls silent, and its end comes back
_ENDS = 4 * 1024  # frames in which a session that ends falls silent


class RandomDeviceSession:
    """A random session: what was typed and answered, and what became of its keys."""

    def __init__(self, played: Played, seed: int) -> None:
        self.played = played
        self.draws = Player(seed)
        self.transcript: list[str] = []
        self.lost: tuple[Paced, str] | None = None

    def step(self) -> None:
        """One line, or a key that vanishes or comes back."""
        draw = self.draws.draw
        if draw.random() < 0.12:
            self.change()
        else:
            # What plays here is the file heard.wav itself.
            line = self.draws.line().replace("heard.wav", "own.wav")
            if draw.random() < 0.15:
                line = self.draws.choose(
                    "guide remi ada K=40N/m now",
                    "guide zoe leo K=60N/m now",
                    "guide remi off",
                    "record remi as solo now",
                    "record zoe as duo now",
                    "record off now",
                    "ada plays solo now",
                    "panic",
                    "release",
                )
            self.type(line)
        self.played.run(draw.choice([0.002, 0.02, 0.1, 0.3]))
        self.tells(*self.played.session.messages())

    def change(self) -> None:
        if self.lost is not None:
            self.transcript.append(f"({self.lost[1]} is back)")
            self.played.find(self.lost[0])
            self.lost = None
            return
        board, player = self.draws.draw.choice(
            list(zip(self.played.boards, ("remi", "zoe"), strict=True))
        )
        self.transcript.append(f"({player} vanishes)")
        self.played.lose(board, player)
        self.lost = board, player

    def type(self, line: str) -> None:
        self.transcript.append(line)
        reply = self.played.session.submit(line)
        self.tells(reply.text, *reply.lines)

    def tells(self, *texts: str) -> None:
        """Note what the session says: nothing of it stands for a fault of the program."""
        self.transcript += (f"    {text}" for text in texts)
        for text in texts:
            assert not BROKEN.search(text), self.story()
            assert "Error" not in text or "your Python" in text, self.story()

    def story(self) -> str:
        return "\n".join(self.transcript)


def played(folder: Path, seed: int, n_lines: int) -> None:
    for name, text in SCENES.items():
        (folder / f"{name}.yaml").write_text(text)
    with playing(folder, SCORE) as player_session:
        order = [id(board) for board in player_session.boards]
        saved = RandomDeviceSession(player_session, seed)
        player_session.run(0.02)
        saved.type("play")
        for _ in range(n_lines):
            saved.step()
            # The first is always remi's: `change` names the player of a board by its place.
            player_session.boards.sort(key=lambda board: order.index(id(board)))
    done = rendered(folder)
    assert done.returncode == 0, [done.stderr, saved.story()]
    assert "warning" not in done.stderr, [done.stderr, saved.story()]
    listened, again = sound(folder / "heard.wav"), sound(folder / "again.wav")
    n = min(len(listened), len(again)) - _ENDS
    events = [json.loads(line) for line in (folder / "session.jsonl").read_text().splitlines()]
    n = min(n, unpaced(events))
    differs = np.any(listened[:n] != again[:n], axis=1)
    for event in events:
        if event["event"] == "silence":
            differs[max(0, event["frame"] - _FALLS) : event["frame"] + _FALLS] = False
    assert not differs.any(), [np.flatnonzero(differs)[:3], n, saved.story()]


def unpaced(events: list[dict]) -> int:
    """The first frame at which both keys are gone.

    Boards set the pace here. Where a busy machine loses the second one, the engine goes on as fast
    as it can, far beyond what the session has put on the timeline.
    """
    away: set[str] = set()
    for event in events:
        if event["event"] == "hand":
            away = away - {event["player"]} if event["real"] else away | {event["player"]}
            if len(away) == 2:
                return int(event["frame"])
    return sys.maxsize


@pytest.mark.slow
@sessions(3)
@given(seed=st.integers(0, 2**32 - 1))
def test_journal_of_random_session_with_vanishing_keys(
    seed: int, tmp_path_factory: pytest.TempPathFactory
):
    played(tmp_path_factory.mktemp("devices"), seed, 20)


@pytest.mark.slow
@sessions(300)
@given(seed=st.integers(0, 2**32 - 1))
def test_journals_of_many_sessions_with_vanishing_keys(
    seed: int, tmp_path_factory: pytest.TempPathFactory
):
    played(tmp_path_factory.mktemp("devices"), seed, 40)
