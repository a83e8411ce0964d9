"""What the words of a melody strike: notes of instruments, or modules by full names."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from ergon.instruments.model import Target
from ergon.instruments.names import PartNames
from ergon.notation.tables import notes, tuning
from ergon.notation.tables.quantities import note_slip
from ergon.notation.tables.shapes import Name
from ergon.notation.tables.tuning import Tuning
from ergon.notation.text.errors import TextError, quote
from ergon.scores.reading.melody import Row


@dataclass(frozen=True, slots=True)
class NoteTargets:
    """The targets of the words of a melody: notes of `instruments`, or modules by full
    names.
    """

    part_names: PartNames
    instruments: tuple[Name, ...]
    _targets_by_name: dict[str, list[Target]] = field(
        default_factory=dict, init=False, compare=False
    )

    def mirrored(self, phrase_row: Row, first_row: Row) -> Row:
        """A row mirrored in pitch about the first note of a phrase. Raises TextError."""
        note_pitches = (self._note_pitch(word) for word in first_row.struck_names)
        mirror_pitch = next((pitch for pitch in note_pitches if pitch is not None), None)
        if mirror_pitch is None:
            raise TextError(
                f"{quote(' '.join(first_row.struck_names))} has no note to mirror about"
            )
        mirrored_names = [
            self.transposed(word, 2 * (mirror_pitch - (self._note_pitch(word) or 0)))
            for word in phrase_row.struck_names
        ]
        return self.with_names(phrase_row, mirrored_names)

    def with_names(self, row: Row, new_names: Sequence[Name]) -> Row:
        """A row with other notes; `before` keeps those that were written."""
        return replace(
            row, struck_names=tuple(new_names), written_names=row.written_names or row.struck_names
        )

    def transposed(self, word: Name, semitones: float) -> Name:
        """A note, or a module of one, moved by semitones; in a tuning of keys an integer counts
        keys. Raises TextError.
        """
        note_pitch = self._note_pitch(word)
        if note_pitch is None:
            raise TextError(f"{quote(word)} has no note that could be transposed")
        if not notes.LOWEST <= note_pitch + semitones <= notes.HIGHEST:
            raise TextError(f"{quote(word)} lies outside the notes from C-1 to B9")
        note_words = tuning.spelled(word).split(".")
        note_index = self._note_word_index(note_words)
        with tuning.used(self._tuning(note_words)):
            note_words[note_index] = notes.moved(note_words[note_index], semitones)
        return Name(".".join(note_words), word.place)

    def has_act(self, act: str) -> bool:
        """Whether a note of the instruments has an act that lasts as long as a note."""
        members = (
            member for name in self.instruments for member in self.part_names.member_names(name)
        )
        return any(True for member in members for _ in self.part_names.drawn_act_names(member, act))

    def targets(self, row: Row, strikes_label: str) -> tuple[Target, ...]:
        """The MATs that a row strikes; reports what cannot be reached."""
        name_pairs = zip(row.struck_names, row.written_names or row.struck_names, strict=True)
        member_names = [
            name
            for struck_word, written_name in name_pairs
            for name in self._member_names(struck_word, written_name, strikes_label)
        ]
        if row.act:
            member_names = [
                name
                for struck_name in member_names
                for name in self.part_names.drawn_act_names(struck_name, row.act)
            ]
        return tuple(
            target for name in member_names for target in self._targets_of_name(name, strikes_label)
        )

    def _targets_of_name(self, target_name: Name, strikes_label: str) -> list[Target]:
        """The targets of a name, kept for further rows, which differ only in their place."""
        earlier_targets = self._targets_by_name.get(target_name)
        if earlier_targets is not None:
            return [
                Target(
                    target.part,
                    target.module,
                    target.first,
                    target.count,
                    target.text,
                    target_name.place,
                )
                for target in earlier_targets
            ]
        struck_targets = self.part_names.struck_targets(target_name, strikes_label)
        if struck_targets:  # without targets each row reports them
            self._targets_by_name[target_name] = struck_targets
        return struck_targets

    def _member_names(self, word: Name, written_word: Name, strikes_label: str) -> list[Name]:
        if notes.word_of(word) is None:
            spelling_mistake = note_slip(word) if self.instruments else None
            if spelling_mistake is None or word.partition(".")[0] in self.part_names.parts:
                return [word]
            message = f"{strikes_label}: {spelling_mistake.message}"
            self.part_names.collector.error(
                "E201", message, word.place, suggestion=spelling_mistake.suggestion
            )
            return []
        if not self.instruments:
            message = (
                f"{strikes_label}: {quote(word)} is a note; write `to`, whose notes are struck"
            )
            self.part_names.collector.error("E103", message, word.place)
            return []
        member_names = []
        for instrument_name in self.instruments:
            family_and_rest = self.part_names.family_and_rest(instrument_name)
            if family_and_rest is None:
                message = (
                    f"{strikes_label}: {quote(instrument_name)} has no notes; write `notes` in the "
                    "instrument"
                )
                if self.part_names.is_known(instrument_name):
                    self.part_names.collector.error("E304", message, instrument_name.place)
                else:
                    self.part_names.target(instrument_name, "mats", strikes_label)
                continue
            note_family, name_rest = family_and_rest
            note_name = note_family.note(word)
            if note_name is None:
                known_notes = [part.rpartition(".")[2] for part in note_family.parts.values()]
                message = f"{strikes_label}: {quote(instrument_name)} has no note {quote(word)}"
                note_range = (
                    f"; its notes are {known_notes[0]} to {known_notes[-1]}" if known_notes else ""
                )
                if word == written_word:
                    self.part_names.collector.error(
                        "E301", message + note_range, word.place, word=word, names=known_notes
                    )
                else:
                    message += f", to which {quote(written_word)} is moved{note_range}"
                    self.part_names.collector.error("E301", message, word.place)
                continue
            member_names.append(Name(".".join(filter(None, (note_name, name_rest))), word.place))
        return member_names

    def _note_pitch(self, word: str) -> float | None:
        """The note of a name in semitones or keys; None if it has none. Raises TextError."""
        note_words = tuning.spelled(word).split(".")
        note_index = self._note_word_index(note_words)
        if note_index is None:
            return None
        with tuning.used(self._tuning(note_words)):
            return notes.step(note_words[note_index])

    def _tuning(self, words: Sequence[str]) -> Tuning | None:
        """The tuning of the note of a name: of its instrument, or of those that a note is for."""
        return self.part_names.tuning_of(".".join(words)) if words[1:] else tuning.written()

    def _note_word_index(self, words: list[str]) -> Any:
        """The index of the word in a name that is its note; None if there is none."""
        if len(words) == 1:
            return 0 if tuning.is_pitch(words[0]) else None
        for word_count in range(1, len(words)):
            is_family = ".".join(words[:word_count]) in self.part_names.families
            if is_family and tuning.is_pitch(words[word_count]):
                return word_count
        return None
