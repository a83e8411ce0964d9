"""Turns `entries` and `play` of strikes into hits: transformed rows, with the targets they
reach.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from pathlib import PurePath
from typing import Any

from ergon.instruments.model import PRESS, Target
from ergon.instruments.names import PartNames
from ergon.notation.clock.positions import Length
from ergon.notation.tables import notes, tuning
from ergon.notation.tables.fields import Values
from ergon.notation.tables.shapes import Name
from ergon.notation.tables.strengths import MEZZO_FORTE, ImpulseRange, Level
from ergon.notation.tables.strengths import velocity as velocity_level
from ergon.notation.tables.velocities import EVEN, Curve
from ergon.notation.text.errors import TextError, quote
from ergon.notation.text.files import Files
from ergon.scores.gesture.midi_file import MidiNotes
from ergon.scores.gesture.midi_pressures import read_pressures
from ergon.scores.gesture.note_files import SUFFIXES, is_musicxml, read_notes
from ergon.scores.gesture.take_file import TakeError
from ergon.scores.gesture.transforms import Transform
from ergon.scores.reading.melody import Row
from ergon.scores.reading.note_targets import NoteTargets
from ergon.scores.reading.phrase_changes import transformed
from ergon.scores.reading.phrase_do import phrase_do
from ergon.scores.reading.phrase_rows import phrase_rows, with_levels
from ergon.scores.reading.piece import Hit, Strikes

_STRENGTH = ("impulse", "lasts")
_PASSING = ("to", "at", "for", "every", "times", "until", "chance", "mass", "speed", *_STRENGTH)
_FIELDS_BY_KIND = {
    "entries": ("entries", "to", "until", *_STRENGTH),
    "play": ("play", "to", "at", "every", "times", "until", "transpose", "do", *_STRENGTH),
    "sweep": ("sweep", *_PASSING),
    "path": ("path", "width", *_PASSING),
    "rhythm": ("rhythm", "to", "at", "for", "until", "times", "skip", "cycle", "do", *_STRENGTH),
}
_NEEDED = {"entries": ("entries",), "play": ("play", "at"), "rhythm": ("rhythm", "at")}
_NEEDED |= dict.fromkeys(("sweep", "path"), ("to", "at", "for"))
MELODIES = ("entries", "play")
# Fields that only strikes of one kind have.
_ONLY = {"transpose": "play", "width": "path", "cycle": "rhythm"}


def kind_of(values: Values) -> str:
    """The field that tells the kind of strikes; "" if there is no such field."""
    return next(iter(values.written(*_FIELDS_BY_KIND)), "")


def has_required_fields(values: Values) -> bool:
    """Whether strikes have the fields that their kind needs, and no others; reports an error if
    not.
    """
    v, kind = values, kind_of(values)
    needed = _NEEDED.get(kind, ("to", "at"))
    for name in needed:
        if name not in v.nodes:
            message = (
                f"{v.context.label('')} has no '{name}': {v.record.by_name[name].shape.words()}"
            )
            v.error("E103", message)
    fields = _FIELDS_BY_KIND.get(
        kind, tuple(name for name in v.record.by_name if name not in _ONLY)
    )
    for name in v.nodes:
        if name not in fields:
            advice = f"cannot be used together with `{kind}`; remove it"
            if not kind:
                advice = f"needs `{_ONLY[name]}` beside it; write that, or remove this"
            v.error("E111", f"{v.context.label(name)} {advice}", name)
            return False
    return all(name in v.by_name for name in (*needed, *v.written("to", "play", "impulse", "do")))


def hits_of(
    values: Values, part_names: PartNames, phrases: Mapping[str, Any], files: Files
) -> tuple[tuple[Hit, ...], Length | None] | None:
    """The hits of a melody and, of a phrase, its length; None if an error was reported."""
    label = f"strikes {quote(values.context.name)}"
    if kind_of(values) == "entries":
        voices = NoteTargets(part_names, values["to"] or ())
        rows = with_levels(values["entries"], values["impulse"])
        return _hits(rows, voices, label), None
    phrase = phrases.get(values["play"])
    if not isinstance(phrase, Values):
        if values["play"] not in phrases:
            message = f"{label}: no phrase or MIDI take is called {quote(values['play'])}"
            names = tuple(phrases)
            values.error("E301", message, "play", word=str(values["play"]), names=names)
        return None
    do = phrase_do(values)
    if do is None:
        return None
    voices = NoteTargets(part_names, notes_in(phrase, values))
    played_hits = played(phrase, values, do[0], voices, files, phrases)
    if not (values.written("to", "transpose", "do") or is_midi(phrase)):
        label = phrase.context.label("")  # a name that is unknown is the phrase's
    return (
        None
        if played_hits is None
        else (_hits(played_hits[0], played_hits[1], label), played_hits[2])
    )


def notes_in(phrase: Values, values: Values) -> tuple[Name, ...]:
    """The instruments whose notes a phrase names."""
    return values["to"] or (() if is_midi(phrase) else phrase["to"] or ())


def in_quarters(
    phrase: Values, hits: tuple[Hit, ...], length: Length | None
) -> tuple[tuple[Hit, ...], Length | None]:
    """The hits and the length of what strikes play; of a MIDI file in quarter notes, which are not
    beats where the meter has other notes.
    """
    if not is_midi(phrase):
        return hits, length

    def quarters(of_file: Length) -> Length:
        return replace(of_file, beats=0.0, quarters=of_file.beats)

    hits_in_quarters = (
        replace(hit, at=quarters(hit.at), lasting=hit.lasting and quarters(hit.lasting))
        for hit in hits
        if isinstance(hit.at, Length)
    )
    return tuple(hits_in_quarters), length and quarters(length)


def played(
    phrase: Values,
    values: Values,
    chain: Iterable[Transform],
    voices: NoteTargets,
    files: Files,
    phrases: Mapping[str, Any],
) -> tuple[Sequence[Row], NoteTargets, Length] | None:
    """The rows of a phrase as strikes play them after the transformations of a `chain`, with the
    notes they may name and the phrase's length; None if an error was reported.
    """
    length: Length | None
    if is_midi(phrase):
        if (tune := midi_rows(phrase, files)) is None:
            return None
        rows, length = tune
        if values.written("impulse") and not phrase.written("velocity"):
            rows = tuple(replace(row, level=None) for row in rows)
        rows = with_levels(rows, values["impulse"])
        if voices.has_act(PRESS):
            rows = (*rows, *_pressed(phrase, files))
    else:
        rows_of_phrase = phrase_rows(phrase, phrases, voices, values["impulse"])
        if rows_of_phrase is None:
            return None
        rows, length = rows_of_phrase
    try:
        if (interval := values["transpose"]) is not None:
            rows = tuple(
                voices.renamed(row, [voices.moved(word, interval.semitones) for word in row.what])
                for row in rows
            )
    except TextError as error:
        values.error("E306", f"{values.context.label('transpose')}: {error.message}", "transpose")
        return None
    try:
        rows, length = transformed(rows, length, chain, voices.mirrored)
    except TextError as error:
        values.error("E306", f"{values.context.label('do')}: {error.message}", "do")
        return None
    return rows, voices, length


def strikes_of_pattern(
    strikes: Strikes, values: Values, voices: NoteTargets, label: str
) -> Strikes:
    """Strikes whose pattern of notes says which notes of an instrument are struck."""
    place = values.place_of("notes")
    targets_by_word: dict[str, tuple[Target, ...]] = {}
    for word in strikes.notes:
        root = tuning.spelled(word).partition(".")[0]
        if not tuning.is_pitch(root):
            message = (
                f"{label}: {quote(word)} is not a note such as A3, by which members are called"
            )
            voices.part_names.collector.error("E304", message, place)
            continue
        row = Row(Length(), (Name(notes.scale_step(word), place),), None, place)
        targets_by_word[word] = voices.targets(row, label)
    targets = dict.fromkeys(
        target for word_targets in targets_by_word.values() for target in word_targets
    )
    return replace(strikes, to=tuple(targets), notes={}, voices=targets_by_word)


def is_midi(take: Any) -> bool:
    """Whether a value is a take whose file is one of notes: MIDI or MusicXML."""
    is_take = isinstance(take, Values) and take.record.noun == "take"
    return is_take and PurePath(take["file"] or "").suffix.lower() in SUFFIXES


def midi_notes(take: Values, files: Files) -> MidiNotes | None:
    """The notes of a file of notes; None if an error was reported."""
    label, folder = f"{take.context.label('file')}: ", take.nodes["file"].document.folder
    path = files.locate(take["file"], folder, take.place_of("file"), label, is_text=False)
    if path is None:
        return None
    try:
        return read_notes(path, take["channel"])
    except TakeError as error:
        message = f"take {quote(take.context.name)}: {error.message}"
        take.error("E310", message, error.field)
    return None


def midi_rows(take: Values, files: Files) -> tuple[tuple[Row, ...], Length] | None:
    """The notes of a file as a phrase, and its length; None if an error was reported."""
    take_notes = midi_notes(take, files)
    if take_notes is None:
        return None
    place, impulse = take.place_of("file"), take["velocity"]
    rows: list[Row] = []
    curve = take["curve"] or EVEN
    for note in take_notes.notes:
        level: Level | None = curve.level(note.velocity)
        if impulse is not None:
            level = Level(*(between(note.velocity, impulse, curve),) * 2)
        elif note.word is not None and take["curve"] is None:
            strength = note.strength
            level = None if strength is None else Level(strength, strength, is_strength=True)
        note_names = (Name(note.word or tuning.current().key_word(note.number), place),)
        lasting = None if note.lasting is None else Length(beats=note.lasting)
        rows.append(Row(Length(beats=note.at), note_names, level, place, lasting=lasting))
    return tuple(rows), Length(beats=take_notes.length)


def _pressed(take: Values, files: Files) -> Iterator[Row]:
    """What the pressure on the keys of a MIDI file plays: the act called `press`, as on a keyboard.

    Reports pressures that cannot be read.
    """
    place = take.place_of("file")
    path = files.find(take["file"], take.nodes["file"].document.folder, is_text=False)
    if path is None or is_musicxml(path):
        return
    try:
        pressures = read_pressures(path, take["channel"])
    except TakeError as error:
        take.error("E310", f"take {quote(take.context.name)}: {error.message}", error.field)
        return
    for pressure in pressures:
        note_names = (Name(tuning.current().key_word(pressure.number), place),)
        start, lasting = Length(beats=pressure.start), Length(beats=pressure.lasting)
        level = velocity_level(pressure.value)
        yield Row(start, note_names, level, place, lasting=lasting, act=PRESS)


def between(velocity: int, value_range: tuple[float, float], curve: Curve) -> float:
    """The value between two ends for a velocity from 1 to 127, computed in exact fractions."""
    low, high = (Fraction(repr(end)) for end in value_range)
    return float(low + (high - low) * curve.share(velocity, 1))


def _hits(rows: Sequence[Row], voices: NoteTargets, label: str) -> tuple[Hit, ...]:
    hits: list[Hit] = []
    collector = voices.part_names.collector
    n_reports = collector.n_reports
    for row in rows:
        if row.act and collector.n_reports > n_reports:  # of the notes that are pressed
            break
        level = row.level or MEZZO_FORTE
        hit = Hit(row.at, (), level, row.place, " ".join(row.what), row.jitter)
        targets = voices.targets(row, label)
        if any(voices.part_names.has_end(target) for target in targets):
            hit = replace(hit, lasting=row.lasting)
        if not level.is_strength:
            hits.append(replace(hit, to=targets))
            continue
        by_reach: dict[ImpulseRange, list[Target]] = {}
        for target in targets:
            reach = voices.part_names.sure_reach(target, label)
            if reach is not None:
                by_reach.setdefault(reach, []).append(target)
        hits += [replace(hit, to=tuple(to), reach=reach) for reach, to in by_reach.items()]
    return tuple(hits)
