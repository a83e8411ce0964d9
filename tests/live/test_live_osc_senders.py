"""Whose OSC is heard: the user's own programs, and whoever has the key."""

from __future__ import annotations

import os
import socket
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest
from patience import PATIENCE, until
from second_user import as_second_user, needs_root

from ergon.live.datagrams import encode_message
from ergon.live.osc import OscError, OscServer
from ergon.live.osc_senders import SenderCheck
from ergon.live.osc_values import InputValues

KEY = "a-word-of-16-letters"
LINUX = pytest.mark.skipif(not Path("/proc/net/udp").exists(), reason="no table of sockets here")


class Served:
    """A server whose requests are written down; `hands`: whether it moves live hands."""

    def __init__(self, host: str = "127.0.0.1", key: str = "", *, hands: bool = False) -> None:
        self.requests: list[tuple[str, Sequence[object]]] = []
        self.osc = OscServer((host, 0), None, key=key)
        values = InputValues(lambda name, value: True)
        self.osc.serve(self, lambda send: None, values, lambda: hands)  # type: ignore[arg-type, return-value]
        assert self.osc.address is not None
        self.port = self.osc.address[1]

    def get(self, address: str) -> Any:
        return lambda arguments: self.requests.append((address, arguments))

    def addresses(self) -> list[str]:
        return [address for address, _ in self.requests]


@pytest.fixture
def served() -> Iterator[Served]:
    server = Served()
    yield server
    server.osc.close()


class Client:
    """A program of the user's that keeps its socket open."""

    def __init__(self, server: Served, host: str = "127.0.0.1", *, shares: bool = False) -> None:
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        self.socket = socket.socket(family, socket.SOCK_DGRAM)
        if shares:
            self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            self.socket.bind((host, 0))
        self.socket.settimeout(PATIENCE)
        self.server, self.place = server, (host, server.port)

    def say(self, address: str) -> None:
        self.socket.sendto(encode_message(address, []), self.place)

    def answer(self) -> str:
        return self.socket.recv(4096).decode(errors="replace")

    def is_heard(self, address: str) -> None:
        self.say(address)
        until(lambda: address in self.server.addresses(), address)

    def close(self) -> None:
        self.socket.close()


@LINUX
@pytest.mark.parametrize("host", ["127.0.0.1", "::1"])
def test_osc_from_same_user_accepted_without_key(host: str) -> None:
    served = Served(host)
    client = Client(served, host)
    client.is_heard("/ergon/cmd")
    client.close()
    served.osc.close()


# Stops what is said, from a socket that stays open, from one that is closed at once, and from the
# port of a socket of the first user.
_SAY = """
port, shared, datagram = int(sys.argv[1]), int(sys.argv[2]), bytes.fromhex(sys.argv[3])
def sender(at):
    opened = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    opened.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    opened.bind(("127.0.0.1", at))
    opened.sendto(datagram, ("127.0.0.1", port))
    return opened
for _ in range(20):
    sender(0).close()
    sender(shared).close()
stays = sender(0)
stays.settimeout(0.2)
answer = b""
while not answer:  # there are few answers to strangers
    try:
        answer = stays.recv(4096)
    except TimeoutError:
        stays.sendto(datagram, ("127.0.0.1", port))
print(json.dumps(answer.decode(errors="replace")))
"""


@LINUX
@needs_root
def test_osc_from_second_user_ignored(served: Served) -> None:
    client, sharing = Client(served), Client(served, shares=True)
    client.is_heard("/ergon/before")
    datagram = encode_message("/ergon/stop", [])
    shared = sharing.socket.getsockname()[1]
    answer = as_second_user(_SAY, served.port, shared, datagram.hex(), imports="json, socket")
    assert "the sender is not heard" in answer
    client.is_heard("/ergon/after")
    assert served.addresses() == ["/ergon/before", "/ergon/after"]
    remarks = " ".join(served.osc.remarks())
    for reason in ("another user", "closed already", "can be shared"):
        assert reason in remarks
    client.close()
    sharing.close()


@LINUX
def test_sender_of_a_shared_port_needs_the_key() -> None:
    served = Served(key=KEY)
    client, sharing = Client(served), Client(served, shares=True)
    client.is_heard("/ergon/before")
    sharing.say("/ergon/cmd")
    assert "its port can be shared" in sharing.answer()
    for address in (f"/{KEY}x/ergon/cmd", f"/{KEY[:-1]}/ergon/cmd", "//ergon/cmd"):
        sharing.say(address)
    sharing.say(f"/{KEY}/ergon/stop")
    until(lambda: "/ergon/stop" in served.addresses(), "the key")
    closed = Client(served)
    closed.say(f"/{KEY}/ergon/panic")
    closed.close()
    until(lambda: "/ergon/panic" in served.addresses(), "a socket that is closed, with the key")
    assert served.addresses() == ["/ergon/before", "/ergon/stop", "/ergon/panic"]
    client.close()
    sharing.close()
    served.osc.close()


