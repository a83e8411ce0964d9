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
from ergon.scores.reading.phrase_changes import transformed_rows
from ergon.scores.reading.phrase_do import phrase_transforms
from ergon.scores.reading.phrase_rows import phrase_rows, with_levels
from ergon.scores.reading.piece import Hit, Strikes

_STRENGTH_FIELDS = ("impulse", "lasts")
_PASSING_FIELDS = (
    "to",
    "at",
    "for",
    "every",
    "times",
    "until",
    "chance",
    "mass",
    "speed",
    *_STRENGTH_FIELDS,
)
_FIELDS_BY_KIND = {
    "entries": ("entries", "to", "until", *_STRENGTH_FIELDS),
    "play": ("play", "to", "at", "every", "times", "until", "transpose", "do", *_STRENGTH_FIELDS),
    "sweep": ("sweep", *_PASSING_FIELDS),
    "path": ("path", "width", *_PASSING_FIELDS),
    "rhythm": (
        "rhythm",
        "to",
        "at",
        "for",
        "until",
        "times",
        "skip",
        "cycle",
        "do",
        *_STRENGTH_FIELDS,
    ),
}
_REQUIRED_FIELDS_BY_KIND = {
    "entries": ("entries",),
    "play": ("play", "at"),
    "rhythm": ("rhythm", "at"),
}
_REQUIRED_FIELDS_BY_KIND |= dict.fromkeys(("sweep", "path"), ("to", "at", "for"))
MELODY_KINDS = ("entries", "play")
# Fields that only strikes of one kind have.
_KIND_BY_FIELD = {"transpose": "play", "width": "path", "cycle": "rhythm"}


def kind_of(values: Values) -> str:
    """The field that tells the kind of strikes; "" if there is no such field."""
    return next(iter(values.written(*_FIELDS_BY_KIND)), "")


def has_required_fields(strike_fields: Values) -> bool:
    """Whether strikes have the fields that their kind needs, and no others; reports an error if
    not.
    """
    strike_values, strikes_kind = strike_fields, kind_of(strike_fields)
    required_fields = _REQUIRED_FIELDS_BY_KIND.get(strikes_kind, ("to", "at"))
    for field_name in required_fields:
        if field_name not in strike_values.nodes:
            message = (
                f"{strike_values.context.label('')} has no '{field_name}': "
                f"{strike_values.record.by_name[field_name].shape.words()}"
            )
            strike_values.error("E103", message)
    fields = _FIELDS_BY_KIND.get(
        strikes_kind,
        tuple(name for name in strike_values.record.by_name if name not in _KIND_BY_FIELD),
    )
    for field_name in strike_values.nodes:
        if field_name not in fields:
            advice = f"cannot be used together with `{strikes_kind}`; remove it"
            if not strikes_kind:
                advice = (
                    f"needs `{_KIND_BY_FIELD[field_name]}` beside it; write that, or remove this"
                )
            strike_values.error(
                "E111", f"{strike_values.context.label(field_name)} {advice}", field_name
            )
            return False
    return all(
        name in strike_values.by_name
        for name in (*required_fields, *strike_values.written("to", "play", "impulse", "do"))
    )


def hits_of(
    strike_values: Values, part_names: PartNames, phrases: Mapping[str, Any], files: Files
) -> tuple[tuple[Hit, ...], Length | None] | None:
    """The hits of a melody and, of a phrase, its length; None if an error was reported."""
    error_label = f"strikes {quote(strike_values.context.name)}"
    if kind_of(strike_values) == "entries":
        note_targets = NoteTargets(part_names, strike_values["to"] or ())
        rows = with_levels(strike_values["entries"], strike_values["impulse"])
        return _hits_of_rows(rows, note_targets, error_label), None
    phrase = phrases.get(strike_values["play"])
    if not isinstance(phrase, Values):
        if strike_values["play"] not in phrases:
            message = (
                f"{error_label}: no phrase or MIDI take is called {quote(strike_values['play'])}"
            )
            names = tuple(phrases)
            strike_values.error(
                "E301", message, "play", word=str(strike_values["play"]), names=names
            )
        return None
    transform_chain = phrase_transforms(strike_values)
    if transform_chain is None:
        return None
    note_targets = NoteTargets(part_names, notes_in(phrase, strike_values))
    played_phrase = played_rows(
        phrase, strike_values, transform_chain[0], note_targets, files, phrases
    )
    if not (strike_values.written("to", "transpose", "do") or has_note_file(phrase)):
        error_label = phrase.context.label("")  # mistakes in names belong to the phrase
    return (
        None
        if played_phrase is None
        else (_hits_of_rows(played_phrase[0], played_phrase[1], error_label), played_phrase[2])
    )


