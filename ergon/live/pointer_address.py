"""Addresses of keys that are played without a device, such as `page:`, `midi:cc2` and `osc:/x`."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from .boards import POINTER_KINDS, BoardError

if TYPE_CHECKING:
    from ergon.notation.tables.quantities import Dimension

# Axes of a gamepad: their numbers in Linux, and signs: a stick that is pushed away counts down.
GAMEPAD_AXES = {
    "lx": (0, 1),
    "ly": (1, -1),
    "lt": (2, 1),
    "rx": (3, 1),
    "ry": (4, -1),
    "rt": (5, 1),
}
OSC_PORT = 9001  # port on 127.0.0.1 for positions
_CONTROLLER_PATTERN = re.compile(r"cc(\d{1,3})\Z")
_OSC_ADDRESS_PATTERN = re.compile(r"/[A-Za-z0-9_./-]{1,80}\Z")
_CONTROLLER_NUMBERS = range(120)  # above are messages to whole channels
# [N/m/kg] at which a finger is still computed well: below half of what the core takes, for a pen's
# pressure doubles the spring and the fingertip is one more.
_STIFFNESS_PER_MASS_MAX = 2e7
_DELAY_MAX = 0.5  # [s] that a player could still play with
_FIELD_BY_OPTION = {
    "K": "stiffness",
    "Z": "damping",
    "M": "mass",
    "travel": "travel",
    "delay": "delay",
}
_TRACE_OPTION = "trace"  # an option for tests, not listed


@dataclass(frozen=True, slots=True)
class Finger:
    """A finger: spring [N/m] and damper [N·s/m] to its pointer, and its moving mass [kg].

    A. Z. Hajian and R. D. Howe, "Identification of the mechanical impedance at the human finger
    tip", J. Biomech. Eng. 119 (1997), model a finger by these three.
    """

    stiffness: float = 400.0
    damping: float = 2.0
    mass: float = 6e-3


@dataclass(frozen=True, slots=True)
class PointerAddress:
    """A key's source of positions: its kind, which of its values, and how they pull the finger.

    `delay` [s] is that of the path, `travel` [m] the length of the key's about 0 (None: that of the
    score's key), `port` the OSC port, `source` a MIDI input or the file of a gamepad, `channel` (1
    to 16) a MIDI channel; None is any. For tests, in lockstep time is that of the ticks, and ticks
    are kept for about `traced_seconds` [s].
    """

    kind: str
    control: str
    finger: Finger
    delay: float = 0.02
    travel: float | None = None
    port: int = OSC_PORT
    source: str = ""
    channel: int | None = None
    lockstep: bool = False
    traced_seconds: float = 0.0

    @property
    def controller(self) -> int | None:
        """The number of the MIDI controller; None for other values."""
        match = _CONTROLLER_PATTERN.match(self.control)
        return int(match[1]) if match else None


@dataclass(frozen=True, slots=True)
class PointerKey:
    """The key under such a finger: the two ends of its travel, and its spring [N/m] about a rest.

    Positions are in metres.
    """

    travel: tuple[float, float] = (-0.05, 0.05)
    stiffness: float = 0.0
    rest_position: float = 0.0


def is_pointer_driven(url: str) -> bool:
    """Whether a URL is that of a key that is played without a device."""
    return url.partition(":")[0] in POINTER_KINDS


def parse_pointer_address(url: str) -> PointerAddress:
    """The source at a URL `KIND:WHAT?OPTION&OPTION=VALUE`. Raises BoardError."""
    target, _, url_options = url.partition("?")
    source_kind, _, control = target.partition(":")
    _check_control(url, source_kind, control)
    numbers_by_name: dict[str, float] = {}
    other_options: dict[str, int | str | bool] = {}
    for url_option in filter(None, url_options.split("&")):
        option_name, equals_sign, option_text = url_option.partition("=")
        if url_option == "lockstep":
            other_options["lockstep"] = True
        elif option_name in (*_FIELD_BY_OPTION, _TRACE_OPTION) and equals_sign:
            numbers_by_name[_FIELD_BY_OPTION.get(option_name, "traced_seconds")] = _parse_quantity(
                url, option_name, option_text
            )
        elif (source_kind, option_name) in _OPTIONS_BY_KIND and equals_sign:
            field, read_option = _OPTIONS_BY_KIND[source_kind, option_name]
            other_options[field] = read_option(url, option_text)
        else:
            raise BoardError(f"{url}: unknown option '{url_option}'; {_options_text(source_kind)}")
    finger = Finger(
        **{
            name: numbers_by_name.pop(name)
            for name in tuple(numbers_by_name)
            if name in _FINGER_FIELDS
        }
    )
    if numbers_by_name.get("delay", 0.0) > _DELAY_MAX:
        raise BoardError(f"{url}: a delay is at most {_DELAY_MAX * 1e3:g} ms")
    if finger.stiffness > _STIFFNESS_PER_MASS_MAX * finger.mass:
        raise BoardError(
            f"{url}: the finger is too light for its spring: M has to be at least "
            f"{finger.stiffness / _STIFFNESS_PER_MASS_MAX * 1e3:.2g} g for K = "
            f"{finger.stiffness:g} N/m"
        )
    return PointerAddress(source_kind, control, finger, **numbers_by_name, **other_options)  # type: ignore[arg-type]


_FINGER_FIELDS = ("stiffness", "damping", "mass")


def _check_control(url: str, source_kind: str, control: str) -> None:
    if source_kind == "osc" and not _OSC_ADDRESS_PATTERN.match(control):
        raise BoardError(f"{url}: after osc: comes the address of its messages, such as osc:/x")
    if source_kind == "gamepad" and control not in GAMEPAD_AXES:
        raise BoardError(f"{url}: after gamepad: comes one of {', '.join(GAMEPAD_AXES)}")
    if source_kind != "midi":
        return
    controller_match = _CONTROLLER_PATTERN.match(control)
    if controller_match and int(controller_match[1]) not in _CONTROLLER_NUMBERS:
        raise BoardError(f"{url}: controllers have the numbers 0 to 119")
    if not controller_match and control not in ("bend", "pressure"):
        raise BoardError(f"{url}: after midi: comes cc and a number (cc2), bend or pressure")


def _options_text(kind: str) -> str:
    special_options = [name for option_kind, name in _OPTIONS_BY_KIND if option_kind == kind]
    names = [*_FIELD_BY_OPTION, *special_options]
    return f"the options are {', '.join(names)}"


def _parse_quantity(url: str, option_name: str, value_text: str) -> float:
    from ergon.notation.tables import quantities
    from ergon.notation.text.errors import TextError

    dimensions: Mapping[str, Dimension] = {
        "K": quantities.STIFFNESS,
        "Z": quantities.DAMPING,
        "M": quantities.MASS,
        "travel": quantities.SIZE,
        "delay": quantities.DURATION,
        _TRACE_OPTION: quantities.DURATION,
    }
    try:
        option_value = quantities.quantity(value_text, dimensions[option_name])
    except TextError as error:
        raise BoardError(f"{url}: {option_name}: {error.message}") from None
    if option_name == "K" and option_value == 0.0:
        raise BoardError(
            f"{url}: K has to be above zero: without a spring nothing leads the finger"
        )
    return option_value


def _number_reader(low_bound: int, high_bound: int) -> Callable[[str, str], int]:
    def read_number(url: str, number_text: str) -> int:
        if (
            not number_text.isascii()
            or not number_text.isdecimal()
            or not low_bound <= int(number_text) <= high_bound
        ):
            raise BoardError(
                f"{url}: '{number_text}' is not a number from {low_bound} to {high_bound}"
            )
        return int(number_text)

    return read_number


def _unchanged_text(_url: str, text: str) -> str:
    return text


_OPTIONS_BY_KIND: Mapping[tuple[str, str], tuple[str, Callable[[str, str], int | str]]] = {
    ("midi", "in"): ("source", _unchanged_text),
    ("gamepad", "in"): ("source", _unchanged_text),
    ("midi", "channel"): ("channel", _number_reader(1, 16)),
    ("osc", "port"): ("port", _number_reader(1, 65535)),
}
