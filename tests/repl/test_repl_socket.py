"""A session in a process of its own: what one prompt cannot do to the others."""

from __future__ import annotations

import contextlib
import json
import socket
import threading
import time
from pathlib import Path

import pytest
from patience import PATIENCE, until
from sockets import raw, remote, serving

from ergon.repl.session_protocol import Reply, State
from ergon.repl.wire import local_socket
from ergon.repl.wire.protocol import (
    MAX_LINE,
    MAX_TEXT,
    PROTOCOL_VERSION,
    REQUEST_FIELDS,
    encode,
    encode_state,
)
from ergon.repl.wire.remote import RemoteSession
from ergon.repl.wire.serve import MAX_PROMPTS


def test_socket_protocol_requests_and_replies(short_folder: Path):
    with serving(short_folder / "s") as face, raw(short_folder / "s") as first:
        assert first.greeting is not None
        assert first.greeting["ergon"] == PROTOCOL_VERSION == 1
        reply = {"taken": False, "text": "unknown verb", "try": "ada", "leaves": False}
        output = first.ask(id=1, do="submit", text="adda")
        assert output == {"id": 1, "is": {**reply, "lines": ["⣀⡠", "b"]}}
        state = first.ask(id="a", do="state")
        assert state is not None
        assert state["is"] == {
            **{"bar": 2, "beat": 1.5, "tempo": 72.0, "playing": [["ada", "lean"]], "load": 0.0},
            **{"late": 0, "level": None, "quant": "bar", "recording": None, "panicked": False},
        }
        assert first.ask(id=2, do="tokens", line="ada") == {"id": 2, "is": [[0, 3, "name"]]}
        assert first.ask(id=3, do="complete", line="a", cursor=-9) == {"id": 3, "is": []}
        assert first.ask(id=4, do="is_whole", text="a\\") == {"id": 4, "is": False}
        face.happened.append("remi is gone")
        output = {"is": []}
        while not output["is"]:
            output = first.ask(id=5, do="messages")
        assert output == {"id": 5, "is": ["remi is gone"]}
        assert first.ask(id=6, do="panic") == {"id": 6, "is": True}
        assert face.panicked.is_set()
        assert first.ask(id=7, do="leave") == {"id": 7, "is": True}
        assert first.read() is None
        with raw(short_folder / "s") as other:
            assert other.ask(id=8, do="end") == {"id": 8, "is": True}
            assert "ended" in (other.read() or {})
            assert other.read() is None


def test_hostile_bytes_leave_other_clients_served(short_folder: Path):
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
        b'{"id": 1e999, "do": "state"}\n',
        b'{"id": NaN, "do": "state"}\n',
        b'{"id": -Infinity}\n',
        b'{"id": 1.5, "do": "state"}\n',
        b'{"id": ' + b"9" * 4000 + b', "do": "state"}\n',
        b'{"id": ' + b"[" * 900 + b"]" * 900 + b', "do": "state"}\n',
        b'{"id": "' + b"x" * 1_000_000 + b'", "do": "state"}\n',
    ]
    with (
        serving(short_folder / "s") as face,
        raw(short_folder / "s") as first,
        raw(short_folder / "s") as other,
    ):
        for line in bad:
            first.say(line)
            output = first.read()
            assert output is not None
            assert "error" in output, line[:60]
        assert first.ask(id=2, do="submit", text="\ud800\x1b[2J") is not None
        first.say(b"x" * (MAX_LINE + 10))  # and what follows cannot be found any more
        output = first.read()
        assert output is not None
        assert "bytes" in str(output["error"])
        assert first.read() is None
        assert face.lines == ["\ud800\x1b[2J"]
        assert other.ask(id=1, do="is_whole", text="") == {"id": 1, "is": True}
        other.say(b'{"id": 1, "do": "sub')  # cut off in its middle
        other.close()
        with contextlib.closing(remote(short_folder / "s")) as third:
            assert third.submit("ada plays") == Reply(True, "ok ada plays")


@pytest.mark.slow
def test_slow_client_is_dropped(short_folder: Path):
    with serving(short_folder / "s") as face, raw(short_folder / "s") as stalled:
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
        with contextlib.closing(remote(short_folder / "s")) as other:
            assert other.submit("ada").taken
        assert face.lines == ["ada"]


def test_panic_and_state_during_long_line(short_folder: Path):
    with (
        serving(short_folder / "s") as face,
        contextlib.closing(remote(short_folder / "s")) as first,
        contextlib.closing(remote(short_folder / "s")) as other,
    ):
        replies: list[Reply] = []
        thread = threading.Thread(target=lambda: replies.append(first.submit("slow")))
        thread.start()
        assert face.slow.wait(PATIENCE)
        until(lambda: other.state().bar == 2, "a state")
        assert list(other.tokens("ada")) == [(0, 3, "name")]
        assert not replies
        other.panic()
        thread.join(PATIENCE)
        assert replies == [Reply(True, "ok slow")]


