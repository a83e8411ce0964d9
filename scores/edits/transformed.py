"""Transforms what strikes play from a cycle on; strikes by the clock become a rhythm first."""

from __future__ import annotations

from ergon.notation.clock.meter import SAME
from ergon.notation.clock.positions import Length
from ergon.notation.text import edit
from ergon.notation.text.edit import EditError
from ergon.notation.text.errors import TextError, quote
from ergon.scores.edits import strikes as edits
from ergon.scores.edits.names import free_name
from ergon.scores.edits.positions import position_text
from ergon.scores.edits.texts import Texts
from ergon.scores.reading.clocked import rhythm_of_clock
from ergon.scores.reading.piece import Piece, Strikes
from ergon.scores.reading.rhythms import Rhythm

NO_TRANSFORMS = "none"  # ends all transformations
# Fields that a rhythm replaces.
_FIELDS_OF_PATTERNS = ("every", "euclid", "notes", "chance", "swing", "play", "transpose", "do")

_BAR_DURATION = Length(bars=1.0)

StrikeFields = dict[str, edit.Tree]


def transform(
    score_texts: Texts, piece: Piece, strikes_name: str, from_beat: float, transforms_text: str
) -> Texts:
    """Transform what strikes of a name play from the first cycle on that begins at a beat or later.

    Raises EditError if they play nothing then, or have no cycles.
    """
    tempo, is_changed = piece.tempo_map, False
    strikes_tree = edit.tree(score_texts.section("strikes"))
    taken_names = {strikes.name for strikes in piece.strikes}
    for strikes in edits.strikes_named(piece, strikes_name):
        stop_beat = strikes.stop_beat(tempo)
        if stop_beat is not None and stop_beat <= from_beat + SAME:
            continue
        assert isinstance(strikes_tree, dict)
        strike_fields = strikes_tree[strikes.name]
        assert isinstance(strike_fields, dict)
        rhythm, strike_fields = _rhythm_and_fields(score_texts, strikes, strike_fields)
        strike_times = (
            strikes.times if strikes.times is not None or "times" not in strike_fields else 1
        )
        begin_beat = tempo.resolve(strikes.at)
        n_passed_cycles = (
            rhythm.cycle_count(tempo, begin_beat, from_beat) if from_beat > begin_beat else 0
        )
        if strike_times is not None and n_passed_cycles >= strike_times:
            continue
        cycle_beat = rhythm.cycle_begin(tempo, begin_beat, n_passed_cycles)
        score_texts = edits.end_strikes(score_texts, piece, strikes, cycle_beat)
        strike_fields = {
            **strike_fields,
            "at": position_text(piece, cycle_beat),
            **_with_transforms_added(strike_fields, transforms_text),
        }
        if first_cycle := rhythm.first_cycle + n_passed_cycles:
            strike_fields["skip"] = str(first_cycle)
        if strike_times is not None:
            strike_fields["times"] = str(strike_times - n_passed_cycles)
        if strikes.span is not None and stop_beat is not None:
            strike_fields = {**strike_fields, "for": "", "until": position_text(piece, stop_beat)}
        for field in [field for field, value in strike_fields.items() if value == ""]:
            del strike_fields[field]
        new_name = (
            strikes.name
            if cycle_beat <= begin_beat + SAME
            else free_name(strikes_name, taken_names)
        )
        taken_names.add(new_name)
        score_texts = score_texts.put(
            ("strikes", new_name), edit.flow(_in_written_order(strike_fields))
        )
        is_changed = True
    if not is_changed:
        raise EditError(f"{quote(strikes_name)} plays nothing now that could be transformed")
    return score_texts


def _with_transforms_added(strike_fields: StrikeFields, transforms_text: str) -> StrikeFields:
    """The transformations after more are added; an empty text if there are none."""
    chain_text = strike_fields.get("do", "")
    if isinstance(chain_text, list):
        chain_text = ", ".join(str(change) for change in chain_text)
    if transforms_text == NO_TRANSFORMS:
        return {"do": ""}
    return {"do": f"{chain_text}, {transforms_text}" if chain_text else transforms_text}


def _in_written_order(strike_fields: StrikeFields) -> StrikeFields:
    """The fields in the order in which they are written by hand."""
    field_order = ("rhythm", "to", "at", "until", "for", "times", "skip", "cycle", "impulse", "do")
    return {name: strike_fields[name] for name in field_order if name in strike_fields}


# --- strikes by the clock as a rhythm ------------------------------------------------------------


def _rhythm_and_fields(
    score_texts: Texts, strikes: Strikes, strike_fields: StrikeFields
) -> tuple[Rhythm, StrikeFields]:
    """The rhythm of strikes, and their fields with it. Raises EditError if they have none."""
    if "rhythm" in strike_fields and strikes.rhythm is not None:
        return strikes.rhythm, strike_fields
    rhythm = strikes.rhythm
    if rhythm is None:
        try:
            rhythm = rhythm_of_clock(strikes)
        except TextError as error:
            raise EditError(error.message) from error
    rhythm_fields = {
        name: value for name, value in strike_fields.items() if name not in _FIELDS_OF_PATTERNS
    }
    rhythm_fields |= {"rhythm": rhythm.text, "do": rhythm.do}
    if "play" in strike_fields:  # the words of the rhythm say levels
        rhythm_fields = {**_notes_of(score_texts, strike_fields), **rhythm_fields, "impulse": ""}
    if strikes.every is not None or rhythm.cycle != _BAR_DURATION:
        rhythm_fields["cycle"] = _length_text(rhythm.cycle)
    if not rhythm_fields.keys() & {"times", "for", "until"}:
        rhythm_fields["times"] = "1"
    return rhythm, rhythm_fields


def _notes_of(texts: Texts, strike_fields: StrikeFields) -> StrikeFields:
    """The instruments whose notes a phrase names, as a field of what plays it."""
    phrases = edit.tree(texts.section("phrases"))
    phrase = phrases.get(str(strike_fields["play"])) if isinstance(phrases, dict) else None
    return {"to": phrase["to"]} if isinstance(phrase, dict) and "to" in phrase else {}


def _length_text(length_written: Length) -> str:
    if length_written.quarters:
        raise EditError(
            "a MIDI file whose quarter notes are no beats of the meter is not written as a rhythm; "
            "write its transformations in the score, in `do`"
        )
    length_parts = [
        (length_written.bars, "bar"),
        (length_written.beats, ""),
        (length_written.seconds, "s"),
    ]
    (length_text,) = [f"{value!r}{unit}" for value, unit in length_parts if value] or ["0"]
    return length_text
