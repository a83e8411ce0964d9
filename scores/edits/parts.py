"""Changing what a player plays from a beat on."""

from __future__ import annotations

from collections.abc import Sequence

from ergon.notation.clock.meter import SAME
from ergon.notation.text.edit import EditError
from ergon.notation.text.errors import quote
from ergon.scores.edits import entries
from ergon.scores.edits.entries import Entry
from ergon.scores.edits.positions import END, end, written
from ergon.scores.edits.texts import Texts
from ergon.scores.gesture.transforms import Middle, apply
from ergon.scores.reading.piece import Piece


def play(texts: Texts, piece: Piece, player: str, at: float, entry: Entry) -> Texts:
    """Let a player play an entry from a beat on; `every` alone repeats without end.

    Raises EditError.
    """
    entry = entry.at(written(piece, at))
    if "every" in entry.fields and not {"times", "until"} & set(entry.fields):
        entry = entry.with_fields(until=end(piece, at))
    return _ended(texts, piece, _known(piece, player), at, [entry])


def transform(texts: Texts, piece: Piece, player: str, at: float, chain: Sequence[str]) -> Texts:
    """Transform further what a player plays; its next occurrence keeps its beat.

    What begins just there begins so; a gesture that plays once and is still under way begins
    again. Raises EditError.
    """
    lines = entries.lines(texts, piece, _known(piece, player))
    playing = [line for line in lines if line.is_open(at, piece)]
    begins = [line for line in lines if abs(line.begin - at) < SAME]
    if not (playing or begins):
        playing = [line for line in lines if _is_under_way(line, piece, at)][-1:]
    if not (playing or begins):
        raise EditError(f"{player} plays nothing at {piece.tempo_map.written(at)}")
    closed, new = [], []
    for line in playing:
        more = Entry(line.entry.fields, (*line.entry.do, *chain))
        if line.is_open(at, piece):
            closed.append(line)
            left = [start for start in line.starts or () if start >= at - SAME]
            more = more.with_fields(at=written(piece, left[0] if left else at))
            if left and "times" in more.fields:
                more = more.with_fields(times=str(len(left)))
        else:
            more = more.with_fields(at=written(piece, at), every=None, times=None, until=None)
        new.append(more)
    new += [Entry(line.entry.fields, (*line.entry.do, *chain)) for line in begins]
    return entries.change(texts, player, written(piece, at), closed, begins, new)


def rest(texts: Texts, piece: Piece, player: str | None, at: float) -> Texts:
    """End the part of a player (None: of all) at a beat. Raises EditError."""
    for name in piece.players if player is None else (_known(piece, player),):
        texts = _ended(texts, piece, name, at)
    return texts


def _ended(texts: Texts, piece: Piece, player: str, at: float, new: Sequence[Entry] = ()) -> Texts:
    """The part of a player ended at a beat, and new entries in its place."""
    lines = entries.lines(texts, piece, player)
    closed = [line for line in lines if line.is_open(at, piece)]
    later = [line for line in lines if line.begin >= at - SAME]
    return entries.change(texts, player, written(piece, at), closed, later, new)


def hush(texts: Texts, piece: Piece, at: float) -> Texts:
    """End all parts and strikes at a beat. Raises EditError."""
    texts = rest(texts, piece, None, at)
    tempo = piece.tempo_map
    for strikes in piece.strikes:
        begin = tempo.resolve(strikes.at)
        path = ("strikes", strikes.name)
        if begin >= at - SAME:
            texts = texts.remove(path)
            continue
        stop = begin if strikes.until is None else tempo.resolve(strikes.until)
        if strikes.span is not None:
            stop = tempo.after(begin, strikes.span)
            texts = texts.remove((*path, "for")) if stop > at else texts
        elif strikes.times is not None and strikes.every is not None and strikes.until is None:
            stop = tempo.after(begin, strikes.every.times(strikes.times))
        if stop > at + SAME:
            texts = texts.put((*path, "until"), written(piece, at))
    return texts


def finish(texts: Texts, piece: Piece, at: float) -> Texts:
    """End at a beat what repeats without end, for a score that is saved."""
    for name in piece.players:
        for line in entries.lines(texts, piece, name):
            if END.fullmatch(line.entry.fields.get("until", "")) is None:
                continue
            # An entry that begins later is left to play once.
            until = written(piece, max(at, line.begin + 1.0))
            texts = entries.change(texts, name, until, [line])
    return texts


def _known(piece: Piece, player: str) -> str:
    if player not in piece.players:
        raise EditError(f"this score has no player {quote(player)}")
    return player


def _is_under_way(line: entries.Line, piece: Piece, at: float) -> bool:
    """Whether the last occurrence of an entry has begun and not ended."""
    tempo, gesture = piece.tempo_map, piece.gestures.get(line.play.what)
    begin = line.starts[-1] if line.starts else line.begin
    if begin >= at - SAME or gesture is None:
        return False
    beat = 60.0 / tempo.bpm(begin)
    points, _ = apply(gesture.points, (*gesture.do, *line.play.do), Middle(), beat)
    return tempo.instant(begin, points[-1].at) > tempo.seconds(at)
