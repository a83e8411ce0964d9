"""`guide`: a real key is led along what a written part does with another."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from paced_board import Paced, paced
from patience import PATIENCE, until

from ergon.live.boards import Board
from ergon.live.perform import PlaybackConfig
from ergon.repl.session.journal import Journal
from ergon.repl.session.journal_content import SessionStart, read_journal
from ergon.repl.session.live import LiveEngine
from ergon.repl.session.replay import ReplayedSession
from ergon.repl.session.session import Session
from ergon.repl.session.version import Version, piece_of
from ergon.scores.edits.texts import Texts
from ergon.scores.staging.hands import Window
from ergon.scores.staging.live import leading_positions
from tests.repl.test_repl_live import ok

SCORE = """\
ergon: 1
tempo: [{at: 1|1, bpm: 120}]
keys:
  k1: {M: 400g, K: 60N/m, Z: 1.2Ns/m}
  k2: {M: 50g, K: 0N/m, Z: 1Ns/m, travel: -5mm..12mm}
  k3: {like: k1}
instruments:
  bell:
    modules:
      m: {CEL: {M: 2g, f: A3, t60: 0.5s}}
      b: {BUT: {between: [k1, m], K: 900N/m, Z: 0.1Ns/m, gap: 1mm}}
    out: {SOX: m}
gestures:
  lean: 0mm@0 smooth 8mm@2 smooth 0mm@4     # two seconds
  back: 0mm@0 smooth -4mm@2 smooth 0mm@4
players:
  ada: {key: k1}
  leo: {key: k3}
  remi: {hand: live, key: k2}
parts:
  ada: [{at: 1|1, play: lean, every: 4, times: 999}]
  remi: [{at: 2|1, play: back}]
mix: {route: [{from: bell, to: 1}]}
"""


@dataclass
class Led:
    """A session on a board whose time is the test's: however busy the machine is, none is lost."""

    session: Session
    board: Paced

    def ok(self, line: str) -> str:
        return ok(self.session, line)

    def watched(self, seconds: float) -> np.ndarray:
        """Beats into a bar, and where remi's key is there [m], (n, 2), while it plays on."""
        engine, result = self.session.schedule.engine, []
        assert isinstance(engine, LiveEngine)

        def look() -> None:
            self.session.do_once()
            if (path := self.session.guidance.due_paths()) is not None:
                self.session.guidance.send(*path)
            status = engine.performance.status()
            beat = self.session.schedule.running.beat(status.frame)
            result.append((beat % 4.0, status.hands[0].position))

        self.board.run(round(1e3 * seconds), look)
        return np.array(result)


@contextmanager
def led(folder: Path, hand: float = 0.0) -> Iterator[Led]:
    """A session on a key that a soft hand holds at a place [m]."""
    path = folder / "score.yaml"
    path.write_text(SCORE, encoding="utf-8")
    texts = Texts.read(path)
    version = Version(0, "", texts, piece_of(texts))
    journal = Journal(folder / "session.jsonl")
    with paced(hand=hand, stiffness=10.0, damping=0.1) as board:
        order = PlaybackConfig(audio="null:fast", boards=[Board(board.url, ((0, "remi"),))])
        session = Session(
            version,
            lambda stage: LiveEngine(stage, order),
            margin=0.006,
            journal=journal,
            real={"remi": None},
        )
        every = session.schedule.engine.tick_frames
        opening = SessionStart(texts, 0.0, version.faders, every, 1.0, 1.0, None)
        journal.append("session", **opening.fields())
        with closing(session):
            try:
                yield Led(session, board)
            finally:
                board.free()  # what ends waits for replies


