"""The tempo map of a score, and whether every position in it exists."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from ergon.common.changed import changed_part
from ergon.notation.clock.positions import Position
from ergon.notation.clock.tempo import NO_FILE, Entry, FileTimes, TempoError, TempoMap
from ergon.notation.tables.fields import Values
from ergon.notation.tables.named_values import named_amounts
from ergon.notation.tables.shapes import MISSING
from ergon.notation.text.errors import Collector, TextError, quote
from ergon.notation.text.memory import Memory
from ergon.notation.text.values import Place
from ergon.scores.gesture.note_files import meters_of, tempos_of
from ergon.scores.reading import build
from ergon.scores.reading.known_plays import KnownPlays
from ergon.scores.reading.midi_uses import MidiUses
from ergon.scores.reading.mixing import FadePoint, PanPoint
from ergon.scores.reading.piece import Mark, Piece, TempoEntry


class Times:
    """Tempo entries and marks of a score; `tempo_map` is a default one if they contain errors."""

    def __init__(
        self, score: Values, collector: Collector, memory: Memory | None, midi_uses: MidiUses
    ) -> None:
        """Read them and make the map. `memory` keeps what was checked before at the same times."""
        self.collector = collector
        tempo_lines = tuple(
            [line_values for line_values in score["tempo"] or () if isinstance(line_values, Values)]
        )
        marks_node, score_file = score.nodes.get("marks"), score.node.document.file
        self._mark_names = tuple(score["marks"] or {})
        self._value_names = named_amounts(score.node.document).names
        old_times = (
            None if memory is None else memory.held(f"tempo {score_file}", self._value_names)
        )
        self.file_times = _times_of_files(tempo_lines, score["meter"], midi_uses)
        if (
            old_times is None
            or old_times[0] is not marks_node
            or old_times[2] != self.file_times
            or changed_part(old_times[1], tempo_lines)
        ):
            tempos = self.file_times.tempos
            self._lines = [
                (
                    line_values,
                    build.tempo(line_values, tempos if line_values.written("from") else ()),
                )
                for line_values in tempo_lines
            ]
            nodes = getattr(marks_node, "entries", {})
            valid_marks = tuple(
                Mark(name, position, nodes[name][1].place)
                for name, position in sorted((score["marks"] or {}).items())
                if position is not MISSING
            )
            self.marks = valid_marks
            old_times = (
                marks_node,
                tempo_lines,
                self.file_times,
                self._lines,
                valid_marks,
                self._make_map(),
            )
            if memory is not None and old_times[-1] is not None:
                memory.hold(f"tempo {score_file}", self._value_names, old_times)
        _, _, _, self._lines, self.marks, known_map = old_times
        self.entries: tuple[TempoEntry, ...] = tuple(entry for _, entry in self._lines)
        self._has_map = known_map is not None
        # With mistakes in tempo or marks no position is known; each mark is somewhere.
        self.tempo_map = known_map or TempoMap((), {name: Position() for name in self._mark_names})
        entries_key = [
            (
                tempo_entry.at,
                tempo_entry.bpm,
                tempo_entry.bpm_end,
                tempo_entry.over,
                tempo_entry.meter,
            )
            for tempo_entry in self.entries
        ]
        mark_positions = [(mark.name, mark.at) for mark in self.marks]
        self.known_plays = KnownPlays(
            memory, score_file, (entries_key, self.file_times, mark_positions)
        )

    def _make_map(self) -> TempoMap | None:
        """The map; None if an error was reported."""
        positions_by_mark = {mark.name: mark.at for mark in self.marks}
        is_valid = True
        for mark in self.marks:
            is_valid &= self._mark_exists(mark.at, mark.place)
        for line_number, (line_values, tempo_entry) in enumerate(self._lines):
            if line_values.written("from"):
                is_valid &= self._is_single_file_line(line_values, line_number)
            is_valid &= self._mark_exists(tempo_entry.at, line_values.place_of("at"))
            is_valid &= all(
                name in line_values.by_name for name in line_values.nodes
            )  # a missing one was reported
        if not is_valid or len(positions_by_mark) != len(self._mark_names):
            return None
        tempo_entries = [
            Entry(entry.at, entry.bpm, entry.bpm_end, entry.over, entry.meter)
            for _, entry in self._lines
        ]
        try:
            return TempoMap(tempo_entries, positions_by_mark, self.file_times)
        except TempoError as error:
            line_values = self._lines[error.entry][0]
            self.collector.error(
                "E305", f"tempo: {error.message}", line_values.place_of(error.field)
            )
        except TextError as error:  # marks in a circle, or a position before 0
            line_values = self._lines[
                _first_unresolved(tempo_entries, positions_by_mark, self.file_times)
            ][0]
            self.collector.error("E305", f"tempo: {error.message}", line_values.place_of("at"))
        return None

    def _is_single_file_line(self, values: Values, number: int) -> bool:
        """Whether a line with the tempos of a file is the first and says no more; reports an error
        if not.
        """
        if number:
            message = "tempo: a file is named in the first line; lines below say what differs"
            values.error("E305", message, "from")
            return False
        for field_name in (extra_names := [name for name in values.nodes if name != "from"]):
            message = (
                f"{values.context.label(field_name)}: a file says the tempos from the beginning "
                "on; "
            )
            values.error("E111", f"{message}write this in a line of its own below", field_name)
        return not extra_names

    def _mark_exists(self, marked_position: Position, position_place: Place) -> bool:
        if marked_position.mark is None or marked_position.mark in self._mark_names:
            return True
        suggestion_text, help_text = self._unknown_mark_advice(marked_position.mark)
        self.collector.error(
            "E301",
            f"no mark is called {quote(marked_position.mark)}",
            Place(
                position_place.file,
                position_place.line,
                position_place.column,
                len(marked_position.mark),
            ),
            suggestion=suggestion_text,
            help=help_text,
            word=None if help_text else marked_position.mark,
            names=self._mark_names,
        )
        return False

    def _unknown_mark_advice(self, position_word: str) -> tuple[str | None, str | None]:
        """A suggestion for an unknown mark such as `c-gap` if `c` is a mark, or else a help
        text.
        """
        words = position_word.split("-")
        for word_count in range(len(words) - 1, 0, -1):
            mark_name, unit_parts = "-".join(words[:word_count]), words[word_count:]
            if mark_name not in self._mark_names:
                continue
            if all(part in self._value_names for part in unit_parts):
                return " - ".join((mark_name, *unit_parts)), None
            if "-".join(unit_parts) in self._mark_names:
                return (
                    None,
                    f"a mark is not a length; write how far before it, such as {mark_name}-1bar",
                )
        return None, None

    def _beat_of(self, position: Position | None, place: Callable[[], Place]) -> float | None:
        """The beat of a position; None if there is none, or if an error was reported."""
        if position is None or (
            position.mark is not None and not self._mark_exists(position, place())
        ):
            return None
        if not self._has_map:
            return None
        try:
            return self.tempo_map.resolve(position)
        except TextError as error:
            self.collector.error("E305", error.message, place())
            return None

    def exists(self, position: Position, place: Place) -> bool:
        """Whether a position exists; reports an error if not."""
        return self._beat_of(position, lambda: place) is not None

    def check_piece(self, score: Values, piece: Piece) -> list[float]:
        """Check that every position in the piece exists, and that nothing ends before it begins.

        Returns the beats on which the lines of the parts begin; 0 if an error was reported.
        """
        for mark in self.marks:
            self._beat_of(mark.at, lambda mark=mark: mark.place)  # type: ignore[misc]
        begin_beats = self._begin_beats(piece)
        sections = score["strikes"] or {}, score["duet"] or (), score["automation"] or ()
        self._check_sections(*sections)
        for strikes in piece.strikes:
            for hit in strikes.hits:
                if isinstance(hit.at, Position):
                    self._beat_of(hit.at, lambda h=hit: h.place)  # type: ignore[misc]
        routes = piece.mix.routes
        timed_points: list[FadePoint | PanPoint] = [
            point for route in routes for point in route.fade
        ]
        timed_points += [point for route in routes for point in route.pan_path]
        timed_points += piece.mix.master.fade if piece.mix.master else ()
        for point in timed_points:
            self._beat_of(point.at, lambda point=point: point.place)  # type: ignore[misc]
        for part in piece.instruments.values():
            for module in part.modules:
                if isinstance(position := module.fields.get("at"), Position):
                    self._beat_of(position, lambda m=module: m.places["at"])  # type: ignore[misc]
        return begin_beats

    def _check_sections(
        self, strikes: Mapping[str, Any], duet: Sequence[Any], automation: Sequence[Any]
    ) -> None:
        """Check where the entries of these sections begin and end."""
        for section_name, section_entries in (
            ("strikes", (*strikes.values(),)),
            ("duet", duet),
            ("automation", automation),
        ):
            checked_values = self.known_plays.recall(f"checked {section_name}", section_entries)
            for entry_index in checked_values.unknown_indices:
                entry_values, n_reports = section_entries[entry_index], self.collector.n_reports
                if isinstance(entry_values, Values):
                    position, end_position = entry_values["at"], entry_values["until"]
                    begin_beat = self._beat_of(position, lambda v=entry_values: v.place_of("at"))  # type: ignore[misc]
                    end_beat = self._beat_of(
                        end_position,
                        lambda v=entry_values: v.place_of("until"),  # type: ignore[misc]
                    )
                    self._check_order(begin_beat, end_beat, entry_values.place_of("until"))
                if self.collector.n_reports == n_reports:
                    checked_values.values[entry_index] = True
            self.known_plays.keep_values(f"checked {section_name}", checked_values)

    def _begin_beats(self, piece: Piece) -> list[float]:
        """The beats on which the lines of the parts begin; 0 if an error was reported."""
        known_beats = self.known_plays.recall("begins", piece.parts)
        begin_beats = known_beats.values
        for entry_index in known_beats.unknown_indices:
            play, n_reports = piece.parts[entry_index], self.collector.n_reports
            start_beat = self._beat_of(play.at, lambda play=play: play.begin_place)  # type: ignore[misc]
            if play.until is not None:
                end_beat = self._beat_of(play.until, lambda play=play: play.until_place)  # type: ignore[misc]
                self._check_order(start_beat, end_beat, play.until_place or play.place)
            if self.collector.n_reports == n_reports:
                begin_beats[entry_index] = start_beat or 0.0
        self.known_plays.keep_values("begins", known_beats)
        if all(begin_beats[number] is not None for number in known_beats.unknown_indices):
            return begin_beats
        return [beat or 0.0 for beat in begin_beats]

    def _check_order(self, begin_beat: float | None, end_beat: float | None, place: Place) -> None:
        if begin_beat is not None and end_beat is not None and end_beat <= begin_beat:
            self.collector.error("E305", "`until` must be later than `at`", place)


def _times_of_files(lines: Sequence[Values], meter: Any, midi_uses: MidiUses) -> FileTimes:
    """What the MIDI files say that `tempo:` and `meter:` name; mistakes are reported."""
    file_values = next((values for values in lines if values.written("from")), None)
    tempos = (
        () if file_values is None else midi_uses.read_times(file_values, tempos_of, is_tempo=True)
    )
    meters = (
        ()
        if not isinstance(meter, Values)
        else midi_uses.read_times(meter, meters_of, is_tempo=False)
    )
    return FileTimes(tempos or (), meters or ()) if tempos or meters else NO_FILE


def _first_unresolved(
    tempo_entries: list[Entry], marks: dict[str, Position], file_times: FileTimes
) -> int:
    """The index of the first entry whose position cannot be resolved: entries up to and including
    it fail.
    """

    def fails(count: int) -> bool:
        try:
            TempoMap(tempo_entries[:count], marks, file_times)
        except TextError:
            return True
        return False

    return bisect_left(range(1, len(tempo_entries) + 1), True, key=fails)
