"""A session in a process of its own: prompts come, share it, vanish; it is killed and goes on."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import socket
import stat
import struct
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from one_bell import SCORE
from terminals import CTRL_D, ENTER, PATIENCE, Terminal

from ergon.repl.face import Reply, State
from ergon.repl.wire import place
from ergon.repl.wire.protocol import MAX_LINE, MAX_TEXT, REQUESTS, VERSION, encode, state_out
from ergon.repl.wire.remote import Remote
from ergon.repl.wire.serve import MAX_PROMPTS, Served

ERGON = [sys.executable, "-m", "ergon.cli"]
_LOOK = 0.02
# What the session's score says, in so few characters that a reply can hold it.
_TEXT = "py __import__('hashlib').sha256(session.commits.head.texts.text.encode()).hexdigest()"


def until(true: Callable[[], object], what: str) -> None:
    end = time.monotonic() + PATIENCE
    while not true():
        assert time.monotonic() < end, f"{what} never came"
        time.sleep(_LOOK)


def remote(path: Path) -> Remote:
    return Remote(path, "ergon repl --socket")


@pytest.fixture
def folder() -> Iterator[Path]:
    """A folder whose name is short enough for a socket."""
    with tempfile.TemporaryDirectory(prefix="ergon-") as name:
        yield Path(name)


# --- without a process: what one prompt cannot do to the others ----------------------------------


class Acted:
    """A face whose lines tell what they do: `slow` until a panic, `quit`, `fail`."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self.happened: list[str] = []
        self.panicked = threading.Event()
        self.slow = threading.Event()
        self.closed = False

    def submit(self, text: str) -> Reply:
        self.lines.append(text)
        if text == "slow":
            self.slow.set()
            assert self.panicked.wait(PATIENCE)
        if text == "fail":
            raise SystemExit
        if text == "adda":
            return Reply(False, "unknown verb", "ada", ("⣀⡠", "b"))
        return Reply(True, f"ok {text[:20]}", leaves=text == "quit")

    def state(self) -> State:
        return State(bar=len(self.lines) + 1, beat=1.5, tempo=72.0, playing=(("ada", "lean"),))

    def messages(self) -> list[str]:
        happened, self.happened = self.happened, []
        return happened

    def panic(self) -> None:
        self.panicked.set()

    def close(self) -> None:
        self.closed = True

    def complete(self, line: str, cursor: int) -> list[object]:
        return [State] if line == "fail" else []

    def tokens(self, line: str) -> list[tuple[int, int, str]]:
        return [(0, len(line), "name")]

    def is_whole(self, text: str) -> bool:
        return not text.endswith("\\")


@contextlib.contextmanager
def serving(path: Path, face: Acted | None = None) -> Iterator[Acted]:
    face = face or Acted()
    served = Served(face, place.Door(path), {"version": "0", "score": "s", "journal": "j"})
    thread = threading.Thread(target=served.run)
    thread.start()
    try:
        until(lambda: _answers(path), "the session")
        yield face
    finally:
        served.end("the test ends")
        thread.join(PATIENCE)
        assert not thread.is_alive()
        assert face.closed
        assert not path.exists()


def _answers(path: Path) -> bool:
    try:
        with raw(path) as found:  # so it was let in, before anything else happens
            return found.greeting is not None
    except place.NobodyError:
        return False


class Raw:
    """A connection on which anything can be said."""

    def __init__(self, path: Path) -> None:
        self.socket = place.connect(path)
        self.socket.settimeout(PATIENCE)
        self._file = self.socket.makefile("rb")
        self.greeting = self.read()

    def read(self) -> dict[str, object] | None:
        """The next line; None at the end."""
        try:
            line = self._file.readline()
        except ConnectionError:
            return None
        return json.loads(line) if line else None

    def say(self, data: bytes) -> None:
        self.socket.sendall(data)

    def ask(self, **fields: object) -> dict[str, object] | None:
        self.say(encode(**fields))
        return self.read()

    def close(self) -> None:
        self._file.close()
        self.socket.close()


