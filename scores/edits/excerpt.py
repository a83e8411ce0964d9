"""Keeps some bars of a score as a score of their own.

The kept score has the same keys, instruments, gestures and mix, and only those bars in its
parts, from 1|1 to its mark `end`: it can be checked, rendered, loaded, copied from, or brought
back as a scene.
"""

from __future__ import annotations

import math

from ergon.notation.clock.meter import SAME
from ergon.notation.clock.occurrences import starts
from ergon.notation.clock.positions import Length
from ergon.notation.tables import quantities
from ergon.notation.text import edit
from ergon.notation.text.document import Mapping, Scalar
from ergon.notation.text.edit import EditError
from ergon.scores.edits import entries, space
from ergon.scores.edits.automation import ValueAtBeat, value_text
from ergon.scores.edits.lists import entry_path, section_entries, without_entry
from ergon.scores.edits.scenes import END_MARK
from ergon.scores.edits.strikes import melody_between
from ergon.scores.edits.texts import Texts
from ergon.scores.pattern.search import n_before
from ergon.scores.reading.automation import Automation
from ergon.scores.reading.piece import Piece, Strikes


def excerpt_between(
    score_texts: Texts,
    piece: Piece,
    excerpt_name: str,
    start_beat: float,
    stop_beat: float,
    value_on: ValueAtBeat | None = None,
) -> Texts:
    """A score of the entries that begin between two beats; it begins at the first beat.

    `value_on` gives the values of glides that began before.

    Raises EditError if nothing begins there.
    """
    window = _Window(piece, start_beat, stop_beat, value_on)
    excerpt_texts = score_texts.put(("title",), edit.quoted(excerpt_name))
    is_included = False
    excerpt_changes = []
    for player in piece.players:
        placed_entries = entries.placed_entries(score_texts, piece, player)
        entries_in_excerpt = [
            entry for line in placed_entries if (entry := window.entry_excerpt(line)) is not None
        ]
        is_included = is_included or bool(entries_in_excerpt)
        excerpt_changes.append(
            entries.PartEdit(
                player, removed_entries=placed_entries, added_entries=entries_in_excerpt
            )
        )
    excerpt_texts = entries.with_part_edits(excerpt_texts, *excerpt_changes)
    for strikes in piece.strikes:
        excerpt_texts, has_strikes = window.cut_strikes(excerpt_texts, strikes)
        is_included = is_included or has_strikes
    if not is_included:
        start_text, stop_text = (
            piece.tempo_map.written(start_beat),
            piece.tempo_map.written(stop_beat),
        )
        raise EditError(f"no gesture begins from {start_text} to {stop_text}")
    excerpt_texts = space.with_excerpt_fades(excerpt_texts, piece, start_beat)
    end_text = window.position(stop_beat)
    end_text = end_text if "|" in end_text else f"{end_text}beats"
    excerpt_texts = window.cut_automation(window.cut_couplings(excerpt_texts)).put(
        ("marks", END_MARK), end_text
    )
    if piece.render.file is not None:
        excerpt_texts = excerpt_texts.put(("render", "file"), edit.quoted(f"{excerpt_name}.wav"))
    # Write the tempo last: the other edits read positions by the old tempo map.
    return window.write_tempo(excerpt_texts)


_GLIDE_CHORDS = 32  # pieces of a glide that is cut


