"""Gestures and takes of a piece: its own, and those of other files that something plays."""

from __future__ import annotations

from ergon.notation.tables.fields import Values
from ergon.notation.tables.shapes import Name
from ergon.notation.tables.value_kinds import AXES
from ergon.notation.text.errors import quote
from ergon.notation.text.values import Place
from ergon.scores.gesture.notation import MAX_EVENTS
from ergon.scores.reading import build, melodies, midi_gesture
from ergon.scores.reading.playing import Gesture, TakeFile
from ergon.scores.reading.uses import Entry, Names, Uses, with_name


class GesturesAndTakes:
    """What players can play, by name; each is made when something in the piece plays it."""

    def __init__(self, names: Names, uses: Uses) -> None:
        """Take what was read."""
        self._tables = names.tables
        self._uses = uses
        self._collector = uses.collector
        self._gestures_by_name: dict[str, Gesture | None] = {}
        self._axis_names_by_path: dict[
            str, tuple[str, ...]
        ] = {}  # gestures in space: the names of their axes
        self._n_points_left = MAX_EVENTS  # points that gestures may still have
        self.takes: dict[str, TakeFile] = {}
        self.has_quarters = True  # whether every beat of the piece is a quarter note

    @property
    def gestures(self) -> dict[str, Gesture]:
        """The gestures without mistakes."""
        return {
            name: gesture for name, gesture in self._gestures_by_name.items() if gesture is not None
        }

    def add_defined(self, section_place: Place) -> None:
        """Make the gestures and takes that the score itself defines; `section_place` is that of the
        score.
        """
        for defined_name, named_entry in self._tables["gestures"].items():
            if named_entry.brought_place is None:
                self._add_gesture(defined_name, named_entry)
            if defined_name in self._tables["takes"]:
                message = (
                    f"{quote(defined_name)} is the name of a gesture and of a take; rename one of "
                    "them"
                )
                self._collector.error("E303", message, named_entry.place or section_place)
        for defined_name, named_entry in self._tables["takes"].items():
            if named_entry.brought_place is None:
                self.add_take(defined_name, named_entry)

    def make(self, name: str) -> bool:
        """Make the gesture or take of a name; False if there is none."""
        gestures, takes = self._tables["gestures"], self._tables["takes"]
        if name in gestures:
            self._add_gesture(name, gestures[name])
        elif self._is_axis(name):
            pass
        elif name in takes and melodies.has_note_file(takes[name].values):
            self._add_pressed_gesture(name, takes[name])
        elif name in takes:
            self.add_take(name, takes[name])
        else:
            return False
        return True

    def make_named(self, name: Name, label: str) -> bool:
        """Make what `label` plays; False if an error was reported because nothing has that name."""
        is_there = self.make(name)
        if name in self._axis_names_by_path:
            axes = ", ".join(self._axis_names_by_path[name])
            message = f"{label}: {quote(name)} is a path in space; play one of its axes: {axes}"
            self._collector.error("E304", message, name.place)
        elif not is_there:
            message = f"{label}: no gesture or take is called {quote(name)}"
            names = (*self._tables["gestures"], *self.gestures, *self._tables["takes"])
            self._collector.error("E301", message, name.place, word=str(name), names=names)
        return is_there

    def add_take(self, name: str, entry: Entry) -> None:
        """Make a take, unless it is a MIDI file: strikes and keys play the notes of a MIDI file."""
        if name not in self.takes and isinstance(entry.values, Values):
            take_built = build.take(entry.values, self._uses.files)
            if take_built is not None and not melodies.has_note_file(entry.values):
                self.takes[name] = with_name(take_built, name)

    def _add_gesture(self, name: str, entry: Entry) -> None:
        if name not in self._gestures_by_name:
            values, _ = self._uses.resolved("gestures", entry)
            gestures_built = (
                build.gestures(values, self._n_points_left) if values is not None else None
            )
            self._keep(name, (gestures_built or {}).get(""))
            axis_gestures = {
                f"{name}.{axis}": gesture_of_axis
                for axis, gesture_of_axis in (gestures_built or {}).items()
                if axis
            }
            for axis_path, gesture_of_axis in axis_gestures.items():
                self._keep(axis_path, gesture_of_axis)
            if axis_gestures:
                self._axis_names_by_path[name] = tuple(axis_gestures)

    def _is_axis(self, gesture_name: str) -> bool:
        """Whether a name is that of an axis of a path in space, or of a path that has mistakes."""
        path_name, _, axis = gesture_name.rpartition(".")
        gesture_entry = self._tables["gestures"].get(path_name)
        if gesture_entry is None or axis not in AXES:
            return False
        self._add_gesture(path_name, gesture_entry)
        return gesture_name in self._gestures_by_name or (
            self._gestures_by_name[path_name] is None and path_name not in self._axis_names_by_path
        )

    def _add_pressed_gesture(self, name: str, entry: Entry) -> None:
        """Make a gesture of a MIDI take that a hand plays."""
        if name not in self._gestures_by_name:
            self.add_take(name, entry)
            self._uses.midi_uses.register_played(entry.values, has_lengths=False)
            files, room = self._uses.files, self._n_points_left
            self._keep(
                name, midi_gesture.gesture_of_take(entry.values, files, room, self.has_quarters)
            )

    def _keep(self, name: str, gesture: Gesture | None) -> None:
        self._gestures_by_name[name] = with_name(gesture, name) if gesture else None
        self._n_points_left -= len(gesture.points) if gesture else 0
