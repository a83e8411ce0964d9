"""Devices that move players' keys: `remi=firefader:/dev/ttyACM0#1`, and names for devices."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ergon.common.errors import ErgonError
from ergon.common.regular import read_bounded
from ergon.common.structured import MalformedTextError, parse_toml
from ergon.common.user_folders import config_folder

if TYPE_CHECKING:
    from ergon import _core

    from .calibration import AxisCalibration

# The name of a device in the user's file, with an optional axis, such as tgr0.3.
_DEVICE_NAME = re.compile(r"(?P<name>[^\W\d][\w-]*)(?:\.(?P<axis>\d+))?\Z")
PAGE_KINDS = ("page", "keys")  # keys that a page plays, by a pointer or by letters
POINTER_KINDS = (*PAGE_KINDS, "midi", "osc", "gamepad")  # keys that are played without a device
_BYTES_MAX = 1 << 18  # a list of devices is small; what is larger is another file


class BoardError(ErgonError):
    """A device whose description is wrong or unknown; the message says what to write."""


@dataclass(frozen=True, slots=True)
class Board:
    """A device, its axes as (axis, player), and the calibrations of axes by their numbers.

    `name` is its name in the user's list, if it was given by name. `pointer` pulls the finger on a
    key without a device, once it is open.
    """

    url: str
    axes: tuple[tuple[int, str], ...]
    calibrations: Mapping[int, AxisCalibration] = field(default_factory=dict)
    name: str = ""
    pointer: _core.Lead | None = None

    @property
    def display_name(self) -> str:
        """Its name, or its address without options, for messages."""
        return self.name or self.url.partition("?")[0]

    @property
    def kind(self) -> str:
        """The protocol, such as `firefader`."""
        return self.url.partition(":")[0]

    @property
    def has_motor(self) -> bool:
        """Whether it may have a real motor: not if it is played without a device, or emulated in
        this process or by a pseudo-terminal.
        """
        address = self.url.partition("?")[0].partition(":")[2]
        return self.kind not in ("emul", *POINTER_KINDS) and not address.startswith("/dev/pts/")

    @property
    def is_emulated(self) -> bool:
        """Whether it is an emulator, surely or probably: datagrams to this machine count as one."""
        address = self.url.partition("?")[0].partition(":")[2].removeprefix("//")
        return not self.has_motor or (self.kind == "frame+udp" and address.startswith("127."))


def config_path() -> Path:
    """The user's list of devices. Raises BoardError for a user without a home folder."""
    folder = config_folder()
    if folder is None:
        raise BoardError("no list of devices: there is no home folder; set HOME or XDG_CONFIG_HOME")
    return folder / "devices.toml"


def read_config() -> dict[str, Any]:
    """The user's list; empty where there is no such file. Raises BoardError."""
    try:
        return parse_toml(config_bytes())
    except MalformedTextError as error:
        raise BoardError(f"{config_path()}: {error}") from None


def config_bytes() -> bytes:
    """The user's list as its file holds it; empty where there is none. Raises BoardError."""
    if config_folder() is None:
        return b""
    path = config_path()
    try:
        config_data = read_bounded(path, _BYTES_MAX)
    except FileNotFoundError:
        return b""
    except OSError as error:
        raise BoardError(f"{path}: {error.strerror or error}") from None
    if len(config_data) > _BYTES_MAX:
        raise BoardError(f"{path}: larger than a list of devices may be ({_BYTES_MAX:,} bytes)")
    return config_data


def device_urls() -> dict[str, str]:
    """The URL of each named device; empty where there is no such file. Raises BoardError."""
    urls_by_name = read_config().get("devices", {})
    if not isinstance(urls_by_name, dict) or not all(
        isinstance(url, str) for url in urls_by_name.values()
    ):
        raise BoardError(
            f'{config_path()}: [devices] holds lines such as tgr0 = "frame:/dev/ttyACM0"'
        )
    return urls_by_name


def boards(devices_by_player: Mapping[str, str], urls_by_name: Mapping[str, str]) -> list[Board]:
    """Devices with their axes, for `devices_by_player` player → device; one for each URL. Raises
    BoardError.
    """
    axes_by_device: dict[str, list[tuple[int, str]]] = {}
    names_by_url: dict[str, str] = {}
    for player, device_text in devices_by_player.items():
        url, axis_number = url_and_axis(device_text, urls_by_name)
        kind, _, address = url.partition("?")[0].partition(":")
        if kind in PAGE_KINDS and not address:  # each player has a key of the page
            url = url.replace(":", f":{player}", 1)
        if ":" not in device_text and (name_match := _DEVICE_NAME.match(device_text)):
            names_by_url.setdefault(url, name_match["name"])
        device_axes = axes_by_device.setdefault(url, [])
        if any(axis_number == taken_axis for taken_axis, _ in device_axes):
            raise BoardError(
                f"axis {axis_number} of {url} is given to two players; a device with several axes "
                "has "
                f"{url}#{axis_number + 1} too (`ergon emulate frame --axes 2` emulates one)"
            )
        device_axes.append((axis_number, player))
    return [
        Board(url, tuple(axes), name=names_by_url.get(url, ""))
        for url, axes in axes_by_device.items()
    ]


def url_and_axis(device_text: str, urls_by_name: Mapping[str, str]) -> tuple[str, int]:
    """(URL, axis) of `URL#3`, or of `name` or `name.3` of the user's file. Raises BoardError."""
    if ":" in device_text:
        url, _, axis_text = device_text.partition("#")
        # The options of a URL come after its axis.
        number_text, question_mark, url_options = axis_text.partition("?")
        if axis_text and not number_text.isdecimal():
            raise BoardError(f"{device_text}: the axis is a number from 0 on, as in {url}#0")
        return url + question_mark + url_options, int(number_text or 0)
    name_match = _DEVICE_NAME.match(device_text)
    if name_match is None:
        raise BoardError(
            f"{device_text}: a device is a URL, such as firefader:/dev/ttyACM0, or a name"
        )
    device, axis = name_match["name"], name_match["axis"]
    if device not in urls_by_name:
        known_names = (
            ", ".join(urls_by_name) or "none yet (`ergon devices` says where to write one)"
        )
        raise BoardError(f"no device is called {device}; known: {known_names}")
    board_url, first_axis = url_and_axis(urls_by_name[device], {})
    return board_url, first_axis if axis is None else int(axis)


def parse_live_options(option_texts: Sequence[str]) -> dict[str, str]:
    """`PLAYER=DEVICE` of each `--live`. Raises BoardError."""
    devices_by_player: dict[str, str] = {}
    for option_text in option_texts:
        player, equals_sign, device = option_text.partition("=")
        if not equals_sign or not player or not device:
            raise BoardError(
                f"{option_text}: a hand is PLAYER=DEVICE, such as remi=firefader:/dev/ttyACM0"
            )
        if player in devices_by_player:
            raise BoardError(f"{player} is given two devices; a player has one")
        devices_by_player[player] = device
    return devices_by_player
