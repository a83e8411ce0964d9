"""Changes strikes of modules from a beat on."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from math import inf

from ergon.notation.clock.meter import SAME
from ergon.notation.text import edit
from ergon.scores.edits.names import free_name
from ergon.scores.edits.positions import endless_end, position_text
from ergon.scores.edits.texts import Texts
from ergon.scores.reading.piece import Hit, Piece, Strikes


def strike(
    score_texts: Texts,
    piece: Piece,
    strikes_name: str,
    from_beat: float,
    strike_fields: Mapping[str, str],
) -> Texts:
    """Write strikes from a beat on; they replace earlier strikes of the same name.

    `strike_fields` are those of a score as texts; modules in `to` are separated by
    spaces, transformations in `do` by commas. Repeated strikes without an end continue for ever.
    Raises EditError.
    """
    named_strikes = strikes_named(piece, strikes_name)
    for strikes_entry in named_strikes:
        score_texts = end_strikes(score_texts, piece, strikes_entry, from_beat)
    unbegun_names = {
        strikes_entry.name
        for strikes_entry in named_strikes
        if piece.tempo_map.resolve(strikes_entry.at) >= from_beat - SAME
    }
    used_names = {strikes_entry.name for strikes_entry in piece.strikes} - unbegun_names
    new_name = free_name(strikes_name, used_names)
    fields: dict[str, edit.Tree] = {**strike_fields, "at": position_text(piece, from_beat)}
    if "to" in strike_fields:
        target_words = strike_fields["to"].split()
        other_fields = {field: text for field, text in fields.items() if field not in ("to", "at")}
        fields = {
            "to": target_words[0] if len(target_words) == 1 else [*target_words],
            "at": fields["at"],
            **other_fields,
        }
    if "do" in strike_fields and "rhythm" not in strike_fields and "(" not in strike_fields["do"]:
        fields["do"] = [transform.strip() for transform in strike_fields["do"].split(",")]
    bound_fields = (
        {"times", "until"} if fields.keys() & {"sweep", "path"} else {"times", "for", "until"}
    )
    if fields.keys() & {"rate", "every", "euclid", "rhythm"} and not fields.keys() & bound_fields:
        fields["until"] = endless_end(piece, from_beat)
    return score_texts.put(("strikes", new_name), edit.flow(fields))


def strikes_named(piece: Piece, strikes_name: str) -> list[Strikes]:
    """The strikes of a name, and those that a session has numbered after it: `rain`, `rain-2`."""
    numbered_pattern = re.compile(rf"{re.escape(strikes_name)}(-[0-9]+)?")
    if not any(strikes_entry.name == strikes_name for strikes_entry in piece.strikes):
        return []
    return [
        strikes_entry
        for strikes_entry in piece.strikes
        if numbered_pattern.fullmatch(strikes_entry.name)
    ]


def end_strikes(score_texts: Texts, piece: Piece, strikes: Strikes, from_beat: float) -> Texts:
    """End strikes at a beat; those that have not begun are removed. Raises EditError."""
    tempo = piece.tempo_map
    begin_beat = tempo.resolve(strikes.at)
    path = ("strikes", strikes.name)
    if strikes.hits and strikes.length is None:
        return melody_between(score_texts, piece, strikes, -inf, from_beat, None)
    if begin_beat >= from_beat - SAME:
        return score_texts.remove(path)
    stop_beat = begin_beat if strikes.until is None else tempo.resolve(strikes.until)
    if strikes.span is not None:
        stop_beat = tempo.after(begin_beat, strikes.span)
        score_texts = score_texts.remove((*path, "for")) if stop_beat > from_beat else score_texts
    elif strikes.rhythm is not None and strikes.until is None:
        stop_beat = strikes.rhythm.cycle_begin(tempo, begin_beat, strikes.cycles(tempo))
    elif strikes.pattern is not None and strikes.until is None:
        place_beats = strikes.place_beats(piece)
        stop_beat = place_beats.beat(len(place_beats))
    elif strikes.has_rounds and strikes.until is None:
        stop_beat = strikes.rounds(tempo)[-1] + 2 * SAME
    elif strikes.times is not None and strikes.every is not None and strikes.until is None:
        stop_beat = tempo.after(begin_beat, strikes.every.times(strikes.times))
    return (
        score_texts.put((*path, "until"), position_text(piece, from_beat))
        if stop_beat > from_beat + SAME
        else score_texts
    )


def end_strikes_at_once(
    score_texts: Texts, piece: Piece, strikes: Strikes, cut_beat: float
) -> Texts:
    """End strikes at a beat, also in the middle of a phrase. Raises EditError.

    The round under way is written out as a melody of the strikes before that beat.
    """
    tempo = piece.tempo_map
    if not strikes.hits or strikes.length is None:
        return end_strikes(score_texts, piece, strikes, cut_beat)
    begun_rounds = [beat for beat in strikes.rounds(tempo) if beat < cut_beat - SAME]
    if not begun_rounds:
        return score_texts.remove(("strikes", strikes.name))
    timed_hits = [
        (beat, hit)
        for beat, _, hit in strikes.played_hits(piece)
        if beat >= begun_rounds[-1] - SAME
    ]
    last_round = timed_hits[: len(strikes.hits)]
    played_hits = [(beat, hit) for beat, hit in last_round if beat < cut_beat - SAME]
    if len(played_hits) == len(last_round):
        return end_strikes(score_texts, piece, strikes, cut_beat)
    if len(begun_rounds) == 1:
        score_texts = score_texts.remove(("strikes", strikes.name))
    else:
        for bound_field, value in (("times", strikes.times), ("for", strikes.span)):
            if value is not None:
                score_texts = score_texts.remove(("strikes", strikes.name, bound_field))
        score_texts = score_texts.put(
            ("strikes", strikes.name, "until"), position_text(piece, begun_rounds[-1])
        )
    if not played_hits:
        return score_texts
    name = free_name(strikes.name, {other_strikes.name for other_strikes in piece.strikes})
    rows = [melody_entry(hit, position_text(piece, beat)) for beat, hit in played_hits]
    return score_texts.put(("strikes", name), edit.flow({"entries": rows}))


def melody_between(
    score_texts: Texts,
    piece: Piece,
    strikes: Strikes,
    since_beat: float,
    until_beat: float,
    write_position: Callable[[float], str] | None,
) -> Texts:
    """A melody of `entries`, or a rhythm written as such, with only the strikes between two beats;
    it is removed if none are left.

    `write_position` writes their beats if they change. Raises EditError.
    """
    path = ("strikes", strikes.name)
    timed_hits = [
        (beat, hit) for beat, _, hit in strikes.played_hits(piece, since_beat, until_beat)
    ]
    hits_between = [
        (beat, hit) for beat, hit in timed_hits if since_beat - SAME <= beat < until_beat - SAME
    ]
    if len(hits_between) == len(timed_hits) and write_position is None and strikes.rhythm is None:
        return score_texts
    score_texts = score_texts.remove(path)
    if not hits_between:
        return score_texts
    position_of = write_position or (lambda beat: position_text(piece, beat))
    return score_texts.put(
        path,
        edit.flow(
            {"entries": [melody_entry(hit, position_of(beat)) for beat, hit in hits_between]}
        ),
    )


def melody_entry(hit: Hit, position: str) -> edit.Tree:
    """A strike of a melody as an entry of a score."""
    return {
        "at": position,
        "what": [target.text for target in hit.to],
        "impulse": hit.level.written,
    }
