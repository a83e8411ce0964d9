"""Sessions and prompts as real processes in real terminals: shared, left, killed, resumed."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import socket
import struct
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
from commands import PATIENT
from one_bell import SCORE
from patience import PATIENCE, until
from sockets import remote
from terminals import CTRL_D, ENTER, Terminal

from ergon.repl.wire import local_socket

# What the session's score says, in so few characters that a reply can hold it.
_TEXT = "py __import__('hashlib').sha256(session.schedule.head.texts.text.encode()).hexdigest()"


class Stage:
    """A folder with a score, and the engines that are started in it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.socket = folder / "s"
        (folder / "score.yaml").write_text(SCORE)
        self._engines: set[int] = set()

    def command(self, *words: str) -> list[str]:
        return [*PATIENT, "repl", *words, "--socket", str(self.socket)]

    def prompt(self, *words: str) -> Terminal:
        state = {"XDG_STATE_HOME": str(self.folder / "state")}
        terminal = Terminal(self.command(*words), cwd=self.folder, **state)
        return terminal

    def begins(self) -> Terminal:
        prompt_shown = self.prompt("score.yaml", "--audio", "null", "--gain", "0dB")
        prompt_shown.sees("1|1 >")
        self.engine()
        return prompt_shown

    def engine(self) -> int:
        """The process that serves."""
        with contextlib.closing(local_socket.connect(self.socket)[0]) as raised:
            output = raised.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, 12)
            pid = struct.unpack("3i", output)[0]
        self._engines.add(pid)
        return pid

    def events(self, name: str, journal: str = "session.jsonl") -> list[dict[str, object]]:
        lines = (self.folder / journal).read_text().splitlines()
        return [event for event in map(json.loads, lines) if event["event"] == name]

    def close(self) -> None:
        with contextlib.suppress(local_socket.SocketError):
            self.engine()
        for pid in self._engines:
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)


@pytest.fixture
def home_stage(short_folder: Path) -> Iterator[Stage]:
    with contextlib.closing(Stage(short_folder)) as stage:
        yield stage


def test_prompts_of_two_terminals_share_a_session(home_stage: Stage):
    with home_stage.begins() as first, home_stage.prompt() as two:
        two.sees("joined")
        two.sees("1|1 >")
        first.type("play" + ENTER)
        first.sees("ok from 1|1")
        two.sees("prompt 1 > play   ok from 1|1")
        two.type("ada plays knock every 1" + ENTER)
        first.sees("> ada plays knock every 1   ok 2|1 ada: knock every 1")
        two.type("quit" + ENTER)
        assert two.ends() == 0
        first.sees("the session has ended")
        first.type("play" + ENTER)
        assert first.ends() == 0
    until(lambda: not home_stage.socket.exists(), "the end of the engine")
    assert home_stage.events("end")


def test_closed_terminal_leaves_engine_running(home_stage: Stage):
    with home_stage.begins() as first:
        first.type("play" + ENTER + "ada plays knock every 1" + ENTER)
        first.sees("ok 2|1 ada")
    # The window is closed: the terminal hangs up.
    engine = home_stage.engine()
    with contextlib.closing(remote(home_stage.socket)) as looks:
        bar = looks.state().bar
        until(lambda: looks.state().bar >= max(bar + 1, 3), "the next bar")
        assert looks.submit("tempo 140 now").taken
    until(lambda: len(home_stage.events("commit")) >= 3, "a commit")
    frames = [event["frame"] for event in home_stage.events("commit")]
    assert frames == sorted(frames)
    with home_stage.prompt("score.yaml") as again:
        again.sees("ada knock")  # it shows the running state
        again.sees("140 bpm")
        again.type(CTRL_D)
        assert again.ends() == 0
        assert "the music goes on" in again.text
    assert home_stage.engine() == engine


