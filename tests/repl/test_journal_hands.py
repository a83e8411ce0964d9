"""A journal with real hands renders to what was heard: hands, jumps, panics, a device lost."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import soundfile
from paced_board import Paced, paced
from patience import PATIENCE, until
from sweep import few

from ergon import _core
from ergon.live.boards import Board
from ergon.live.perform import PlaybackConfig
from ergon.repl.session.clock import Clock, Timing
from ergon.repl.session.journal import Journal
from ergon.repl.session.journal_content import SessionStart
from ergon.repl.session.journal_hands import JournalHand, JournalTake
from ergon.repl.session.live import LiveEngine
from ergon.repl.session.running import stage_first
from ergon.repl.session.session import Session
from ergon.repl.session.takeover import Takeovers
from ergon.repl.session.version import Version, piece_of
from ergon.scores.edits.texts import Texts
from tests.repl.test_repl_live import ok

ERGON = [sys.executable, "-m", "ergon.cli"]
GAIN = 200.0
SCORE = """\
ergon: 1
tempo: [{at: 1|1, bpm: 240}]
keys:
  k1: {M: 400g, K: 60N/m, Z: 1.2Ns/m}
  k2: {M: 50g, K: 0N/m, Z: 1Ns/m, travel: -12mm..12mm}
  k3: {M: 50g, K: 0N/m, Z: 1Ns/m, travel: -12mm..12mm}
instruments:
  bell:
    modules:
      m: {CEL: {M: 2g, f: A3, t60: 0.5s}}
      b: {BUT: {between: [k1, m], K: 900N/m, Z: 0.1Ns/m, gap: 1mm}}
      c: {BUT: {between: [k2, m], K: 300N/m, Z: 0.1Ns/m, gap: 1mm}}
    out: {SOX: m}
  drum:
    modules:
      m: {CEL: {M: 9g, f: A2, t60: 0.5s}}
      c: {BUT: {between: [k3, m], K: 300N/m, Z: 0.1Ns/m, gap: 1mm}}
    out: {SOX: m}
gestures:
  lean: 0mm@0 smooth 8mm@2 smooth 0mm@4
players:
  ada: {key: k1}
  remi: {hand: live, key: k2}
  zoe: {hand: live, key: k3}
parts:
  ada: [{at: 1|1, play: lean, every: 4, times: 999}]
  remi: [{at: 2|1, play: lean}]
mix: {channels: 2, route: [{from: bell, to: 1}, {from: drum, to: 2}]}
"""


@dataclass
class Played:
    session: Session
    boards: list[Paced]
    folder: Path

    def ok(self, line: str) -> str:
        return ok(self.session, line)

    def run(self, seconds: float) -> None:
        """Both boards go on, a few periods at a time, and the session with them."""
        periods = round(1e3 * seconds)
        while periods > 0:
            some = min(periods, 20)
            self.step(some)
            periods -= some

    def step(self, periods: int) -> None:
        """The boards go on, and the session once."""
        for board in self.boards:
            board.may(periods)
        for board in self.boards:
            board.wait()
        self.session.do_once()
        if (path := self.session.guidance.due_paths()) is not None:
            self.session.guidance.send(*path)

    def take_effect(self) -> None:
        """Until no line waits: a busy machine gives lines more time."""
        for _ in range(3000):
            if not (self.session.schedule.waiting or self.session.schedule.changes.pending):
                return
            self.run(0.02)
        raise AssertionError("a line waits for a minute")

    def lose(self, board: Paced, player: str) -> None:
        """A board answers no more, until its player's key is gone; the others go on."""
        board.leave()
        self.boards.remove(board)
        self._until(lambda: player in self.session.schedule.engine.status().disconnected)

    def find(self, board: Paced) -> None:
        """A board answers again, until no key is gone."""
        board.come()

        def is_back() -> bool:
            board.may(20)
            return not self.session.schedule.engine.status().disconnected

        self._until(is_back)
        board.hold()
        self.boards.append(board)

    def _until(self, is_so: Callable[[], bool]) -> None:
        end = time.monotonic() + PATIENCE
        while not is_so():
            self.step(20)
            assert time.monotonic() < end, "a board was not lost, or not found"


