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
from ergon.scores.edits.positions import END, end, written
from ergon.scores.edits.texts import Texts
from ergon.scores.gesture.transforms import MidpointChance, apply
from ergon.scores.pattern import words
from ergon.scores.pattern.steps import Steps
from ergon.scores.pattern.turn_chain import is_turn
from ergon.scores.reading.patterns import PATTERN_FIELDS
from ergon.scores.reading.piece import Piece


def play(texts: Texts, piece: Piece, player: str, beat: float, entry: Entry) -> Texts:
    """Let a player play an entry from a beat on.

    `every` or `euclid` without an end repeats for ever. Raises EditError.
    """
    entry = entry.starting(written(piece, beat))
    if {"every", "euclid"} & set(entry.fields) and not {"times", "until"} & set(entry.fields):
        entry = entry.with_fields(until=end(piece, beat))
    return entries.change(texts, ending(texts, piece, _known(piece, player), beat, [entry]))


def transform(texts: Texts, piece: Piece, player: str, beat: float, chain: Sequence[str]) -> Texts:
    """Add transformations to what a player plays; the next occurrence keeps its beat.

    Entries that begin on this beat are transformed as a whole; a gesture that plays once and has
    not ended begins again. Raises EditError.
    """
    lines = entries.lines(texts, piece, _known(piece, player), beat)
    playing = [line for line in lines if line.is_open(beat, piece)]
    begins = [line for line in lines if abs(line.begin - beat) < SAME]
    if not (playing or begins):
        newest = entries.newest_first(texts, piece, player)
        playing = [*islice(filter(None, (_under_way(line, piece, beat) for line in newest)), 1)]
    if not (playing or begins):
        raise EditError(f"{player} plays nothing at {piece.tempo_map.written(beat)}")
    closed, new = [], []
    for line in playing:
        later_entry = Entry(line.entry.fields, (*line.entry.do, *chain))
        if line.is_open(beat, piece):
            closed.append(line)
            later_entry = _rest_of(line, piece, later_entry, beat)
        else:
            always = takewhile(lambda do: not is_turn(do), line.entry.do)
            later_entry = Entry(line.entry.fields, (*always, *chain))
            later_entry = later_entry.with_fields(
                at=written(piece, beat), every=None, times=None, until=None
            )
        new.append(later_entry)
    new += [Entry(line.entry.fields, (*line.entry.do, *chain)) for line in begins]
    return entries.change(texts, PartEdit(player, written(piece, beat), closed, begins, new))


def _rest_of(
    line: entries.PlacedEntry, piece: Piece, entry: entries.Entry, beat: float
) -> entries.Entry:
    """The part of a line that is left from a beat on, with the fields of `entry`."""
    starts = line.starts or ()
    n_done = line.count_before(beat)
    if isinstance(starts, Steps) and n_done < len(starts):
        first_part = replace(line, entry=entry).part(n_done, len(starts), partial(written, piece))
        until = None if "times" in entry.fields else entry.fields.get("until")
        return first_part if until is None else first_part.with_fields(until=until)
    later_entry = entry.with_fields(
        at=written(piece, starts[n_done] if n_done < len(starts) else beat)
    )
    if n_done and any(map(is_turn, entry.do)):  # a pattern now, whose rounds go on counting
        return later_entry.with_fields(skip=str(n_done))
    if n_done < len(starts) and "times" in later_entry.fields:
        later_entry = later_entry.with_fields(times=str(len(starts) - n_done))
    return later_entry


def rest(texts: Texts, piece: Piece, player: str | None, beat: float) -> Texts:
    """End the part of a player (None: of all), or strikes, at a beat. Raises EditError."""
    if player is not None and (named_strikes := strikes.named(piece, player)):
        for strikes_entry in named_strikes:
            texts = strikes.end(texts, piece, strikes_entry, beat)
        return texts
    names = piece.players if player is None else (_known(piece, player),)
    return entries.change(texts, *(ending(texts, piece, name, beat) for name in names))


def ending(
    texts: Texts, piece: Piece, player: str, beat: float, new: Sequence[Entry] = ()
) -> PartEdit:
    """The edit that ends the part of a player at a beat, and adds new entries."""
    lines = entries.lines(texts, piece, player, beat)
    closed = [line for line in lines if line.is_open(beat, piece)]
    later_lines = [line for line in lines if line.begin >= beat - SAME]
    return PartEdit(player, written(piece, beat), closed, later_lines, new)


def hush(texts: Texts, piece: Piece, beat: float) -> Texts:
    """End all parts and strikes at a beat, also in the middle of a phrase. Raises EditError."""
    texts = rest(texts, piece, None, beat)
    for strikes_entry in piece.strikes:
        texts = strikes.cut(texts, piece, strikes_entry, beat)
    return texts


def finish(texts: Texts, piece: Piece, beat: float) -> Texts:
    """End endless parts, strikes and automation at a beat, for a score that is saved."""
    for name in piece.players:
        for line in entries.lines(texts, piece, name):
            if END.fullmatch(line.entry.fields.get("until", "")) is None:
                continue
            # An entry that begins after `beat` plays once.
            until = written(piece, max(beat, line.begin + 1.0))
            texts = entries.change(texts, PartEdit(name, until, [line]))
    for entry in piece.strikes:
        if entry.until is not None and END.fullmatch(entry.until.text) is not None:
            until = written(piece, max(beat, piece.tempo_map.resolve(entry.at) + 1.0))
            texts = texts.put(("strikes", entry.name, "until"), until)
    return automation.finish(texts, piece, beat)


def _known(piece: Piece, player: str) -> str:
    if player not in piece.players:
        raise EditError(f"this score has no player {quote(player)}")
    return player


def _under_way(
    line: entries.PlacedEntry, piece: Piece, instant: float
) -> entries.PlacedEntry | None:
    """The last occurrence of an entry, as an entry that plays it alone; None if it has ended or not
    begun.
    """
    tempo, pattern_or_name = piece.tempo_map, line.play.what
    begin = line.starts[-1] if line.starts else line.begin
    if isinstance(line.starts, Steps):
        course = line.starts.course
        last_played = next((n for n in reversed(range(len(line.starts))) if course.played(n)), None)
        if last_played is None:
            return None
        begin, pattern_or_name = line.starts[last_played], course.played(last_played) or ""
        fields = dict.fromkeys((*PATTERN_FIELDS, words.NTH), None)
        line = replace(line, entry=line.entry.with_fields(**{**fields, "play": pattern_or_name}))
    gesture = piece.gestures.get(pattern_or_name)
    if begin >= instant - SAME or gesture is None:
        return None
    beat = gesture.beat(tempo, begin)
    points, _ = apply(gesture.points, (*gesture.do, *line.play.do), MidpointChance(), beat)
    return line if gesture.instant(tempo, begin, points[-1].at) > tempo.seconds(instant) else None
