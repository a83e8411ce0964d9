"""`ergon emulate`: an emulated force-feedback device, for trying scores and drivers."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from ergon.api import emulate as api

from . import options

if TYPE_CHECKING:
    from .console import Console


@click.command()
@click.argument("device", type=click.Choice(list(api.DEVICES)))
@options.from_dataclass(api.EmulationOptions)
@options.with_console
def emulate(console: Console, device: api.DeviceName, **arguments: Any) -> None:
    """Emulate a force-feedback device, for trying scores and drivers.

    The command prints the URL of the device, then serves it until Ctrl-C. Each --gesture is played
    by an emulated hand from the first period on; --hand and --grip are the spring and the damper
    that pull the key along.

    A key is a mass on a spring and a damper. --weight, --dry, --presliding, --static, --mode and
    --delay add what real keys have; --mass then is that of the key without its modes. With them the
    same seed and the same packets give the same positions.
    """

    def report_event(event_name: str, event_text: str) -> None:
        if event_name == "ready":
            if console.json:
                console.record("ready", url=event_text)
            else:
                print(event_text, flush=True)
        elif event_name == "over":
            periods, packets, position_hash = event_text.split()
            _report_end(console, int(periods), int(packets), position_hash)
        elif console.json:
            console.record(event_name)
        else:
            console.say(
                {
                    "let-go": "no packet in time: the force is zero",
                    "host-gone": "the host has disconnected",
                }[event_name]
            )

    api.emulate(device, api.EmulationOptions(**arguments), report_event)


def _report_end(console: Console, periods: int, packets: int, position_hash: str) -> None:
    if console.json:
        console.record("over", periods=periods, packets=packets, positions=position_hash)
    else:
        console.say(f"{periods:,} periods, {packets:,} packets, positions {position_hash}")
