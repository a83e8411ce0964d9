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
_HAPLY_URL = "haply:ws://127.0.0.1:10001"


@click.group(cls=LazyGroup, table=COMMANDS, invoke_without_command=True)
@click.option("--probe", is_flag=True, help="Open what looks like a board, and ask.")
@options.with_console
def devices(console: Console, probe: bool) -> None:
    """List loudspeakers and keys, the URL of each, and what it could be.

    Nothing is opened, unless --probe asks for it: many boards start anew when their port is opened.
    """
    if click.get_current_context().invoked_subcommand is not None:
        return
    _print_sound_systems(console)
    _print_named_devices(console)
    _print_ports(console, probe)
    _print_hands(console)


def _print_sound_systems(console: Console) -> None:
    from ergon import _core

    for system in _core.survey_audio():
        if console.json:
            console.record("sound", audio=system.name, there=system.available, said=system.sentence)
        else:
            availability = "" if system.available else "not there: "
            console.data(f"sound   {system.name:12} {availability}{system.sentence}\n")


def _print_named_devices(console: Console) -> None:
    from ergon.live.boards import BoardError, config_path, device_urls, url_and_axis
    from ergon.live.calibration import stored_calibrations
    from ergon.live.hand_sources import uses_of

    try:
        urls_by_name = device_urls()
        for device_name, device_url in urls_by_name.items():
            url, _ = url_and_axis(device_url, {})
            tested = sorted(stored_calibrations(url))
            if console.json:
                uses = list(uses_of(url))
                console.record("device", name=device_name, url=device_url, tested=tested, uses=uses)
            else:
                axes = ", ".join(map(str, tested))
                test_state = f"axis {axes} tested" if tested else "not tested yet"
                console.data(
                    f"device  {device_name:12} {device_url}  {_uses_text(uses_of(url))} "
                    f"({test_state})\n"
                )
        if not urls_by_name and not console.json:
            console.data(f"device  none has a name yet; write names into {config_path()}\n")
    except BoardError as error:
        raise Refused(str(error)) from None


def _print_ports(console: Console, probe: bool) -> None:
    from ergon.live.hand_sources import uses_of
    from ergon.live.ports import ports

    for port in ports():
        port_answers = _probed_answers(port) if probe else {}
        if console.json:
            uses = sorted({use for url in port.urls for use in uses_of(url)})
            urls = list(port.urls)
            console.record(
                "port", path=port.path, name=port.name, urls=urls, answers=port_answers, uses=uses
            )
            continue
        console.data(f"port    {port.path:12} {port.name or 'unknown'}\n")
        for url in port.urls:
            answer = f", {port_answers[url]}" if url in port_answers else ""
            console.data(f"{'':20} {url}  {_uses_text(uses_of(url))}{answer}\n")
    if not console.json:
        service_line = (
            f"{_HAPLY_URL}  {_uses_text(uses_of(_HAPLY_URL))}, where Haply's Inverse Service runs"
        )
        console.data(f"service {'haply':12} {service_line}\n")


def _print_hands(console: Console) -> None:
    """List the sources that move keys without a force, and explain the terms."""
    from ergon.live.hand_sources import USES, hand_sources

    for hand_source in hand_sources():
        if console.json:
            uses, kind = list(hand_source.uses), hand_source.kind
            console.record("hand", kind=kind, url=hand_source.url, name=hand_source.name, uses=uses)
        else:
            line = f"{hand_source.url}  {_uses_text(hand_source.uses)}: {hand_source.name}"
            console.data(f"hand    {hand_source.kind:12} {line}\n")
    if not console.json:
        for use, meaning in USES.items():
            console.data(f"        {use:12} {meaning}\n")


def _uses_text(uses: tuple[str, ...]) -> str:
    return " or ".join(uses)


def _probed_answers(port: Port) -> dict[str, str]:
    from ergon import _core

    answers = {}
    for url in port.urls:
        try:
            device = _core.Device(url)
        except _core.EngineError as error:
            answers[url] = error.sentence
            continue
        axis_noun = "axis" if device.axes == 1 else "axes"
        answers[url] = f"{device.axes} {axis_noun}, {device.force_max:g} N at most"
        device.close()
    return answers
