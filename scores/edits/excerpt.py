"""Keeps some bars of a score as a score of their own.

The kept score has the same keys, instruments, gestures and mix, and only those bars in its
parts, from 1|1 to its mark `end`: it can be checked, rendered, loaded, copied from, or brought
back as a scene.
"""

from __future__ import annotations

import math

from ergon.notation.clock.meter import SAME
from ergon.notation.clock.occurrences import starts
from ergon.notation.clock.positions import Length
from ergon.notation.tables import quantities as q
from ergon.notation.text import edit
from ergon.notation.text.document import Mapping, Scalar
from ergon.notation.text.edit import EditError
from ergon.scores.edits import entries, space
from ergon.scores.edits.automation import ValueOn, value_text
from ergon.scores.edits.lists import dropped, items, place
from ergon.scores.edits.scenes import END
from ergon.scores.edits.strikes import only
from ergon.scores.edits.texts import Texts
from ergon.scores.pattern.search import n_before
from ergon.scores.reading.automation import Automation
from ergon.scores.reading.piece import Piece, Strikes


def keep(
    texts: Texts,
    piece: Piece,
    name: str,
    start: float,
    stop: float,
    value_on: ValueOn | None = None,
) -> Texts:
    """A score of the entries that begin between two beats; it begins at the first beat.

    `value_on` gives the values of glides that began before.

    Raises EditError if nothing begins there.
    """
    window = _Window(piece, start, stop, value_on)
    kept = texts.put(("title",), edit.quoted(name))
    found = False
    changes = []
    for player in piece.players:
        lines = entries.lines(texts, piece, player)
        chosen = [entry for line in lines if (entry := window.of(line)) is not None]
        found = found or bool(chosen)
        changes.append(entries.PartEdit(player, dropped=lines, new=chosen))
    kept = entries.change(kept, *changes)
    for strikes in piece.strikes:
        kept, is_in = window.strikes(kept, strikes)
        found = found or is_in
    if not found:
        first, last = piece.tempo_map.written(start), piece.tempo_map.written(stop)
        raise EditError(f"no gesture begins from {first} to {last}")
    kept = space.kept(kept, piece, start)
    end = window.at(stop)
    end = end if "|" in end else f"{end}beats"
    kept = window.automation(window.duet(kept)).put(("marks", END), end)
    if piece.render.file is not None:
        kept = kept.put(("render", "file"), edit.quoted(f"{name}.wav"))
    # Write the tempo last: the other edits read positions by the old tempo map.
    return window.tempo(kept)


_PIECES = 32  # of a glide that is cut


