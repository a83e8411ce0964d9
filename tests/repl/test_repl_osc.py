"""OSC in a session: requests are lines of the journal, and what plays is told."""

import json
from contextlib import closing, contextmanager
from pathlib import Path

import numpy as np
import pytest
from patience import until
from sessions import Stepped

from ergon.live.osc import OscServer
from ergon.repl.session.osc import SessionEvents, SessionOsc
from tests.live.test_live_osc import Listener, listener  # noqa: F401  # a fixture
from tests.repl.test_repl_live import session_on
from tests.repl.test_repl_session import SCORE


@contextmanager
def served(folder: Path, there: int | None = None):
    """A session that plays nowhere, and the port where it hears OSC."""
    osc = OscServer(("127.0.0.1", 0), None if there is None else ("127.0.0.1", there))
    with closing(session_on(folder, "null")) as session:
        session.attach(SessionOsc(session, osc, session.schedule.engine.performance))
        assert osc.address is not None
        yield session, osc.address[1]


def _lines(folder: Path) -> list[str]:
    rows = map(json.loads, (folder / "session.jsonl").read_text().splitlines())
    return [row["line"] for row in rows if row["event"] == "line"]


def test_requests_are_lines_of_the_journal(tmp_path: Path, listener: Listener):  # noqa: F811
    with served(tmp_path, listener.port) as (session, port):
        listener.say(port, "/ergon/cmd", "play")
        assert listener.until("/ergon/reply")[3] == ["ok from 1|1"]
        assert listener.until("/ergon/beat")[3][:2] == [1, 1]
        listener.say(port, "/ergon/cmd", "ada plays knock every 1 now")
        assert "ada: knock every 1" in listener.until("/ergon/reply")[3][0]
        assert listener.until("/ergon/strike")[3][:3] == ["ada", "k1", "knock"]
        listener.say(port, "/ergon/cmd", "ada plyas knock")
        assert listener.until("/ergon/error")[3] == ["unknown verb 'plyas'; try: ada plays knock"]
        for level in (-3.0, -9.0, -6.0):
            listener.say(port, "/ergon/instrument/bell/gain", level)
        listener.say(port, "/ergon/player/leo/gain", float("-inf"))
        listener.say(port, "/ergon/gain", -12)
        faders = lambda: session.schedule.head.faders  # noqa: E731
        until(lambda: faders().gains.get("drum") == 0.0, "the levels are set")
        until(lambda: faders().master < 1.0, "the master level is set")
        assert faders().gains["bell"] == pytest.approx(10**-0.3)
        listener.say(port, "/ergon/stop", 1)
        until(lambda: not session.schedule.running.clock.is_running, "the piece stops")
        listener.say(port, "/ergon/panic")
        until(lambda: session.state().panicked, "a panic")
        assert listener.until("/ergon/trouble")[3][:1] == ["PANIC"]
        listener.say(port, "/ergon/release")
        until(lambda: not session.state().panicked, "no panic any more")
    typed = _lines(tmp_path)
    assert typed[0] == "play"
    assert any("gain bell -6dB now" in line for line in typed)
    assert any("gain leo x0 now" in line for line in typed)
    assert "stop" in typed


@pytest.mark.parametrize(
    "line",
    ["py 1", "save x.yaml", "keep 1bar as x", "load score.yaml", "reload", "quit",
     "tempo 99\npy __import__('os').system('true')", "record ada as x"],
)  # fmt: skip
def test_osc_line_requiring_password_is_refused(tmp_path: Path, listener: Listener, line: str):  # noqa: F811
    with served(tmp_path) as (_, port):
        listener.say(port, "/ergon/cmd", line)
        answer = listener.until("/ergon/error", "/ergon/reply")[2:]
        words = "this line has to be typed at a prompt: OSC has no passwords"
        assert answer == ("/ergon/error", [words])
    assert _lines(tmp_path) == []


def test_wrong_osc_messages_change_no_fader(tmp_path: Path, listener: Listener):  # noqa: F811
    with served(tmp_path) as (session, port):
        listener.socket.sendto(b"#bundle\0" + bytes(3), ("127.0.0.1", port))
        listener.say(port, "/ergon/instrument/nobody/gain", 1.0)
        listener.say(port, "/ergon/instrument/bell/gain", "loud")
        assert "one number" in listener.until("/ergon/error")[3][0]
        listener.say(port, "/ergon/gain", 60.0)
        assert "above the highest level" in listener.until("/ergon/error")[3][0]
        assert session.schedule.head.faders.master == 1.0
    assert "1 datagrams were not valid OSC and were ignored" in session.messages()


def test_osc_beats_and_gestures_across_versions(tmp_path: Path):
    player_session = Stepped(SCORE, tmp_path)
    events = SessionEvents(player_session.session.schedule)
    output = []

    def go(seconds: float) -> None:
        for _ in range(round(seconds / 0.01)):
            player_session.run(0.01)
            output.extend(events.pop_before(player_session.engine.frame))

    go(0.1)
    assert output == []  # the piece is stopped
    player_session.ok("play")
    player_session.ok("ada plays knock every 1 now")
    go(2.0)
    player_session.ok("tempo 240 now")
    go(1.0)
    player_session.ok("stop")
    go(0.5)
    player_session.ok("play from 9|1")
    go(1.0)
    player_session.close()
    assert [frame for frame, *_ in output] == sorted(frame for frame, *_ in output)
    beats = [said for _, address, said in output if address == "/ergon/beat"]
    first = [(1 + n // 4, 1 + n % 4) for n in range(len(beats))]
    cut = [bar for bar, *_ in beats].index(9)
    assert [one[:2] for one in beats[:cut]] == first[:cut]
    assert [one[:2] for one in beats[cut:]][:4] == [(9, 1), (9, 2), (9, 3), (9, 4)]
    frames = np.array([frame for frame, address, _ in output if address == "/ergon/beat"])
    assert set(np.diff(frames[:4])) == {4_000}
    assert 2_000 in np.diff(frames[:cut])
    strikes = [frame for frame, address, said in output if address == "/ergon/strike"]
    assert strikes[1] - strikes[0] == 4_000
    assert len(strikes) == len(set(strikes)) > 6


def test_repl_command_with_osc_options(tmp_path: Path):
    import subprocess

    from commands import ERGON

    (tmp_path / "score.yaml").write_text(SCORE)
    line = [*ERGON, "repl", "score.yaml", "--audio", "null", "--gain", "0dB", "--plain"]
    done = subprocess.run(
        [*line, "--osc", "0", "--osc-to", "127.0.0.1:9"],
        cwd=tmp_path,
        input="play\n",
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "OSC is heard at 127.0.0.1:" in done.stderr + done.stdout
    done = subprocess.run(
        [*line, "--osc", "nowhere"],
        cwd=tmp_path,
        input="",
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2
    assert "HOST:PORT" in done.stderr
    assert not list(tmp_path.glob("session-2*"))
