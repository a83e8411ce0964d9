"""The local socket of a session, which its owner alone can open."""

from __future__ import annotations

import contextlib
import errno
import hmac
import os
import socket
import stat
import struct
from collections.abc import Mapping
from pathlib import Path

from ergon.common.errors import ErgonError
from ergon.common.private import NotPrivateError, runtime_folder

from . import loopback

_SOCKET_NAME = "session.sock"
_BACKLOG_CONNECTIONS = 16


class SocketError(ErgonError):
    """A socket cannot be made, or cannot be trusted: one sentence."""


class NoSessionError(SocketError):
    """No session is served at a socket."""


def default_path(environment: Mapping[str, str] = os.environ) -> Path:
    """session.sock in the user's run-time folder (`runtime_folder`). Raises SocketError."""
    try:
        return runtime_folder(environment) / _SOCKET_NAME
    except NotPrivateError as error:
        raise SocketError(f"{error}; --socket PATH names another place") from None
    except OSError as error:
        raise SocketError(f"{error.filename}: {error.strerror}") from None


class ServerSocket:
    """A bound socket with its lock: no other session can be served there until it is closed.

    `address` is None, or that of a port where the system has no sockets of Unix.
    """

    def __init__(self, path: Path) -> None:
        """Bind the socket; one that a killed process has left is replaced. Raises SocketError."""
        self.path = path
        self._lock = _locked_file(path.with_name(path.name + ".lock"))
        try:
            self._remove()
            self.socket, self.address = _bound_socket(path)
        except (OSError, SocketError) as error:
            os.close(self._lock)
            if isinstance(error, SocketError):
                raise
            raise SocketError(f"{path}: {error.strerror or error}") from None

    def is_client_key(self, key_line: bytes) -> bool:
        """Whether a line is what a client of a port sends first."""
        return self.address is not None and hmac.compare_digest(
            key_line.strip(), self.address.key.encode()
        )

    def listen(self) -> None:
        """Accept connections."""
        self.socket.listen(_BACKLOG_CONNECTIONS)

    def close(self) -> None:
        """Close and remove the socket and its lock."""
        self.socket.close()
        self._remove()
        with contextlib.suppress(PermissionError):  # Windows removes no open file
            self.path.with_name(self.path.name + ".lock").unlink(missing_ok=True)
        os.close(self._lock)

    def _remove(self) -> None:
        try:
            file_mode = self.path.lstat().st_mode
        except FileNotFoundError:
            return
        is_address_file = stat.S_ISREG(file_mode) and loopback.read_address(self.path) is not None
        if not stat.S_ISSOCK(file_mode) and not is_address_file:
            raise SocketError(f"{self.path} already exists and is not a socket")
        self.path.unlink()


def _bound_socket(path: Path) -> tuple[socket.socket, loopback.Address | None]:
    """A socket of Unix at a path, or one at a port whose address is in the file. Raises OSError."""
    if loopback.is_used():
        return loopback.bind_loopback(path)
    unix_socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        unix_socket.bind(os.fspath(path))
        os.chmod(path, 0o600)  # nobody can connect before `listen`
    except OSError:
        unix_socket.close()
        raise
    return unix_socket, None


def _locked_file(path: Path) -> int:
    """A file that is locked for this process; the kernel removes the lock however the process
    ends.
    """
    flags = os.O_RDWR | os.O_CREAT
    flags |= getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_NOFOLLOW", 0)
    while True:
        try:
            descriptor = os.open(path, flags, 0o600)
        except OSError as error:
            raise SocketError(f"{path}: {error.strerror}") from None
        try:
            _lock_file(descriptor)
            if os.path.samestat(os.fstat(descriptor), os.stat(path)):
                return descriptor
        except FileNotFoundError:
            pass
        except OSError:
            os.close(descriptor)
            raise SocketError(
                f"another session is already served at {path.with_suffix('')}"
            ) from None
        os.close(descriptor)  # the lock file was removed meanwhile


def _lock_file(descriptor: int) -> None:
    """Lock a file for this process, without waiting. Raises OSError where another has the lock."""
    try:
        import fcntl
    except ImportError:
        import msvcrt

        msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined, unused-ignore]
    else:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)


def connect(path: Path) -> tuple[socket.socket, str]:
    """Connect to the session at a socket; of one at a port, the second is the `answer` that its
    greeting must hold, else "". Raises NoSessionError, SocketError.
    """
    try:
        address = loopback.read_address(path) if path.is_file() else None
        if address is not None:
            return loopback.connect(address), address.answer
        if not hasattr(socket, "AF_UNIX"):
            raise NoSessionError(f"no session is served at {path}")
        connection = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            connection.connect(os.fspath(path))
        except OSError:
            connection.close()
            raise
    except OSError as error:
        if error.errno in (errno.ENOENT, errno.ECONNREFUSED):
            raise NoSessionError(f"no session is served at {path}") from None
        raise SocketError(f"{path}: {error.strerror or error}") from None
    if not is_same_user(connection):
        connection.close()
        raise SocketError(f"the session at {path} belongs to another user")
    return connection, ""


def is_same_user(connection: socket.socket) -> bool:
    """Whether the process at the other end belongs to the same user; True if the system cannot
    tell.
    """
    peer_option = getattr(socket, "SO_PEERCRED", None)
    if peer_option is None:  # this system cannot tell: the file mode protects
        return True
    credentials_format = struct.Struct("3i")
    _, user_id, _ = credentials_format.unpack(
        connection.getsockopt(socket.SOL_SOCKET, peer_option, credentials_format.size)
    )
    return bool(user_id == os.geteuid())