@contextlib.contextmanager
def raw(path: Path) -> Iterator[Raw]:
    found = Raw(path)
    try:
        yield found
    finally:
        found.close()


def test_the_protocol_as_it_is_written_down(folder: Path):
    with serving(folder / "s") as face, raw(folder / "s") as one:
        assert one.greeting is not None
        assert one.greeting["ergon"] == VERSION == 1
        reply = {"taken": False, "text": "unknown verb", "try": "ada", "leaves": False}
        told = one.ask(id=1, do="submit", text="adda")
        assert told == {"id": 1, "is": {**reply, "lines": ["⣀⡠", "b"]}}
        state = one.ask(id="a", do="state")
        assert state is not None
        assert state["is"] == {
            **{"bar": 2, "beat": 1.5, "tempo": 72.0, "playing": [["ada", "lean"]], "load": 0.0},
            **{"late": 0, "level": None, "quant": "bar", "recording": None, "panicked": False},
        }
        assert one.ask(id=2, do="tokens", line="ada") == {"id": 2, "is": [[0, 3, "name"]]}
        assert one.ask(id=3, do="complete", line="a", cursor=-9) == {"id": 3, "is": []}
        assert one.ask(id=4, do="is_whole", text="a\\") == {"id": 4, "is": False}
        face.happened.append("remi is gone")
        told = {"is": []}
        while not told["is"]:
            told = one.ask(id=5, do="messages")
        assert told == {"id": 5, "is": ["remi is gone"]}
        assert one.ask(id=6, do="panic") == {"id": 6, "is": True}
        assert face.panicked.is_set()
        assert one.ask(id=7, do="leave") == {"id": 7, "is": True}
        assert one.read() is None
        with raw(folder / "s") as other:
            assert other.ask(id=8, do="end") == {"id": 8, "is": True}
            assert "ended" in (other.read() or {})
            assert other.read() is None


def test_hostile_bytes_harm_nobody(folder: Path):
    bad = [
        b"\n",
        b"\x00\xff\xfe\x80\n",
        b"GET / HTTP/1.1\r\n",
        b"[" * 100_000 + b"\n",
        b'{"id": ' + b"9" * 10_000 + b', "do": "state"}\n',
        b'{"id": 1}\n',
        b'{"id": 1, "do": ["submit"]}\n',
        b'{"id": {"a": []}, "do": "submit"}\n',
        b'{"id": 1, "do": "submit", "text": 5}\n',
        b'{"id": 1, "do": "complete", "line": "a", "cursor": true}\n',
        b'{"id": 1, "do": "complete", "line": "fail", "cursor": 1}\n',
        encode(id=1, do="submit", text="x" * (MAX_TEXT + 1)),
        encode(id=1, do="__init__"),
        b'"text"\n',
    ]
    with serving(folder / "s") as face, raw(folder / "s") as one, raw(folder / "s") as other:
        for line in bad:
            one.say(line)
            told = one.read()
            assert told is not None
            assert "error" in told, line[:60]
        assert one.ask(id=2, do="submit", text="\ud800\x1b[2J") is not None
        one.say(b"x" * (MAX_LINE + 10))  # and what follows cannot be found any more
        told = one.read()
        assert told is not None
        assert "bytes" in str(told["error"])
        assert one.read() is None
        assert face.lines == ["\ud800\x1b[2J"]
        assert other.ask(id=1, do="is_whole", text="") == {"id": 1, "is": True}
        other.say(b'{"id": 1, "do": "sub')  # cut off in its middle
        other.close()
        with contextlib.closing(remote(folder / "s")) as third:
            assert third.submit("ada plays") == Reply(True, "ok ada plays")


def test_who_does_not_read_holds_up_nobody(folder: Path):
    with serving(folder / "s") as face, raw(folder / "s") as stalled:
        stalled.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        stalled.socket.settimeout(0.2)
        asked = encode(id=1, do="tokens", line="x") * 1000
        dropped = False
        end = time.monotonic() + PATIENCE
        while not dropped and time.monotonic() < end:
            try:
                stalled.socket.send(asked)
            except TimeoutError:
                pass
            except OSError:
                dropped = True
        assert dropped
        with contextlib.closing(remote(folder / "s")) as other:
            assert other.submit("ada").taken
        assert face.lines == ["ada"]


