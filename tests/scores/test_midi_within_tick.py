"""What comes first in a tick of a MIDI file, and messages that end all notes."""

from __future__ import annotations

from pathlib import Path

import mido
import pytest

from ergon.api import score
from ergon.scores.gesture.midi_file import read_notes
from ergon.scores.gesture.midi_survey import survey
from ergon.scores.staging.struck_notes import struck_notes

TICKS = 480
Row = tuple[float, mido.Message]


def on(quarter: float, number: int = 60) -> Row:
    return quarter, mido.Message("note_on", note=number, velocity=80)


def off(quarter: float, number: int = 60) -> Row:
    return quarter, mido.Message("note_off", note=number)


def control(quarter: float, number: int, value: int = 0) -> Row:
    return quarter, mido.Message("control_change", control=number, value=value)


def written(path: Path, *tracks: list[Row]) -> Path:
    """Tracks of messages at quarter notes, in the order in which they stand."""
    file = mido.MidiFile(ticks_per_beat=TICKS)
    for rows in tracks:
        track, before = mido.MidiTrack(), 0.0
        for quarter, message in rows:
            track.append(message.copy(time=round((quarter - before) * TICKS)))
            before = quarter
        file.tracks.append(track)
    file.save(path)
    return path


PEDAL = 64
CASES = {
    "no length": ([on(0), off(0), on(1, 62), off(2, 62)], [(0, 60, 1 / TICKS), (1, 62, 1)]),
    "no length, then a note": ([on(0), off(0), on(4), off(5)], [(0, 60, 1 / TICKS), (4, 60, 1)]),
    "no length while the pedal is down": (
        [control(0, PEDAL, 127), on(1), off(1), control(3, PEDAL)],
        [(1, 60, 2)],
    ),
    "end behind the next beginning": ([on(0), on(1), off(1), off(2)], [(0, 60, 1), (1, 60, 1)]),
    "end before the next beginning": ([on(0), off(1), on(1), off(2)], [(0, 60, 1), (1, 60, 1)]),
    "no length, then a note at once": ([on(0), off(0), on(0), off(1)], [(0, 60, 0), (0, 60, 1)]),
    "two at one tick": ([on(0), on(0), off(1), off(1)], [(0, 60, 0), (0, 60, 1)]),
    "pedal before the end": ([on(0), control(1, PEDAL, 127), off(1), control(3, PEDAL)],
                             [(0, 60, 3)]),
    "pedal behind the end": ([on(0), off(1), control(1, PEDAL, 127), control(3, PEDAL)],
                             [(0, 60, 1)]),
    "pedal up and down": (
        [control(0, PEDAL, 127), on(0), off(1), control(2, PEDAL), control(2, PEDAL, 127),
         on(2, 62), off(3, 62), control(4, PEDAL)],
        [(0, 60, 2), (2, 62, 2)],
    ),
    "All Notes Off": ([on(0), on(0, 62), control(1, 123), on(2)], [(0, 60, 1), (0, 62, 1),
                                                                  (2, 60, None)]),
    "All Notes Off under the pedal": (
        [control(0, PEDAL, 127), on(0), control(1, 123), control(3, PEDAL)], [(0, 60, 3)]
    ),
    "All Sound Off under the pedal": (
        [control(0, PEDAL, 127), on(0), off(1), on(1, 62), control(2, 120), control(3, PEDAL)],
        [(0, 60, 2), (1, 62, 1)],
    ),
    "reset of controllers": ([control(0, PEDAL, 127), on(0), off(1), control(2, 121), off(3)],
                             [(0, 60, 2)]),
    "mode": ([on(0), control(1, 126, 1)], [(0, 60, 1)]),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_midi_notes_by_order_within_tick(case: str, tmp_path: Path) -> None:
    rows, notes = CASES[case]
    path = written(tmp_path / "tune.mid", rows)
    assert [(note.at, note.number, note.length) for note in read_notes(path).notes] == notes
    n_hanging = sum(length is None for _, _, length in notes)
    assert survey(path).odd_counts["note that nothing ends"] == n_hanging


def test_midi_note_ends_before_others_begin_on_another_track(tmp_path: Path) -> None:
    """The later track ends what the earlier one begins anew in that tick."""
    path = written(tmp_path / "tune.mid", [on(1), off(2)], [on(0), off(1)])
    notes = [(note.at, note.number, note.length) for note in read_notes(path).notes]
    assert notes == [(0, 60, 1), (1, 60, 1)]


SCORE = """\
ergon: 1
instruments: {one: {from: strings/piano, notes: [C4]}}
takes: {tune: {file: tune.mid}}
strikes: {tune: {play: tune, at: 0, to: one}}
mix: {route: [{from: one, to: 1}]}
"""


def test_midi_note_of_no_length_is_damped_at_once(tmp_path: Path) -> None:
    written(tmp_path / "tune.mid", [on(0), off(0), on(4), off(5)])
    (tmp_path / "s.yaml").write_text(SCORE, encoding="utf-8")
    staged = score.stage_piece(score.read(tmp_path / "s.yaml"), None).stage
    ends = [(note.begin, note.end) for note in struck_notes(staged)]
    assert ends[0] == pytest.approx((0, 1 / TICKS), abs=1e-4)
    assert ends[1][1] - ends[1][0] == pytest.approx(1, abs=1e-4)  # a quarter at 60 bpm
