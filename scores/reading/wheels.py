"""Strikes that play a MIDI file with its pitch wheel: how each note glides."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from ergon.instruments.model import Target
from ergon.instruments.transpose import interval_of_cents
from ergon.notation.clock.positions import Length
from ergon.notation.tables import notes, tuning
from ergon.notation.tables.fields import Values
from ergon.notation.text.errors import quote
from ergon.notation.text.files import Files
from ergon.notation.text.values import Place
from ergon.scores.gesture.midi_wheels import NoteCurves, read_wheels
from ergon.scores.gesture.take_file import TakeError
from ergon.scores.reading.piece import NoteGlide, Strikes

_DEFAULT_RANGE_CENTS = 200.0


def with_wheels(
    wheel_strikes: Strikes, strike_values: Values, take: Values, files: Files
) -> Strikes:
    """Strikes with the glides of the file that they play, if its take says `bend`."""
    if take["bend"] is None:
        return wheel_strikes
    if strike_values.written("do"):
        message = f"{strike_values.context.label('do')}: a file with `bend` is played as it is; "
        strike_values.error(
            "E111", f"{message}remove `do`, or `bend` of take {take.context.name}", "do"
        )
        return wheel_strikes
    path = files.find(take["file"], take.nodes["file"].document.folder, is_text=False)
    if path is None:  # the reader of the notes reports it
        return wheel_strikes
    range_cents = take["bend"].cents
    try:
        curves = read_wheels(
            path, take["channel"], _DEFAULT_RANGE_CENTS if range_cents is None else range_cents
        )
    except TakeError as error:
        take.error("E310", f"take {quote(take.context.name)}: {error.message}", error.field)
        return wheel_strikes
    interval = strike_values["transpose"]
    semitones = 0.0 if interval is None else interval.semitones
    return replace(wheel_strikes, glides=tuple(_note_glides(wheel_strikes, curves, semitones)))


def _note_glides(
    wheel_strikes: Strikes, curves: NoteCurves, semitones: float
) -> Iterator[NoteGlide]:
    """The glides of each struck instrument, whose notes lie `semitones` above those of the file."""
    places_by_part: dict[str, dict[str, Place]] = {}
    for hit in wheel_strikes.hits:
        places_by_part.setdefault(hit.struck_text, {}).update(
            (target.part, target.place) for target in hit.to
        )
    for note_key, points in curves.items():
        glide_points = tuple(
            (Length(quarters=quarter), interval_of_cents(cents).ratio) for quarter, cents in points
        )
        note = tuning.current().key_word(note_key)
        if semitones:
            note = notes.moved(note, semitones)
        for part, place in places_by_part.get(note, {}).items():
            yield NoteGlide(Target(part, "", 0, 1, part, place), glide_points)