def test_engine_killed_and_session_resumed(home_stage: Stage):
    with home_stage.begins() as first:
        first.type("play" + ENTER + "ada plays knock every 1" + ENTER)
        first.sees("ok 2|1 ada")
        first.type("knock = 0@0 smooth 5@1/8 smooth 0@1/2" + ENTER + "tempo 90 now" + ENTER)
        first.sees("tempo")
        first.type("ada plays lean every 2 at 40|1" + ENTER)  # accepted, and waits for its bar
        first.sees("ok 40|1 ada")
        with contextlib.closing(remote(home_stage.socket)) as looks:
            until(lambda: looks.state().bar >= 3, "bar 3")
            text, bar = looks.submit(_TEXT).text, looks.state().bar
        os.kill(home_stage.engine(), signal.SIGKILL)
        first.sees("the session no longer answers")
        first.type("ada plays knock" + ENTER)
        first.sees("not taken")
        resume = ("--resume", "session.jsonl", "--audio", "null")
        with home_stage.prompt(*resume) as two:
            two.sees(" >")
            home_stage.engine()
            first.sees("the session answers again")
            with contextlib.closing(remote(home_stage.socket)) as looks:
                assert looks.submit(_TEXT).text == text
                assert looks.state().tempo == 90
                assert looks.state().bar >= bar
            first.type("play" + ENTER)
            first.sees("ok from")
            two.type("quit" + ENTER)
            assert two.ends() == 0


@pytest.mark.slow
def test_engine_start_failure_messages(home_stage: Stage):
    bad = home_stage.folder / "bad.yaml"
    bad.write_text(SCORE.replace("M: 400g", "M: 400h"))
    for words, code, why in (
        (("bad.yaml",), 1, "400h"),
        (("score.yaml", "--audio", "nonsense"), 3, "nonsense"),
        ((), 2, "no session is served"),
        (("--resume", "bad.yaml"), 2, "not a session's journal"),
    ):
        done = subprocess.run(
            home_stage.command(*words),
            cwd=home_stage.folder,
            capture_output=True,
            text=True,
            timeout=PATIENCE,
        )
        assert done.returncode == code, done.stderr
        assert why in done.stderr
        assert not home_stage.socket.exists()
    assert {path.name for path in home_stage.folder.iterdir()} == {"score.yaml", "bad.yaml"}


def test_engine_after_sighup_and_sigterm(home_stage: Stage):
    with home_stage.begins() as first:
        engine = home_stage.engine()
        os.kill(engine, signal.SIGHUP)
        first.type("play" + ENTER)
        first.sees("ok from")
        os.kill(engine, signal.SIGTERM)
        first.sees("the session has ended")
        until(lambda: not home_stage.socket.exists(), "its end")
        assert home_stage.events("end")


def test_socket_option_without_path_joins_session(home_stage: Stage):
    (home_stage.folder / "ergon").mkdir(mode=0o700)
    home_stage.socket = home_stage.folder / "ergon" / "session.sock"

    def script(lines: str, *words: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [*PATIENT, "repl", *words],
            cwd=home_stage.folder,
            env={**os.environ, "XDG_RUNTIME_DIR": str(home_stage.folder)},
            input=lines,
            capture_output=True,
            text=True,
            timeout=PATIENCE,
        )

    wrong = script("", "--socket", "score.yaml")
    assert wrong.returncode == 2
    assert "ergon repl score.yaml --socket" in wrong.stderr
    begun = script("play\n", "score.yaml", "--audio", "null", "--gain", "0dB", "--socket")
    assert "ok from 1|1" in begun.stdout
    assert "`ergon repl --socket` connects to it again" in begun.stdout
    home_stage.engine()
    joined = script("show\nquit\n", "--socket")
    assert "joined the session" in joined.stderr
    assert "bye" in joined.stdout
    until(lambda: not home_stage.socket.exists(), "the end of the engine")


def test_repl_with_other_score_at_used_socket(home_stage: Stage):
    with home_stage.begins():
        (home_stage.folder / "other.yaml").write_text(SCORE)
        done = subprocess.run(
            home_stage.command("other.yaml"), cwd=home_stage.folder, capture_output=True, text=True
        )
        assert done.returncode == 2
        assert "already" in done.stderr
        script = subprocess.run(
            home_stage.command("--strict"), input="adda\n", capture_output=True, text=True
        )
        assert script.returncode == 1  # a script joins, and what it is told
        assert "the music goes on" in script.stdout
