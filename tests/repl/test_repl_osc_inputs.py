"""Inputs that are told values by OSC, through UDP: what acts, and what a journal renders."""

import json
import subprocess
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
import soundfile
from captured import check_heard
from commands import ERGON
from numpy.typing import NDArray
from patience import until
from sessions import EVERY, Stepped

from ergon import _core
from ergon.live.osc import OscServer
from ergon.live.osc_in import OscRequestError
from ergon.live.osc_values import InputValues
from ergon.live.perform import PlaybackConfig
from ergon.live.trouble import troubles
from ergon.repl.session.engine import SteppedEngine
from ergon.repl.session.journal import JournalError
from ergon.repl.session.osc import SessionOsc
from ergon.scores.staging.drives import input_id
from ergon.scores.staging.stage import stage
from tests.live.test_live_osc import Listener, listener, piece, played  # noqa: F401  # a fixture
from tests.repl.test_repl_live import session_on

RATE = 44_100
SCORE = """\
ergon: 1
takes:
  breath: {input: osc, gain: 2mN, glide: 10ms, clamp: 3mN}
  place: {input: osc, gain: 1mm, glide: 0s, file: rehearsal.wav}
instruments:
  free: {modules: {m: {MAS: {M: 2g}}, push: {ENF: {to: m, from: breath}}}, out: {SOX: m}}
  hand: {modules: {m: {MAS: {M: 1g}}, path: {ENX: {to: m, from: place}}}, out: {SOX: m}}
mix:
  channels: 2
  route: [{from: free, to: 1, gain: x1}, {from: hand, to: 2, gain: x1}]
render: {tail: 2s}
"""


@pytest.fixture
def folder(work_folder: Path) -> Path:
    """A folder with the file that an input plays until it is told a value."""
    soundfile.write("rehearsal.wav", np.full(1000, 0.25), RATE, subtype="FLOAT")
    return work_folder


class OscSession:
    """A stepped session that hears OSC: time passes only by `own.run`."""

    def __init__(self, folder: Path, message: Listener) -> None:
        self.stepped = Stepped(SCORE, folder)
        self._listener, self._osc = message, OscServer(("127.0.0.1", 0), None)
        performance = cast(_core.Performance, SimpleNamespace())
        self._served = SessionOsc(self.stepped.session, self._osc, performance)

    def tell(self, name: str, value: float) -> None:
        """Say a value by UDP, and wait until it acts, at the frame that is next."""
        assert self._osc.address is not None
        self._listener.say(self._osc.address[1], f"/ergon/input/{name}", value)
        before = len(self.values())
        until(
            lambda: self.stepped.session.do_once() or len(self.values()) > before, "the value acts"
        )

    def values(self) -> list[tuple[int, str, float]]:
        """Those of the journal: frame, input, value."""
        rows = map(json.loads, self.stepped.journal.read_text().splitlines())
        return [
            (row["frame"], row["input"], row["value"]) for row in rows if row["event"] == "value"
        ]

    def close(self) -> None:
        self._served.close()
        self.stepped.close()


@pytest.fixture
def session_osc(folder: Path, listener: Listener) -> Iterator[OscSession]:  # noqa: F811
    built = OscSession(folder, listener)
    yield built
    built.close()


def forces(values: list[tuple[int, str, float]], n_frames: int) -> NDArray[np.float64]:
    """What `breath` gives at each frame [N]: an even way of 441 frames to each value."""
    x = np.zeros(n_frames + 1)  # of the frame before
    for frame, name, value in values:
        if name == "breath":
            start = x[frame]
            method = np.minimum(np.arange(1, n_frames - frame + 1) / 441, 1.0)
            x[frame + 1 :] = start + (np.clip(value, -1.5, 1.5) - start) * method
    return np.clip(2e-3 * x[1:], -3e-3, 3e-3)