class _Window:
    """The beats from `start` to `stop` of a piece, counted from `start`."""

    def __init__(self, piece: Piece, start: float, stop: float, value_on: ValueOn | None) -> None:
        self.piece = piece
        self.value_on = value_on
        self.map = piece.tempo_map
        self.start = start
        self.stop = stop

    def within(self, beats: list[float]) -> list[float]:
        return [beat for beat in beats if self.start - SAME <= beat < self.stop - SAME]

    def at(self, beats: float) -> str:
        """A beat of the piece as a position in the window: `bar|beat`, or beats if the window does
        not begin on a bar.
        """
        beats = max(0.0, beats - self.start)
        bar, _ = self.map.bar_beat(self.start)
        whole, beat = self.map.bar_beat(self.start + beats)
        if abs(self.map.bars.start(bar) - self.start) < SAME:
            return f"{whole - bar + 1}|{beat:.12g}"
        return f"{beats:.12g}"  # the window does not begin on a bar: count beats alone

    def of(self, line: entries.Line) -> entries.Entry | None:
        """The entry with only its beginnings in the window; None if there are none."""
        if line.starts is None:
            if not self.within([line.begin]):
                return None
            entry = line.entry.with_fields(at=self.at(line.begin))
            if line.play.until is None:
                return entry
            return entry.with_fields(
                until=self.at(min(self.stop, self.map.resolve(line.play.until)))
            )
        first, last = line.count_before(self.start), line.count_before(self.stop)
        return line.part(first, last, self.at) if first < last else None

    def strikes(self, texts: Texts, strikes: Strikes) -> tuple[Texts, bool]:
        """Strikes cut to the window, and whether any fall in it."""
        path = ("strikes", strikes.name)
        begin = self.map.resolve(strikes.at)
        if strikes.is_melody and strikes.length is None:
            falls = [beat for beat, *_ in strikes.falls(self.piece, self.start, self.stop)]
            kept = only(texts, self.piece, strikes, self.start, self.stop, self.at)
            return kept, bool(self.within(falls))
        stop = begin if strikes.until is None else self.map.resolve(strikes.until)
        if strikes.span is not None:
            stop = self.map.after(begin, strikes.span)
        said: dict[str, str | None] = {"for": None, "until": None}
        if strikes.passing is not None:  # `for` is the time of one pass
            del said["for"]
        if strikes.pattern is not None:
            places = strikes.steps(self.piece)
            since, until = (n_before(places, at - SAME) for at in (self.start, self.stop))
            if since == until:
                return texts.remove(path), False
            said |= places.part(since, until, self.at)
        elif strikes.rate is not None:
            first, last = max(begin, self.start), min(stop, self.stop)
            if last <= first + SAME:
                return texts.remove(path), False
            said |= {"at": self.at(first), "until": self.at(last)}
        else:
            end = stop if strikes.until is not None or strikes.span is not None else None
            every, times = strikes.every, strikes.times
            found = (
                strikes.rounds(self.map)
                if strikes.has_rounds
                else starts(self.map, begin, Length(), every=every, times=times, until=end)
            )
            inside = self.within(found)
            if not inside:
                return texts.remove(path), False
            said |= {"at": self.at(inside[0])}
            if every is not None or strikes.has_rounds:
                said |= {"times": str(len(inside))}
        return self._said(texts, path, said), True

    def duet(self, texts: Texts) -> Texts:
        """Couplings cut to the window."""
        for number in reversed(range(len(self.piece.duet))):
            coupling = self.piece.duet[number]
            begin = self.map.resolve(coupling.at)
            end = self.stop if coupling.until is None else self.map.resolve(coupling.until)
            if begin >= self.stop - SAME or end <= self.start + SAME:
                texts = dropped(texts, "duet", number)
                continue
            until = self.at(end) if coupling.until is not None and end < self.stop else None
            said = {"at": self.at(begin), "until": until}
            texts = self._said(texts, place(texts, "duet", number), said)
        return texts

    def automation(self, texts: Texts) -> Texts:
        """Automation cut to the window."""
        for number in reversed(range(len(self.piece.automation))):
            one = self.piece.automation[number]
            begin = self.map.resolve(one.at)
            end = math.inf if one.until is None else self.map.resolve(one.until)
            said: dict[str, str | None] = {"at": self.at(begin)}
            if one.points:
                texts = self._glide(texts, number, one, begin, end)
                continue
            places = None if one.pattern is None else one.steps(self.map, self.piece.seed)
            if places is not None:
                end = min(end, places.beat(len(places)))
            if begin >= self.stop - SAME or end <= self.start + SAME:
                texts = dropped(texts, "automation", number)
                continue
            if end < math.inf:
                said["until"] = self.at(min(end, self.stop))
            if begin < self.start - SAME and places is not None:
                first = n_before(places, self.start - SAME)
                if first == len(places):
                    texts = dropped(texts, "automation", number)
                    continue
                said |= places.part(first, len(places), self.at)
                said["until"] = self.at(min(end, self.stop))
            elif begin < self.start - SAME and one.swing is not None:
                period = self.map.after(begin, one.swing.period) - begin
                phase = (one.swing.phase + (self.start - begin) / period) % 1.0
                said["phase"] = f"{phase:.12g}"
            elif begin < self.start - SAME and one.moves:
                node = items(texts, "automation")[number]
                written = node.get("start") if isinstance(node, Mapping) else None
                before = q.quantity(written.text, q.RATIO) if isinstance(written, Scalar) else 0.0
                past = self.map.bars.quarters(self.start) - self.map.bars.quarters(begin)
                said["start"] = f"{before + past:.12g}"
            texts = self._said(texts, place(texts, "automation", number), said)
        return texts

    def _glide(self, texts: Texts, number: int, one: Automation, begin: float, end: float) -> Texts:
        """A glide cut to the window: one that began before becomes a curve."""
        if begin >= self.stop - SAME or end <= self.start + SAME:
            return dropped(texts, "automation", number)
        said: dict[str, str | None] = {"at": self.at(begin)}
        if end < math.inf:
            said["until"] = self.at(min(end, self.stop))
        if begin < self.start - SAME and self.value_on is not None:
            said |= {"at": self.at(self.start), "over": None, "curve": None}
            piece, where, tempo = self.piece, (one.target.part, one.target.module), self.map
            if one.over is not None:
                ended = tempo.after(begin, one.over)
            else:
                ended = tempo.beats(tempo.instant(begin, one.points[-1].at))
            left = tempo.seconds(max(ended, self.start)) - tempo.seconds(self.start)
            points = []
            for step in range(_PIECES + 1 if left > 0.0 else 1):
                at = left * step / _PIECES
                beat = tempo.beats(tempo.seconds(self.start) + at)
                value = self.value_on(self.piece, where, one.parameter, beat)
                word = value_text(piece, one.name, value, self.value_on)
                points.append(f"{word}@{at:.12g}s")
            said["to"] = " line ".join(points)
        return self._said(texts, place(texts, "automation", number), said)

    def tempo(self, texts: Texts) -> Texts:
        """Write the tempo and meter at the start of the window, and the changes that follow."""
        _, _, meter = [c for c in self.map.bars.changes() if c[0] <= self.start + SAME][-1]
        first: dict[str, edit.Tree] = {"at": "1|1", "bpm": f"{self.map.bpm(self.start):.12g}"}
        first["meter"] = str(meter)
        said = [first]
        for begin, entry in self.map.placed:
            end = begin if entry.over is None else self.map.after(begin, entry.over)
            if begin >= self.stop - SAME or max(begin, end) <= self.start + SAME:
                continue
            if entry.bpm is None and entry.meter is None:
                continue
            if begin <= self.start + SAME:  # a ramp under way goes on
                first["bpm"] = f"{first['bpm']} -> {entry.bpm_end:.12g}"
                first["over"] = f"{end - self.start:.12g}"
                continue
            more: dict[str, edit.Tree] = {"at": self.at(begin)}
            if entry.bpm is not None:
                is_ramp = entry.bpm_end is not None
                more["bpm"] = f"{entry.bpm:.12g}" + (f" -> {entry.bpm_end:.12g}" if is_ramp else "")
            if entry.over is not None:
                more["over"] = f"{end - begin:.12g}"
            if entry.meter is not None:
                more["meter"] = str(entry.meter)
            said.append(more)
        for section in ("tempo", "meter"):  # what files say of them is written out
            if items(texts, section):
                texts = texts.remove((section,))
        for one in said:
            texts = texts.append(("tempo",), edit.flow(one))
        return texts

    def _said(self, texts: Texts, path: edit.Path, fields: dict[str, str | None]) -> Texts:
        """Set fields of an entry; None removes a field."""
        for name, text in fields.items():
            if text is not None:
                texts = texts.put((*path, name), text)
                continue
            try:
                texts = texts.remove((*path, name))
            except EditError:  # the field is not written
                continue
        return texts
