"""Continuous sources of MIDI and their positions: controllers, wheel and pressures."""

from __future__ import annotations

import re
from typing import NamedTuple

from ergon.notation.text.errors import TextError, quote
from ergon.scores.gesture.midi_bytes import (
    CHANNEL_PRESSURE,
    CONTROLLER,
    KEY_PRESSURE,
    PITCH_BEND,
)
from ergon.scores.gesture.midi_notes import note_number

# The moving source as written, and its meaning.
SOURCES = {
    "cc 21": "controller 21, in 128 steps",
    "cc 1/33": "controllers 1 and 33 together, in 16,384 steps",
    "bend": "the pitch wheel, in 16,384 steps; its middle is the middle of the range",
    "pressure": "the pressure on the keys (channel pressure)",
    "pressure C4": "the pressure on one key (polyphonic pressure)",
}
_KIND_BY_WORD = {"bend": PITCH_BEND, "pressure": CHANNEL_PRESSURE}
_SEVEN_BIT_MAX = 127
_FOURTEEN_BIT_MAX = 16383
_WHEEL_CENTRE = 8192
_CONTROLLERS_PATTERN = re.compile(r"([0-9]{1,3})(?:/([0-9]{1,3}))?")


class MidiSource(NamedTuple):
    """What moves: the kind of event, and its number: that of a controller, of two (the upper seven
    bits first), or of a key.
    """

    kind: int
    numbers: tuple[int, ...] = ()

    def __str__(self) -> str:
        """As it is written."""
        if self.kind == CONTROLLER:
            return f"cc {'/'.join(map(str, self.numbers))}"
        if self.kind == KEY_PRESSURE:
            return f"pressure {self.numbers[0]}"
        return next(word for word, kind in _KIND_BY_WORD.items() if kind == self.kind)


def parse_source(written_text: str) -> MidiSource:
    """Read `cc 21`, `cc 1/33`, `bend`, `pressure` or `pressure C4`. Raises TextError."""
    prefix, _, source_text = written_text.strip().partition(" ")
    source_text = source_text.strip()
    if prefix == "cc":
        return MidiSource(
            CONTROLLER, _parse_controllers(source_text, len(written_text) - len(source_text))
        )
    if prefix == "pressure" and source_text:
        return MidiSource(KEY_PRESSURE, (note_number(source_text),))
    if prefix in _KIND_BY_WORD and not source_text:
        return MidiSource(_KIND_BY_WORD[prefix])
    message = (
        f"{quote(written_text)} is not what moves in MIDI: write cc 21, cc 1/33, bend, pressure or "
    )
    raise TextError(f"{message}pressure C4", length=max(1, len(written_text)), code="E201")


def _parse_controllers(controllers_text: str, text_offset: int) -> tuple[int, ...]:
    """`21`, or `1/33`: the controllers of the upper and of the lower seven bits."""
    match = _CONTROLLERS_PATTERN.fullmatch(controllers_text)
    controller_numbers = (
        [int(number) for number in match.groups() if number is not None] if match else []
    )
    if not controller_numbers or max(controller_numbers) > _SEVEN_BIT_MAX:
        message = (
            f"{quote(controllers_text)} is not a controller: write a number from 0 to 127, or two "
            "such "
        )
        message += "as 1/33"
        raise TextError(message, offset=text_offset, length=max(1, len(controllers_text)))
    if len(controller_numbers) > 1 and controller_numbers[0] == controller_numbers[1]:
        message = (
            f"{quote(controllers_text)} names one controller twice: its lower bits come by "
            "another, such"
        )
        raise TextError(f"{message} as 1/33", offset=text_offset, length=len(controllers_text))
    return tuple(controller_numbers)


def seven_bit_position(value: int) -> float:
    """The position of a controller or a pressure, from 0 to 1."""
    return value / _SEVEN_BIT_MAX


def pair_position(upper_bits: int, lower_bits: int) -> float:
    """The joint position of two controllers, from 0 to 1."""
    return (upper_bits << 7 | lower_bits) / _FOURTEEN_BIT_MAX


def wheel_position(wheel_value: int) -> float:
    """The position of the wheel: 0 and 1 at its ends (0 and 16383), one half in its middle."""
    if wheel_value <= _WHEEL_CENTRE:
        return 0.5 * wheel_value / _WHEEL_CENTRE
    return 0.5 + 0.5 * (wheel_value - _WHEEL_CENTRE) / (_FOURTEEN_BIT_MAX - _WHEEL_CENTRE)