def test_osc_inputs_by_udp_live_equal_journal(
    session_osc: OscSession,
):
    single = session_osc.stepped
    single.run(0.1)
    session_osc.tell("breath", 0.5)
    single.run(0.05)
    session_osc.tell("breath", -1.0)  # on the way of the value before
    single.run(0.005)
    session_osc.tell("breath", 7)  # more than the clamp lets act
    session_osc.tell("place", -0.5)
    single.run(0.2)
    single.close()
    values = session_osc.values()
    assert [value for *_, value in values] == [0.5, -1.0, 7.0, -0.5]
    force = forces(values, len(single.sound))
    x = np.zeros(len(force) + 1)
    v = 0.0
    for n, f in enumerate(force):
        v += f / (2e-3 * RATE * RATE)
        x[n + 1] = x[n] + v
    assert np.allclose(single.sound[:, 0], x[:-1], rtol=1e-9, atol=1e-16)
    assert np.abs(x).max() > 1e-6
    place = np.zeros(len(single.sound) + 1)
    place[1:1001] = 0.25e-3  # the file; then at rest, then held
    place[values[-1][0] + 1 :] = -0.5e-3
    assert np.array_equal(single.sound[:, 1].astype(np.float32), place[:-1].astype(np.float32))
    assert np.array_equal(single.again(), single.sound)


def test_new_version_continues_osc_input_values(session_osc: OscSession):
    single = session_osc.stepped
    single.run(0.1)
    session_osc.tell("breath", 1.0)
    session_osc.tell("place", 0.75)
    single.run(0.004)
    single.ok("set free.m.M 3g now")
    single.run(0.2)
    assert single.sound[-1, 1] == 0.75e-3
    single.ok("undo")
    single.run(0.2)
    assert single.sound[-1, 1] == 0.75e-3
    single.close()
    assert np.array_equal(single.again(), single.sound)
    further = Stepped.resumed(single.journal)
    further.run(0.1)
    assert further.sound[-1, 1] == 0.0  # nobody has told it anything yet
    further.close()


@pytest.mark.parametrize("value", ["loud", float("nan"), float("inf"), True, None])
def test_osc_input_refuses_non_finite_values(
    session_osc: OscSession,
    listener: Listener,  # noqa: F811
    value: Any,
):
    assert session_osc._osc.address is not None
    text = () if value is None else (value,)
    listener.say(session_osc._osc.address[1], "/ergon/input/breath", *text)
    assert listener.until("/ergon/error")[3] == [
        "the argument has to be one finite number; 1 is full scale"
    ]
    session_osc.stepped.run(0.1)
    assert session_osc.values() == []
    assert not session_osc.stepped.sound[:, 0].any()


def test_osc_address_of_unknown_input(session_osc: OscSession, listener: Listener):  # noqa: F811
    assert session_osc._osc.address is not None
    listener.say(session_osc._osc.address[1], "/ergon/input/nobody", 1.0)
    listener.say(session_osc._osc.address[1], "/ergon/input/", 1.0)
    session_osc.tell("breath", 0.0)
    assert len(session_osc._osc.remarks()) == 2


class Asked:
    """What would be told, at a time that a test sets."""

    def __init__(self) -> None:
        self.now, self.takes = 0.0, True
        self.received: list[tuple[str, float]] = []
        self.inputs = InputValues(self._tell, lambda: self.now)

    def _tell(self, name: str, value: float) -> bool:
        if self.takes:
            self.received.append((name, value))
        return self.takes


def test_osc_inputs_rate_limit_with_fast_values():
    asked = Asked()
    for index in range(1000):  # in one second, to two inputs by turns
        asked.now = index / 1000
        for name in "ab":
            asked.inputs.handler_of(name)([index])
        asked.inputs.send_due_values()
    asked.now = 1.1
    asked.inputs.send_due_values()
    assert 200 <= len(asked.received) <= 222
    assert dict(asked.received) == {"a": 999.0, "b": 999.0}
    assert abs(sum(name == "a" for name, _ in asked.received) - len(asked.received) / 2) <= 1


