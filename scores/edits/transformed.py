"""Transforms what strikes play from a cycle on; strikes by the clock become a rhythm first."""

from __future__ import annotations

from ergon.notation.clock.meter import SAME
from ergon.notation.clock.positions import Length
from ergon.notation.text import edit
from ergon.notation.text.edit import EditError
from ergon.notation.text.errors import TextError, quote
from ergon.scores.edits import strikes as edits
from ergon.scores.edits.names import free_name
from ergon.scores.edits.positions import written
from ergon.scores.edits.texts import Texts
from ergon.scores.reading.clocked import clocked
from ergon.scores.reading.piece import Piece, Strikes
from ergon.scores.reading.rhythms import Rhythm

NONE = "none"  # ends all transformations
# Fields that a rhythm replaces.
_REPLACED = ("every", "euclid", "notes", "chance", "swing", "play", "transpose", "do")

_BAR = Length(bars=1.0)

Body = dict[str, edit.Tree]


def transform(texts: Texts, piece: Piece, name: str, beat: float, do: str) -> Texts:
    """Transform what strikes of a name play from the first cycle on that begins at a beat or later.

    Raises EditError if they play nothing then, or have no cycles.
    """
    tempo, changed = piece.tempo_map, False
    section = edit.tree(texts.section("strikes"))
    taken_names = {strikes.name for strikes in piece.strikes}
    for strikes in edits.named(piece, name):
        stop = strikes.stop(tempo)
        if stop is not None and stop <= beat + SAME:
            continue
        assert isinstance(section, dict)
        body = section[strikes.name]
        assert isinstance(body, dict)
        rhythm, body = _as_rhythm(texts, strikes, body)
        times = strikes.times if strikes.times is not None or "times" not in body else 1
        begin = tempo.resolve(strikes.at)
        n_passed_cycles = rhythm.count(tempo, begin, beat) if beat > begin else 0
        if times is not None and n_passed_cycles >= times:
            continue
        turn_beat = rhythm.begin(tempo, begin, n_passed_cycles)
        texts = edits.end(texts, piece, strikes, turn_beat)
        body = {**body, "at": written(piece, turn_beat), **_transforms(body, do)}
        if first_cycle := rhythm.first + n_passed_cycles:
            body["skip"] = str(first_cycle)
        if times is not None:
            body["times"] = str(times - n_passed_cycles)
        if strikes.span is not None and stop is not None:
            body = {**body, "for": "", "until": written(piece, stop)}
        for field in [field for field, value in body.items() if value == ""]:
            del body[field]
        new = strikes.name if turn_beat <= begin + SAME else free_name(name, taken_names)
        taken_names.add(new)
        texts = texts.put(("strikes", new), edit.flow(_in_order(body)))
        changed = True
    if not changed:
        raise EditError(f"{quote(name)} plays nothing now that could be transformed")
    return texts


def _transforms(body: Body, do: str) -> Body:
    """The transformations after more are added; an empty text if there are none."""
    chain_text = body.get("do", "")
    if isinstance(chain_text, list):
        chain_text = ", ".join(str(each) for each in chain_text)
    if do == NONE:
        return {"do": ""}
    return {"do": f"{chain_text}, {do}" if chain_text else do}


def _in_order(body: Body) -> Body:
    """The fields in the order in which they are written by hand."""
    order = ("rhythm", "to", "at", "until", "for", "times", "skip", "cycle", "impulse", "do")
    return {name: body[name] for name in order if name in body}


# --- strikes by the clock as a rhythm ------------------------------------------------------------


def _as_rhythm(texts: Texts, strikes: Strikes, body: Body) -> tuple[Rhythm, Body]:
    """The rhythm of strikes, and their fields with it. Raises EditError if they have none."""
    if "rhythm" in body and strikes.rhythm is not None:
        return strikes.rhythm, body
    rhythm = strikes.rhythm
    if rhythm is None:
        try:
            rhythm = clocked(strikes)
        except TextError as error:
            raise EditError(error.message) from error
    fields = {name: value for name, value in body.items() if name not in _REPLACED}
    fields |= {"rhythm": rhythm.text, "do": rhythm.do}
    if "play" in body:  # the words of the rhythm say levels
        fields = {**_notes_of(texts, body), **fields, "impulse": ""}
    if strikes.every is not None or rhythm.cycle != _BAR:
        fields["cycle"] = _length(rhythm.cycle)
    if not fields.keys() & {"times", "for", "until"}:
        fields["times"] = "1"
    return rhythm, fields


def _notes_of(texts: Texts, body: Body) -> Body:
    """The instruments whose notes a phrase names, as a field of what plays it."""
    phrases = edit.tree(texts.section("phrases"))
    phrase = phrases.get(str(body["play"])) if isinstance(phrases, dict) else None
    return {"to": phrase["to"]} if isinstance(phrase, dict) and "to" in phrase else {}


def _length(length: Length) -> str:
    if length.quarters:
        raise EditError(
            "a MIDI file whose quarter notes are no beats of the meter is not written as a rhythm; "
            "write its transformations in the score, in `do`"
        )
    parts = [(length.bars, "bar"), (length.beats, ""), (length.seconds, "s")]
    (written_length,) = [f"{value!r}{unit}" for value, unit in parts if value] or ["0"]
    return written_length