def test_lines_run_in_order_and_reach_other_clients(short_folder: Path):
    with (
        serving(short_folder / "s") as face,
        contextlib.closing(remote(short_folder / "s")) as first,
        contextlib.closing(remote(short_folder / "s")) as other,
    ):
        for number in range(20):
            assert (first, other)[number % 2].submit(f"line {number}").taken
        assert face.lines == [f"line {number}" for number in range(20)]
        assert not first.submit("adda").taken
        listened: list[str] = []

        def all_heard() -> bool:
            listened.extend(other.messages())
            return any("adda" in message for message in listened)

        until(all_heard, "what the other one typed")
        numbers = [message for message in listened if "line" in message]
        assert [message.rpartition(" ")[2] for message in numbers] == [
            str(number) for number in range(0, 20, 2)
        ]
        assert listened[-1].endswith("adda   not taken: unknown verb")
        assert first.submit("fail").text == "internal error: SystemExit: "
        assert first.submit("after it").taken


def test_quit_at_one_prompt_ends_session_for_all(short_folder: Path):
    with (
        serving(short_folder / "s") as face,
        contextlib.closing(remote(short_folder / "s")) as first,
        contextlib.closing(remote(short_folder / "s")) as other,
    ):
        assert first.submit("quit").leaves
        until(lambda: any("ended" in message for message in other.messages()), "the end")
        assert other.submit("ada plays") == Reply(False, "the session has ended", leaves=True)
        assert face.lines == ["quit"]
        first.close()
        assert not any("goes on" in message for message in first.messages())


def vanishing(path: Path, vanish: threading.Event) -> None:
    """A session whose process is killed: nothing is said at the end."""
    door = local_socket.ServerSocket(path)
    door.listen()
    connection, _ = door.socket.accept()
    with connection, connection.makefile("rwb") as file:
        file.write(encode(ergon=PROTOCOL_VERSION, journal="j"))
        file.flush()
        while not vanish.is_set():
            asked = json.loads(file.readline())
            state = encode_state(State(bar=7, beat=1.0, tempo=60.0))
            file.write(encode(id=asked["id"], **{"is": state if asked["do"] == "state" else []}))
            file.flush()
    door.close()


def test_prompt_reconnects_after_server_vanishes(short_folder: Path):
    path, vanish = short_folder / "s", threading.Event()
    thread = threading.Thread(target=vanishing, args=(path, vanish))
    thread.start()
    result: list[RemoteSession] = []

    def connected() -> bool:
        with contextlib.suppress(local_socket.NoSessionError):
            result.append(remote(path))
        return bool(result)

    until(connected, "a session")
    with contextlib.closing(result[0]) as prompt:
        listened: list[str] = []

        def hears(words: str) -> None:
            def is_received() -> bool:
                listened.extend(prompt.messages())
                return any(words in message for message in listened)

            until(is_received, words)

        vanish.set()
        hears("no longer answers")
        thread.join(PATIENCE)
        assert prompt.submit("ada") == Reply(
            False, f"no session answers at {path}; ergon tries to connect again"
        )
        assert prompt.state().bar == 7
        assert list(prompt.tokens("ada")) == list(prompt.complete("ada", 1)) == []
        assert prompt.is_whole("ada")
        prompt.panic()
        hears("silent")
        with serving(path) as face:
            hears("answers again")
            assert prompt.submit("ada").taken
            assert face.lines == ["ada"]
            prompt.close()
            hears("goes on")


def test_number_of_connected_prompts_is_limited(short_folder: Path):
    with serving(short_folder / "s"), contextlib.ExitStack() as stack:
        many = [stack.enter_context(raw(short_folder / "s")) for _ in range(MAX_PROMPTS)]
        with raw(short_folder / "s") as late:
            assert "error" in (late.greeting or {})
        many[0].close()

        def fits() -> bool:
            with raw(short_folder / "s") as again:
                return "ergon" in (again.greeting or {})

        until(fits, "a free place")


def test_server_answers_every_request(short_folder: Path):
    values = {str: "ada", int: 1}
    with serving(short_folder / "s"):
        for do, fields in REQUEST_FIELDS.items():
            if do == "end":
                continue
            with raw(short_folder / "s") as first:
                arguments = {name: values[kind] for name, kind in fields.items()}
                output = first.ask(id=1, do=do, **arguments)
                assert output is not None
                assert "is" in output, do