def test_osc_input_value_resent_after_full_queue():
    asked = Asked()
    asked.takes = False
    asked.inputs.handler_of("a")([0.5])
    asked.inputs.handler_of("a")([0.25])
    assert asked.received == []
    asked.takes = True
    asked.inputs.send_due_values()
    assert asked.received == [("a", 0.25)]
    for wrong in ([], [1.0, 2.0], ["1"], [10**400]):
        with pytest.raises(OscRequestError, match="finite number"):
            asked.inputs.handler_of("a")(wrong)


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        ({"input": "nobody"}, "has no such input"),
        ({"input": 3}, "'input' has the wrong type"),
        ({"value": "1"}, "'value' has the wrong type"),
        ({"value": float("nan")}, "must be from"),
        ({"frame": -1}, "must be from 0"),
    ],
)
def test_forged_input_value_in_journal_is_refused(
    session_osc: OscSession, damage: dict[str, Any], message: str
):
    session_osc.stepped.run(0.1)
    session_osc.tell("breath", 1.0)
    session_osc.stepped.run(0.1)
    session_osc.stepped.close()
    rows = [json.loads(line) for line in session_osc.stepped.journal.read_text().splitlines()]
    for number, row in enumerate(rows, 1):
        if row["event"] == "value":
            row.update(damage)
            place = number
    session_osc.stepped.journal.write_text("".join(json.dumps(row) + "\n" for row in rows))
    with pytest.raises(JournalError, match=f"line {place}: .*{message}"):
        session_osc.stepped.again()


@contextmanager
def served(folder: Path, audio: str) -> Iterator[tuple[Any, int]]:
    osc = OscServer(("127.0.0.1", 0), None)
    with closing(session_on(folder, audio, text=SCORE)) as session:
        session.attach(SessionOsc(session, osc, session.schedule.engine.performance))
        assert osc.address is not None
        yield session, osc.address[1]


def test_journal_renders_live_osc_inputs_to_the_bit(folder: Path, listener: Listener):  # noqa: F811
    """Over the real engine, whose ticks the values fall between."""
    listened = folder / "heard.wav"
    with served(folder, f"clock:{listened}") as (session, port):
        engine = session.schedule.engine
        frame = 4410
        for step in range(20):
            until(lambda after=frame: engine.frame > after, "the engine goes on")
            listener.say(port, "/ergon/input/breath", 0.1 * step - 1.0)
            listener.say(port, "/ergon/input/place", -0.05 * step)
            frame = engine.frame + 1500
        until(lambda: engine.frame > frame + 22_050, "the last is held")
        troubles = engine.status().troubles
    rows = [json.loads(line) for line in (folder / "session.jsonl").read_text().splitlines()]
    assert sum(row["event"] == "value" for row in rows) == 40
    done = subprocess.run(
        [*ERGON, "render", "session.jsonl", "-o", "again.wav", "--bits", "float"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    sound, _ = soundfile.read(listened, dtype="float32", always_2d=True)
    again, _ = soundfile.read("again.wav", dtype="float32", always_2d=True)
    assert check_heard(sound, again, troubles).equal > 44_100


def test_osc_inputs_of_play_command_act_at_ticks(folder: Path, listener: Listener):  # noqa: F811
    """`ergon play`: what is heard is what values at the frames of their events make."""
    staged = stage(piece(SCORE), planned=True)
    listened = PlaybackConfig(audio=f"clock:{folder / 'heard.wav'}")
    acted: list[int] = []

    def has(n: int) -> Callable[[], bool]:
        def look() -> bool:
            acted.extend(frame for frame, what, _ in performance.events() if what == "acted")
            return len(acted) >= n

        return look

    text = {"breath": 0.5, "place": -0.25}
    with played(staged, listened) as (performance, osc):
        assert osc.address is not None
        for number, (name, value) in enumerate(text.items(), 1):
            listener.say(osc.address[1], f"/ergon/input/{name}", value)
            until(has(number), "the value acts")
        until(lambda: performance.wait(0.1), "the end of the piece")
        result = troubles(performance.status(), (), None, is_endless=False)
    player_session = SteppedEngine(
        stage(piece(SCORE), planned=True), tick_frames=EVERY, highpass=None
    )
    mixed = []
    for frame, (name, value) in zip(acted, text.items(), strict=True):
        mixed.append(player_session.process(frame - player_session.frame))
        player_session.set_input(input_id(name), value)
    mixed.append(player_session.process(staged.n_frames - player_session.frame))
    sound, _ = soundfile.read(folder / "heard.wav", dtype="float32", always_2d=True)
    check_heard(sound, np.concatenate(mixed).astype(np.float32), result)