class _Window:
    """The beats from `start_beat` to `stop_beat` of a piece, counted from `start_beat`."""

    def __init__(
        self, piece: Piece, start_beat: float, stop_beat: float, value_on: ValueAtBeat | None
    ) -> None:
        self.piece = piece
        self.value_on = value_on
        self.tempo_map = piece.tempo_map
        self.start_beat = start_beat
        self.stop_beat = stop_beat

    def beats_within(self, beats: list[float]) -> list[float]:
        return [beat for beat in beats if self.start_beat - SAME <= beat < self.stop_beat - SAME]

    def position(self, beat_of_piece: float) -> str:
        """A beat of the piece as a position in the window: `bar|beat`, or beats if the window does
        not begin on a bar.
        """
        beats_from_start = max(0.0, beat_of_piece - self.start_beat)
        bar, _ = self.tempo_map.bar_beat(self.start_beat)
        beat_bar, beat = self.tempo_map.bar_beat(self.start_beat + beats_from_start)
        if abs(self.tempo_map.bars.start(bar) - self.start_beat) < SAME:
            return f"{beat_bar - bar + 1}|{beat:.12g}"
        return f"{beats_from_start:.12g}"  # the window does not begin on a bar: count beats alone

    def entry_excerpt(self, placed_entry: entries.PlacedEntry) -> entries.Entry | None:
        """The entry with only its beginnings in the window; None if there are none."""
        if placed_entry.start_beats is None:
            if not self.beats_within([placed_entry.begin_beat]):
                return None
            part_entry = placed_entry.entry.with_fields(at=self.position(placed_entry.begin_beat))
            if placed_entry.play.until is None:
                return part_entry
            return part_entry.with_fields(
                until=self.position(
                    min(self.stop_beat, self.tempo_map.resolve(placed_entry.play.until))
                )
            )
        first_start, stop_start = (
            placed_entry.count_before(self.start_beat),
            placed_entry.count_before(self.stop_beat),
        )
        return (
            placed_entry.entry_between(first_start, stop_start, self.position)
            if first_start < stop_start
            else None
        )

    def cut_strikes(self, texts: Texts, strikes: Strikes) -> tuple[Texts, bool]:
        """Strikes cut to the window, and whether any fall in it."""
        path = ("strikes", strikes.name)
        begin_beat = self.tempo_map.resolve(strikes.at)
        if strikes.is_melody and strikes.length is None:
            hit_beats = [
                beat
                for beat, *_ in strikes.played_hits(self.piece, self.start_beat, self.stop_beat)
            ]
            excerpt_texts = melody_between(
                texts, self.piece, strikes, self.start_beat, self.stop_beat, self.position
            )
            return excerpt_texts, bool(self.beats_within(hit_beats))
        stop_beat = begin_beat if strikes.until is None else self.tempo_map.resolve(strikes.until)
        if strikes.span is not None:
            stop_beat = self.tempo_map.after(begin_beat, strikes.span)
        changed_fields: dict[str, str | None] = {"for": None, "until": None}
        if strikes.passing is not None:  # `for` is the time of one pass
            del changed_fields["for"]
        if strikes.pattern is not None:
            place_beats = strikes.place_beats(self.piece)
            first_place, stop_place = (
                n_before(place_beats, bound - SAME) for bound in (self.start_beat, self.stop_beat)
            )
            if first_place == stop_place:
                return texts.remove(path), False
            changed_fields |= place_beats.excerpt_fields(first_place, stop_place, self.position)
        elif strikes.rate is not None:
            first_beat, last_beat = max(begin_beat, self.start_beat), min(stop_beat, self.stop_beat)
            if last_beat <= first_beat + SAME:
                return texts.remove(path), False
            changed_fields |= {"at": self.position(first_beat), "until": self.position(last_beat)}
        else:
            end_beat = stop_beat if strikes.until is not None or strikes.span is not None else None
            step_length, strike_times = strikes.every, strikes.times
            start_beats = (
                strikes.rounds(self.tempo_map)
                if strikes.has_rounds
                else starts(
                    self.tempo_map,
                    begin_beat,
                    Length(),
                    every=step_length,
                    times=strike_times,
                    until=end_beat,
                )
            )
            starts_inside = self.beats_within(start_beats)
            if not starts_inside:
                return texts.remove(path), False
            changed_fields |= {"at": self.position(starts_inside[0])}
            if step_length is not None or strikes.has_rounds:
                changed_fields |= {"times": str(len(starts_inside))}
        return self._with_fields(texts, path, changed_fields), True

    def cut_couplings(self, texts: Texts) -> Texts:
        """Couplings cut to the window."""
        for entry_index in reversed(range(len(self.piece.duet))):
            coupling = self.piece.duet[entry_index]
            begin_beat = self.tempo_map.resolve(coupling.at)
            end_beat = (
                self.stop_beat if coupling.until is None else self.tempo_map.resolve(coupling.until)
            )
            if begin_beat >= self.stop_beat - SAME or end_beat <= self.start_beat + SAME:
                texts = without_entry(texts, "duet", entry_index)
                continue
            end_position = (
                self.position(end_beat)
                if coupling.until is not None and end_beat < self.stop_beat
                else None
            )
            fields = {"at": self.position(begin_beat), "until": end_position}
            texts = self._with_fields(texts, entry_path(texts, "duet", entry_index), fields)
        return texts

    def cut_automation(self, score_texts: Texts) -> Texts:
        """Automation cut to the window."""
        for entry_index in reversed(range(len(self.piece.automation))):
            automation_entry = self.piece.automation[entry_index]
            begin_beat = self.tempo_map.resolve(automation_entry.at)
            end_beat = (
                math.inf
                if automation_entry.until is None
                else self.tempo_map.resolve(automation_entry.until)
            )
            entry_fields: dict[str, str | None] = {"at": self.position(begin_beat)}
            if automation_entry.points:
                score_texts = self._cut_glide(
                    score_texts, entry_index, automation_entry, begin_beat, end_beat
                )
                continue
            place_beats = (
                None
                if automation_entry.pattern is None
                else automation_entry.place_beats(self.tempo_map, self.piece.seed)
            )
            if place_beats is not None:
                end_beat = min(end_beat, place_beats.beat(len(place_beats)))
            if begin_beat >= self.stop_beat - SAME or end_beat <= self.start_beat + SAME:
                score_texts = without_entry(score_texts, "automation", entry_index)
                continue
            if end_beat < math.inf:
                entry_fields["until"] = self.position(min(end_beat, self.stop_beat))
            if begin_beat < self.start_beat - SAME and place_beats is not None:
                first_place = n_before(place_beats, self.start_beat - SAME)
                if first_place == len(place_beats):
                    score_texts = without_entry(score_texts, "automation", entry_index)
                    continue
                entry_fields |= place_beats.excerpt_fields(
                    first_place, len(place_beats), self.position
                )
                entry_fields["until"] = self.position(min(end_beat, self.stop_beat))
            elif begin_beat < self.start_beat - SAME and automation_entry.swing is not None:
                period = (
                    self.tempo_map.after(begin_beat, automation_entry.swing.period) - begin_beat
                )
                phase = (
                    automation_entry.swing.phase + (self.start_beat - begin_beat) / period
                ) % 1.0
                entry_fields["phase"] = f"{phase:.12g}"
            elif begin_beat < self.start_beat - SAME and automation_entry.moves:
                node = section_entries(score_texts, "automation")[entry_index]
                start_node = node.get("start") if isinstance(node, Mapping) else None
                start_quarters = (
                    quantities.quantity(start_node.text, quantities.RATIO)
                    if isinstance(start_node, Scalar)
                    else 0.0
                )
                quarters_past = self.tempo_map.bars.quarters(
                    self.start_beat
                ) - self.tempo_map.bars.quarters(begin_beat)
                entry_fields["start"] = f"{start_quarters + quarters_past:.12g}"
            score_texts = self._with_fields(
                score_texts, entry_path(score_texts, "automation", entry_index), entry_fields
            )
        return score_texts

    def _cut_glide(
        self,
        score_texts: Texts,
        entry_index: int,
        automation_entry: Automation,
        begin_beat: float,
        end_beat: float,
    ) -> Texts:
        """A glide cut to the window: one that began before becomes a curve."""
        if begin_beat >= self.stop_beat - SAME or end_beat <= self.start_beat + SAME:
            return without_entry(score_texts, "automation", entry_index)
        entry_fields: dict[str, str | None] = {"at": self.position(begin_beat)}
        if end_beat < math.inf:
            entry_fields["until"] = self.position(min(end_beat, self.stop_beat))
        if begin_beat < self.start_beat - SAME and self.value_on is not None:
            entry_fields |= {"at": self.position(self.start_beat), "over": None, "curve": None}
            piece, module_key, tempo = (
                self.piece,
                (automation_entry.target.part, automation_entry.target.module),
                self.tempo_map,
            )
            if automation_entry.over is not None:
                glide_end_beat = tempo.after(begin_beat, automation_entry.over)
            else:
                glide_end_beat = tempo.beats(
                    tempo.instant(begin_beat, automation_entry.points[-1].at)
                )
            seconds_left = tempo.seconds(max(glide_end_beat, self.start_beat)) - tempo.seconds(
                self.start_beat
            )
            glide_points = []
            for step in range(_GLIDE_CHORDS + 1 if seconds_left > 0.0 else 1):
                glide_offset = seconds_left * step / _GLIDE_CHORDS
                beat = tempo.beats(tempo.seconds(self.start_beat) + glide_offset)
                value = self.value_on(self.piece, module_key, automation_entry.parameter, beat)
                value_word = value_text(piece, automation_entry.name, value, self.value_on)
                glide_points.append(f"{value_word}@{glide_offset:.12g}s")
            entry_fields["to"] = " line ".join(glide_points)
        return self._with_fields(
            score_texts, entry_path(score_texts, "automation", entry_index), entry_fields
        )

    def write_tempo(self, texts: Texts) -> Texts:
        """Write the tempo and meter at the start of the window, and the changes that follow."""
        _, _, meter = [
            meter_change
            for meter_change in self.tempo_map.bars.changes()
            if meter_change[0] <= self.start_beat + SAME
        ][-1]
        first_entry: dict[str, edit.Tree] = {
            "at": "1|1",
            "bpm": f"{self.tempo_map.bpm(self.start_beat):.12g}",
        }
        first_entry["meter"] = str(meter)
        tempo_entries = [first_entry]
        for begin_beat, tempo_entry in self.tempo_map.entries_by_beat:
            end_beat = (
                begin_beat
                if tempo_entry.over is None
                else self.tempo_map.after(begin_beat, tempo_entry.over)
            )
            if (
                begin_beat >= self.stop_beat - SAME
                or max(begin_beat, end_beat) <= self.start_beat + SAME
            ):
                continue
            if tempo_entry.bpm is None and tempo_entry.meter is None:
                continue
            if begin_beat <= self.start_beat + SAME:  # a ramp under way goes on
                first_entry["bpm"] = f"{first_entry['bpm']} -> {tempo_entry.bpm_end:.12g}"
                first_entry["over"] = f"{end_beat - self.start_beat:.12g}"
                continue
            later_entry: dict[str, edit.Tree] = {"at": self.position(begin_beat)}
            if tempo_entry.bpm is not None:
                is_ramp = tempo_entry.bpm_end is not None
                later_entry["bpm"] = f"{tempo_entry.bpm:.12g}" + (
                    f" -> {tempo_entry.bpm_end:.12g}" if is_ramp else ""
                )
            if tempo_entry.over is not None:
                later_entry["over"] = f"{end_beat - begin_beat:.12g}"
            if tempo_entry.meter is not None:
                later_entry["meter"] = str(tempo_entry.meter)
            tempo_entries.append(later_entry)
        for section in ("tempo", "meter"):  # tempos and meters from files are written out
            if section_entries(texts, section):
                texts = texts.remove((section,))
        for entry_change in tempo_entries:
            texts = texts.append(("tempo",), edit.flow(entry_change))
        return texts

    def _with_fields(
        self, score_texts: Texts, path: edit.Path, entry_fields: dict[str, str | None]
    ) -> Texts:
        """Set fields of an entry; None removes a field."""
        for field_name, text in entry_fields.items():
            if text is not None:
                score_texts = score_texts.put((*path, field_name), text)
                continue
            try:
                score_texts = score_texts.remove((*path, field_name))
            except EditError:  # the field is not written
                continue
        return score_texts