@pytest.mark.parametrize(
    ("key", "hands", "expected"),
    [
        ("", False, ["/ergon/cmd", "/ergon/release", "/ergon/gain", "/ergon/panic"]),
        ("", True, ["/ergon/gain", "/ergon/panic"]),
        (KEY, False, []),
        (KEY, True, []),
    ],
)
def test_osc_force_needs_key_without_socket_tables(
    key: str, hands: bool, expected: list[str]
) -> None:
    served = Served(key=key, hands=hands)
    served.osc._sender_check = SenderCheck(tables=(Path("/nowhere"),))
    client = Client(served)
    for address in ("/ergon/cmd", "/ergon/release", "/ergon/gain", "/ergon/panic"):
        client.say(address)
    last = f"/{key}/last" if key else "/last/gain"
    client.say(last)
    until(lambda: {"/last", "/last/gain"} & set(served.addresses()), "the last")
    assert served.addresses()[:-1] == expected
    client.close()
    served.osc.close()


def test_osc_key_format_is_checked() -> None:
    for key in ("short", "a" * 65, "sixteen letters!", "a/b/c/d/e/f/g/h/i"):
        with pytest.raises(OscError, match="ERGON_OSC_KEY must be 16 to 64 letters"):
            OscServer(("127.0.0.1", 0), None, key=key)


# --- the tables of the system ---------------------------------------------------------------------


class Table:
    """A table of sockets, as Linux writes it, and a check that reads it at given times."""

    def __init__(self, folder: Path) -> None:
        self.path, self.now = folder / "udp", 100.0
        self.check = SenderCheck((self.path, folder / "none"), lambda: self.now)
        self.set()

    def set(self, *rows: tuple[str, int, int, int]) -> None:
        """Rows of address, port, user and inode."""
        lines = ["  sl  local_address rem_address   st"]
        for address, port, user, inode in rows:
            digits = socket.inet_aton(address)[::-1].hex().upper()
            lines.append(
                f" 1: {digits}:{port:04X} 00000000:0000 07 0:0 00:0 0 {user} 0 {inode} 2 0 0"
            )
        self.path.write_text("\n".join(lines) + "\n")

    def says(self, port: int = 4242) -> str:
        """Why a sender is not heard; empty if it is."""
        sender = ("127.0.0.1", port)
        self.check.look_up_senders([sender])
        verdict = self.check.access(sender)
        self.check.count_empty_queue()
        assert verdict.is_identified
        return "" if verdict.is_user else verdict.reason


@pytest.fixture
def table(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Table:
    from ergon.live import osc_senders

    monkeypatch.setattr(osc_senders, "_is_shareable", lambda address, port: False)
    return Table(tmp_path)


@pytest.mark.skipif(not hasattr(os, "geteuid"), reason="no users here")
def test_sender_check_requires_all_sockets_of_user(table: Table) -> None:
    me = os.geteuid()
    assert "closed" in table.says()
    table.now += 2
    table.set(("127.0.0.1", 4242, me, 7), ("127.0.0.2", 4242, 1002, 8), ("0.0.0.0", 4243, 1002, 9))
    assert table.says() == ""
    table.set(("0.0.0.0", 4242, 0, 7))
    assert table.says() == ""  # root may do anything
    table.set(("127.0.0.1", 4242, me, 7), ("0.0.0.0", 4242, 1002, 8))
    assert "another user" in table.says()
    table.set(("0.0.0.0", 4242, 1002, 8))
    assert "another user" in table.says()


@pytest.mark.skipif(not hasattr(os, "geteuid"), reason="no users here")
def test_sender_check_delays_new_socket(table: Table) -> None:
    """A stranger may have sent from the port before, and what it sent may still wait."""
    me = os.geteuid()
    table.set(("127.0.0.1", 4000, me, 1))
    assert table.says(4000) == ""
    assert "closed" in table.says(4242)
    table.set(("127.0.0.1", 4000, me, 1), ("127.0.0.1", 4242, me, 2))
    assert table.says(4000) == ""  # which was known before
    assert ["new" in table.says(4242) for _ in range(3)] == [True, True, False]
    table.set(("127.0.0.1", 4242, me, 3))  # another socket at the same port
    assert "new" in table.says(4242)
    table.now += 2
    table.set(("127.0.0.1", 4242, me, 4))
    assert table.says(4242) == ""
