"""`ergon emulate`: an emulated force-feedback device, for trying scores and drivers."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, cast

import click

from . import options
from .outcome import Refused

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from ergon import _core

    from .console import Console

# By device: number of axes, greatest force [N], and URL scheme for each transport.
_DEVICES: dict[str, tuple[int, float, dict[str, str]]] = {
    "firefader": (2, 1.56, {"pty": "firefader"}),
    "frame": (1, 20.0, {"pty": "frame", "udp": "frame+udp"}),
    "haply": (3, 10.0, {"ws": "haply"}),
}
_TICK = 44100 / 44  # periods a second: a tick of 44 samples


class Quantity(click.ParamType):  # type: ignore[type-arg] # older clicks' is not generic
    """A number with a unit, as in a score."""

    name = "quantity"

    def __init__(self, dimension: str) -> None:
        """`dimension` is one of the dimensions in `notation.tables.quantities`."""
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


class Quantities(click.ParamType):  # type: ignore[type-arg] # older clicks' is not generic
    """Several numbers with units in one word, separated by spaces."""

    name = "quantities"

    def __init__(self, example: str, *dimensions: str) -> None:
        """`dimensions` are from `notation.tables.quantities`; `example` shows all the numbers."""
        self.example = example
        self.parts = [Quantity(dimension) for dimension in dimensions]

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[float, ...]:
        """The SI values."""
        if isinstance(value, tuple):
            return value
        words = str(value).split()
        if len(words) != len(self.parts):
            self.fail(
                f"'{value}' is not {len(self.parts)} numbers, such as '{self.example}'", param, ctx
            )
        return tuple(
            part.convert(word, param, ctx) for part, word in zip(self.parts, words, strict=True)
        )


def _quantity(
    name: str, dimension: str, default: float | None, shown: str, text: str
) -> Callable[[options.F], options.F]:
    return click.option(
        name, type=Quantity(dimension), default=default, show_default=shown, help=text
    )


@click.command()
@click.argument("device", type=click.Choice(list(_DEVICES)))
@click.option(
    "--pty", "terminal", is_flag=True, help="Serve at a pseudo-terminal, as at a serial port."
)
@click.option(
    "--udp",
    metavar="PORT",
    type=click.IntRange(0, 65535),
    help="Serve by datagrams at this UDP port; 0 is any free port.",
)
@click.option(
    "--ws",
    metavar="PORT",
    type=click.IntRange(0, 65535),
    help="Serve by a WebSocket at this TCP port; 0 is any free port.",
)
@click.option("--axes", type=click.IntRange(1, 16), help="Number of keys; for a frame alone.")
@_quantity("--mass", "MASS", 0.05, "50g", "Mass of each key.")
@_quantity("--stiffness", "STIFFNESS", 0.0, "0N/m", "Spring of each key.")
@_quantity("--damping", "DAMPING", 1.0, "1Ns/m", "Damping of each key.")
@click.option(
    "--calib",
    metavar="FILE",
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    help="Make each key that of a score with this calibration file: its mass, spring, damping, "
    "rest, dry friction and modes, stepped once a period as a score steps them.",
)
@_quantity("--weight", "PUSH", 0.0, "0N", "Constant force on each key, downwards.")
@_quantity("--dry", "FORCE", None, "none", "Dry friction of each key.")
@_quantity(
    "--presliding", "STIFFNESS", None, "rigid", "Stiffness of dry friction before the key slides."
)
@click.option(
    "--static",
    type=Quantities("80mN 4mm/s", "FORCE", "SPEED"),
    metavar="'FORCE SPEED'",
    help="Dry friction near rest, and the speed at which it has fallen, such as '80mN 4mm/s'.",
)
@click.option(
    "--mode",
    "modes",
    type=Quantities("20g 180Hz 0.02", "MASS", "FREQUENCY", "RATIO"),
    metavar="'MASS FREQUENCY RATIO'",
    multiple=True,
    help="A part that swings on each key: its mass, frequency and damping ratio, such as "
    "'20g 180Hz 0.02'; repeatable.",
)
@_quantity("--delay", "DURATION", None, "none", "Delay of each motor's force.")
@_quantity("--travel", "POSITION", 0.1, "100mm", "Travel of each key, from end to end.")
@_quantity("--force-max", "FORCE", None, "20N", "Largest force of each motor; for a frame alone.")
@_quantity("--resolution", "POSITION", 0.0, "exact", "Resolution of each position sensor.")
@_quantity("--noise", "POSITION", 0.0, "none", "Noise of each position sensor, as its rms.")
@click.option(
    "--seed", type=click.IntRange(0), default=0, show_default=True, help="Seed of the noise."
)
@_quantity("--force-step", "FORCE", None, "exact", "Resolution of each motor's force.")
@_quantity("--rate", "FREQUENCY", _TICK, "1002Hz", "Periods a second of the device.")
@click.option(
    "--gesture",
    "gestures",
    metavar="NOTATION",
    multiple=True,
    help="Gesture of a hand on the next key, such as '0mm@0 6mm@1/8 0mm@1/2'; repeatable.",
)
@click.option(
    "--tempo",
    type=options.Number(1, 1000),
    default=60.0,
    show_default=True,
    help="Beats a minute of the gestures.",
)
@_quantity("--hand", "STIFFNESS", 400.0, "400N/m", "Spring by which a hand pulls its key.")
@_quantity("--grip", "DAMPING", 4.0, "4Ns/m", "Damping of a hand on its key.")
@click.option("--free", is_flag=True, help="Leave the keys that have no gesture without a hand.")
@click.option(
    "--gate/--no-gate",
    default=None,
    help="Whether a motor gives force only while a hand touches the key; as the device does.",
)
@_quantity(
    "--watchdog", "DURATION", 0.05, "50ms", "Time without a packet after which the force is zero."
)
@click.option(
    "--lockstep",
    is_flag=True,
    help="Advance one period for each packet, instead of by the wall clock.",
)
@click.option(
    "--seconds",
    type=options.Number(0, dimension="DURATION", min_open=True),
    help="End after this many seconds.",
)
@click.option("--once", is_flag=True, help="End when the host has disconnected.")
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
    mass: float,
    stiffness: float,
    damping: float,
    weight: float,
    dry: float | None,
    presliding: float | None,
    static: tuple[float, float] | None,
    modes: tuple[tuple[float, float, float], ...],
    delay: float | None,
    noise: float,
    force_step: float | None,
    calib: Path | None,
    **board: Any,
) -> None:
    """Emulate a force-feedback device, for trying scores and drivers.

    The command prints the URL of the device, then serves it until Ctrl-C. Each --gesture is played
    by an emulated hand from the first period on; --hand and --grip are the spring and the damper
    that pull the key along.

    A key is a mass on a spring and a damper. --weight, --dry, --presliding, --static, --mode and
    --delay add what real keys have; --mass then is that of the key without its modes. With them the
    same seed and the same packets give the same positions.
    """
    from ergon import _core

    usual_axes, usual_force, ways = _DEVICES[device]
    if axes is not None and axes != usual_axes and device != "frame":
        raise Refused(f"a {device} has {usual_axes} axes")
    if force_max is not None and device != "frame":
        raise Refused(
            f"--force-max is for a frame alone; the motors of a {device} have a fixed limit"
        )
    axes = axes or usual_axes
    if len(gestures) > axes:
        raise Refused(f"{len(gestures)} gestures are given for {axes} keys")
    transport, port = _way(device, ways, terminal, udp, ws)
    suffix = "?lockstep" if lockstep else ""
    if noise < 0:
        raise Refused("--noise must not be negative")
    if dry is None and (presliding or static):
        raise Refused("--presliding and --static say how dry friction begins; give --dry too")
    friction = (dry or 0.0, presliding or 0.0, *(static or (0.0, 0.0)))
    own = (mass, stiffness, damping) != (0.05, 0.0, 1.0) or weight or any(friction)
    if calib is not None and (own or modes or delay):
        raise Refused("--calib says what the key is made of; leave the other options of it out")
    model = _model((mass, stiffness, damping), weight, friction, modes, delay or 0.0)

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
            console.say(
                {
                    "let-go": "no packet in time: the force is zero",
                    "host-gone": "the host has disconnected",
                }[event]
            )

    _core.emulate(
        cast("Literal['firefader', 'frame', 'haply']", device),
        cast("Literal['pty', 'udp', 'ws']", transport),
        tell,
        port=port,
        paths=_paths(gestures, tempo, rate, 0 if free else axes),
        hand=(hand, grip),
        axes=axes,
        force_max=usual_force if force_max is None else force_max,
        rate=rate,
        lockstep=lockstep,
        mass=mass,
        stiffness=stiffness,
        damping=damping,
        model=model,
        network=None if calib is None else _measured(calib),
        noise=noise,
        force_step=force_step or 0.0,
        touch_gate=device == "firefader" if gate is None else gate,
        **board,
    )


def _model(
    cel: tuple[float, float, float],
    weight: float,
    friction: tuple[float, ...],
    modes: tuple[tuple[float, float, float], ...],
    delay: float,
) -> NDArray[np.float64] | None:
    """The parameters of the model of a key (`_core.key_path`); None if the key is a plain CEL."""
    if not (weight or any(friction) or modes or delay):
        return None
    import numpy as np

    rest = -weight / cel[1] if cel[1] else 0.0
    dry, *others = friction
    return np.array([*cel, weight, dry, rest, delay, *others, *(x for mode in modes for x in mode)])


def _measured(calib: Path) -> tuple[_core.Network, int]:
    """The network of a key from a calibration file, and the MAT that ergons strike."""
    from ergon.instruments.assemble import Assembly
    from ergon.scores.reading.load import load

    text = f"ergon: 1\nkeys: {{k: {{calib: {json.dumps(calib.name)}}}}}\n"
    loaded = load(str(calib.parent / "emulated-key.yaml"), text=text)
    if loaded.piece is None:
        raise Refused(f"{calib}: {'; '.join(found.message for found in loaded.diagnostics)}")
    key = loaded.piece.keys["k"]
    assembly = Assembly()
    assembly.part(key.name, key.modules)
    assembly.joins(key.name, key.modules)
    return assembly.network, assembly.mats[key.name, key.struck]


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
    """The positions (n,) [m] of each hand; then an empty path for each finger that rests."""
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
