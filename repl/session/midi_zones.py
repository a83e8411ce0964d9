"""Zones of MIDI Polyphonic Expression (M1-100-UM, 2018): what a channel moves is the note that it
plays.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from ergon.notation.tables.notes import number
from ergon.repl.language.mapping import MapControl
from ergon.repl.session.midi_controllers import ControllerMessage, Controllers
from ergon.repl.session.midi_maps import Map, line_at_position, line_of_value
from ergon.scores.gesture.midi_bytes import CONTROLLER, NOTE_ON, PITCH_BEND, MidiEvent
from ergon.scores.gesture.midi_wheels import Wheels

if TYPE_CHECKING:
    from ergon.repl.session.fast_values import LineMaker
    from ergon.repl.session.version import Version
    from ergon.scores.reading.piece import Piece

_FOLLOWED_KINDS = (CONTROLLER, NOTE_ON, PITCH_BEND)
_WHEEL_RANGE_CENTS = 200.0  # [cents] of a wheel that says none
_PITCH_SUFFIX = ".transpose"


class Zones:
    """The channels of zones, the notes that they play, and the positions of their controllers."""

    def __init__(self) -> None:
        """Begin without zones: then a channel counts for nothing."""
        self._wheels = Wheels(_WHEEL_RANGE_CENTS)
        self._controllers: dict[int, Controllers] = {}
        self._positions: dict[tuple[int, str], float] = {}  # by channel and source
        self._bent_names: set[str] = set()  # names of the pitches that a wheel has moved

    def follow(self, data: bytes) -> None:
        """Follow a message of three bytes."""
        kind = data[0] & 0xF0
        if kind in _FOLLOWED_KINDS:
            event = MidiEvent(0, kind, (data[0] & 0x0F) + 1, data[1], data[1:])
            for _ in self._wheels.follow(event):
                pass

    def move_values(
        self, channel: int, message: ControllerMessage, maps: Mapping[str, Map], piece: Piece
    ) -> tuple[bool, list[tuple[str, LineMaker]]]:
        """Whether a message has a map, and what it sets: the name of each value, and the line that
        sets it.
        """
        is_in_zone, is_mapped = self._wheels.is_in_zone(channel), False
        named_lines: list[tuple[str, LineMaker]] = []
        controllers = self._controllers.setdefault(channel if is_in_zone else 0, Controllers())
        for map_source, position in controllers.positions(message, maps):
            control = maps.get(map_source)
            if not isinstance(control, MapControl):
                continue
            is_mapped = True
            if is_in_zone and _note_family(control, piece):
                self._positions[channel, map_source] = position
                for note in self._wheels.notes_of_channel(channel):
                    named_lines += self._note_values(control, note, position, piece)
            else:
                named_lines.append((map_source, partial(line_at_position, map_source, position)))
        return is_mapped, named_lines

    def note_begin_values(
        self, channel: int, note: int, maps: Mapping[str, Map], piece: Piece
    ) -> Iterator[tuple[str, LineMaker]]:
        """What the beginning of a note sets: a note has the values of its channel."""
        if not self._wheels.is_in_zone(channel):
            return
        for map_source, control in maps.items():
            if isinstance(control, MapControl) and _note_family(control, piece):
                position = self._positions.get((channel, map_source))
                if map_source == "bend" or position is not None:
                    yield from self._note_values(control, note, position, piece)

    def _note_values(
        self, control: MapControl, note_number: int, position: float | None, piece: Piece
    ) -> Iterator[tuple[str, LineMaker]]:
        """The value of one note, if its instrument has that note."""
        family = _note_family(control, piece)
        target_path = _note_target(control, family, note_number, piece)
        if target_path is None:
            return
        value_name = f"{control.source}, {target_path}"
        if control.source == "bend" and target_path.endswith(_PITCH_SUFFIX):
            cents = self._wheels.note_cents(note_number)
            if cents or value_name in self._bent_names:
                self._bent_names.add(value_name)
                yield (
                    value_name,
                    partial(_constant_line, f"set {target_path} {cents:.6g}cents over 50ms now"),
                )
        elif position is not None:
            yield (
                value_name,
                partial(
                    _constant_line, line_of_value(replace(control, target=target_path), position)
                ),
            )


def _note_family(control: MapControl, piece: Piece) -> str | None:
    """The instrument with notes to whose parameter a controller leads."""
    words = (control.target or "").split(".")
    prefixes = (".".join(words[:n_words]) for n_words in range(1, len(words)))
    return next((prefix for prefix in prefixes if prefix in piece.families), None)


def _note_target(
    control: MapControl, family: str | None, note_number: int, piece: Piece
) -> str | None:
    """The parameter of one note; None if there is no such note."""
    if family is None or control.target is None:
        return None
    for member in piece.families[family]:
        if number(member.rpartition(".")[2]) == note_number:
            return f"{member}{control.target.removeprefix(family)}"
    return None


def _constant_line(line: str, _: Version) -> str:
    """A line that is the same in every version."""
    return line