def part(folder: Path) -> tuple[np.ndarray, np.ndarray]:
    """Beats into a bar, and where ada's part takes her key there [m]."""
    piece = piece_of(Texts.read(folder / "score.yaml"))
    ticks = range(2 * 44_100 // 44)
    path, _ = leading_positions(piece, "ada", ((piece, Window(0.0, 4.0)),), 44, ticks)
    return np.array(ticks) * 2.0 * 44 / 44_100, path


@pytest.mark.slow
def test_guided_key_follows_leader_until_released(tmp_path: Path):
    with led(tmp_path) as single:
        single.ok("play")
        assert single.ok("guide remi ada now").endswith("remi: guided by ada")
        single.watched(4.0)  # forces rise in the first two seconds
        beat, x = single.watched(4.0).T
        # The hand holds against it by 1/12 of its stiffness, the dampers make it late.
        assert np.abs(x - np.interp(beat, *part(tmp_path))).max() < 1.5e-3
        assert 6e-3 < x.max() < 8.5e-3
        single.ok("leo plays back every 4 now")
        single.ok("guide remi leo now")
        single.watched(2.5)
        beat, x = single.watched(2.0).T
        assert -4.2e-3 < x.min() < -2.5e-3
        assert x.max() < 1e-3
        single.ok("undo")
        single.watched(2.5)
        beat, x = single.watched(2.0).T
        assert x.max() > 6e-3
        single.ok("guide remi off now")
        single.watched(1.5)
        beat, x = single.watched(2.0).T
        assert np.abs(x).max() < 0.3e-3
    again = ReplayedSession(read_journal(tmp_path / "session.jsonl"))
    out = np.zeros((again.n_frames, again.n_channels))
    again.process(out)
    assert again.running.version.guides == {}
    assert np.isfinite(out).all()


@pytest.mark.slow
def test_resting_player_guides_no_key(tmp_path: Path):
    with led(tmp_path, hand=4e-3) as single:
        single.ok("play")
        single.ok("guide remi leo now")
        single.watched(3.0)
        _, x = single.watched(0.5).T
        # He does not hold the key at 0, where his own rests.
        assert np.abs(x - 4e-3).max() < 0.3e-3
        single.ok("leo plays lean times 1 now")
        _, x = single.watched(2.0).T
        assert x.max() > 7e-3
        single.watched(2.0)
        _, x = single.watched(0.5).T
        assert np.abs(x - 4e-3).max() < 0.3e-3


@pytest.mark.parametrize(
    ("line", "why"),
    [
        ("guide ada leo", "no real hand plays ada"),
        ("guide remi remi", "'remi' is named twice"),
        ("guide remi ada K=500N/m", "120N/m at most"),
        ("guide remi ada Z=3Ns/m", "1Ns/m at most"),
        ("guide remi off", "remi's hand is not guided"),
    ],
)
def test_guide_refuses_wrong_players_with_one_sentence(hands: Session, line: str, why: str):
    reply = hands.submit(line)
    assert not reply.taken
    assert why in reply.text
    assert "\n" not in reply.text
    assert hands.schedule.head.guides == {}


@pytest.fixture(scope="module")
def hands(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Session]:
    with led(tmp_path_factory.mktemp("hands")) as own:
        yield own.session


def test_guide_with_disconnected_key_is_refused(tmp_path: Path):
    with led(tmp_path) as single:
        single.board.leave()
        until(
            lambda: "remi" in single.session.schedule.engine.status().disconnected,
            "the key is gone",
        )
        assert "the device of remi's key is gone" in single.session.submit("guide remi ada").text


@pytest.mark.parametrize("is_away", [True, False])
def test_session_close_without_response_from_board(tmp_path: Path, is_away: bool):
    """It is searched for, or its reply is waited for: for longer than a test lasts."""
    with led(tmp_path) as single:
        if is_away:
            single.board.leave()
            until(
                lambda: "remi" in single.session.schedule.engine.status().disconnected,
                "the key is gone",
            )
            time.sleep(0.3)  # by now it is searched for; if not, closing has less to end
        closes = threading.Thread(target=single.session.close, daemon=True)
        closes.start()
        closes.join(PATIENCE)
        assert not closes.is_alive()
        assert is_away or not [said for said in single.session.messages() if "gone" in said]


def test_guide_path_recomputed_from_middle(tmp_path: Path):
    path = tmp_path / "score.yaml"
    path.write_text(SCORE, encoding="utf-8")
    piece = piece_of(Texts.read(path))
    spans = ((piece, Window(0.0, 64.0)),)
    every, a_second = 44, 44_100 // 44
    complete, plays = leading_positions(piece, "ada", spans, every, range(20 * a_second))
    again, later = leading_positions(
        piece, "ada", spans, every, range(13 * a_second, 20 * a_second)
    )
    assert np.abs(complete[13 * a_second :] - again).max() < 10e-6
    # As it is written: there every two seconds, and back.
    assert complete[a_second :: 2 * a_second] == pytest.approx(8e-3, abs=10e-6)
    assert complete[2 * a_second :: 2 * a_second] == pytest.approx(0.0, abs=10e-6)
    assert plays[:2] == [(0.0, 2.0), (2.0, 4.0)]
    assert set(later) < set(plays)
    assert later[-1] == (18.0, 20.0)
