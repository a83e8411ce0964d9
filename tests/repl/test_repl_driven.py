"""`--drive` in a session: a written part moves a real key, and other lines change what it does."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from paced_board import Paced, paced

from ergon.live.boards import Board
from ergon.live.perform import PlaybackConfig
from ergon.repl.session.live import LiveEngine
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
  k: {calib: key.yaml, travel: -12mm..12mm}
  k2: {M: 400g, K: 60N/m, Z: 1.2Ns/m}
instruments:
  bell:
    modules:
      m: {CEL: {M: 2g, f: A3, t60: 0.5s}}
      b: {BUT: {between: [k, m], K: 900N/m, Z: 0.1Ns/m, gap: 11mm}}
    out: {SOX: m}
gestures:
  lean: 0mm@0 smooth 8mm@2 smooth 0mm@4     # two seconds
  back: 0mm@0 smooth -4mm@2 smooth 0mm@4
players: {ada: {key: k}, leo: {key: k2}}
parts: {ada: [{at: 1|1, play: lean, every: 4, times: 999}]}
mix: {route: [{from: bell, to: 1}]}
"""


def watched(session: Session, board: Paced, seconds: float) -> tuple[np.ndarray, np.ndarray]:
    """Beats into a bar, and where the key is there [m], while the session plays on."""
    engine, result = session.schedule.engine, []
    assert isinstance(engine, LiveEngine)

    def look() -> None:
        session.do_once()
        if (path := session.guidance.due_paths()) is not None:
            session.guidance.send(*path)
        status = engine.performance.status()
        beat = session.schedule.running.beat(status.frame)
        result.append((beat % 4.0, status.hands[0].position))

    board.run(round(1e3 * seconds), look)
    beats, positions = np.array(result).T
    return beats, positions


def part(folder: Path) -> tuple[np.ndarray, np.ndarray]:
    """Beats into a bar, and where ada's part takes her key there [m]."""
    piece = piece_of(Texts.read(folder / "score.yaml"))
    ticks = range(2 * 44_100 // 44)
    path, _ = leading_positions(piece, "ada", ((piece, Window(0.0, 4.0)),), 44, ticks)
    return np.array(ticks) * 2.0 * 44 / 44_100, path


def test_drive_in_a_session(tmp_path: Path):
    (tmp_path / "key.yaml").write_text("ergon: 1\nM: 50g\nK: 0N/m\nZ: 1Ns/m\n")
    (tmp_path / "score.yaml").write_text(SCORE, encoding="utf-8")
    texts = Texts.read(tmp_path / "score.yaml")
    with paced(stiffness=0.0, damping=0.0) as board:
        boards = [Board(board.url, ((0, "ada"),))]
        order = PlaybackConfig(audio="null:fast", boards=boards, driven_players=frozenset({"ada"}))
        session = Session(
            Version(0, "", texts, piece_of(texts)),
            lambda stage: LiveEngine(stage, order),
            margin=0.006,
            real={"ada": None},
            driven_players={"ada"},
        )
        with closing(session):
            try:
                ok(session, "play")
                watched(session, board, 6.5)  # forces rise in the first two seconds
                beats, x = watched(session, board, 4.0)
                assert np.ptp(x) > 7e-3
                # A look at the status sees the tick before or after: at 25 mm/s that is 25 µm.
                assert np.sqrt(np.mean((x - np.interp(beats, *part(tmp_path))) ** 2)) < 0.15e-3
                ok(session, "ada plays back every 4 now")
                watched(session, board, 4.0)
                _, x = watched(session, board, 2.0)
                assert -4.3e-3 < x.min() < -3.7e-3
                assert x.max() < 0.3e-3
                with pytest.raises(AssertionError, match="drives this key already"):
                    ok(session, "guide ada leo now")
            finally:
                board.free()
