"""`ergon emulate`: a force-feedback device that is not there, for trying scores and drivers."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal, cast

import click

from . import options
from .outcome import Refused

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from .console import Console

# What is emulated → its axes, its greatest force [N], and how it is reached: scheme by transport.
_DEVICES: dict[str, tuple[int, float, dict[str, str]]] = {
    "firefader": (2, 1.56, {"pty": "firefader"}),
    "frame": (1, 20.0, {"pty": "frame", "udp": "frame+udp"}),
    "haply": (3, 10.0, {"ws": "haply"}),
}
_TICK = 44100 / 44  # periods a second: a tick of 44 samples


class Quantity(click.ParamType):  # type: ignore[type-arg] # older clicks' is not generic
    """A number with a unit, as a score has it."""

    name = "quantity"

    def __init__(self, dimension: str) -> None:
        """`dimension` is one of `scores.tables.quantities`."""
        self.dimension = dimension

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        """The SI value."""
        from ergon.notation.tables import quantities
        from ergon.notation.text.errors import TextError

        if isinstance(value, float):
            return value
        try:
            return quantities.quantity(value, getattr(quantities, self.dimension))
        except TextError as error:
            self.fail(error.message, param, ctx)


@click.command()
@click.argument("device", type=click.Choice(list(_DEVICES)))
@click.option("--pty", "terminal", is_flag=True, help="As a serial port (the usual way).")
@click.option("--udp", metavar="PORT", type=click.IntRange(0, 65535), help="As datagrams.")
@click.option("--ws", metavar="PORT", type=click.IntRange(0, 65535), help="As a WebSocket.")
@click.option("--axes", type=click.IntRange(1, 16), help="Keys of a frame.")
@click.option("--mass", type=Quantity("MASS"), default=0.05, help="Of a key; 50g.")
@click.option("--stiffness", type=Quantity("STIFFNESS"), default=0.0, help="Its spring; 0N/m.")
@click.option("--damping", type=Quantity("DAMPING"), default=1.0, help="Its friction; 1Ns/m.")
@click.option("--travel", type=Quantity("POSITION"), default=0.1, help="From end to end; 100mm.")
@click.option("--force-max", type=Quantity("FORCE"), help="Of a frame's motors; 20N.")
@click.option("--resolution", type=Quantity("POSITION"), default=0.0, help="Of its sensor.")
@click.option("--rate", type=Quantity("FREQUENCY"), default=_TICK, help="Its periods; 1002Hz.")
@click.option(
    "--gesture",
    "gestures",
    metavar="NOTATION",
    multiple=True,
    help="What a hand does on the next key: '0mm@0 6mm@1/8 0mm@1/2'.",
)
@click.option("--tempo", type=click.FloatRange(1, 1000), default=60.0, help="Its beats; 60.")
@click.option("--hand", type=Quantity("STIFFNESS"), default=400.0, help="The hand's pull; 400N/m.")
@click.option("--grip", type=Quantity("DAMPING"), default=4.0, help="Its damping; 4Ns/m.")
@click.option("--free", is_flag=True, help="No finger on keys without a gesture.")
@click.option("--gate/--no-gate", default=None, help="No force without a finger.")
@click.option("--watchdog", type=Quantity("DURATION"), default=0.05, help="Lets go after; 50ms.")
@click.option("--lockstep", is_flag=True, help="A packet is a period; else by the wall clock.")
@click.option("--seconds", type=click.FloatRange(0, min_open=True), help="End after so long.")
@click.option("--once", is_flag=True, help="End when the host has gone.")
@options.speaking
def emulate(
    console: Console,
    device: str,
    terminal: bool,
    udp: int | None,
    ws: int | None,
    gestures: tuple[str, ...],
    tempo: float,
    hand: float,
    grip: float,
    free: bool,
    gate: bool | None,
    axes: int | None,
    force_max: float | None,
    rate: float,
    lockstep: bool,
    **board: Any,
) -> None:
    """Be a force-feedback device that is not there.

    Prints what to open, then serves until Ctrl-C. A hand can play on it: its gesture begins with
    the first period, and its stiffness and damping pull the key along.
    """
    from ergon import _core

    usual_axes, usual_force, ways = _DEVICES[device]
    if axes is not None and axes != usual_axes and device != "frame":
        raise Refused(f"a {device} has {usual_axes} axes")
    if force_max is not None and device != "frame":
        raise Refused(f"--force-max is for a frame; the motors of a {device} are given")
    axes = axes or usual_axes
    if len(gestures) > axes:
        raise Refused(f"{len(gestures)} gestures are given for {axes} keys")
    transport, port = _way(device, ways, terminal, udp, ws)
    suffix = "?lockstep" if lockstep else ""

    def tell(event: str, what: str) -> None:
        if event == "ready":
            url = f"{ways[transport]}:{what}{suffix}"
            if console.json:
                console.record("ready", url=url)
            else:
                print(url, flush=True)
        elif event == "over":
            periods, packets, positions = what.split()
            _over(console, int(periods), int(packets), positions)
        elif console.json:
            console.record(event)
        else:
            console.say({"let-go": "no host: force -> 0", "host-gone": "the host has gone"}[event])

    _core.emulate(
        cast("Literal['firefader', 'frame', 'haply']", device),
        cast("Literal['pty', 'udp', 'ws']", transport),
        tell,
        port=port,
        paths=_paths(gestures, tempo, rate, 0 if free else axes),
        hand=(hand, grip),
        axes=axes,
        force_max=force_max or usual_force,
        rate=rate,
        lockstep=lockstep,
        touch_gate=device == "firefader" if gate is None else gate,
        **board,
    )


def _way(
    device: str, ways: dict[str, str], terminal: bool, udp: int | None, ws: int | None
) -> tuple[str, int]:
    """The transport asked for, or the device's own, and its port."""
    asked = [("pty", 0)] if terminal else []
    asked += [(name, port) for name, port in (("udp", udp), ("ws", ws)) if port is not None]
    if len(asked) > 1:
        raise Refused("--pty, --udp and --ws exclude each other; give one")
    name, port = asked[0] if asked else (next(iter(ways)), 10001 if "ws" in ways else 0)
    if name not in ways:
        raise Refused(f"a {device} is emulated by --{' or --'.join(ways)}")
    return name, port


def _paths(
    gestures: tuple[str, ...], tempo: float, rate: float, fingers: int
) -> list[NDArray[np.float64]]:
    """Each hand's positions (n,) [m]; then fingers that rest, which are empty."""
    import numpy as np

    from ergon.notation.text.errors import TextError
    from ergon.scores.gesture import notation
    from ergon.scores.gesture.sampled import sampled

    paths = []
    for text in gestures:
        try:
            paths.append(sampled(notation.parse(text).points, 60 / tempo, rate))
        except TextError as error:
            raise Refused(f"--gesture: {error.message}: {text}") from None
    return paths + [np.empty(0)] * (fingers - len(paths))


def _over(console: Console, periods: int, packets: int, positions: str) -> None:
    if console.json:
        console.record("over", periods=periods, packets=packets, positions=positions)
    else:
        console.say(f"{periods:,} periods, {packets:,} packets, positions {positions}")
