"""Random sessions of all verbs, jumps, edited files and resumes: a journal renders what was heard.

The engine is stepped, so that time is counted and every session can be done again from its seed.
"""

from __future__ import annotations

import random
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from sessions import Stepped
from tests.repl.test_repl_session import SCORE

OTHER = SCORE.replace("60N/m", "80N/m").replace("A3", "C4").replace("bpm: 120", "bpm: 100")
TABLE = SCORE.replace("  ada: []\n", "  ada: |\n    2|1 knock every 1 until 4|1\n    5|1 lean\n")
MONO = SCORE.replace("channels: 2", "channels: 1").replace("to: [2]", "to: [1]")
VERSE = OTHER.replace("  ada: []", "  ada: [{at: 1|1, play: knock, every: 1, times: 7}]")
PLAYERS, GESTURES = ("ada", "leo"), ("knock", "lean", "far")


class Player:
    """Draws what is typed in a session, and what is done to its files."""

    def __init__(self, seed: int) -> None:
        self.draw = random.Random(seed)

    def one(self, *of: str) -> str:
        return self.draw.choice(of)

    def number(self, low: float, high: float) -> str:
        return f"{self.draw.uniform(low, high):.4g}"

    def when(self) -> str:
        at = f"at {self.draw.randint(1, 60)}|{self.draw.randint(1, 4)}"
        return self.one("", "", "", " now", " now", f" in {self.draw.randint(1, 5)}", f" {at}")

    def line(self) -> str:
        """A line of any verb; some are refused."""
        player, gesture = self.one(*PLAYERS), self.one(*GESTURES)
        part = self.one("bell", "drum", "ada", "leo", "nobody")
        how = self.one(
            "",
            "",
            " every 1",
            " every 1/2 times 5",
            " every 2",
            " layer",
            f" until {self.number(2, 9)}|1",
        )
        do = self.one("", "", " do mirror", " do scale 0.5, jitter 4ms 0.2mm", " do from 1/4")
        point = f"{self.number(-9, 12)}@{self.one('1/8', '60ms', '1/4')}"
        curve = self.one("smooth", "smooth", "smooth", "linear", "throw", "hold")
        timed = (
            f"{player} plays {gesture}{how}{do}",
            f"{player} plays {gesture}{how}{do}",
            f"{player} do {self.one('scale 0.7', 'mirror', 'shift 1/8', 'stretch 1.5')}",
            f"rest {self.one('ada', 'leo', 'all')}",
            f"{gesture} = 0@0 {curve} {point} smooth 0@1/2",
            f"tempo {self.number(60, 300)}",
            f"tempo {self.number(60, 300)} -> 90 over {self.one('1bar', '2', '3s')}",
            f"nudge {self.one('-10ms', '20ms', '1s')}",
            f"set {self.one('bell.m.t60', 'drum.m.t60')} {self.number(0.1, 3)}s",
            f"set bell.b.K x{self.number(0.5, 2)} over {self.one('1bar', '1s')}",
            f"set k1.M {self.number(200, 600)}g",
            f"set drum.m.f {self.number(50, 200)}Hz",
            f"couple k1 k2 K={self.number(1, 60)}N/m Z=0.2Ns/m",
            "uncouple k1 k2",
            f"b2 = {self.one('bell', 'drum')} transpose {self.draw.randint(-5, 9)}st\nroute b2 2",
            f"link {self.one('k1', 'k2', 'bell.m')} {self.one('b2.m', 'drum.m')} "
            + self.one("BUT K=300N/m gap=1mm", "REF K=20N/m Z=0.1Ns/m", "RES K=2kN/m"),
            f"remove {self.one('b2', 'links.but-1', 'links.ref-1', 'links', 'far', 'mia')}",
            f"{self.one('mia', 'leo')} takes {self.one('k1', 'k2', 'k3')}",
            f"rename {self.one('knock far2', 'far2 knock', 'leo leo2', 'leo2 leo')}",
            f"route {self.one('bell', 'drum')} {self.one('1', '2', '1 2', '3')}",
            f"gain {part} {self.number(-20, 3)}dB",
            f"mute {part}",
            f"solo {part}",
            "unmute",
            f"seed {self.draw.randint(0, 99)}",
            "undo",
            "undo",
            "redo",
            f"back {self.draw.randint(1, 5)}",
            "hush",
            f"damp {self.number(0.2, 3)}s",
            "reload",
            f"load {self.one('other', 'table', 'mono', 'nothing', 'score')}.yaml",
            "stop",
        )
        others = (
            f"play from {self.draw.randint(1, 400)}|{self.draw.randint(1, 4)}",
            "play",
            "play",
            f"quant {self.one('bar', '2bar', 'beat', 'now')}",
            "panic",
            "release",
            "save",
            f"save {self.one('one', 'two', 'score')}",
            f"scene {self.one('kept', 'more', 'verse', 'verse', 'table')}",
            f"scene {self.one('kept', 'verse')} -> {self.one('table', 'verse')} over 1bar",
            f"keep {self.draw.randint(1, 8)}bar as {self.one('kept', 'more')}",
            "history",
            self.one("show", "show ada", "? knock", "scope ada", "meters", "help", "py piece.seed"),
            self.one(
                "py 1/0", "ada plyas lean", "= =", "tap", "guide ada leo K=3N/m", "load /dev/zero"
            ),
            f"set bell.m.t60 2s now\n{player} plays {gesture} every 1",
        )
        if self.draw.random() < 0.8:
            return self.one(*timed) + self.when()
        return self.one(*others)

    def edit(self, folder: Path) -> None:
        """Edit the score's file as an editor does, for the better or the worse."""
        path = folder / "score.yaml"
        text = path.read_text()
        old, new = self.draw.choice(
            [
                ("t60: 0.3s", f"t60: {self.number(0.1, 1)}s"),
                ("smooth 3mm@1", f"smooth {self.number(1, 6)}mm@1"),
                ("smooth 6mm@1/8", f"smooth {self.number(1, 6)}mm@1/8"),
                ("seed: 7", f"seed: {self.draw.randint(0, 99)}"),
                ("  lean:", "  tilt:"),
                ("bpm: 120", f"bpm: {self.draw.randint(60, 200)}"),
                ("ada: []", "ada: [{at: 3|1, play: knock, every: 1, times: 3}]"),
                ("gestures:\n", "gestures:\n  new: 0mm@0 smooth 2mm@1/4 smooth 0mm@1/2\n"),
                ("\n", "\n# remark\n"),
                ("{SOX: m}", "{SOX: q}"),
            ]
        )
        path.write_text(text.replace(old, new, 1))


