"""The server of pages, as options ask for it."""

from __future__ import annotations

import contextlib
import hmac
import ipaddress
import os
import secrets
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ergon.common.private import NotPrivateError, is_own_alone, runtime_folder
from ergon.common.regular import read_bounded
from ergon.common.report import Report
from ergon.live.pages import Pages

from .errors import OptionError
from .film import window
from .options import PerformanceOptions

if TYPE_CHECKING:
    from ergon import _core

ANY_LOCAL_PORT = "127.0.0.1:0"  # any free port of this machine
_SECRET_BYTES = 32


def pages_of(
    options: PerformanceOptions, report: Report, pointers: Sequence[_core.Lead] = ()
) -> Pages | None:
    """A server of pages that show a performance and play the keys of `pointers`, its address
    reported; None if none is asked for.

    Raises OptionError if nothing can be served at that address.
    """
    if not options.view and options.view_at is None and not pointers:
        return None
    server = serve(options.view_at or ANY_LOCAL_PORT, "view_at", report, pointers=pointers)
    report.event("view", url=server.url)
    report.say(f"seen at {server.url}")
    if pointers:
        report.say(f"keys are played there, or at {server.url}hands.html alone")
    return Pages(server, window)


def sees_all(options: PerformanceOptions) -> bool:
    """Whether parts that nobody hears are computed for pages. Raises OptionError."""
    if options.see not in (None, "all"):
        raise OptionError("see", "the only possible value is all", value=options.see)
    if options.see and not options.view and options.view_at is None:
        raise OptionError("see", "this needs a page; add the option view")
    return options.see is not None


def serve(
    address: str,
    option: str,
    report: Report,
    motion: Path | None = None,
    sound: Path | None = None,
    pointers: Sequence[_core.Lead] = (),
) -> _core.ViewServer:
    """A server of pages at HOST:PORT; its address has a key, for others can reach every port.

    `option` is the option that gave the address. Raises OptionError.
    """
    from ergon import _core

    is_local = _is_loopback(address)
    key = _local_key(address) if is_local else secrets.token_hex(16)
    try:
        server = _core.ViewServer(motion, sound=sound, address=address, key=key, leads=pointers)
    except _core.EngineError as error:
        raise OptionError(option, str(error)) from None
    if not is_local:
        report.say(
            "from another machine, replace 127.0.0.1 in the address by the address of this "
            "machine; anyone who has the address with its key can watch the piece"
            + (" and play its keys" if pointers else "")
        )
    return server


def _local_key(address: str) -> str:
    """The key of pages for this machine. On a port that was chosen it is the same each time, so
    that an open page finds a server that is begun again.
    """
    if address.endswith(":0"):
        return secrets.token_hex(16)
    try:
        user_secret = _secret_of_user()
    except (OSError, NotPrivateError):
        return secrets.token_hex(16)
    return hmac.new(user_secret, address.encode(), "sha256").hexdigest()[:32]


def _secret_of_user() -> bytes:
    """Random bytes in a file of the run-time folder, which is made. Raises OSError and
    NotPrivateError.
    """
    path = runtime_folder() / "view.key"
    with contextlib.suppress(FileExistsError):
        descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        with os.fdopen(descriptor, "wb") as file:
            file.write(secrets.token_bytes(_SECRET_BYTES))
    secret = read_bounded(path, _SECRET_BYTES)
    if len(secret) != _SECRET_BYTES or not is_own_alone(path.stat()):
        raise NotPrivateError(f"{path} was not made by ergon")
    return secret


def _is_loopback(address: str) -> bool:
    host = address.rpartition(":")[0].strip("[]")
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False
