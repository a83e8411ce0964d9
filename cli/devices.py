"""`ergon devices`: the sound cards and keys of this machine."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from . import options
from .console import Console
from .lazy import LazyGroup, Table
from .outcome import Refused

if TYPE_CHECKING:
    from ergon.live.ports import Port

COMMANDS: Table = {
    "calibrate": (
        "devices_calibrate",
        "calibrate",
        "Find the direction and the ends of an axis, and keep them.",
    ),
}
_SERVICE = "haply:ws://127.0.0.1:10001"


@click.group(cls=LazyGroup, table=COMMANDS, invoke_without_command=True)
@click.option("--probe", is_flag=True, help="Open what looks like a board, and ask.")
@options.speaking
def devices(console: Console, probe: bool) -> None:
    """List loudspeakers and keys, and the URL of each.

    Nothing is opened, unless --probe asks for it: many boards start anew when their port is opened.
    """
    if click.get_current_context().invoked_subcommand is not None:
        return
    _sound(console)
    _named(console)
    _ports(console, probe)


def _sound(console: Console) -> None:
    from ergon import _core

    for system in _core.survey_audio():
        if console.json:
            console.record("sound", audio=system.name, there=system.available, said=system.sentence)
        else:
            there = "" if system.available else "not there: "
            console.data(f"sound   {system.name:12} {there}{system.sentence}\n")


def _named(console: Console) -> None:
    from ergon.live.boards import BoardError, config_path, device_urls, resolve
    from ergon.live.calibration import known_axes

    try:
        table = device_urls()
        for name, text in table.items():
            url, _ = resolve(text, {})
            tested = sorted(known_axes(url))
            if console.json:
                console.record("device", name=name, url=text, tested=tested)
            else:
                axes = ", ".join(map(str, tested))
                ready = f"axis {axes} tested" if tested else "not tested yet"
                console.data(f"device  {name:12} {text} ({ready})\n")
        if not table and not console.json:
            console.data(f"device  none has a name yet; write names into {config_path()}\n")
    except BoardError as error:
        raise Refused(str(error)) from None


def _ports(console: Console, probe: bool) -> None:
    from ergon.live.ports import ports

    for port in ports():
        answers = _probed(port) if probe else {}
        if console.json:
            console.record(
                "port", path=port.path, name=port.name, urls=list(port.urls), answers=answers
            )
            continue
        console.data(f"port    {port.path:12} {port.name or 'unknown'}\n")
        for url in port.urls:
            answer = f": {answers[url]}" if url in answers else ""
            console.data(f"{'':20} {url}{answer}\n")
    if not console.json:
        console.data(f"service {'haply':12} {_SERVICE}, where Haply's Inverse Service runs\n")


def _probed(port: Port) -> dict[str, str]:
    from ergon import _core

    errors = {}
    for url in port.urls:
        try:
            device = _core.Device(url)
        except _core.EngineError as error:
            errors[url] = error.sentence
            continue
        plural = "axis" if device.axes == 1 else "axes"
        errors[url] = f"{device.axes} {plural}, {device.force_max:g} N at most"
        device.close()
    return errors