def test_while_a_line_takes_long_panic_acts_and_others_see(folder: Path):
    with (
        serving(folder / "s") as face,
        contextlib.closing(remote(folder / "s")) as one,
        contextlib.closing(remote(folder / "s")) as other,
    ):
        replies: list[Reply] = []
        thread = threading.Thread(target=lambda: replies.append(one.submit("slow")))
        thread.start()
        assert face.slow.wait(PATIENCE)
        until(lambda: other.state().bar == 2, "a state")
        assert list(other.tokens("ada")) == [(0, 3, "name")]
        assert not replies
        other.panic()
        thread.join(PATIENCE)
        assert replies == [Reply(True, "ok slow")]


def test_lines_are_done_in_order_and_told_to_the_others(folder: Path):
    with (
        serving(folder / "s") as face,
        contextlib.closing(remote(folder / "s")) as one,
        contextlib.closing(remote(folder / "s")) as other,
    ):
        for number in range(20):
            assert (one, other)[number % 2].submit(f"line {number}").taken
        assert face.lines == [f"line {number}" for number in range(20)]
        assert not one.submit("adda").taken
        heard: list[str] = []

        def all_heard() -> bool:
            heard.extend(other.messages())
            return any("adda" in message for message in heard)

        until(all_heard, "what the other one typed")
        numbers = [message for message in heard if "line" in message]
        assert [message.rpartition(" ")[2] for message in numbers] == [
            str(number) for number in range(0, 20, 2)
        ]
        assert heard[-1].endswith("adda   not taken: unknown verb")
        assert one.submit("fail").text == "internal error: SystemExit: "
        assert one.submit("after it").taken


def test_quit_at_one_prompt_ends_it_for_all(folder: Path):
    with (
        serving(folder / "s") as face,
        contextlib.closing(remote(folder / "s")) as one,
        contextlib.closing(remote(folder / "s")) as other,
    ):
        assert one.submit("quit").leaves
        until(lambda: any("ended" in message for message in other.messages()), "the end")
        assert other.submit("ada plays") == Reply(False, "the session has ended", leaves=True)
        assert face.lines == ["quit"]
        one.close()
        assert not any("goes on" in message for message in one.messages())


def vanishing(path: Path, vanish: threading.Event) -> None:
    """A session whose process is killed: nothing is said at the end."""
    door = place.Door(path)
    door.listen()
    connection, _ = door.socket.accept()
    with connection, connection.makefile("rwb") as file:
        file.write(encode(ergon=VERSION, journal="j"))
        file.flush()
        while not vanish.is_set():
            asked = json.loads(file.readline())
            state = state_out(State(bar=7, beat=1.0, tempo=60.0))
            file.write(encode(id=asked["id"], **{"is": state if asked["do"] == "state" else []}))
            file.flush()
    door.close()


def test_a_prompt_waits_for_a_session_that_went_away(folder: Path):
    path, vanish = folder / "s", threading.Event()
    thread = threading.Thread(target=vanishing, args=(path, vanish))
    thread.start()
    found: list[Remote] = []

    def connected() -> bool:
        with contextlib.suppress(place.NobodyError):
            found.append(remote(path))
        return bool(found)

    until(connected, "a session")
    with contextlib.closing(found[0]) as prompt:
        heard: list[str] = []

        def hears(words: str) -> None:
            def heard_it() -> bool:
                heard.extend(prompt.messages())
                return any(words in message for message in heard)

            until(heard_it, words)

        vanish.set()
        hears("went away")
        thread.join(PATIENCE)
        assert prompt.submit("ada") == Reply(
            False, f"no session answers at {path}; it is looked for"
        )
        assert prompt.state().bar == 7
        assert list(prompt.tokens("ada")) == list(prompt.complete("ada", 1)) == []
        assert prompt.is_whole("ada")
        prompt.panic()
        hears("silent")
        with serving(path) as face:
            hears("is back")
            assert prompt.submit("ada").taken
            assert face.lines == ["ada"]
            prompt.close()
            hears("goes on")