def played(folder: Path, seed: int, n_lines: int) -> None:
    """Play one session, over all its resumes, and hold each journal against what was heard."""
    folder.mkdir()
    mine = folder / "mine"
    mine.mkdir()
    for name, text in (("other", OTHER), ("table", TABLE), ("mono", MONO), ("verse", VERSE)):
        (mine / f"{name}.yaml").write_text(text)
    player = Player(seed)
    typed: list[str] = []
    at = Stepped(player.one(SCORE, TABLE), mine)
    at.run(0.002)
    try:
        if player.draw.random() < 0.7:
            at.ok("play")
            typed.append("play")
        for _ in range(n_lines):
            chance = player.draw.random()
            if chance < 0.05:
                at.close()
                same(at, typed)
                rows = at.ok("history").lines
                typed.append("(resumed)")
                at = Stepped.resumed(at.journal)
                at.run(0.002)
                assert at.ok("history").lines == rows, [*typed, rows, at.ok("history").lines]
            elif chance < 0.12:
                player.edit(mine)
                typed.append("(edited)")
            else:
                line = player.line()
                if line.startswith("load ") and "/dev" not in line:
                    line = line.replace("load ", f"load {mine}/")
                typed.append(line)
                reply = at.type(line)
                typed.append(f"    {reply.text}")
                assert "internal" not in reply.text, typed
                assert "ergon itself" not in reply.text, typed
            at.run(player.draw.choice([0.002, 0.01, 0.2, 0.5, 1.3]))
            messages = at.session.messages()
            assert not any("rror" in said for said in messages), [*typed, *messages]
        at.close()
        same(at, typed)
    finally:
        at.close()
    assert [path.name for path in folder.iterdir()] == ["mine"]


def same(at: Stepped, typed: list[str]) -> None:
    """The journal renders what was heard, at every frame."""
    sound, again = at.sound, at.again()
    differ = np.flatnonzero(np.any(again != sound[: len(again)], axis=1))
    assert not differ.size, ["\n".join(typed), f"from frame {differ[0]} of {len(again)}"]
    assert len(again) == len(sound)


def sessions(n: int):
    return settings(
        max_examples=n,
        derandomize=True,
        deadline=None,
        database=None,
        suppress_health_check=list(HealthCheck),
    )


@sessions(8)
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
