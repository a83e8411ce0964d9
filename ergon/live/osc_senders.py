"""Whose program sent a datagram: the user's own, by the system's tables of sockets, or anybody's.

A datagram does not say whose it is, but Linux lists each socket with its port and its owner. That
tells the sender of a datagram from this machine as long as its socket is open, and as long as no
other program can have its port. So no sender can be identified if

* the socket is closed already;
* the socket lets others share its port (SO_REUSEADDR): another user may have sent from it, and have
  closed it at once;
* the socket is new, and within the last second somebody sent who could not be told: that one may
  have had the same port before. The socket is heard when all that waited before it is read.
"""

from __future__ import annotations

import ipaddress
import os
import socket
import struct
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

_SOCKET_TABLES = (Path("/proc/net/udp"), Path("/proc/net/udp6"))
_CAUTION_SECONDS = 1.0  # [s] after a datagram of a stranger, in which a new socket has to wait
_KNOWN_SENDERS_MAX = 1000  # sockets that are remembered
_ROOT = 0

Address = ipaddress.IPv4Address | ipaddress.IPv6Address


@dataclass(frozen=True, slots=True)
class SenderAccess:
    """Whether a sender is the user (or root), and whether the system can tell it; if it can and the
    sender is not, `reason` says what was found.
    """

    is_user: bool
    is_identified: bool
    reason: str = ""


USER_ACCESS = SenderAccess(is_user=True, is_identified=True)
UNIDENTIFIED = SenderAccess(is_user=False, is_identified=False)


def _refusal(reason: str) -> SenderAccess:
    return SenderAccess(is_user=False, is_identified=True, reason=reason)


class _Socket(NamedTuple):
    """A row of the system's tables."""

    address: Address
    port: int
    user_id: int
    inode: int


@dataclass(frozen=True, slots=True)
class _KnownSender:
    """A sender that was seen: its sockets, whether others can share their port, and the number of
    times that the queue has to be empty before they are heard.
    """

    inodes: frozenset[int]
    is_shared: bool
    trusted_count: int


class SenderCheck:
    """Tells the senders of datagrams, batch by batch."""

    def __init__(
        self, tables: Sequence[Path] = _SOCKET_TABLES, clock: Callable[[], float] = time.monotonic
    ) -> None:
        """Read the sockets of the system from these tables."""
        self._tables, self._clock = tables, clock
        self._sockets: list[_Socket] | None = None
        self._known_senders: dict[tuple[Address, int], _KnownSender] = {}
        self._empty_count = 0  # how often all datagrams were read
        self._stranger_instant = -_CAUTION_SECONDS

    def look_up_senders(self, senders: Iterable[tuple[object, ...]]) -> None:
        """Look the sockets of a batch of senders up, after its datagrams were read."""
        ports = {port for address, port in map(_address_and_port, senders) if address.is_loopback}
        self._sockets = _find_sockets(self._tables, ports) if ports else []

    def count_empty_queue(self) -> None:
        """After the verdicts on a batch: at its end no datagram waited any more."""
        self._empty_count += 1

    def access(self, sender: tuple[object, ...]) -> SenderAccess:
        """Who a sender of the batch is."""
        address, port = _address_and_port(sender)
        if not address.is_loopback or self._sockets is None:
            return UNIDENTIFIED
        sender_access = self._find_access(address, port)
        if not sender_access.is_user:
            self._stranger_instant = self._clock()
        return sender_access

    def _find_access(self, address: Address, port: int) -> SenderAccess:
        assert self._sockets is not None
        senders = [
            row
            for row in self._sockets
            if row.port == port and (row.address == address or row.address.is_unspecified)
        ]
        if not senders:
            return _refusal("its socket is closed already, so its user cannot be identified")
        if any(row.user_id not in (_ROOT, os.geteuid()) for row in senders):
            return _refusal("it belongs to another user")
        inodes = frozenset(row.inode for row in senders)
        known_sender = self._known_senders.get((address, port))
        if known_sender is None or known_sender.inodes != inodes:
            # A socket that is noted now is older than what comes after the queue was empty twice:
            # the first time may have been before it was noted.
            is_calm = self._clock() - self._stranger_instant >= _CAUTION_SECONDS
            trusted_count = 0 if is_calm else self._empty_count + 2
            known_sender = _KnownSender(inodes, _is_shareable(address, port), trusted_count)
            if len(self._known_senders) >= _KNOWN_SENDERS_MAX:
                self._known_senders.clear()
            self._known_senders[address, port] = known_sender
        if known_sender.is_shared:
            return _refusal("its port can be shared, so its user cannot be identified")
        if self._empty_count < known_sender.trusted_count:
            return _refusal("it is new while strangers send; what it sends from now on is heard")
        return USER_ACCESS


def _address_and_port(sender: tuple[object, ...]) -> tuple[Address, int]:
    """Address and port of a sender; an IPv4 address as such, in whatever way it came."""
    address = ipaddress.ip_address(str(sender[0]).partition("%")[0])
    return _unmapped(address), int(str(sender[1]))


def _unmapped(address: Address) -> Address:
    ipv4_address = address.ipv4_mapped if isinstance(address, ipaddress.IPv6Address) else None
    return address if ipv4_address is None else ipv4_address


def _find_sockets(tables: Sequence[Path], ports: set[int]) -> list[_Socket] | None:
    """The sockets that have one of the ports; None where the system has no such tables."""
    port_suffixes = tuple(f":{port:04X}" for port in ports)
    sockets, has_tables = [], False
    for table in tables:
        try:
            table_rows = table.read_text(encoding="ascii").splitlines()[1:]
        except OSError:
            continue
        has_tables = True
        for row in table_rows:
            columns = row.split()
            if columns[1].endswith(port_suffixes):
                address_digits, _, port = columns[1].partition(":")
                address = _parse_address(address_digits)
                sockets.append(_Socket(address, int(port, 16), int(columns[7]), int(columns[9])))
    return sockets if has_tables else None


def _parse_address(digits: str) -> Address:
    """An address of the tables, which are words of 32 bits in the machine's order of bytes."""
    words = [int(digits[offset : offset + 8], 16) for offset in range(0, len(digits), 8)]
    return _unmapped(ipaddress.ip_address(struct.pack(f"={len(words)}I", *words)))


def _is_shareable(address: Address, port: int) -> bool:
    """Whether a second socket can have an address, which the first one has to allow."""
    family = socket.AF_INET if address.version == 4 else socket.AF_INET6
    with socket.socket(family, socket.SOCK_DGRAM) as second_socket:
        second_socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            second_socket.bind((str(address), port))
        except OSError:
            return False
    return True
