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
    excerpt = texts.put(("title",), edit.quoted(name))
    is_included = False
    changes = []
    for player in piece.players:
        lines = entries.lines(texts, piece, player)
        chosen = [entry for line in lines if (entry := window.excerpt_of(line)) is not None]
        is_included = is_included or bool(chosen)
        changes.append(entries.PartEdit(player, dropped=lines, new=chosen))
    excerpt = entries.change(excerpt, *changes)
    for strikes in piece.strikes:
        excerpt, is_in = window.strikes(excerpt, strikes)
        is_included = is_included or is_in
    if not is_included:
        start_text, stop_text = piece.tempo_map.written(start), piece.tempo_map.written(stop)
        raise EditError(f"no gesture begins from {start_text} to {stop_text}")
    excerpt = space.fades_from(excerpt, piece, start)
    end = window.position(stop)
    end = end if "|" in end else f"{end}beats"
    excerpt = window.automation(window.duet(excerpt)).put(("marks", END), end)
    if piece.render.file is not None:
        excerpt = excerpt.put(("render", "file"), edit.quoted(f"{name}.wav"))
    # Write the tempo last: the other edits read positions by the old tempo map.
    return window.tempo(excerpt)


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

    def position(self, beats: float) -> str:
        """A beat of the piece as a position in the window: `bar|beat`, or beats if the window does
        not begin on a bar.
        """
        beats = max(0.0, beats - self.start)
        bar, _ = self.map.bar_beat(self.start)
        full_bars, beat = self.map.bar_beat(self.start + beats)
        if abs(self.map.bars.start(bar) - self.start) < SAME:
            return f"{full_bars - bar + 1}|{beat:.12g}"
        return f"{beats:.12g}"  # the window does not begin on a bar: count beats alone

    def excerpt_of(self, line: entries.PlacedEntry) -> entries.Entry | None:
        """The entry with only its beginnings in the window; None if there are none."""
        if line.starts is None:
            if not self.within([line.begin]):
                return None
            entry = line.entry.with_fields(at=self.position(line.begin))
            if line.play.until is None:
                return entry
            return entry.with_fields(
                until=self.position(min(self.stop, self.map.resolve(line.play.until)))
            )
        first_start, stop_start = line.count_before(self.start), line.count_before(self.stop)
        return (
            line.part(first_start, stop_start, self.position) if first_start < stop_start else None
        )

    def strikes(self, texts: Texts, strikes: Strikes) -> tuple[Texts, bool]:
        """Strikes cut to the window, and whether any fall in it."""
        path = ("strikes", strikes.name)
        begin = self.map.resolve(strikes.at)
        if strikes.is_melody and strikes.length is None:
            falls = [beat for beat, *_ in strikes.falls(self.piece, self.start, self.stop)]
            excerpt = only(texts, self.piece, strikes, self.start, self.stop, self.position)
            return excerpt, bool(self.within(falls))
        stop = begin if strikes.until is None else self.map.resolve(strikes.until)
        if strikes.span is not None:
            stop = self.map.after(begin, strikes.span)
        changed_fields: dict[str, str | None] = {"for": None, "until": None}
        if strikes.passing is not None:  # `for` is the time of one pass
            del changed_fields["for"]
        if strikes.pattern is not None:
            places = strikes.steps(self.piece)
            first_place, stop_place = (
                n_before(places, at - SAME) for at in (self.start, self.stop)
            )
            if first_place == stop_place:
                return texts.remove(path), False
            changed_fields |= places.part(first_place, stop_place, self.position)
        elif strikes.rate is not None:
            first_beat, last_beat = max(begin, self.start), min(stop, self.stop)
            if last_beat <= first_beat + SAME:
                return texts.remove(path), False
            changed_fields |= {"at": self.position(first_beat), "until": self.position(last_beat)}
        else:
            end = stop if strikes.until is not None or strikes.span is not None else None
            every, times = strikes.every, strikes.times
            window_starts = (
                strikes.rounds(self.map)
                if strikes.has_rounds
                else starts(self.map, begin, Length(), every=every, times=times, until=end)
            )
            inside = self.within(window_starts)
            if not inside:
                return texts.remove(path), False
            changed_fields |= {"at": self.position(inside[0])}
            if every is not None or strikes.has_rounds:
                changed_fields |= {"times": str(len(inside))}
        return self._with_fields(texts, path, changed_fields), True

    def duet(self, texts: Texts) -> Texts:
        """Couplings cut to the window."""
        for number in reversed(range(len(self.piece.duet))):
            coupling = self.piece.duet[number]
            begin = self.map.resolve(coupling.at)
            end = self.stop if coupling.until is None else self.map.resolve(coupling.until)
            if begin >= self.stop - SAME or end <= self.start + SAME:
                texts = dropped(texts, "duet", number)
                continue
            until = self.position(end) if coupling.until is not None and end < self.stop else None
            fields = {"at": self.position(begin), "until": until}
            texts = self._with_fields(texts, place(texts, "duet", number), fields)
        return texts

    def automation(self, texts: Texts) -> Texts:
        """Automation cut to the window."""
        for number in reversed(range(len(self.piece.automation))):
            entry = self.piece.automation[number]
            begin = self.map.resolve(entry.at)
            end = math.inf if entry.until is None else self.map.resolve(entry.until)
            fields: dict[str, str | None] = {"at": self.position(begin)}
            if entry.points:
                texts = self._glide(texts, number, entry, begin, end)
                continue
            places = None if entry.pattern is None else entry.steps(self.map, self.piece.seed)
            if places is not None:
                end = min(end, places.beat(len(places)))
            if begin >= self.stop - SAME or end <= self.start + SAME:
                texts = dropped(texts, "automation", number)
                continue
            if end < math.inf:
                fields["until"] = self.position(min(end, self.stop))
            if begin < self.start - SAME and places is not None:
                first = n_before(places, self.start - SAME)
                if first == len(places):
                    texts = dropped(texts, "automation", number)
                    continue
                fields |= places.part(first, len(places), self.position)
                fields["until"] = self.position(min(end, self.stop))
            elif begin < self.start - SAME and entry.swing is not None:
                period = self.map.after(begin, entry.swing.period) - begin
                phase = (entry.swing.phase + (self.start - begin) / period) % 1.0
                fields["phase"] = f"{phase:.12g}"
            elif begin < self.start - SAME and entry.moves:
                node = items(texts, "automation")[number]
                written = node.get("start") if isinstance(node, Mapping) else None
                before = q.quantity(written.text, q.RATIO) if isinstance(written, Scalar) else 0.0
                past = self.map.bars.quarters(self.start) - self.map.bars.quarters(begin)
                fields["start"] = f"{before + past:.12g}"
            texts = self._with_fields(texts, place(texts, "automation", number), fields)
        return texts

    def _glide(
        self, texts: Texts, number: int, entry: Automation, begin: float, end: float
    ) -> Texts:
        """A glide cut to the window: one that began before becomes a curve."""
        if begin >= self.stop - SAME or end <= self.start + SAME:
            return dropped(texts, "automation", number)
        fields: dict[str, str | None] = {"at": self.position(begin)}
        if end < math.inf:
            fields["until"] = self.position(min(end, self.stop))
        if begin < self.start - SAME and self.value_on is not None:
            fields |= {"at": self.position(self.start), "over": None, "curve": None}
            piece, module_key, tempo = (
                self.piece,
                (entry.target.part, entry.target.module),
                self.map,
            )
            if entry.over is not None:
                ended = tempo.after(begin, entry.over)
            else:
                ended = tempo.beats(tempo.instant(begin, entry.points[-1].at))
            seconds_left = tempo.seconds(max(ended, self.start)) - tempo.seconds(self.start)
            points = []
            for step in range(_PIECES + 1 if seconds_left > 0.0 else 1):
                offset = seconds_left * step / _PIECES
                beat = tempo.beats(tempo.seconds(self.start) + offset)
                value = self.value_on(self.piece, module_key, entry.parameter, beat)
                word = value_text(piece, entry.name, value, self.value_on)
                points.append(f"{word}@{offset:.12g}s")
            fields["to"] = " line ".join(points)
        return self._with_fields(texts, place(texts, "automation", number), fields)

    def tempo(self, texts: Texts) -> Texts:
        """Write the tempo and meter at the start of the window, and the changes that follow."""
        _, _, meter = [c for c in self.map.bars.changes() if c[0] <= self.start + SAME][-1]
        first_entry: dict[str, edit.Tree] = {"at": "1|1", "bpm": f"{self.map.bpm(self.start):.12g}"}
        first_entry["meter"] = str(meter)
        entries_written = [first_entry]
        for begin, entry in self.map.placed:
            end = begin if entry.over is None else self.map.after(begin, entry.over)
            if begin >= self.stop - SAME or max(begin, end) <= self.start + SAME:
                continue
            if entry.bpm is None and entry.meter is None:
                continue
            if begin <= self.start + SAME:  # a ramp under way goes on
                first_entry["bpm"] = f"{first_entry['bpm']} -> {entry.bpm_end:.12g}"
                first_entry["over"] = f"{end - self.start:.12g}"
                continue
            later_entry: dict[str, edit.Tree] = {"at": self.position(begin)}
            if entry.bpm is not None:
                is_ramp = entry.bpm_end is not None
                later_entry["bpm"] = f"{entry.bpm:.12g}" + (
                    f" -> {entry.bpm_end:.12g}" if is_ramp else ""
                )
            if entry.over is not None:
                later_entry["over"] = f"{end - begin:.12g}"
            if entry.meter is not None:
                later_entry["meter"] = str(entry.meter)
            entries_written.append(later_entry)
        for section in ("tempo", "meter"):  # what files say of them is written out
            if items(texts, section):
                texts = texts.remove((section,))
        for change in entries_written:
            texts = texts.append(("tempo",), edit.flow(change))
        return texts

    def _with_fields(self, texts: Texts, path: edit.Path, fields: dict[str, str | None]) -> Texts:
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
