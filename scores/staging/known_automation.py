"""What the stage before knew of automation: entries in order, and the points of modules on which
nothing acts any more. A new line changes little of both.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import chain
from typing import NamedTuple

from ergon.common.changed import Changed, changed_part
from ergon.instruments.model import Instrument, Module
from ergon.notation.clock.positions import Length, Position
from ergon.notation.clock.tempo import TempoMap
from ergon.notation.text.values import Time
from ergon.scores.pattern.values import Amount
from ergon.scores.reading.automation import Automation
from ergon.scores.reading.curves import CurvePoint
from ergon.scores.reading.piece import NoteGlide, Piece, Strikes
from ergon.scores.reading.playing import Key
from ergon.scores.staging.parameter_curves import Entry
from ergon.scores.staging.parameter_values import AutomatedModule, ModuleKey, Points

_APPROACH_SECONDS = (
    0.01  # [s] in which a value of a MIDI file is reached, so that it does not click
)


@dataclass(frozen=True, slots=True)
class ModuleTracks:
    """The entries of each parameter of a module, in order; `first_move_beat` is the beat on which
    the first one begins that is no swing.
    """

    entries: Mapping[str, list[Entry]]
    first_move_beat: float


class _ConstantPoints(NamedTuple):
    """The points of a module with these entries; nothing acts on it from beat `since_beat` on."""

    tracks: ModuleTracks
    automated_module: AutomatedModule
    since_beat: float
    points: Points
    has_moved: bool  # whether they are other values than the module's own


@dataclass(slots=True)
class KnownAutomation:
    """The memory of a chain of stages, in which each piece has nearly the automation of the line
    before.
    """

    _tempo: TempoMap | None = None
    _lines: tuple[Automation, ...] = ()
    _all_strikes: tuple[Strikes, ...] = ()
    _strikes: tuple[Strikes, ...] = ()  # those that have notes
    # The lines of each module, and those of strikes with notes.
    _lines_by_module: dict[ModuleKey, list[Automation]] = field(default_factory=dict)
    _note_lines_by_module: dict[ModuleKey, list[Automation]] = field(default_factory=dict)
    _tracks: dict[ModuleKey, ModuleTracks] = field(default_factory=dict)
    # By the id of what they are made of, which is kept with them so that no other has its id.
    _note_lines_by_id: dict[int, tuple[Strikes, list[Automation]]] = field(default_factory=dict)
    # With the module and its part, of which a key has a reach of its own.
    _automated_modules: dict[ModuleKey, tuple[Module | None, object, AutomatedModule]] = field(
        default_factory=dict
    )
    _modules: dict[str, tuple[object, dict[str, Module]]] = field(default_factory=dict)
    _constant_points: dict[ModuleKey, _ConstantPoints] = field(default_factory=dict)

    def tracks(self, piece: Piece) -> Mapping[ModuleKey, ModuleTracks]:
        """The entries of a piece by module; those of a module that did not change are the same
        object as before.
        """
        is_same_tempo = self._tempo is not None and self._tempo.is_same(piece.tempo_map)
        if is_same_tempo and piece.automation is self._lines and piece.strikes is self._all_strikes:
            return self._tracks
        self._all_strikes = piece.strikes
        strikes = tuple([line for line in piece.strikes if line.moves_pitches])
        changed_modules: set[ModuleKey] = set()
        if not is_same_tempo:
            self._lines, self._strikes, self._note_lines_by_id = (), (), {}
            changed_modules |= self._tracks.keys()
        self._tempo = piece.tempo_map
        changed_lines = changed_part(self._lines, piece.automation)
        changed_strikes = changed_part(self._strikes, strikes)
        self._lines, self._strikes = piece.automation, strikes
        removed_note_lines = [
            self._note_lines_by_id.pop(id(line)) for line in changed_strikes.before
        ]
        new_note_lines = [
            (line, [*_strike_automation(piece.tempo_map, line)]) for line in changed_strikes.now
        ]
        self._note_lines_by_id |= {
            id(line): (line, note_lines) for line, note_lines in new_note_lines
        }
        note_lines = (note_lines for _, note_lines in (*removed_note_lines, *new_note_lines))
        affected_lines = chain(changed_lines.before, changed_lines.now, *note_lines)
        changed_modules |= {module_key for line in affected_lines for module_key in line.modules}
        is_at_end = changed_lines.start + len(changed_lines.now) == len(piece.automation)
        if is_same_tempo and is_at_end:
            self._set_last_lines(changed_lines)
        elif changed_modules:
            self._set_lines(changed_modules)
        if changed_strikes or not is_same_tempo:
            self._note_lines_by_module = {}
            for automation_line in chain.from_iterable(
                self._note_lines_by_id[id(strikes_line)][1] for strikes_line in strikes
            ):
                for module_key in automation_line.modules:
                    self._note_lines_by_module.setdefault(module_key, []).append(automation_line)
        if changed_modules:
            self._set_tracks(piece.tempo_map, changed_modules)
        return self._tracks

    def _set_last_lines(self, changed_range: Changed[Automation]) -> None:
        """Set the lines of modules of which only the last ones have changed."""
        n_removed = Counter(chain.from_iterable(line.modules for line in changed_range.before))
        new_lines: dict[ModuleKey, list[Automation]] = {}
        for line in changed_range.now:
            for module_key in line.modules:
                new_lines.setdefault(module_key, []).append(line)
        for module_key in {*n_removed, *new_lines}:
            old_lines = self._lines_by_module.get(module_key, [])
            self._lines_by_module[module_key] = old_lines[
                : len(old_lines) - n_removed[module_key]
            ] + new_lines.get(module_key, [])

    def _set_lines(self, changed_modules: set[ModuleKey]) -> None:
        """Set the lines of modules whose automation has changed."""
        lines_by_module: dict[ModuleKey, list[Automation]] = {
            module_key: [] for module_key in changed_modules
        }
        for line in self._lines:
            for module_key in changed_modules.intersection(line.modules):
                lines_by_module[module_key].append(line)
        self._lines_by_module |= lines_by_module

    def _set_tracks(self, tempo: TempoMap, changed_modules: set[ModuleKey]) -> None:
        """Set the entries of modules whose lines have changed."""
        old_tracks, self._tracks = self._tracks, dict(self._tracks)
        for module_key in changed_modules:
            module_lines = [
                *self._lines_by_module.get(module_key, ()),
                *self._note_lines_by_module.get(module_key, ()),
            ]
            if not module_lines:
                self._tracks.pop(module_key, None)
                continue
            lines_by_parameter: dict[str, list[Automation]] = {}
            for line in module_lines:
                lines_by_parameter.setdefault(line.parameter, []).append(line)
            track = self._make_track(tempo, lines_by_parameter)
            old_track = old_tracks.get(module_key)
            self._tracks[module_key] = (
                old_track if old_track is not None and old_track == track else track
            )

    def _make_track(
        self, tempo: TempoMap, lines_by_parameter: Mapping[str, list[Automation]]
    ) -> ModuleTracks:
        """The entries of a module: of each parameter one lasts until the next one begins."""
        entries_by_name: dict[str, list[Entry]] = {}
        first_move_beat = math.inf
        for name, lines in lines_by_parameter.items():
            spans = sorted([_entry_span(tempo, line) for line in lines], key=lambda span: span[1])
            entries = entries_by_name[name] = []
            for index, (automation_line, begin_beat, end_beat) in enumerate(spans):
                is_last = index + 1 == len(spans)
                stop = end_beat if is_last else min(end_beat, spans[index + 1][1])
                entries += _timed_entries(tempo, Entry(automation_line, begin_beat, stop))
                if automation_line.swing is None:
                    first_move_beat = min(first_move_beat, begin_beat)
        return ModuleTracks(entries_by_name, first_move_beat)

    def automated_module(self, piece: Piece, module_key: ModuleKey) -> AutomatedModule | None:
        """A module of a piece; None if it does not exist."""
        part = piece.keys.get(module_key[0]) or piece.instruments.get(module_key[0])
        module, known_module = (
            self._module(part, module_key),
            self._automated_modules.get(module_key),
        )
        if known_module is not None:
            # The values of a key's module depend on its reach too.
            is_same = known_module[0] is module is not None and isinstance(part, Instrument)
            if is_same or known_module[1] is part:
                return known_module[2]
        new_module = AutomatedModule.from_piece(piece, module_key)
        if new_module is None:
            self._automated_modules.pop(module_key, None)
        else:
            if known_module is not None and known_module[2].is_same(new_module):
                new_module = known_module[2]
            self._automated_modules[module_key] = module, part, new_module
        return new_module

    def _module(self, part: Key | Instrument | None, module_key: ModuleKey) -> Module | None:
        """A module of a part by name; None for a part as a whole."""
        part_modules = self._modules.get(module_key[0])
        if part_modules is None or part_modules[0] is not part:
            modules = () if part is None else part.modules
            part_modules = self._modules[module_key[0]] = (
                part,
                {module.name: module for module in modules},
            )
        return part_modules[1].get(module_key[1])

    def constant_points(
        self,
        module_key: ModuleKey,
        tracks: ModuleTracks,
        automated_module: AutomatedModule,
        beat: float,
    ) -> Points | None:
        """The constant points of a module on which nothing acts from a beat on; None if that is not
        known.
        """
        known_points = self._constant_points.get(module_key)
        if (
            known_points is None
            or known_points.tracks is not tracks
            or known_points.automated_module is not automated_module
        ):
            return None
        return known_points.points if known_points.since_beat <= beat else None

    def keep_constant_points(
        self,
        module_key: ModuleKey,
        tracks: ModuleTracks,
        automated_module: AutomatedModule,
        since_beat: float,
        points: Points,
    ) -> None:
        """Keep the constant points of a module on which nothing acts from beat `since_beat` on."""
        is_moved = any(point[1:] != automated_module.written_engine_values for point in points)
        self._constant_points[module_key] = _ConstantPoints(
            tracks, automated_module, since_beat, points, is_moved
        )

    def has_moved(self, module_key: ModuleKey, path_points: Points) -> bool | None:
        """Whether these settled points are other values than the module's own; None if they are not
        settled.
        """
        known_points = self._constant_points.get(module_key)
        return (
            known_points.has_moved
            if known_points is not None and known_points.points is path_points
            else None
        )


def _entry_span(tempo: TempoMap, automation_line: Automation) -> tuple[Automation, float, float]:
    """An entry with the beats on which it begins and ends."""
    return (
        automation_line,
        tempo.resolve(automation_line.at),
        math.inf if automation_line.until is None else tempo.resolve(automation_line.until),
    )


def _timed_entries(tempo: TempoMap, automation_entry: Entry) -> Iterator[Entry]:
    """An entry; for one that follows a MIDI file a glide for each value that it has there."""
    automation_line, begin_beat, stop_beat = automation_entry
    if not automation_line.moves:
        yield automation_entry
        return
    glides = [
        (glide, tempo.resolve(glide.at))
        for glide in _file_glides(tempo, automation_line, begin_beat)
    ]
    beats = [beat for _, beat in glides if beat < stop_beat]
    for (glide, beat), next_beat in zip(glides, [*beats[1:], stop_beat], strict=False):
        yield Entry(glide, beat, next_beat)


def _file_glides(
    tempo: TempoMap, automation_line: Automation, start_beat: float
) -> Iterator[Automation]:
    """A glide for each value of a MIDI file that begins on beat `start_beat`, which ends where the
    file has it.
    """
    last_instant = tempo.seconds(start_beat)
    for length, amount in automation_line.moves:
        instant = tempo.seconds(tempo.after(start_beat, length))
        glide_begin = max(last_instant, instant - _APPROACH_SECONDS)
        yield replace(
            automation_line,
            at=Position(plus=Length(beats=tempo.beats(glide_begin))),
            points=(CurvePoint(Time(), amount, "line"),),
            over=Length(seconds=instant - glide_begin) if instant > glide_begin else None,
            moves=(),
        )
        last_instant = instant


def _strike_automation(tempo: TempoMap, strikes_line: Strikes) -> Iterator[Automation]:
    """Automation of the pitches of what is struck."""
    if strikes_line.pattern is not None:
        yield from _note_automation(tempo, strikes_line)
    for beat in strikes_line.rounds(tempo) if strikes_line.glides else ():
        for glide in strikes_line.glides:
            yield from _wheel_automation(tempo, strikes_line, glide, beat)


def _wheel_automation(
    tempo: TempoMap, strikes_line: Strikes, glide: NoteGlide, start_beat: float
) -> Iterator[Automation]:
    """Automation by a pitch wheel in a phrase that begins on beat `start_beat`."""
    wheel_entry = Automation(
        glide.target,
        "f",
        Position(),
        until=None,
        every=None,
        times=None,
        pattern=None,
        amounts={},
        swing=None,
        place=glide.target.place,
        begin_place=glide.target.place,
        strikes_name=strikes_line.draw_key,
        moves=tuple((length, Amount(factor, is_factor=True)) for length, factor in glide.points),
    )
    yield from _file_glides(tempo, wheel_entry, start_beat)


def _note_automation(tempo: TempoMap, strikes_line: Strikes) -> Iterator[Automation]:
    """Automation of the pitches of strikes that have notes."""
    assert strikes_line.pattern is not None
    until_position = strikes_line.until
    if strikes_line.span is not None:
        until_position = Position(
            plus=Length(beats=tempo.after(tempo.resolve(strikes_line.at), strikes_line.span))
        )
    pattern = replace(strikes_line.pattern, chance=None)
    for target in strikes_line.to:
        automation_arguments = (
            target,
            "f",
            strikes_line.at,
            until_position,
            strikes_line.every,
            strikes_line.times,
            pattern,
            strikes_line.notes,
        )
        yield Automation(
            *automation_arguments,
            None,
            strikes_line.place,
            strikes_line.place,
            strikes_line.draw_key,
        )
