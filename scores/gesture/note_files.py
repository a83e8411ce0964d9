"""Files of notes: MIDI and MusicXML, which are read alike."""

from __future__ import annotations

from pathlib import Path

from ergon.notation.clock.meter import Meter
from ergon.notation.tables.strengths import MEZZO_FORTE
from ergon.scores.gesture import midi_file, midi_survey, musicxml_bytes, musicxml_file
from ergon.scores.gesture.midi_file import MidiNote, MidiNotes

SUFFIXES = (*midi_file.SUFFIXES, *musicxml_bytes.SUFFIXES)


def is_musicxml(path: Path) -> bool:
    """Whether a file is one of MusicXML, by its name."""
    return path.suffix.lower() in musicxml_bytes.SUFFIXES


def read_notes(path: Path, part_name: str | None = None) -> MidiNotes:
    """The notes of a channel of a MIDI file, of a part of a MusicXML file, or all. Raises
    TakeError.
    """
    if not is_musicxml(path):
        return midi_file.read_notes(path, part_name)
    notes, length = musicxml_file.part_notes(path, part_name)
    return MidiNotes(tuple(_midi_note(note) for note in notes), length)


def _midi_note(note: musicxml_file.XmlNote) -> MidiNote:
    strength = MEZZO_FORTE.low if note.strength is None else note.strength
    velocity = max(1, round(127.0 * strength))
    return MidiNote(note.at, note.key, velocity, note.length, note.word, note.strength)


def tempos_of(path: Path) -> tuple[tuple[float, float], ...]:
    """The tempos of a file: quarter notes from the beginning, and quarters a minute. Raises
    TakeError.
    """
    return musicxml_file.tempos_of(path) if is_musicxml(path) else midi_survey.tempos_of(path)


def meters_of(path: Path) -> tuple[tuple[float, Meter], ...]:
    """The meters of a file: quarter notes from the beginning, and a meter. Raises TakeError."""
    return musicxml_file.meters_of(path) if is_musicxml(path) else midi_survey.meters_of(path)
