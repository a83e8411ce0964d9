"""Calibrations of axes, kept in the user's list of devices beside the lines of the user."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ergon import _core
from ergon.common.structured import MalformedTextError, parse_toml

from .boards import Board, BoardError, config_bytes, config_path, read_config

if TYPE_CHECKING:
    from ergon._core import Device

_TABLE = "calibration"
# URL options that say how to communicate, not with which device.
_PROTOCOL_OPTIONS = ("lockstep", "wide")


@dataclass(frozen=True, slots=True)
class AxisCalibration:
    """The calibration of an axis; positions in m or rad, `force_max` in N or N·m.

    `sign` is 1 if a positive force moves the axis towards positive positions as the device gives
    them, else -1; its true position is (position - zero) · gain.
    """

    sign: int
    zero: float
    gain: float
    range: tuple[float, float]
    force_max: float

    def for_core(self, number: int) -> _core.AxisCalibration:
        """The calibration of axis `number`, as the core takes it."""
        return _core.AxisCalibration(
            number, float(self.sign), self.zero, self.gain, self.range, self.force_max
        )


def uncalibrated_axis(device: Device, sign: int) -> AxisCalibration:
    """The axis as its device describes it, with the given sign."""
    return AxisCalibration(sign, 0.0, 1.0, device.range, device.force_max)


def axis_between_ends(
    axis: AxisCalibration, low_end: float, high_end: float, travel: float
) -> AxisCalibration:
    """The axis with its ends at the device's positions `low_end` and `high_end`, which are truly
    `travel`.

    Zero is midway.
    """
    half_travel = 0.5 * abs(travel)
    return AxisCalibration(
        axis.sign,
        0.5 * (low_end + high_end),
        travel / (high_end - low_end),
        (-half_travel, half_travel),
        axis.force_max,
    )


def board_identity(url: str) -> str | None:
    """A name of a board that does not depend on its port; None if it has none.

    For a board on a serial port it is the serial number that USB reports, for a Haply device its
    `?id=`. A network address does not tell which device answers there.
    """
    target, _, url_options = url.partition("?")
    address_kind, _, address = target.partition(":")
    if address_kind in ("firefader", "frame"):
        return _core.serial_identity(address)
    haply_ids = [option[3:] for option in url_options.split("&") if option.startswith("id=")]
    return (
        f"haply:{haply_ids[-1]}"
        if address_kind == "haply" and haply_ids and haply_ids[-1]
        else None
    )


def axis_key(url: str, number: int) -> str:
    """The name of an axis: by the identity of its board, or else by its address."""
    return f"{board_identity(url) or _device_address(url)}#{number}"


def _device_address(url: str) -> str:
    url_target, _, options = url.partition("?")
    target_options = [
        option for option in options.split("&") if option and option not in _PROTOCOL_OPTIONS
    ]
    return url_target + ("?" + "&".join(target_options) if target_options else "")


def stored_calibrations(url: str) -> dict[int, AxisCalibration]:
    """The known calibrations of a device's axes, by their numbers.

    Raises BoardError.
    """
    return {number: axis for number, (axis, _) in _axes_in_list(url).items()}


def calibrated_axes(url: str) -> set[int]:
    """The axes of a device that were calibrated on this board. Raises BoardError."""
    return {number for number, (_, is_same_board) in _axes_in_list(url).items() if is_same_board}


def _axes_in_list(url: str) -> dict[int, tuple[AxisCalibration, bool]]:
    axis_table = _axis_table(read_config())
    identity, address = board_identity(url), _device_address(url)
    axes_by_number = {}
    for axis_number in range(16):
        for axis_name, is_same_board in (
            (f"{identity}#{axis_number}", identity is not None),
            (f"{address}#{axis_number}", False),
        ):
            if axis_name in axis_table:
                axes_by_number[axis_number] = (
                    _parse_axis(axis_name, axis_table[axis_name]),
                    is_same_board,
                )
                break
    return axes_by_number


def _axis_table(config: dict[str, Any]) -> dict[str, Any]:
    axis_table = config.get(_TABLE, {})
    if not isinstance(axis_table, dict):
        raise BoardError(f"{config_path()}: [{_TABLE}] is not a table")
    return axis_table


def axis_header(board: Board, axis_number: int) -> dict[str, object]:
    """An axis, as the header of a recording describes it."""
    axis_calibration = board.calibrations.get(axis_number)
    return {
        "device": f"{board.url}#{axis_number}",
        "calibration": None if axis_calibration is None else asdict(axis_calibration),
    }


def _parse_axis(axis_name: str, axis_row: Any) -> AxisCalibration:
    try:
        low_end, high_end = axis_row["range"]
        written_numbers = (
            low_end,
            high_end,
            *(axis_row[field] for field in ("sign", "zero", "gain", "force_max")),
        )
        if any(type(value) not in (int, float) for value in written_numbers):
            raise TypeError
        parsed_axis = AxisCalibration(
            int(axis_row["sign"]),
            float(axis_row["zero"]),
            float(axis_row["gain"]),
            (float(low_end), float(high_end)),
            float(axis_row["force_max"]),
        )
        numbers = (parsed_axis.zero, parsed_axis.gain, *parsed_axis.range, parsed_axis.force_max)
        if (
            not all(map(math.isfinite, numbers))
            or parsed_axis.gain == 0
            or axis_row["sign"] not in (-1, 1)
        ):
            raise ValueError
    except (KeyError, OverflowError, TypeError, ValueError):
        raise BoardError(
            f'{config_path()}: [{_TABLE}."{axis_name}"] is not what '
            "`ergon devices calibrate` writes"
        ) from None
    return parsed_axis


def find_direction(
    url: str, axis_number: int, axis_before: AxisCalibration | None = None
) -> AxisCalibration:
    """Find the direction of an axis by a small force.

    Returns `axis_before` if its direction still holds; else another motor is connected, and the
    axis is as the device describes it. Raises EngineError, UnsureError if the axis does not move
    both ways.
    """
    device = _core.Device(url, [] if axis_before is None else [axis_before.for_core(axis_number)])
    try:
        motor_sign = int(device.direction(axis_number, 1e-3))
        if axis_before is None:
            return uncalibrated_axis(device, motor_sign)
    finally:
        device.close()
    if motor_sign > 0:
        return axis_before
    # Another motor is connected: nothing of the old calibration holds for it.
    device = _core.Device(url)
    try:
        return uncalibrated_axis(device, -axis_before.sign)
    finally:
        device.close()


def confirm_axes(
    url: str, axes_before: Mapping[int, AxisCalibration | None]
) -> dict[int, AxisCalibration]:
    """Push the axes `axes_before` together by small forces; return those that move in the expected
    direction.

    An axis without a calibration is then as the device describes it. Where several did not move,
    these are pushed together once more, for a busy machine may have passed over the push. Raises
    EngineError.
    """
    calibrations_before = {number: axis for number, axis in axes_before.items() if axis is not None}
    device = _core.Device(
        url, [axis.for_core(number) for number, axis in calibrations_before.items()]
    )
    try:
        signs = dict(zip(axes_before, device.directions(list(axes_before), 1e-3), strict=True))
        unmoved_axes = [number for number, sign in signs.items() if sign is None]
        if len(unmoved_axes) > 1:
            signs.update(zip(unmoved_axes, device.directions(unmoved_axes, 1e-3), strict=True))
        moved_axes = [number for number, sign in signs.items() if sign == 1.0]
        return {
            number: calibrations_before.get(number) or uncalibrated_axis(device, 1)
            for number in moved_axes
        }
    finally:
        device.close()


def store_axis(url: str, axis_number: int, stored_axis: AxisCalibration) -> Path:
    """Write an axis into the user's list of devices; every other line stays. Raises BoardError."""
    from ergon.exchange.safe import open_for_writing

    path = config_path()
    config_before = read_config()
    config_text = config_bytes().decode()
    axis_name = axis_key(url, axis_number)
    axis_row: dict[str, Any] = {
        "sign": stored_axis.sign,
        "zero": stored_axis.zero,
        "gain": stored_axis.gain,
        "range": list(stored_axis.range),
        "force_max": stored_axis.force_max,
    }
    table_lines = [f"[{_TABLE}.{json.dumps(axis_name)}]"]
    table_lines += [f"{field} = {json.dumps(value)}" for field, value in axis_row.items()]
    text_after = _with_table(config_text, table_lines)
    # However the user's file is formatted, everything else in it must stay the same.
    try:
        expected_config = {
            **config_before,
            _TABLE: {**_axis_table(config_before), axis_name: axis_row},
        }
        is_unchanged = parse_toml(text_after.encode()) == expected_config
    except MalformedTextError:
        is_unchanged = False
    if not is_unchanged:
        raise BoardError(
            f"{path} has a form that ergon cannot edit; add to it:\n" + ("\n".join(table_lines))
        )
    with open_for_writing(path, binary=False, force=True, replaceable=False) as file:
        file.write(text_after.encode())
    return path


def _with_table(config_text: str, table_lines: list[str]) -> str:
    """The text with a table in place of the one with the same header, or else at its end."""
    line_end = "\r\n" if "\r\n" in config_text else "\n"
    table_text = line_end.join(table_lines) + line_end
    config_lines = config_text.splitlines(keepends=True)
    header_index = next(
        (index for index, line in enumerate(config_lines) if line.strip() == table_lines[0]), None
    )
    if header_index is None:
        blank_line = (
            ""
            if not config_text
            else line_end
            if config_text.endswith("\n")
            else line_end + line_end
        )
        return config_text + blank_line + table_text
    end_index = header_index + 1
    while end_index < len(config_lines) and not config_lines[end_index].lstrip().startswith("["):
        end_index += 1
    # Comments and empty lines above the next table belong to that one.
    while end_index > header_index + 1 and (
        not config_lines[end_index - 1].strip() or config_lines[end_index - 1].startswith("#")
    ):
        end_index -= 1
    return "".join(config_lines[:header_index]) + table_text + "".join(config_lines[end_index:])
