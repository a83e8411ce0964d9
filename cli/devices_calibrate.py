"""`ergon devices calibrate`: direction and ends of an axis, measured once and stored."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from . import options
from .console import Console
from .outcome import DeviceMissing, Refused

if TYPE_CHECKING:
    from ergon._core import Device
    from ergon.live.calibration import AxisCalibration

_PERIOD = 1e-3  # [s]
_TRAVEL_MIN = 0.05  # share of the device's range; a smaller movement may be a tremor


def _travel(
    ctx: click.Context, parameter: click.Parameter, travel_text: str | None
) -> float | None:
    from ergon.notation.tables.quantities import POSITION, quantity
    from ergon.notation.text.errors import TextError

    try:
        return None if travel_text is None else quantity(travel_text, POSITION)
    except TextError as error:
        raise click.BadParameter(error.message, ctx, parameter) from None


@click.command()
@click.argument("device", metavar="URL|NAME")
@click.option(
    "--axis",
    type=click.IntRange(0, 15),
    help="Number of the axis, where the URL does not say it (as #1 does); otherwise 0.",
)
@click.option(
    "--seconds",
    type=options.Number(0, 600, "DURATION"),
    default=5.0,
    show_default=True,
    help="Seconds in which you move the key from end to end.",
)
@click.option(
    "--travel",
    callback=_travel,
    metavar="LENGTH",
    help="Length from end to end, measured with a ruler, such as 60mm.",
)
@click.option("--turned", "is_reversed", is_flag=True, help="Swap up and down of the axis.")
@click.option(
    "--force-max",
    type=options.Number(0, 200, "FORCE"),
    help="Largest force that this axis may get [N].",
)
@options.with_console
def calibrate(
    console: Console,
    device: str,
    axis: int | None,
    seconds: float,
    travel: float | None,
    is_reversed: bool,
    force_max: float | None,
) -> None:
    """Find the direction and the ends of an axis, and keep them.

    First let go of the key: a small pulse finds in which direction a force moves it. Then move the
    key by hand from end to end; zero is in the middle. --seconds 0 takes the ends that the device
    states.
    """
    from ergon import _core
    from ergon.live.boards import BoardError, device_urls, url_and_axis
    from ergon.live.calibration import axis_key, store_axis, uncalibrated_axis

    try:
        url, url_axis = url_and_axis(device, {} if ":" in device else device_urls())
    except BoardError as error:
        raise Refused(str(error)) from None
    axis_index = url_axis if axis is None else axis
    try:
        open_device = _core.Device(url)
    except _core.EngineError as error:
        raise DeviceMissing(str(error)) from None
    try:
        console.say("let go of the key: it gets a small pulse to one side, then to the other")
        calibration = uncalibrated_axis(
            open_device, int(open_device.direction(axis_index, _PERIOD))
        )
        if seconds > 0:
            calibration = _axis_with_ends(
                console, open_device, calibration, axis_index, seconds, travel
            )
        elif travel is not None:
            raise Refused("--travel needs the ends of the axis, which --seconds 0 does not measure")
    except _core.EngineError as error:
        raise Refused(f"{axis_key(url, axis_index)}: {error}") from None
    finally:
        open_device.close()
    calibration = _with_options(calibration, is_reversed, force_max)
    try:
        path = store_axis(url, axis_index, calibration)
    except BoardError as error:
        raise Refused(str(error)) from None
    _say(console, axis_key(url, axis_index), calibration, open_device.unit, str(path))


def _axis_with_ends(
    console: Console,
    device: Device,
    axis: AxisCalibration,
    axis_number: int,
    move_seconds: float,
    travel: float | None,
) -> AxisCalibration:
    from ergon.live.calibration import axis_between_ends

    console.say(f"move the key from end to end, for {move_seconds:g} s")
    low_end, high_end = device.ends(move_seconds, _PERIOD)[axis_number].tolist()
    least, greatest = device.range
    if high_end - low_end < _TRAVEL_MIN * (greatest - least):
        raise Refused(
            f"the key moved {high_end - low_end:.2g} {device.unit} in {move_seconds:g} s, too "
            "little to find "
            "its ends; --seconds 0 takes the ends that the device states"
        )
    return axis_between_ends(
        axis, low_end, high_end, high_end - low_end if travel is None else travel
    )


def _with_options(
    measured_axis: AxisCalibration, is_reversed: bool, force_max: float | None
) -> AxisCalibration:
    from dataclasses import replace

    if is_reversed:
        low, high = measured_axis.range
        measured_axis = replace(measured_axis, gain=-measured_axis.gain, range=(-high, -low))
    if force_max is not None:
        measured_axis = replace(measured_axis, force_max=min(force_max, measured_axis.force_max))
    return measured_axis


def _say(
    console: Console, device_name: str, axis: AxisCalibration, unit_name: str, path: str
) -> None:
    if console.json:
        console.record(
            "calibrated",
            axis=device_name,
            sign=axis.sign,
            zero=axis.zero,
            gain=axis.gain,
            range=list(axis.range),
            force_max=axis.force_max,
            file=path,
        )
        return
    low, high = axis.range
    direction = "as it should" if axis.sign > 0 else "the other way round, which is corrected"
    console.say(
        f"{device_name}: a force moves it {direction}; {low:.4g} to {high:.4g} {unit_name}, "
        f"{axis.force_max:g} N at most; kept in {path}"
    )
