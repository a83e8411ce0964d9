"""Sessions on scores whose tempos and meters come from a MIDI file."""

import random
from pathlib import Path

import midi_files
import mido
import pytest
from sessions import Stepped

from ergon.scores.reading.load import load

SCORE = """\
ergon: 1
tempo: {from: tune.mid}
meter: {from: tune.mid}
instruments:
  cell: {CEL: {M: 1g, f: A4, t60: 200ms}, notes: C3..C5, out: {SOX: cell}}
takes: {tune: {file: tune.mid, velocity: 1mNs}}
strikes: {melody: {play: tune, to: cell, at: 1|1, times: 3}}
mix: {channels: 1}
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    head = [midi_files.meter(0, 3, 8), midi_files.meter(1440, 4, 4)]
    head += [midi_files.tempo(0, 300_000), midi_files.tempo(960, 420_000)]
    head += [midi_files.tempo(1920, 250_000), midi_files.tempo(2880, 350_000)]
    notes = [event for tick in range(0, 4800, 240) for event in midi_files.note(tick)]
    midi_files.save(tmp_path / "tune.mid", head, notes)
    return tmp_path


@pytest.mark.parametrize(
    "lines",
    [
        ["tempo 120 at 4|1", "meter 3/4 at 6|1"],
        ["meter 5/8 at 3|1", "tempo 80 -> 160 over 2bar at 4|1"],
        ["tempo 90 now", "undo", "nudge 20ms"],
    ],
)
def test_journal_of_lines_on_tempos_of_file(folder: Path, lines: list[str]) -> None:
    session = Stepped(SCORE, folder)
    session.ok("play")
    session.run(0.3)
    for line in lines:
        session.ok(line)
        session.run(0.25)
    session.run(2.5)
    session.close()
    assert abs(session.sound).max() > 0
    again = session.again()
    assert session.sound[: len(again)].tobytes() == again.tobytes()


def test_saved_score_has_the_file_and_the_line(folder: Path) -> None:
    session = Stepped(SCORE, folder)
    session.ok("play")
    session.ok("tempo 120 at 4|1")
    session.run(3.0)
    session.ok("save later.yaml")
    session.run(0.2)
    session.close()
    piece = load(folder / "later.yaml").piece
    assert piece is not None
    assert len(piece.tempo) == 2
    border = piece.tempo_map.bars.start(4)
    assert piece.tempo_map.bpm(border) == 120.0
    assert piece.tempo_map.bpm(border - 0.01) == pytest.approx(60 / 0.35)
    assert piece.tempo_map.bpm(0.0) == pytest.approx(2 * 60 / 0.3)


def test_show_names_file_of_tempos(folder: Path) -> None:
    session = Stepped(SCORE, folder)
    lines = session.type("show").lines
    session.close()
    assert lines[0] == "1|1: 4 tempos of a MIDI file"


FOLLOWING = """\
ergon: 1
instruments:
  cell: {CEL: {M: 1g, f: A4, t60: 2s}, out: {SOX: cell}}
strikes: {beat: {to: [cell], at: 1|1, every: 1/2, until: 9|1, impulse: 1mNs}}
automation:
  - {set: cell.f, from: tune.mid, at: 1|1, by: cc 1/33, range: 400Hz..700Hz}
  - {set: cell.t60, from: tune.mid, at: 1|1, by: pressure, range: 0.1..2, until: 3|1}
mix: {channels: 1}
"""


@pytest.mark.parametrize(
    "lines",
    [
        ["tempo 90 now", "undo", "tempo 150 at 2|1"],
        ["set cell.f 500Hz over 1 now", "set cell.f 400Hz 500Hz every 1/2 now", "undo"],
        ["lfo cell.t60 0.5..2 period 1bar now", "lfo cell.t60 off"],
    ],
)
def test_followed_file_sounds_as_its_journal(tmp_path: Path, lines: list[str]) -> None:
    draw, events = random.Random(3), midi_files.note(0)
    for tick in range(0, 9600, 37):
        events.append((tick, mido.Message("control_change", control=1, value=draw.randrange(128))))
        events.append((tick, mido.Message("control_change", control=33, value=draw.randrange(128))))
        events.append((tick, mido.Message("aftertouch", value=draw.randrange(128))))
    midi_files.save(tmp_path / "tune.mid", events)
    session = Stepped(FOLLOWING, tmp_path)
    session.ok("play")
    session.run(0.6)
    for line in lines:
        session.ok(line)
        session.run(0.7)
    session.run(2.0)
    session.close()
    assert abs(session.sound).max() > 0
    again = session.again()
    assert session.sound[: len(again)].tobytes() == again.tobytes()