def notes_in(phrase: Values, values: Values) -> tuple[Name, ...]:
    """The instruments whose notes a phrase names."""
    return values["to"] or (() if has_note_file(phrase) else phrase["to"] or ())


def in_quarter_notes(
    phrase: Values, phrase_hits: tuple[Hit, ...], phrase_length: Length | None
) -> tuple[tuple[Hit, ...], Length | None]:
    """The hits of strikes, and their length. Those of a MIDI file count in quarter notes, which
    differ from beats if the meter counts other notes.
    """
    if not has_note_file(phrase):
        return phrase_hits, phrase_length

    def quarters(file_length: Length) -> Length:
        return replace(file_length, beats=0.0, quarters=file_length.beats)

    hits_in_quarters = (
        replace(hit, at=quarters(hit.at), duration=hit.duration and quarters(hit.duration))
        for hit in phrase_hits
        if isinstance(hit.at, Length)
    )
    return tuple(hits_in_quarters), phrase_length and quarters(phrase_length)


def played_rows(
    phrase: Values,
    strike_values: Values,
    transforms: Iterable[Transform],
    note_targets: NoteTargets,
    score_files: Files,
    phrases: Mapping[str, Any],
) -> tuple[Sequence[Row], NoteTargets, Length] | None:
    """The rows of a phrase as strikes play them after the `transforms`, with
    the notes they may name and the phrase's length; None if an error was reported.
    """
    phrase_length: Length | None
    if has_note_file(phrase):
        if (rows_and_length := rows_of_take(phrase, score_files)) is None:
            return None
        rows, phrase_length = rows_and_length
        if strike_values.written("impulse") and not phrase.written("velocity"):
            rows = tuple(replace(row, level=None) for row in rows)
        rows = with_levels(rows, strike_values["impulse"])
        if note_targets.has_act(PRESS):
            rows = (*rows, *_pressure_rows(phrase, score_files))
    else:
        rows_of_phrase = phrase_rows(phrase, phrases, note_targets, strike_values["impulse"])
        if rows_of_phrase is None:
            return None
        rows, phrase_length = rows_of_phrase
    try:
        if (interval := strike_values["transpose"]) is not None:
            rows = tuple(
                note_targets.with_names(
                    row,
                    [
                        note_targets.transposed(word, interval.semitones)
                        for word in row.struck_names
                    ],
                )
                for row in rows
            )
    except TextError as error:
        strike_values.error(
            "E306", f"{strike_values.context.label('transpose')}: {error.message}", "transpose"
        )
        return None
    try:
        rows, phrase_length = transformed_rows(
            rows, phrase_length, transforms, note_targets.mirrored
        )
    except TextError as error:
        strike_values.error("E306", f"{strike_values.context.label('do')}: {error.message}", "do")
        return None
    return rows, note_targets, phrase_length


def strikes_of_pattern(
    strikes: Strikes, strike_values: Values, note_targets: NoteTargets, strikes_label: str
) -> Strikes:
    """Strikes whose pattern of notes says which notes of an instrument are struck."""
    notes_place = strike_values.place_of("notes")
    targets_by_word: dict[str, tuple[Target, ...]] = {}
    for pattern_word in strikes.notes:
        root = tuning.spelled(pattern_word).partition(".")[0]
        if not tuning.is_pitch(root):
            message = (
                f"{strikes_label}: {quote(pattern_word)} is not a note such as A3, by which "
                "members are called"
            )
            note_targets.part_names.collector.error("E304", message, notes_place)
            continue
        row = Row(Length(), (Name(notes.scale_step(pattern_word), notes_place),), None, notes_place)
        targets_by_word[pattern_word] = note_targets.targets(row, strikes_label)
    targets = dict.fromkeys(
        target for word_targets in targets_by_word.values() for target in word_targets
    )
    return replace(strikes, to=tuple(targets), notes={}, voices=targets_by_word)