@contextmanager
def playing(folder: Path, text: str = SCORE) -> Iterator[Played]:
    """Two hands on two devices; every frame that is computed stands in heard.wav."""
    path = folder / "score.yaml"
    path.write_text(text, encoding="utf-8")
    texts = Texts.read(path)
    version = Version(0, "", texts, piece_of(texts))
    journal = Journal(folder / "session.jsonl")
    moving = {"stiffness": 900.0, "sine": 5e-3}
    with paced(hertz=2.0, **moving) as first, paced(hertz=3.0, **moving) as two:
        boards = [Board(first.url, ((0, "remi"),)), Board(two.url, ((0, "zoe"),))]
        config = PlaybackConfig(
            audio=f"file:{folder / 'heard.wav'}",
            gain=GAIN,
            boards=boards,
            record=folder / "session.take",
        )
        session = Session(
            version,
            lambda stage: LiveEngine(stage, config),
            margin=0.006,
            journal=journal,
            real={"remi": None, "zoe": None},
            hands=folder / "session.take",
        )
        hands = (JournalHand("remi", "k2", first.url, 0), JournalHand("zoe", "k3", two.url, 0))
        opening = SessionStart(
            texts,
            0.0,
            version.faders,
            session.schedule.engine.tick_frames,
            GAIN,
            1.0,
            None,
            take=JournalTake(folder / "session.take", hands),
        )
        journal.append("session", **opening.fields())
        with closing(session):
            try:
                yield Played(session, [first, two], folder)
            finally:
                for board in (first, two):
                    board.come()
                    board.free()  # what ends waits for replies


def rendered(folder: Path, journal: str = "session.jsonl") -> subprocess.CompletedProcess[str]:
    command = [*ERGON, "render", journal, "-o", "again.wav", "--bits", "float"]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)


def sound(path: Path) -> np.ndarray:
    frames, _ = soundfile.read(path, dtype="float32", always_2d=True)
    return frames


def test_render_of_hands_jumps_panics_and_lost_device(tmp_path: Path):
    with playing(tmp_path) as player_session:
        player_session.run(0.3)
        player_session.ok("play")
        player_session.run(1.0)
        player_session.ok("ada plays lean every 2 now")
        player_session.ok("record remi as solo now")
        player_session.run(1.0)
        player_session.ok("record off now")
        player_session.run(1.0)
        player_session.ok("set bell.m.K x1.3 over 1bar")
        player_session.ok("guide remi ada K=60N/m now")
        player_session.run(2.5)
        player_session.ok("play from 3|1")
        player_session.run(0.7)
        player_session.session.panic()
        until(lambda: player_session.session.stops.panicked, "the panic")
        player_session.run(0.5)
        player_session.ok("release")
        player_session.ok("play from 2|1")
        player_session.run(1.5)
        player_session.ok("stop")
        player_session.take_effect()
        player_session.run(0.2)
        player_session.ok("play")
        player_session.run(0.5)
        player_session.ok("undo")
        player_session.run(0.5)
        lost = player_session.boards[1]
        player_session.lose(lost, "zoe")
        player_session.run(0.5)
        player_session.find(lost)
        player_session.run(1.0)
    done = rendered(tmp_path)
    assert done.returncode == 0, done.stderr
    assert "warning" not in done.stderr
    played, again = sound(tmp_path / "heard.wav"), sound(tmp_path / "again.wav")
    # The last frames fall silent, for the session ends.
    listened = min(len(played), len(again)) - 4 * 1024
    assert listened > 10 * 44_100
    differs = np.flatnonzero(np.any(played[:listened] != again[:listened], axis=1))
    assert not len(differs), (len(differs), differs[:3], listened)
    assert np.abs(played[:, 0]).max() > 0.01
    assert np.abs(played[:, 1]).max() > 0.01
    events = [json.loads(line) for line in (tmp_path / "session.jsonl").read_text().splitlines()]
    silences = [one for one in events if one["event"] == "silence"]
    assert [one["begins"] for one in silences] == [True, False]
    begin, end = (one["frame"] for one in silences)
    assert not played[begin + 221 : end].any()
    moved = [(one["player"], one["real"]) for one in events if one["event"] == "hand"]
    assert moved == [("zoe", False), ("zoe", True)]