def test_there_are_so_many_prompts_and_no_more(folder: Path):
    with serving(folder / "s"), contextlib.ExitStack() as stack:
        many = [stack.enter_context(raw(folder / "s")) for _ in range(MAX_PROMPTS)]
        with raw(folder / "s") as late:
            assert "error" in (late.greeting or {})
        many[0].close()

        def fits() -> bool:
            with raw(folder / "s") as again:
                return "ergon" in (again.greeting or {})

        until(fits, "a free place")


def test_every_request_is_answered_by_the_server(folder: Path):
    values = {str: "ada", int: 1}
    with serving(folder / "s"):
        for do, fields in REQUESTS.items():
            if do == "end":
                continue
            with raw(folder / "s") as one:
                given = {name: values[kind] for name, kind in fields.items()}
                told = one.ask(id=1, do=do, **given)
                assert told is not None
                assert "is" in told, do


# --- who is let in --------------------------------------------------------------------------------


def test_the_place_is_its_owners_alone(folder: Path):
    found = place.default({"XDG_RUNTIME_DIR": str(folder)})
    assert found == folder / "ergon" / "session.sock"
    assert stat.S_IMODE(found.parent.stat().st_mode) == 0o700
    door = place.Door(found)
    try:
        assert stat.S_IMODE(found.stat().st_mode) == 0o600
        with pytest.raises(place.PlaceError, match=f"{found} already"):
            place.Door(found)
    finally:
        door.close()
    assert list(found.parent.iterdir()) == []
    found.parent.chmod(0o755)
    with pytest.raises(place.PlaceError, match="not yours alone"):
        place.default({"XDG_RUNTIME_DIR": str(folder)})
    found.parent.rmdir()
    (folder / "elsewhere").mkdir(mode=0o700)
    found.parent.symlink_to(folder / "elsewhere")
    with pytest.raises(place.PlaceError, match="not yours alone"):
        place.default({"XDG_RUNTIME_DIR": str(folder)})


