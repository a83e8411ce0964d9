"""An emulated force-feedback device, for trying scores and drivers."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from ergon.common.errors import ErgonError
from ergon.common.option import Integer, Number, Quantities, Switch, documented, option
from ergon.common.option import Path as PathTo

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from ergon import _core

DeviceName = Literal["firefader", "frame", "haply"]
Transport = Literal["pty", "udp", "ws"]


class EmulationError(ErgonError):
    """Options that contradict each other, or the device."""


@dataclass(frozen=True, slots=True)
class _Device:
    """A device: its axes, the greatest force of its motors [N], and a URL scheme for each
    transport.
    """

    n_axes: int
    force_max: float
    scheme_by_transport: dict[Transport, str]


DEVICES: dict[DeviceName, _Device] = {
    "firefader": _Device(2, 1.56, {"pty": "firefader"}),
    "frame": _Device(1, 20.0, {"pty": "frame", "udp": "frame+udp"}),
    "haply": _Device(3, 10.0, {"ws": "haply"}),
}
_DEFAULT_TICK_HZ = 44100 / 44  # periods a second: a tick of 44 samples
_DEFAULT_CEL = 0.05, 0.0, 1.0  # mass [kg], stiffness [N/m] and damping [N·s/m] of a key


def _quantity_option(default: float | None, default_text: str, dimension: str, help: str) -> Any:
    return option(default, help, Quantities((dimension,)), shown=default_text)


@documented
@dataclass(frozen=True, slots=True, kw_only=True)
class EmulationOptions:
    """What an emulated device is made of, in SI units, and how it is served."""

    pty: bool = option(False, "Serve at a pseudo-terminal, as at a serial port.")
    udp: int | None = option(
        None,
        "Serve by datagrams at this UDP port; 0 is any free port.",
        Integer(0, 65535),
        metavar="PORT",
    )
    ws: int | None = option(
        None,
        "Serve by a WebSocket at this TCP port; 0 is any free port.",
        Integer(0, 65535),
        metavar="PORT",
    )
    axes: int | None = option(None, "Number of keys; for a frame alone.", Integer(1, 16))
    mass: float = _quantity_option(_DEFAULT_CEL[0], "50g", "MASS", "Mass of each key.")
    stiffness: float = _quantity_option(_DEFAULT_CEL[1], "0N/m", "STIFFNESS", "Spring of each key.")
    damping: float = _quantity_option(_DEFAULT_CEL[2], "1Ns/m", "DAMPING", "Damping of each key.")
    calib: Path | None = option(
        None,
        "Make each key that of a score with this calibration file: its mass, spring, damping, "
        "rest, dry friction and modes, stepped once a period as a score steps them.",
        PathTo("file", must_exist=True),
        metavar="FILE",
    )
    weight: float = _quantity_option(0.0, "0N", "PUSH", "Constant force on each key, downwards.")
    dry: float | None = _quantity_option(None, "none", "FORCE", "Dry friction of each key.")
    presliding: float | None = _quantity_option(
        None, "rigid", "STIFFNESS", "Stiffness of dry friction before the key slides."
    )
    static: tuple[float, float] | None = option(
        None,
        "Dry friction near rest, and the speed at which it has fallen, such as '80mN 4mm/s'.",
        Quantities(("FORCE", "SPEED"), "80mN 4mm/s"),
        metavar="'FORCE SPEED'",
    )
    mode: Sequence[tuple[float, float, float]] = option(
        (),
        "A part that swings on each key: its mass, frequency and damping ratio, such as "
        "'20g 180Hz 0.02'; repeatable.",
        Quantities(("MASS", "FREQUENCY", "RATIO"), "20g 180Hz 0.02"),
        metavar="'MASS FREQUENCY RATIO'",
    )
    delay: float | None = _quantity_option(None, "none", "DURATION", "Delay of each motor's force.")
    travel: float = _quantity_option(
        0.1, "100mm", "POSITION", "Travel of each key, from end to end."
    )
    force_max: float | None = _quantity_option(
        None, "20N", "FORCE", "Largest force of each motor; for a frame alone."
    )
    resolution: float = _quantity_option(
        0.0, "exact", "POSITION", "Resolution of each position sensor."
    )
    noise: float = _quantity_option(
        0.0, "none", "POSITION", "Noise of each position sensor, as its rms."
    )
    seed: int = option(0, "Seed of the noise.", Integer(0), shown=True)
    force_step: float | None = _quantity_option(
        None, "exact", "FORCE", "Resolution of each motor's force."
    )
    rate: float = _quantity_option(
        _DEFAULT_TICK_HZ, "1002Hz", "FREQUENCY", "Periods a second of the device."
    )
    gesture: Sequence[str] = option(
        (),
        "Gesture of a hand on the next key, such as '0mm@0 6mm@1/8 0mm@1/2'; repeatable.",
        metavar="NOTATION",
    )
    tempo: float = option(60.0, "Beats a minute of the gestures.", Number(1, 1000), shown=True)
    hand: float = _quantity_option(
        400.0, "400N/m", "STIFFNESS", "Spring by which a hand pulls its key."
    )
    grip: float = _quantity_option(4.0, "4Ns/m", "DAMPING", "Damping of a hand on its key.")
    free: bool = option(False, "Leave the keys that have no gesture without a hand.")
    gate: bool | None = option(
        None,
        "Whether a motor gives force only while a hand touches the key; as the device does.",
        Switch(),
    )
    watchdog: float = _quantity_option(
        0.05, "50ms", "DURATION", "Time without a packet after which the force is zero."
    )
    lockstep: bool = option(
        False, "Advance one period for each packet, instead of by the wall clock."
    )
    seconds: float | None = option(
        None, "End after this many seconds.", Number(0, dimension="DURATION", is_open=True)
    )
    once: bool = option(False, "End when the host has disconnected.")

    @property
    def friction(self) -> tuple[float, float, float, float]:
        """Dry friction, its stiffness, and what it is near rest, up to which speed."""
        return self.dry or 0.0, self.presliding or 0.0, *(self.static or (0.0, 0.0))


def emulate(
    device: DeviceName, options: EmulationOptions, report_event: Callable[[str, str], object]
) -> None:
    """Serve an emulated device until Ctrl-C.

    `report_event(event, text)` is called with "ready" and the URL, "let-go", "host-gone", and
    "over" with periods, packets and the hash of all positions. Raises EmulationError and
    EngineError.
    """
    from ergon import _core

    device_traits = DEVICES[device]
    _check_options(device, options)
    transport, port = _chosen_transport(device, options)
    n_axes = options.axes or device_traits.n_axes
    url_suffix = "?lockstep" if options.lockstep else ""

    def report_url(event: str, url_text: str) -> None:
        is_ready = event == "ready"
        report_event(
            event,
            f"{device_traits.scheme_by_transport[transport]}:{url_text}{url_suffix}"
            if is_ready
            else url_text,
        )

    _core.emulate(
        device,
        transport,
        report_url,
        port=port,
        paths=_hand_paths(options, 0 if options.free else n_axes),
        hand=(options.hand, options.grip),
        axes=n_axes,
        force_max=device_traits.force_max if options.force_max is None else options.force_max,
        model=_key_model(options),
        network=None if options.calib is None else _measured_key(options.calib, options.travel),
        force_step=options.force_step or 0.0,
        touch_gate=device == "firefader" if options.gate is None else options.gate,
        mass=options.mass,
        stiffness=options.stiffness,
        damping=options.damping,
        travel=options.travel,
        resolution=options.resolution,
        noise=options.noise,
        seed=options.seed,
        rate=options.rate,
        watchdog=options.watchdog,
        lockstep=options.lockstep,
        seconds=options.seconds,
        once=options.once,
    )


def _check_options(device: DeviceName, emulation_options: EmulationOptions) -> None:
    """Refuse options that contradict each other, or the device. Raises EmulationError."""
    device_traits = DEVICES[device]
    if emulation_options.axes not in (None, device_traits.n_axes) and device != "frame":
        raise EmulationError(f"a {device} has {device_traits.n_axes} axes")
    if emulation_options.force_max is not None and device != "frame":
        raise EmulationError(
            f"--force-max is for a frame alone; the motors of a {device} have a fixed limit"
        )
    n_axes = emulation_options.axes or device_traits.n_axes
    if len(emulation_options.gesture) > n_axes:
        raise EmulationError(
            f"{len(emulation_options.gesture)} gestures are given for {n_axes} keys"
        )
    if emulation_options.noise < 0:
        raise EmulationError("--noise must not be negative")
    if emulation_options.dry is None and (emulation_options.presliding or emulation_options.static):
        raise EmulationError(
            "--presliding and --static say how dry friction begins; give --dry too"
        )
    has_default_cel = (
        emulation_options.mass,
        emulation_options.stiffness,
        emulation_options.damping,
    ) == _DEFAULT_CEL
    dynamic_options = (
        emulation_options.weight,
        *emulation_options.friction,
        emulation_options.mode,
        emulation_options.delay,
    )
    if emulation_options.calib is not None and (not has_default_cel or any(dynamic_options)):
        raise EmulationError(
            "--calib says what the key is made of; leave the other options of it out"
        )


def _key_model(emulation_options: EmulationOptions) -> NDArray[np.float64] | None:
    """The parameters of the model of a key (`_core.key_path`); None if the key is a plain CEL."""
    key_weight, friction, delay = (
        emulation_options.weight,
        emulation_options.friction,
        emulation_options.delay or 0.0,
    )
    if not (key_weight or any(friction) or emulation_options.mode or delay):
        return None
    import numpy as np

    rest_position = (
        -key_weight / emulation_options.stiffness if emulation_options.stiffness else 0.0
    )
    dry, *friction_curve = friction
    cel_constants = emulation_options.mass, emulation_options.stiffness, emulation_options.damping
    modes = (number for mode in emulation_options.mode for number in mode)
    return np.array(
        [*cel_constants, key_weight, dry, rest_position, delay, *friction_curve, *modes]
    )


def _measured_key(calib: Path, travel: float) -> tuple[_core.Network, int, float, float]:
    """The network of a key from a calibration file, the MAT that ergons strike, the constant force
    there [N], and the delay of its motor [s].
    """
    from ergon.instruments.assemble import Assembly
    from ergon.scores.reading.load import load

    travel_text = f"travel: {-0.5 * travel!r}m..{0.5 * travel!r}m"
    score_text = f"ergon: 1\nkeys: {{k: {{calib: {json.dumps(calib.name)}, {travel_text}}}}}\n"
    loaded = load(str(calib.parent / "emulated-key.yaml"), text=score_text)
    if loaded.piece is None:
        raise EmulationError(
            f"{calib}: {'; '.join(mistake.message for mistake in loaded.diagnostics)}"
        )
    calibrated_key = loaded.piece.keys["k"]
    assembly = Assembly()
    assembly.add_part(calibrated_key.name, calibrated_key.modules)
    assembly.add_links(calibrated_key.name, calibrated_key.modules)
    weight_force = sum(
        module.fields["from"] for module in calibrated_key.modules if module.kind == "ENF"
    )
    assert calibrated_key.measured_constants is not None
    return (
        assembly.network,
        assembly.mats[calibrated_key.name, calibrated_key.struck],
        weight_force,
        calibrated_key.measured_constants[2] or 0.0,
    )


def _chosen_transport(
    device: DeviceName, emulation_options: EmulationOptions
) -> tuple[Transport, int]:
    """The transport asked for, or the device's own, and its port."""
    transport_schemes = DEVICES[device].scheme_by_transport
    ports: dict[Transport, int | None] = {
        "pty": 0 if emulation_options.pty else None,
        "udp": emulation_options.udp,
        "ws": emulation_options.ws,
    }
    chosen_ports = [(name, port) for name, port in ports.items() if port is not None]
    if len(chosen_ports) > 1:
        raise EmulationError("--pty, --udp and --ws exclude each other; give one")
    transport_name, port = (
        chosen_ports[0]
        if chosen_ports
        else (next(iter(transport_schemes)), 10001 if "ws" in transport_schemes else 0)
    )
    if transport_name not in transport_schemes:
        raise EmulationError(f"a {device} is emulated by --{' or --'.join(transport_schemes)}")
    return transport_name, port


def _hand_paths(emulation_options: EmulationOptions, n_resting: int) -> list[NDArray[np.float64]]:
    """The positions (n,) [m] of each hand; then an empty path for each finger that rests."""
    import numpy as np

    from ergon.notation.text.errors import TextError
    from ergon.scores.gesture import notation
    from ergon.scores.gesture.sampled import sampled_positions

    paths = []
    for gesture_text in emulation_options.gesture:
        try:
            paths.append(
                sampled_positions(
                    notation.parse(gesture_text).points,
                    60 / emulation_options.tempo,
                    emulation_options.rate,
                )
            )
        except TextError as error:
            raise EmulationError(f"--gesture: {error.message}: {gesture_text}") from None
    return paths + [np.empty(0)] * (n_resting - len(paths))
