"""`ergon view`: what moved, in a browser."""

from __future__ import annotations

import ipaddress
import secrets
import threading
from pathlib import Path

import click

from . import options
from .console import Console
from .outcome import Refused

_BEGINS = b"ERGM"  # docs/motion.md
_WAIT = 3600.0  # [s] between looks at nothing: signals come at once


@click.command()
@click.argument("path", metavar="FILE.motion", type=click.Path(path_type=Path))
@click.option(
    "--at",
    metavar="HOST:PORT",
    default="127.0.0.1:0",
    show_default=True,
    help="Serve here; port 0 is any free one. Where others can reach it, the address has a key.",
)
@click.option(
    "--stage",
    is_flag=True,
    help="For projectors: full screen after a click, no pointer, no words, black where the line "
    "is lost.",
)
@click.option(
    "--strobe", is_flag=True, help="Let flashes cover more of the picture than WCAG 2.3.1 allows."
)
@options.speaking
def view(console: Console, path: Path, at: str, stage: bool, strobe: bool) -> None:
    """Show in a browser what moved in a piece.

    The command prints an address and serves the page there until Ctrl-C. The page plays what
    `ergon render --motion` wrote; press H in it for its keys.
    """
    from ergon import _core

    _refuse_others(path)
    key = None if _is_loopback(at) else secrets.token_hex(16)
    try:
        server = _core.ViewServer(path, at=at, key=key)
    except _core.EngineError as error:
        raise Refused(f"--at: {error}") from None
    try:
        asked = [name for name, wanted in (("stage", stage), ("strobe", strobe)) if wanted]
        url = server.url + ("?" + "&".join(asked) if asked else "")
        if console.json:
            console.record("ready", url=url)
        else:
            print(url, flush=True)
        if key is not None:
            console.say(
                "other machines open this address with this machine's own instead of 127.0.0.1; "
                "who knows the key sees the piece"
            )
        _until_interrupted()
    finally:
        server.close()


def _refuse_others(path: Path) -> None:
    """A sentence for what is no motion."""
    from ergon.common.regular import open_regular

    with open_regular(path) as file:  # a pipe's other end would be waited for
        begins = file.read(len(_BEGINS))
    if begins == _BEGINS:
        return
    if path.suffix in (".yaml", ".yml"):
        motion = path.with_suffix(".motion")
        raise Refused(
            f"{path} is a score; write its motion first: "
            f"`ergon render {path} --motion`, then `ergon view {motion}`"
        )
    raise Refused(f"{path} is no .motion file: such a file begins with {_BEGINS.decode()}")


def _is_loopback(at: str) -> bool:
    host = at.rpartition(":")[0].strip("[]")
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def _until_interrupted() -> None:
    over = threading.Event()
    while not over.wait(_WAIT):
        pass