def test_without_a_runtime_folder_it_lies_in_one_of_the_users_own(
    folder: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    for environment in ({}, {"XDG_RUNTIME_DIR": "not/absolute"}, {"XDG_RUNTIME_DIR": "/nowhere"}):
        found = place.default(environment)
        assert found == folder / f"ergon-{os.geteuid()}" / "session.sock"
        assert stat.S_IMODE(found.parent.stat().st_mode) == 0o700


def test_what_a_killed_process_left_is_taken_over_and_a_file_is_not(folder: Path):
    left = socket.socket(socket.AF_UNIX)
    left.bind(str(folder / "s"))
    left.close()
    with serving(folder / "s"):
        pass
    (folder / "s").write_text("mine")
    with pytest.raises(place.PlaceError, match="no socket"):
        place.Door(folder / "s")
    assert (folder / "s").read_text() == "mine"
    with pytest.raises(place.PlaceError, match="too long"):
        place.Door(folder / ("x" * 200))


def test_another_user_is_not_let_in(folder: Path, monkeypatch: pytest.MonkeyPatch):
    with serving(folder / "s"):
        monkeypatch.setattr(place, "is_ours", lambda connection: False)
        with socket.socket(socket.AF_UNIX) as stranger:
            stranger.connect(str(folder / "s"))
            with stranger.makefile("rb") as said:
                told = json.loads(said.readline())
        assert told == {"error": "this session is another user's"}
        with pytest.raises(place.PlaceError, match="another user"):
            remote(folder / "s")
        monkeypatch.undo()
        one, two = socket.socketpair()
        with one, two:
            assert place.is_ours(one)
            other = os.geteuid() + 1
            monkeypatch.setattr(os, "geteuid", lambda: other)
            assert not place.is_ours(one)
            monkeypatch.undo()


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can be another user")
def test_a_process_of_another_user_is_refused_though_it_can_connect(folder: Path):
    with serving(folder / "s"):
        folder.chmod(0o777)
        (folder / "s").chmod(0o777)
        code = f"""
import socket
s = socket.socket(socket.AF_UNIX)
s.connect({str(folder / "s")!r})
print(s.makefile().readline())
"""
        done = subprocess.run(
            ["/usr/bin/python3", "-c", code],
            user=65534,
            capture_output=True,
            text=True,
            check=True,
        )
    assert json.loads(done.stdout) == {"error": "this session is another user's"}


# --- real processes in real terminals -------------------------------------------------------------


class Stage:
    """A folder with a score, and the engines that are started in it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.socket = folder / "s"
        (folder / "score.yaml").write_text(SCORE)
        self._engines: set[int] = set()

    def command(self, *words: str) -> list[str]:
        return [*ERGON, "repl", *words, "--socket", str(self.socket)]

    def prompt(self, *words: str) -> Terminal:
        state = {"XDG_STATE_HOME": str(self.folder / "state")}
        at = Terminal(self.command(*words), cwd=self.folder, **state)
        return at

    def begins(self) -> Terminal:
        at = self.prompt("score.yaml", "--audio", "null", "--gain", "0dB")
        at.sees("1|1 >")
        self.engine()
        return at

    def engine(self) -> int:
        """The process that serves."""
        with contextlib.closing(place.connect(self.socket)) as found:
            told = found.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, 12)
            pid = struct.unpack("3i", told)[0]
        self._engines.add(pid)
        return pid

    def events(self, name: str, journal: str = "session.jsonl") -> list[dict[str, object]]:
        lines = (self.folder / journal).read_text().splitlines()
        return [event for event in map(json.loads, lines) if event["event"] == name]

    def close(self) -> None:
        with contextlib.suppress(place.PlaceError):
            self.engine()
        for pid in self._engines:
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)


@pytest.fixture
def at_home(folder: Path) -> Iterator[Stage]:
    stage = Stage(folder)
    try:
        yield stage
    finally:
        stage.close()


def test_two_prompts_share_a_session(at_home: Stage):
    with at_home.begins() as one, at_home.prompt() as two:
        two.sees("joined")
        two.sees("1|1 >")
        one.type("play" + ENTER)
        one.sees("ok from 1|1")
        two.sees("prompt 1 > play   ok from 1|1")
        two.type("ada plays knock every 1" + ENTER)
        one.sees("> ada plays knock every 1   ok 2|1 ada: knock every 1")
        two.type("quit" + ENTER)
        assert two.ends() == 0
        one.sees("the session has ended")
        one.type("play" + ENTER)
        assert one.ends() == 0
    until(lambda: not at_home.socket.exists(), "the end of the engine")
    assert at_home.events("end")


def test_a_closed_window_leaves_the_music_on(at_home: Stage):
    with at_home.begins() as one:
        one.type("play" + ENTER + "ada plays knock every 1" + ENTER)
        one.sees("ok 2|1 ada")
    # The window is closed: the terminal hangs up.
    engine = at_home.engine()
    with contextlib.closing(remote(at_home.socket)) as looks:
        bar = looks.state().bar
        until(lambda: looks.state().bar >= max(bar + 1, 3), "the next bar")
        assert looks.submit("tempo 140 now").taken
    until(lambda: len(at_home.events("commit")) >= 3, "a commit")
    frames = [event["frame"] for event in at_home.events("commit")]
    assert frames == sorted(frames)
    with at_home.prompt("score.yaml") as again:
        again.sees("ada knock")  # it shows the running state
        again.sees("140 bpm")
        again.type(CTRL_D)
        assert again.ends() == 0
        assert "the music goes on" in again.text
    assert at_home.engine() == engine


def test_kill_the_engine_and_resume(at_home: Stage):
    with at_home.begins() as one:
        one.type("play" + ENTER + "ada plays knock every 1" + ENTER)
        one.sees("ok 2|1 ada")
        one.type("knock = 0@0 smooth 5@1/8 smooth 0@1/2" + ENTER + "tempo 90 now" + ENTER)
        one.sees("tempo")
        one.type("ada plays lean every 2 at 40|1" + ENTER)  # accepted, and waits for its bar
        one.sees("ok 40|1 ada")
        with contextlib.closing(remote(at_home.socket)) as looks:
            until(lambda: looks.state().bar >= 3, "bar 3")
            text, bar = looks.submit(_TEXT).text, looks.state().bar
        os.kill(at_home.engine(), signal.SIGKILL)
        one.sees("the session went away")
        one.type("ada plays knock" + ENTER)
        one.sees("not taken")
        resume = ("--resume", "session.jsonl", "--audio", "null")
        with at_home.prompt(*resume) as two:
            two.sees(" >")
            at_home.engine()
            one.sees("the session is back")
            with contextlib.closing(remote(at_home.socket)) as looks:
                assert looks.submit(_TEXT).text == text
                assert looks.state().tempo == 90
                assert looks.state().bar >= bar
            one.type("play" + ENTER)
            one.sees("ok from")
            two.type("quit" + ENTER)
            assert two.ends() == 0


def test_why_an_engine_does_not_start(at_home: Stage):
    bad = at_home.folder / "bad.yaml"
    bad.write_text(SCORE.replace("M: 400g", "M: 400h"))
    for words, code, why in (
        (("bad.yaml",), 1, "400h"),
        (("score.yaml", "--audio", "nonsense"), 3, "nonsense"),
        ((), 2, "no session is served"),
        (("--resume", "bad.yaml"), 2, "no journal"),
    ):
        done = subprocess.run(
            at_home.command(*words), cwd=at_home.folder, capture_output=True, text=True, timeout=60
        )
        assert done.returncode == code, done.stderr
        assert why in done.stderr
        assert not at_home.socket.exists()
    assert {path.name for path in at_home.folder.iterdir()} == {"score.yaml", "bad.yaml"}


def test_an_ended_engine_ends_well(at_home: Stage):
    with at_home.begins() as one:
        engine = at_home.engine()
        os.kill(engine, signal.SIGHUP)
        one.type("play" + ENTER)
        one.sees("ok from")
        os.kill(engine, signal.SIGTERM)
        one.sees("the session has ended")
        until(lambda: not at_home.socket.exists(), "its end")
        assert at_home.events("end")


def test_the_place_need_not_be_said(at_home: Stage):
    (at_home.folder / "ergon").mkdir(mode=0o700)
    at_home.socket = at_home.folder / "ergon" / "session.sock"

    def script(lines: str, *words: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [*ERGON, "repl", *words],
            cwd=at_home.folder,
            env={**os.environ, "XDG_RUNTIME_DIR": str(at_home.folder)},
            input=lines,
            capture_output=True,
            text=True,
            timeout=60,
        )

    wrong = script("", "--socket", "score.yaml")
    assert wrong.returncode == 2
    assert "ergon repl score.yaml --socket" in wrong.stderr
    begun = script("play\n", "score.yaml", "--audio", "null", "--gain", "0dB", "--socket")
    assert "ok from 1|1" in begun.stdout
    assert "`ergon repl --socket` comes back to it" in begun.stdout
    at_home.engine()
    joined = script("show\nquit\n", "--socket")
    assert "joined the session" in joined.stderr
    assert "bye" in joined.stdout
    until(lambda: not at_home.socket.exists(), "the end of the engine")


def test_another_score_does_not_get_into_it(at_home: Stage):
    with at_home.begins():
        (at_home.folder / "other.yaml").write_text(SCORE)
        done = subprocess.run(
            at_home.command("other.yaml"), cwd=at_home.folder, capture_output=True, text=True
        )
        assert done.returncode == 2
        assert "is played" in done.stderr
        script = subprocess.run(
            at_home.command("--strict"), input="adda\n", capture_output=True, text=True
        )
        assert script.returncode == 1  # a script joins, and what it is told
        assert "the music goes on" in script.stdout