@pytest.fixture(scope="module")
def short(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A short session with hands."""
    folder = tmp_path_factory.mktemp("short")
    with playing(folder) as player_session:
        player_session.ok("play")
        player_session.run(0.5)
        # A recording is written a few times a second of the wall clock: what follows is a chunk of
        # its own.
        take = folder / "session.take"
        until(lambda: len(_core.read_recording(take).ticks()) >= 450, "the recording on the disk")
        player_session.run(0.1)
    return folder


def copied(short: Path, folder: Path) -> list[dict]:
    """The files of a session, copied; its events."""
    for name in ("score.yaml", "session.jsonl", "session.take"):
        (folder / name).write_bytes((short / name).read_bytes())
    text = (folder / "session.jsonl").read_text(encoding="utf-8")
    return [json.loads(line) for line in text.splitlines()]


def written(folder: Path, events: list[dict]) -> None:
    text = "".join(json.dumps(one) + "\n" for one in events)
    (folder / "session.jsonl").write_text(text, encoding="utf-8")


def test_load_without_player_of_a_device_is_refused(tmp_path: Path):
    """It was an internal error; what plays goes on."""
    (tmp_path / "other.yaml").write_text(SCORE.replace("remi", "ines"), encoding="utf-8")
    with playing(tmp_path) as player_session:
        player_session.run(0.2)
        reply = player_session.session.submit(f"load {tmp_path / 'other.yaml'} now")
        assert not reply.taken
        assert "'remi' plays on a device, and this score has no player" in reply.text
        player_session.ok("play")
        player_session.run(0.2)


def test_journal_fields_of_real_hands(short: Path, tmp_path: Path):
    first = copied(short, tmp_path)[0]
    assert first["take"] == "session.take"
    hands = [(h["player"], h["key"], h["axis"], h["start"]) for h in first["hands"]]
    assert hands == [("remi", "k2", 0, 0), ("zoe", "k3", 0, 0)]
    assert len({hand["device"] for hand in first["hands"]}) == 2


def test_render_without_recording_is_refused(short: Path, tmp_path: Path):
    copied(short, tmp_path)
    (tmp_path / "session.take").unlink()
    done = rendered(tmp_path)
    assert done.returncode == 2
    assert "session.take is missing" in done.stderr
    assert "remi, zoe" in done.stderr
    assert not (tmp_path / "again.wav").exists()


@pytest.mark.parametrize(
    "name", few(["../session.take", "/dev/zero", "a/b.take", "score.yaml", ""], 2)
)
def test_render_with_recording_elsewhere_is_refused(short: Path, tmp_path: Path, name: str):
    events = copied(short, tmp_path)
    events[0]["take"] = name
    written(tmp_path, events)
    done = rendered(tmp_path)
    assert done.returncode == 2
    assert "beside the journal" in done.stderr
    assert "line 1" in done.stderr


def test_render_with_recording_of_other_hands_is_refused(short: Path, tmp_path: Path):
    events = copied(short, tmp_path)
    del events[0]["hands"][1]
    written(tmp_path, events)
    done = rendered(tmp_path)
    assert done.returncode == 2
    assert "does not record remi of this session" in done.stderr


def test_render_of_cut_journal_and_recording(short: Path, tmp_path: Path):
    events = copied(short, tmp_path)
    written(tmp_path, events[:-1])
    take = tmp_path / "session.take"
    take.write_bytes(take.read_bytes()[:-100])
    done = rendered(tmp_path)
    assert done.returncode == 0, done.stderr
    assert "session.jsonl has no end" in done.stderr
    assert "session.take: " in done.stderr
    complete, cut = sound(tmp_path / "again.wav"), sound(short / "heard.wav")
    n = min(len(complete), len(cut)) - 4 * 1024
    assert n > 8 * 1024
    assert np.array_equal(complete[:n], cut[:n])


@pytest.mark.parametrize(
    "silences",
    few(
        [
            [{"frame": 5, "begins": False}],
            [{"frame": 5, "begins": True}, {"frame": 9, "begins": True}],
            [{"frame": 5, "begins": True}, {"frame": 4, "begins": False}],
        ],
        1,
    ),
)
def test_render_with_impossible_silences_is_refused(
    short: Path, tmp_path: Path, silences: list[dict]
):
    events = copied(short, tmp_path)
    events[1:1] = [{"v": 1, "event": "silence", **one} for one in silences]
    written(tmp_path, events)
    done = rendered(tmp_path)
    assert done.returncode == 2
    assert "silences neither overlap" in done.stderr


def test_takeover_of_two_islands_with_one_hand(tmp_path: Path):
    """Two islands begin with the hand's key, and each must take over from itself."""
    text = SCORE.replace("gestures:", "  other: {like: drum, transpose: -4st}\ngestures:", 1)
    path = tmp_path / "score.yaml"
    path.write_text(text, encoding="utf-8")
    texts = Texts.read(path)
    version = Version(0, "", texts, piece_of(texts))
    real = {"remi": None, "zoe": None}
    begun = stage_first(version, Clock(), real, None)
    zoe = next(hand.index for hand in begun.stage.live_hands if hand.player == "zoe")

    def played(simulation: _core.Simulation, first: int, last: int) -> np.ndarray:
        frames = np.zeros((44 * (last - first), simulation.n_out))
        for tick in range(first, last):
            simulation.hold(zoe, 3e-3 * np.sin(0.02 * tick))
            simulation.process(frames[44 * (tick - first) : 44 * (tick + 1 - first)])
        return frames

    simulation = begun.stage.simulation
    played(simulation, 0, 100)
    wanted = played(simulation.fork(), 100, 300)
    assert np.abs(wanted).max() > 1e-4
    after = Takeovers(Timing(begun.stage.rate, 44), real).extended(begun, 4400)
    after.stage.simulation.take_over(simulation)
    assert np.array_equal(played(after.stage.simulation, 100, 300), wanted)
