"""Where a session is found, and who is let in."""

from __future__ import annotations

import json
import os
import socket
import stat
import subprocess
import tempfile
from pathlib import Path

import pytest
from sockets import remote, serving

from ergon.repl.wire import local_socket


def test_default_socket_path_permissions(short_folder: Path):
    result = local_socket.default_path({"XDG_RUNTIME_DIR": str(short_folder)})
    assert result == short_folder / "ergon" / "session.sock"
    assert stat.S_IMODE(result.parent.stat().st_mode) == 0o700
    door = local_socket.ServerSocket(result)
    try:
        assert stat.S_IMODE(result.stat().st_mode) == 0o600
        with pytest.raises(local_socket.SocketError, match=f"at {result}"):
            local_socket.ServerSocket(result)
    finally:
        door.close()
    assert list(result.parent.iterdir()) == []
    result.parent.chmod(0o755)
    with pytest.raises(local_socket.SocketError, match="you alone may open"):
        local_socket.default_path({"XDG_RUNTIME_DIR": str(short_folder)})
    result.parent.rmdir()
    (short_folder / "elsewhere").mkdir(mode=0o700)
    result.parent.symlink_to(short_folder / "elsewhere")
    with pytest.raises(local_socket.SocketError, match="you alone may open"):
        local_socket.default_path({"XDG_RUNTIME_DIR": str(short_folder)})


def test_default_socket_path_without_runtime_folder(
    short_folder: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(tempfile, "tempdir", str(short_folder))
    for environment in ({}, {"XDG_RUNTIME_DIR": "not/absolute"}, {"XDG_RUNTIME_DIR": "/nowhere"}):
        result = local_socket.default_path(environment)
        assert result == short_folder / f"ergon-{os.geteuid()}" / "session.sock"
        assert stat.S_IMODE(result.parent.stat().st_mode) == 0o700


def test_server_socket_over_stale_socket_or_file(short_folder: Path):
    left = socket.socket(socket.AF_UNIX)
    left.bind(str(short_folder / "s"))
    left.close()
    with serving(short_folder / "s"):
        pass
    (short_folder / "s").write_text("mine")
    with pytest.raises(local_socket.SocketError, match="not a socket"):
        local_socket.ServerSocket(short_folder / "s")
    assert (short_folder / "s").read_text() == "mine"
    with pytest.raises(local_socket.SocketError, match="too long"):
        local_socket.ServerSocket(short_folder / ("x" * 200))


def test_connection_of_another_user_is_refused(short_folder: Path, monkeypatch: pytest.MonkeyPatch):
    with serving(short_folder / "s"):
        monkeypatch.setattr(local_socket, "is_same_user", lambda connection: False)
        with socket.socket(socket.AF_UNIX) as stranger:
            stranger.connect(str(short_folder / "s"))
            with stranger.makefile("rb") as text:
                output = json.loads(text.readline())
        assert output == {"error": "this session belongs to another user"}
        with pytest.raises(local_socket.SocketError, match="another user"):
            remote(short_folder / "s")
        monkeypatch.undo()
        first, two = socket.socketpair()
        with first, two:
            assert local_socket.is_same_user(first)
            other = os.geteuid() + 1
            monkeypatch.setattr(os, "geteuid", lambda: other)
            assert not local_socket.is_same_user(first)
            monkeypatch.undo()


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can be another user")
def test_connection_of_process_of_other_user_is_refused(short_folder: Path):
    with serving(short_folder / "s"):
        short_folder.chmod(0o777)
        (short_folder / "s").chmod(0o777)
        code = f"""
import socket
s = socket.socket(socket.AF_UNIX)
s.connect({str(short_folder / "s")!r})
print(s.makefile().readline())
"""
        done = subprocess.run(
            ["/usr/bin/python3", "-c", code],
            user=65534,
            capture_output=True,
            text=True,
            check=True,
        )
    assert json.loads(done.stdout) == {"error": "this session belongs to another user"}