def has_note_file(take: Any) -> bool:
    """Whether a value is a take whose file is one of notes: MIDI or MusicXML."""
    is_take = isinstance(take, Values) and take.record.noun == "take"
    return is_take and PurePath(take["file"] or "").suffix.lower() in SUFFIXES


def notes_of_take(take: Values, files: Files) -> MidiNotes | None:
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


def rows_of_take(take: Values, files: Files) -> tuple[tuple[Row, ...], Length] | None:
    """The notes of a file as a phrase, and its length; None if an error was reported."""
    take_notes = notes_of_take(take, files)
    if take_notes is None:
        return None
    file_place, impulse = take.place_of("file"), take["velocity"]
    note_rows: list[Row] = []
    curve = take["curve"] or EVEN
    for midi_note in take_notes.notes:
        note_level: Level | None = curve.level(midi_note.velocity)
        if impulse is not None:
            note_level = Level(*(value_of_velocity(midi_note.velocity, impulse, curve),) * 2)
        elif midi_note.word is not None and take["curve"] is None:
            note_strength = midi_note.strength
            note_level = (
                None
                if note_strength is None
                else Level(note_strength, note_strength, is_strength=True)
            )
        note_names = (
            Name(midi_note.word or tuning.current().key_word(midi_note.number), file_place),
        )
        note_length = None if midi_note.length is None else Length(beats=midi_note.length)
        note_rows.append(
            Row(Length(beats=midi_note.at), note_names, note_level, file_place, length=note_length)
        )
    return tuple(note_rows), Length(beats=take_notes.length)


def _pressure_rows(take: Values, files: Files) -> Iterator[Row]:
    """What the pressure on the keys of a MIDI file plays: the act called `press`, as on a keyboard.

    Reports pressures that cannot be read.
    """
    file_place = take.place_of("file")
    path = files.find(take["file"], take.nodes["file"].document.folder, is_text=False)
    if path is None or is_musicxml(path):
        return
    try:
        pressures = read_pressures(path, take["channel"])
    except TakeError as error:
        take.error("E310", f"take {quote(take.context.name)}: {error.message}", error.field)
        return
    for pressure in pressures:
        note_names = (Name(tuning.current().key_word(pressure.number), file_place),)
        start, pressure_length = Length(beats=pressure.start), Length(beats=pressure.length)
        level = velocity_level(pressure.value)
        yield Row(start, note_names, level, file_place, length=pressure_length, act=PRESS)


def value_of_velocity(velocity: int, value_range: tuple[float, float], curve: Curve) -> float:
    """The value between two ends for a velocity from 1 to 127, computed in exact fractions."""
    low, high = (Fraction(repr(end)) for end in value_range)
    return float(low + (high - low) * curve.share(velocity, 1))


def _hits_of_rows(
    rows: Sequence[Row], note_targets: NoteTargets, strikes_label: str
) -> tuple[Hit, ...]:
    phrase_hits: list[Hit] = []
    collector = note_targets.part_names.collector
    n_reports = collector.n_reports
    for phrase_row in rows:
        if phrase_row.act and collector.n_reports > n_reports:  # some pressed note was refused
            break
        row_level = phrase_row.level or MEZZO_FORTE
        phrase_hit = Hit(
            phrase_row.at,
            (),
            row_level,
            phrase_row.place,
            " ".join(phrase_row.struck_names),
            phrase_row.jitter,
        )
        strike_targets = note_targets.targets(phrase_row, strikes_label)
        if any(note_targets.part_names.ends_with_note(target) for target in strike_targets):
            phrase_hit = replace(phrase_hit, duration=phrase_row.length)
        if not row_level.is_strength:
            phrase_hits.append(replace(phrase_hit, to=strike_targets))
            continue
        targets_by_range: dict[ImpulseRange, list[Target]] = {}
        for strike_target in strike_targets:
            impulse_range = note_targets.part_names.required_impulse_range(
                strike_target, strikes_label
            )
            if impulse_range is not None:
                targets_by_range.setdefault(impulse_range, []).append(strike_target)
        phrase_hits += [
            replace(phrase_hit, to=tuple(targets), impulse_range=impulse_range)
            for impulse_range, targets in targets_by_range.items()
        ]
    return tuple(phrase_hits)
