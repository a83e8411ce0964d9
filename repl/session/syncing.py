"""`sync d1`: the beat on which another voice begins again."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from ergon.notation.clock.meter import SAME
from ergon.repl.session.version import NotTakenError
from ergon.scores.edits.strikes import strikes_named
from ergon.scores.pattern.search import n_before
from ergon.scores.pattern.steps import PlaceBeats

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ergon.scores.reading.piece import Piece, Strikes


def next_beginning(piece: Piece, voice_name: str, after_beat: float) -> float:
    """The first beat, not before `after_beat`, on which a voice begins again: a cycle of a rhythm,
    a round of a pattern, a phrase or a sweep, else a stroke or a gesture. Raises NotTakenError.
    """
    next_beats = [
        _next_beat(beats, after_beat) for beats in _beginning_beats(piece, voice_name, after_beat)
    ]
    later_beats = [beat for beat in next_beats if beat is not None]
    if not later_beats:
        place_text = piece.tempo_map.written(after_beat)
        raise NotTakenError(
            f"{voice_name} does not begin again after {place_text}: nothing to wait for"
        )
    return min(later_beats)


def _beginning_beats(piece: Piece, voice_name: str, after_beat: float) -> Iterator[Sequence[float]]:
    """Rising beats on which the strikes or the player of a name begin."""
    strikes = strikes_named(piece, voice_name)
    if any(voice.rate is not None for voice in strikes):
        raise NotTakenError(f"{voice_name} strikes by chance: there is no beat to wait for")
    for voice in strikes:
        yield _strikes_beginnings(piece, voice, after_beat)
    for play, start_beats in zip(piece.parts, piece.starts, strict=True):
        if play.player == voice_name and start_beats:
            yield (
                _next_round_beat(start_beats, after_beat)
                if isinstance(start_beats, PlaceBeats)
                else start_beats
            )


def _strikes_beginnings(piece: Piece, strikes: Strikes, after_beat: float) -> Sequence[float]:
    tempo_map = piece.tempo_map
    if strikes.rhythm is not None:
        begin_beat = tempo_map.resolve(strikes.at)
        cycle_index = strikes.rhythm.cycle_count(tempo_map, begin_beat, after_beat - SAME)
        cycle_beat = strikes.rhythm.cycle_begin(tempo_map, begin_beat, cycle_index)
        return [cycle_beat] if cycle_index < strikes.cycles(tempo_map) else []
    if strikes.pattern is not None:
        return _next_round_beat(strikes.place_beats(piece), after_beat)
    if strikes.length is not None or strikes.passing is not None:
        return strikes.rounds(tempo_map)
    if strikes.hits:
        return sorted({cycle_beat for cycle_beat, *_ in strikes.played_hits(piece)})
    return strikes.beats(tempo_map)


def _next_round_beat(pattern_steps: PlaceBeats, after_beat: float) -> Sequence[float]:
    """The beat of the next place on which a round of a pattern begins."""
    pattern = pattern_steps.places.pattern
    round_places = pattern.order.places if pattern.euclid is None else pattern.euclid.pulses
    place_index = n_before(pattern_steps, after_beat - SAME)
    place_index += -(place_index + pattern.skip) % round_places
    return [pattern_steps.beat(place_index)] if place_index < len(pattern_steps) else []


def _next_beat(beats: Sequence[float], after_beat: float) -> float | None:
    beat_index = n_before(beats, after_beat - SAME)
    return beats[beat_index] if beat_index < len(beats) else None
