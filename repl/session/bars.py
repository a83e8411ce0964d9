"""Who plays what at which beat: the present bar and the next, with a row for each player, and for
strikes.
"""

from __future__ import annotations

import math
import shutil
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from ergon.notation.clock.meter import SAME
from ergon.scores.pattern.search import n_before
from ergon.scores.pattern.steps import PlaceBeats

if TYPE_CHECKING:
    from ergon.scores.reading.piece import Piece, Strikes

_DRAWN_BARS = 2
_COLUMNS_PER_BEAT_MIN, _COLUMNS_PER_BEAT_MAX = 4, 10  # characters of a beat
_NAME_WIDTH_MAX, _WIDTH_MAX = 12, 100
_CONTINUED_SIGN = "\u2026"  # sign of an earlier gesture, and of strikes by chance
_STRIKE_SIGN = "x"  # sign of a strike without a note name


def draw_bars(
    piece: Piece, gestures_in_flight: Sequence[tuple[str, str]], beat_now: float
) -> list[str]:
    """The bar of beat `beat_now` and the next: their beats, what begins on them, and a mark at
    `beat_now`.

    `gestures_in_flight` are the gestures in flight: (player, gesture).
    """
    tempo = piece.tempo_map
    bar, _ = tempo.bar_beat(beat_now)
    bar_starts = [tempo.bars.start(bar + number) for number in range(_DRAWN_BARS + 1)]
    events_by_row = {name: [*_play_beginnings(piece, name, bar_starts)] for name in piece.players}
    strokes_by_name = {
        strikes.name: [*_strokes(piece, strikes, bar_starts)] for strikes in piece.strikes
    }
    events_by_row |= {name: strokes for name, strokes in strokes_by_name.items() if strokes}
    name_length_max = max(map(len, events_by_row), default=0)
    name_width = min(name_length_max, _NAME_WIDTH_MAX) + 2
    columns_left = min(shutil.get_terminal_size().columns, _WIDTH_MAX) - name_width
    while (
        len(bar_starts) > 2
        and (bar_starts[-1] - bar_starts[0]) * _COLUMNS_PER_BEAT_MIN > columns_left
    ):
        bar_starts.pop()
    n_beats = bar_starts[-1] - bar_starts[0]
    beat_columns = max(
        _COLUMNS_PER_BEAT_MIN, min(_COLUMNS_PER_BEAT_MAX, int(columns_left / n_beats))
    )
    n_columns = math.ceil(n_beats * beat_columns)

    def column(beat: float) -> int:
        return int((beat - bar_starts[0]) * beat_columns + SAME)

    drawn_beats = [bar_starts[0] + number for number in range(math.ceil(n_beats - SAME))]
    header_cells = [(column(beat), _beat_text(piece, beat)) for beat in drawn_beats]
    drawn_rows = [" " * name_width + _row_of_cells(n_columns, header_cells)]
    for row_name, row_events in events_by_row.items():
        beat_cells = [(column(beat), "\u00b7") for beat in drawn_beats]
        bar_events = [
            (column(beat), event_name)
            for beat, event_name in row_events
            if bar_starts[0] <= beat < bar_starts[-1]
        ]
        if any(player == row_name for player, _ in gestures_in_flight) and not any(
            column_index == 0 for column_index, _ in bar_events
        ):
            bar_events.insert(0, (0, _CONTINUED_SIGN))
        taken_columns = {column_index for column_index, _ in bar_events}
        row_cells = sorted(
            [
                *(beat_cell for beat_cell in beat_cells if beat_cell[0] not in taken_columns),
                *bar_events,
            ]
        )
        drawn_rows.append(
            row_name[: name_width - 2].ljust(name_width) + _row_of_cells(n_columns, row_cells)
        )
    drawn_rows.append(" " * (name_width + min(column(beat_now), n_columns - 1)) + "^")
    return drawn_rows


def _beat_text(piece: Piece, beat: float) -> str:
    bar, beat_in_bar = piece.tempo_map.bar_beat(beat + SAME)
    return f"{bar}|1" if beat_in_bar < 1.5 else f"{beat_in_bar:.0f}"


def _play_beginnings(
    piece: Piece, player_name: str, bar_starts: Sequence[float]
) -> Iterator[tuple[float, str]]:
    """What a player begins within these bars, each with its beat."""
    for part_play, start_beats in zip(piece.parts, piece.starts, strict=True):
        if part_play.player != player_name:
            continue
        play_beats = [piece.tempo_map.resolve(part_play.at)] if start_beats is None else start_beats
        first_index = n_before(play_beats, bar_starts[0] - SAME)
        last_index = n_before(play_beats, bar_starts[-1] - SAME)
        for place_index in range(first_index, last_index):
            shown_name = (
                play_beats.places.played_name(place_index)
                if isinstance(play_beats, PlaceBeats)
                else part_play.played_text
            )
            if shown_name is not None:  # a rest, or what chance leaves out
                yield play_beats[place_index], shown_name


def _strokes(
    piece: Piece, strikes: Strikes, bar_starts: Sequence[float]
) -> Iterator[tuple[float, str]]:
    """The strikes within these bars, each with its beat, and the note that it strikes."""
    tempo = piece.tempo_map
    first_beat, last_beat = bar_starts[0] - SAME, bar_starts[-1] - SAME
    if strikes.is_melody:
        timed_hits = strikes.played_hits(piece, first_beat, last_beat)
        yield from (
            (beat, hit.struck_text) for beat, _, hit in timed_hits if first_beat <= beat < last_beat
        )
    elif strikes.passing is not None:
        yield from (
            (beat, _STRIKE_SIGN) for beat in strikes.rounds(tempo) if first_beat <= beat < last_beat
        )
    elif strikes.pattern is not None:
        steps = strikes.place_beats(piece)
        for place_index in range(n_before(steps, first_beat), n_before(steps, last_beat)):
            note = steps.places.name_in_place(place_index)
            if note is not None:
                yield steps[place_index], note if strikes.voices else _STRIKE_SIGN
    elif strikes.rate is not None:
        begin_beat, stop_beat = tempo.resolve(strikes.at), strikes.stop_beat(tempo)
        if begin_beat < last_beat and (stop_beat is None or stop_beat > first_beat):
            yield max(begin_beat, bar_starts[0]), _CONTINUED_SIGN
    else:
        beats = strikes.beats(tempo)
        stroke_indices = range(n_before(beats, first_beat), n_before(beats, last_beat))
        yield from ((beats[stroke_index], _STRIKE_SIGN) for stroke_index in stroke_indices)


def _row_of_cells(n_columns: int, cells: Sequence[tuple[int, str]]) -> str:
    """Words at columns, each cut where the next begins."""
    drawn_row = ""
    for number, (column, text) in enumerate(cells):
        next_column = cells[number + 1][0] if number + 1 < len(cells) else n_columns
        drawn_row = drawn_row.ljust(column)[:column] + text[: max(1, next_column - column - 1)]
    return drawn_row.rstrip()
