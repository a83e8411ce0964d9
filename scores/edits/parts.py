"""Changes what a player plays from a beat on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from itertools import islice, takewhile

from ergon.notation.clock.meter import SAME
from ergon.notation.text.edit import EditError
from ergon.notation.text.errors import quote
from ergon.scores.edits import automation, entries, strikes
from ergon.scores.edits.entries import Entry, PartEdit
from ergon.scores.edits.positions import ENDLESS_POSITION, endless_end, position_text
from ergon.scores.edits.texts import Texts
from ergon.scores.gesture.transforms import MidpointChance, apply
from ergon.scores.pattern import words
from ergon.scores.pattern.steps import PlaceBeats
from ergon.scores.pattern.turn_chain import is_turn
from ergon.scores.reading.patterns import PATTERN_FIELDS
from ergon.scores.reading.piece import Piece


def play(
    score_texts: Texts, piece: Piece, player: str, from_beat: float, new_entry: Entry
) -> Texts:
    """Let a player play an entry from a beat on.

    `every` or `euclid` without an end repeats for ever. Raises EditError.
    """
    new_entry = new_entry.from_position(position_text(piece, from_beat))
    if {"every", "euclid"} & set(new_entry.fields) and not {"times", "until"} & set(
        new_entry.fields
    ):
        new_entry = new_entry.with_fields(until=endless_end(piece, from_beat))
    return entries.with_part_edits(
        score_texts,
        part_edit_ending_at(
            score_texts, piece, _known_player(piece, player), from_beat, [new_entry]
        ),
    )


def transform(
    score_texts: Texts, piece: Piece, player: str, from_beat: float, transforms: Sequence[str]
) -> Texts:
    """Add transformations to what a player plays; the next occurrence keeps its beat.

    Entries that begin on this beat are transformed as a whole; a gesture that plays once and has
    not ended begins again. Raises EditError.
    """
    placed_entries = entries.placed_entries(
        score_texts, piece, _known_player(piece, player), from_beat
    )
    playing_entries = [
        placed for placed in placed_entries if placed.is_continuing(from_beat, piece)
    ]
    beginning_entries = [
        placed for placed in placed_entries if abs(placed.begin_beat - from_beat) < SAME
    ]
    if not (playing_entries or beginning_entries):
        newest_entries = entries.newest_first(score_texts, piece, player)
        playing_entries = [
            *islice(
                filter(
                    None,
                    (_ongoing_occurrence(placed, piece, from_beat) for placed in newest_entries),
                ),
                1,
            )
        ]
    if not (playing_entries or beginning_entries):
        raise EditError(f"{player} plays nothing at {piece.tempo_map.written(from_beat)}")
    ended_entries, new_entries = [], []
    for playing_entry in playing_entries:
        later_entry = Entry(
            playing_entry.entry.fields, (*playing_entry.entry.transforms, *transforms)
        )
        if playing_entry.is_continuing(from_beat, piece):
            ended_entries.append(playing_entry)
            later_entry = _remaining_entry(playing_entry, piece, later_entry, from_beat)
        else:
            constant_transforms = takewhile(
                lambda entry_transform: not is_turn(entry_transform), playing_entry.entry.transforms
            )
            later_entry = Entry(playing_entry.entry.fields, (*constant_transforms, *transforms))
            later_entry = later_entry.with_fields(
                at=position_text(piece, from_beat), every=None, times=None, until=None
            )
        new_entries.append(later_entry)
    new_entries += [
        Entry(placed.entry.fields, (*placed.entry.transforms, *transforms))
        for placed in beginning_entries
    ]
    return entries.with_part_edits(
        score_texts,
        PartEdit(
            player, position_text(piece, from_beat), ended_entries, beginning_entries, new_entries
        ),
    )


def _remaining_entry(
    placed_entry: entries.PlacedEntry, piece: Piece, new_entry: entries.Entry, from_beat: float
) -> entries.Entry:
    """The part of a line that is left from a beat on, with the fields of `new_entry`."""
    start_beats = placed_entry.start_beats or ()
    n_played = placed_entry.count_before(from_beat)
    if isinstance(start_beats, PlaceBeats) and n_played < len(start_beats):
        remaining = replace(placed_entry, entry=new_entry).entry_between(
            n_played, len(start_beats), partial(position_text, piece)
        )
        end_position = None if "times" in new_entry.fields else new_entry.fields.get("until")
        return remaining if end_position is None else remaining.with_fields(until=end_position)
    later_entry = new_entry.with_fields(
        at=position_text(piece, start_beats[n_played] if n_played < len(start_beats) else from_beat)
    )
    if n_played and any(
        map(is_turn, new_entry.transforms)
    ):  # a pattern now, whose rounds go on counting
        return later_entry.with_fields(skip=str(n_played))
    if n_played < len(start_beats) and "times" in later_entry.fields:
        later_entry = later_entry.with_fields(times=str(len(start_beats) - n_played))
    return later_entry


def end_part(score_texts: Texts, piece: Piece, player: str | None, beat: float) -> Texts:
    """End the part of a player (None: of all), or strikes, at a beat. Raises EditError."""
    if player is not None and (named_strikes := strikes.strikes_named(piece, player)):
        for strikes_entry in named_strikes:
            score_texts = strikes.end_strikes(score_texts, piece, strikes_entry, beat)
        return score_texts
    names = piece.players if player is None else (_known_player(piece, player),)
    return entries.with_part_edits(
        score_texts, *(part_edit_ending_at(score_texts, piece, name, beat) for name in names)
    )


def part_edit_ending_at(
    score_texts: Texts,
    piece: Piece,
    player: str,
    end_beat: float,
    new_entries: Sequence[Entry] = (),
) -> PartEdit:
    """The edit that ends the part of a player at a beat, and adds new entries."""
    placed_entries = entries.placed_entries(score_texts, piece, player, end_beat)
    ended_entries = [placed for placed in placed_entries if placed.is_continuing(end_beat, piece)]
    later_entries = [placed for placed in placed_entries if placed.begin_beat >= end_beat - SAME]
    return PartEdit(
        player, position_text(piece, end_beat), ended_entries, later_entries, new_entries
    )


def end_all_parts(score_texts: Texts, piece: Piece, from_beat: float) -> Texts:
    """End all parts and strikes at a beat, also in the middle of a phrase. Raises EditError."""
    score_texts = end_part(score_texts, piece, None, from_beat)
    for strikes_entry in piece.strikes:
        score_texts = strikes.end_strikes_at_once(score_texts, piece, strikes_entry, from_beat)
    return score_texts


def end_endless(score_texts: Texts, piece: Piece, end_beat: float) -> Texts:
    """End endless parts, strikes and automation at a beat, for a score that is saved."""
    for player_name in piece.players:
        for placed_entry in entries.placed_entries(score_texts, piece, player_name):
            if ENDLESS_POSITION.fullmatch(placed_entry.entry.fields.get("until", "")) is None:
                continue
            # An entry that begins after `end_beat` plays once.
            until_text = position_text(piece, max(end_beat, placed_entry.begin_beat + 1.0))
            score_texts = entries.with_part_edits(
                score_texts, PartEdit(player_name, until_text, [placed_entry])
            )
    for strikes_entry in piece.strikes:
        if (
            strikes_entry.until is not None
            and ENDLESS_POSITION.fullmatch(strikes_entry.until.text) is not None
        ):
            until_text = position_text(
                piece, max(end_beat, piece.tempo_map.resolve(strikes_entry.at) + 1.0)
            )
            score_texts = score_texts.put(("strikes", strikes_entry.name, "until"), until_text)
    return automation.end_endless(score_texts, piece, end_beat)


def _known_player(piece: Piece, player: str) -> str:
    if player not in piece.players:
        raise EditError(f"this score has no player {quote(player)}")
    return player


def _ongoing_occurrence(
    placed_entry: entries.PlacedEntry, piece: Piece, end_beat: float
) -> entries.PlacedEntry | None:
    """The last occurrence of an entry, as an entry that plays it alone; None if it has ended or not
    begun.
    """
    tempo_map, gesture_name = piece.tempo_map, placed_entry.play.played_text
    begin_beat = (
        placed_entry.start_beats[-1] if placed_entry.start_beats else placed_entry.begin_beat
    )
    if isinstance(placed_entry.start_beats, PlaceBeats):
        places = placed_entry.start_beats.places
        last_played = next(
            (
                place_index
                for place_index in reversed(range(len(placed_entry.start_beats)))
                if places.played_name(place_index)
            ),
            None,
        )
        if last_played is None:
            return None
        begin_beat, gesture_name = (
            placed_entry.start_beats[last_played],
            places.played_name(last_played) or "",
        )
        pattern_fields = dict.fromkeys((*PATTERN_FIELDS, words.NTH_OPTION), None)
        placed_entry = replace(
            placed_entry,
            entry=placed_entry.entry.with_fields(**{**pattern_fields, "play": gesture_name}),
        )
    gesture = piece.gestures.get(gesture_name)
    if begin_beat >= end_beat - SAME or gesture is None:
        return None
    beat = gesture.beat(tempo_map, begin_beat)
    gesture_points, _ = apply(
        gesture.points, (*gesture.do, *placed_entry.play.do), MidpointChance(), beat
    )
    return (
        placed_entry
        if gesture.instant(tempo_map, begin_beat, gesture_points[-1].at)
        > tempo_map.seconds(end_beat)
        else None
    )
