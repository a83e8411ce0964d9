"""MIDI input of a session: notes strike modules, controllers move parameters."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

from ergon.live.midi_messages import (
    ControlChange,
    NoteOff,
    NoteOn,
    PlayedMessage,
    Pressure,
    ProgramChange,
    SongPosition,
    Transport,
    parse_message,
)
from ergon.repl.language.mapping import MapControl, MapNotes
from ergon.repl.session.midi_controllers import ControllerMessage
from ergon.repl.session.midi_maps import note_lines
from ergon.repl.session.midi_monitor import MidiMonitor, source_of
from ergon.repl.session.midi_zones import Zones
from ergon.repl.session.struck_places import (
    Place,
    maps_of,
    place_number,
    pressed_places,
    struck_places,
)
from ergon.repl.session.version import NotTakenError

if TYPE_CHECKING:
    from ergon.repl.session.acts import Acts
    from ergon.repl.session.fast_values import FastValues
    from ergon.repl.session.schedule import Schedule
    from ergon.repl.session.stops import Stops
    from ergon.repl.session.version import Version


# The controller of the pedal, and its least value when down.
_SUSTAIN_CONTROLLER, _PEDAL_DOWN = (64, 64)


class _SoundingNote(NamedTuple):
    """A note whose end does something: what it strikes, and by how much its key has pressed
    places [N·s]. A panic ends it: `n_panics` were before it.
    """

    n_panics: int
    channel: int
    end_strikes: Sequence[tuple[Place, float]]
    impulse_by_place: dict[Place, float]


class MidiInput:
    """Notes and controllers of a session. Any thread may call `receive`."""

    def __init__(
        self,
        schedule: Schedule,
        acts: Acts,
        fast_values: FastValues,
        stops: Stops,
        say: Callable[[str], None],
    ) -> None:
        """Act on what plays (`acts`), and on values of lines; `say` adds a message."""
        self._schedule, self._acts = schedule, acts
        self._fast_values, self._stops = fast_values, stops
        self._sounding_notes: dict[int, _SoundingNote] = {}  # notes whose end does something
        self._pedal_notes: set[int] = set()  # those whose key is up
        self._is_pedal_down = False
        self._n_lines = 0  # typed by notes
        self._zones = Zones()
        self._wanted_map: MapControl | MapNotes | None = None  # the map that is to be learnt
        self._say = say
        self.monitor = MidiMonitor()
        self.inputs: list[str] = []  # the names of the ports that are open
        self.n_lost_strikes = 0  # notes that could not strike because too many came at once

    def receive(self, data: bytes, instant: float) -> None:
        """Act on a message; malformed and unknown ones do nothing."""
        message = parse_message(data)
        if message is None or isinstance(message, SongPosition | Transport):
            return
        channel = (data[0] & 0x0F) + 1
        self._zones.follow(data)
        is_mapped = self._act_on(message, channel)
        self.monitor.note(message, channel, is_mapped=is_mapped)

    def _act_on(self, message: PlayedMessage, channel: int) -> bool:
        """Act on a message; whether anything is mapped to it."""
        if isinstance(message, NoteOff):
            self._end_note(message.number)
        elif isinstance(message, NoteOn):
            if self._learn(message):
                return True
            self._begin_note(message, channel)
            self._type_lines(message)
            head = self._schedule.head
            for name, line in self._zones.note_begin_values(
                channel, message.number, head.maps, head.piece
            ):
                self._fast_values.set_soon(name, line)
            return any(maps_of(self._schedule.head, message.number))
        elif not isinstance(message, ProgramChange):
            return self._move_controller(message, channel)
        return False

    def learn(self, wanted_map: MapControl | MapNotes | None) -> str:
        """Map the next controller or note that comes; returns a sentence that says so."""
        old_wanted_map, self._wanted_map = self._wanted_map, wanted_map
        if wanted_map is None:
            if old_wanted_map is None:
                raise NotTakenError("nothing is to be learnt; `map learn bell.m.K …` begins it")
            return "nothing is learnt any more"
        action_text = "strike a note" if isinstance(wanted_map, MapNotes) else "move a controller"
        return f"{action_text}: it will be mapped; `unmap learn` lets it be"

    def _learn(self, message: PlayedMessage) -> bool:
        """Take a message as that to which the wanted map is; False if none is wanted of its kind.

        A pair of controllers is learnt as the one of its upper bits.
        """
        wanted_map = self._wanted_map
        is_note = isinstance(message, NoteOn)
        if wanted_map is None or is_note is not isinstance(wanted_map, MapNotes):
            return False
        self._wanted_map = None
        if isinstance(wanted_map, MapNotes):
            assert isinstance(message, NoteOn)
            wanted_map = replace(wanted_map, low=message.number, high=message.number)
        else:
            wanted_map = replace(wanted_map, source=source_of(message))
        self._n_lines += 1
        line = f"{wanted_map.line} now"
        self._fast_values.set_soon(f"learn {self._n_lines}", partial(_constant_line, line))
        self._say(f"{wanted_map.name} is learnt: {wanted_map.line}")
        return True

    def _move_controller(self, message: ControllerMessage, channel: int) -> bool:
        """Set what a controller leads to; whether it leads to anything."""
        if self._learn(message):
            return True
        is_pedal = isinstance(message, ControlChange) and message.number == _SUSTAIN_CONTROLLER
        if is_pedal:
            self._move_pedal(is_down=message.value >= _PEDAL_DOWN)
        head = self._schedule.head
        is_mapped, named_lines = self._zones.move_values(channel, message, head.maps, head.piece)
        for name, line in named_lines:
            self._fast_values.set_soon(name, line)
        if isinstance(message, Pressure) and not is_mapped:
            return self._press(message, channel)
        return is_mapped or is_pedal

    def _type_lines(self, note: NoteOn) -> None:
        """Run the blocks and play the gestures to which a note is mapped, each by its own line."""
        for note_line in note_lines(self._schedule.running.version, note.number):
            self._n_lines += 1
            self._fast_values.set_soon(
                f"note {note.number}, line {self._n_lines}", partial(_constant_line, note_line)
            )

    def _begin_note(self, note: NoteOn, channel: int) -> None:
        """Strike what a note is mapped to in the running version; do nothing during a panic."""
        if self._stops.panicked:
            return
        version = self._schedule.running.version
        if note.number in self._sounding_notes:
            self._release_note(note.number)
        strokes = [*struck_places(version, note.number, note.velocity)]
        end_strikes = [
            (stroke.place, -stroke.impulse) for stroke in strokes if stroke.lasts_as_note
        ]
        if end_strikes:
            self._sounding_notes[note.number] = _SoundingNote(
                self._stops.n_panics, channel, end_strikes, {}
            )
        for stroke in strokes:
            self._strike(stroke.place, stroke.impulse)

    def _press(self, message: Pressure, channel: int) -> bool:
        """Press on the notes that sound, those of one key or of one channel; whether there is
        anything to press on.
        """
        has_pressed = False
        for note_number, sounding_note in self._sounding_notes.items():
            if sounding_note.n_panics != self._stops.n_panics:
                continue
            if message.number not in (None, note_number) or sounding_note.channel != channel:
                continue
            version = self._schedule.running.version
            for struck_place, impulse in pressed_places(version, note_number, message.value):
                has_pressed = True
                self._strike(
                    struck_place, impulse - sounding_note.impulse_by_place.get(struck_place, 0.0)
                )
                sounding_note.impulse_by_place[struck_place] = impulse
        return has_pressed

    def _end_note(self, number: int) -> None:
        """End a note, or hold it while the pedal is down."""
        if number in self._sounding_notes and self._is_pedal_down:
            self._pedal_notes.add(number)
        elif number in self._sounding_notes:
            self._release_note(number)

    def _move_pedal(self, *, is_down: bool) -> None:
        """Move the pedal; where it comes up, notes whose keys are up end."""
        self._is_pedal_down = is_down
        for number in [] if is_down else sorted(self._pedal_notes):
            self._release_note(number)

    def _release_note(self, number: int) -> None:
        sounding_note = self._sounding_notes.pop(number)
        self._pedal_notes.discard(number)
        if sounding_note.n_panics != self._stops.n_panics:
            return
        for place, impulse in (
            *sounding_note.end_strikes,
            *(
                (pressed_place, -press_impulse)
                for pressed_place, press_impulse in sounding_note.impulse_by_place.items()
            ),
        ):
            self._strike(place, impulse)

    def _strike(self, place: Place, impulse: float) -> None:
        part, module, member = place
        strike_place = partial(self._schedule.engine.strike, place_number(place), impulse)
        strike_fields = {"part": part, "module": module, "member": member, "impulse": impulse}
        if not self._acts.request(strike_place, "strike", **strike_fields):
            self.n_lost_strikes += 1


def _constant_line(line: str, _: Version) -> str:
    """A line that is the same in every version."""
    return line
