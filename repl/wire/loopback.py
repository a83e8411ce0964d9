"""A session's socket where the system has none of Unix: a port of 127.0.0.1 and two secrets.

Any user of the machine can reach a port. So the address, with both secrets, lies in a file that its
owner alone may read. Who joins sends the first secret, and gets the second in the greeting: a
stranger who has taken the port of a session that was killed knows neither.
"""

from __future__ import annotations

import json
import os
import secrets
import socket
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

from ergon.common.private import is_own_alone
from ergon.common.regular import open_regular
from ergon.common.structured import MalformedTextError, parse_json

HOST = "127.0.0.1"
SOCKET_VARIABLE = "ERGON_SESSION_SOCKET"  # an environment variable; `loopback` asks for a port
_BYTES_MAX = 1000  # largest file
_SECRET_BYTES = 32


@dataclass(frozen=True, slots=True)
class Address:
    """The port, what a client sends first, and what the session's greeting then holds."""

    port: int
    key: str
    answer: str


def is_used(environment: Mapping[str, str] = os.environ) -> bool:
    """Whether sessions are served at a port: the system has no sockets of Unix, or the
    environment asks for it.
    """
    return not hasattr(socket, "AF_UNIX") or environment.get(SOCKET_VARIABLE) == "loopback"


def bind_loopback(path: Path) -> tuple[socket.socket, Address]:
    """A socket at a free port, and its address, which is written to a file that does not exist.

    Raises OSError.
    """
    bound_socket = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    try:
        if hasattr(socket, "SO_EXCLUSIVEADDRUSE"):  # Windows: no other program may share the port
            bound_socket.setsockopt(socket.SOL_SOCKET, socket.SO_EXCLUSIVEADDRUSE, 1)
        bound_socket.bind((HOST, 0))
        port = bound_socket.getsockname()[1]
        address = Address(port, secrets.token_hex(_SECRET_BYTES), secrets.token_hex(_SECRET_BYTES))
        descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        with os.fdopen(descriptor, "w", encoding="ascii") as file:
            json.dump(asdict(address), file)
    except OSError:
        bound_socket.close()
        raise
    return bound_socket, address


def read_address(path: Path) -> Address | None:
    """The address in a file of the user's own; None if it holds none. Raises OSError."""
    with open_regular(path) as file:
        file_bytes = file.read(_BYTES_MAX)
        is_ours = is_own_alone(os.fstat(file.fileno()))
    try:
        fields = parse_json(file_bytes.decode("ascii"))
        port, access_key, hello_answer = (fields[name] for name in ("port", "key", "answer"))
    except (MalformedTextError, ValueError, KeyError, TypeError):
        return None
    is_port = isinstance(port, int) and 0 < port < 1 << 16
    if not (is_ours and is_port and isinstance(access_key, str) and isinstance(hello_answer, str)):
        return None
    return Address(port, access_key, hello_answer)


def connect(address: Address) -> socket.socket:
    """Connect to a session and send its key. Raises OSError."""
    connection = socket.create_connection((HOST, address.port))
    try:
        connection.sendall(f"{address.key}\n".encode())
    except OSError:
        connection.close()
        raise
    return connection
