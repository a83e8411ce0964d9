"""A session at a port of this machine, as where the system has no sockets of Unix."""

from __future__ import annotations

import contextlib
import json
import socket
import stat
import threading
from collections.abc import Callable
from pathlib import Path

import pytest
from commands import forked
from one_bell import SCORE
from sockets import raw, remote, serving

from ergon.repl.wire import local_socket, loopback
from ergon.repl.wire.protocol import ProtocolError


@pytest.fixture(autouse=True)
def _forced(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(loopback.SOCKET_VARIABLE, "loopback")


def test_session_served_at_a_port(short_folder: Path):
    path = short_folder / "s"
    with serving(path):
        assert stat.S_IMODE(path.stat().st_mode) == 0o600
        address = loopback.read_address(path)
        assert address is not None
        with contextlib.closing(remote(path)) as prompt:
            assert prompt.submit("hush").text == "ok hush"
        with raw(path) as client:
            assert client.greeting is not None
            assert client.greeting["answer"] == address.answer
            assert client.ask(id=1, do="submit", text="adda")
        with pytest.raises(local_socket.SocketError, match="another session is already served"):
            local_socket.ServerSocket(path)
    assert list(short_folder.iterdir()) == []


@pytest.mark.parametrize("first", [b"\n", b"0" * 64 + b"\n", b'{"id": 1, "do": "end"}\n', b""])
def test_client_without_the_key_is_refused(first: bytes, short_folder: Path):
    with serving(short_folder / "s") as session:
        address = loopback.read_address(short_folder / "s")
        assert address is not None
        with socket.create_connection((loopback.HOST, address.port)) as stranger:
            stranger.sendall(first)
            if not first:
                stranger.shutdown(socket.SHUT_WR)
            with stranger.makefile("rb") as file:
                lines = file.readlines()
        assert [json.loads(line) for line in lines] == [
            {"error": "this session belongs to another user"}
        ]
        assert session.lines == []


def test_connect_to_port_of_another_program(short_folder: Path):
    """What it answers does not hold the second secret."""
    path = short_folder / "s"
    bound, address = loopback.bind_loopback(path)
    with bound:
        bound.listen()

        def greet() -> None:
            with bound.accept()[0] as connection:
                connection.recv(100)
                greeting = {"ergon": 1, "prompt": 1, "answer": "0" * len(address.answer)}
                connection.sendall(json.dumps(greeting).encode() + b"\n")

        thread = threading.Thread(target=greet)
        thread.start()
        with pytest.raises(ProtocolError, match="another program has taken the port"):
            remote(path)
        thread.join()


def _readable_by_others(path: Path) -> None:
    path.chmod(0o666)


def _cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-9])


def _port_of_no_number(path: Path) -> None:
    path.write_text(json.dumps({"port": "1", "key": "", "answer": ""}))


@pytest.mark.parametrize("spoil", [_readable_by_others, _cut, _port_of_no_number])
def test_read_address_of_invalid_file(spoil: Callable[[Path], None], short_folder: Path):
    bound, address = loopback.bind_loopback(short_folder / "s")
    bound.close()
    assert loopback.read_address(short_folder / "s") == address
    spoil(short_folder / "s")
    assert loopback.read_address(short_folder / "s") is None
    with pytest.raises(local_socket.SocketError, match="is not a socket"):
        local_socket.ServerSocket(short_folder / "s")


def test_address_of_a_killed_session_is_replaced(short_folder: Path):
    bound, _ = loopback.bind_loopback(short_folder / "s")
    bound.close()
    with pytest.raises(local_socket.NoSessionError):
        local_socket.connect(short_folder / "s")
    with serving(short_folder / "s"):
        pass


def test_processes_join_session_at_a_port(short_folder: Path):
    (short_folder / "score.yaml").write_text(SCORE)
    begin = ["repl", "score.yaml", "--socket", "s", "--audio", "null", "--gain", "0dB"]
    done = forked(begin, short_folder, lines="tempo 72\n")
    assert done.returncode == 0, done.stderr
    assert loopback.read_address(short_folder / "s") is not None
    done = forked(["repl", "--socket", "s"], short_folder, lines="quit\n")
    assert done.returncode == 0, done.stderr
    assert "joined the session" in done.stderr
