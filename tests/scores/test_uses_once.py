"""A mistake in what several instruments are made of is told once."""

from pathlib import Path

import mido
import pytest

from ergon.cli import app

LIBRARY = """\
ergon: 1
instruments:
  bell:
    modules:
      body: {CEL: {M: 2kg, f: 330Hz, t60: 1s}}
      b: {BUT: {K: 900N/m, gap: 1mm, between: [body, nobody]}}
    out: {SOX: bodi}
"""
SCORE = """\
ergon: 1
use: [lib.yaml]
instruments:
  x: {from: lib/bell}
  y: {from: lib/bell, transpose: 7st}
  z: {like: x, notes: [C3, D3]}
"""


def test_mistake_of_copied_instrument_has_one_message(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "lib.yaml").write_text(LIBRARY)
    (tmp_path / "s.yaml").write_text(SCORE)
    assert app.run(["check", str(tmp_path / "s.yaml")]) == 1
    output = [line for line in capsys.readouterr().err.splitlines() if ": error[" in line]
    assert [line.partition("nothing is called ")[2] for line in output] == ["'nobody'", "'bodi'"]


MELODY = """\
ergon: 1
instruments:
  b: {notes: [C4, D4], modules: {m: {CEL: {M: 1g, f: C4, t60: 1s}}}, out: {SOX: m}}
takes: {tune: {file: tune.mid, channel: 1, velocity: 1mNs..9mNs}}
strikes:
  a: {to: b.m, play: tune, at: 0}
  c: {to: b.m, play: tune, at: 4}
"""


def test_missing_notes_have_one_message_per_note(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    track = mido.MidiTrack()
    for note in (60, 61, 61, 73, 61):
        track.append(mido.Message("note_on", note=note, velocity=80, time=120))
        track.append(mido.Message("note_off", note=note, velocity=0, time=120))
    file = mido.MidiFile()
    file.tracks.append(track)
    file.save(tmp_path / "tune.mid")
    (tmp_path / "s.yaml").write_text(MELODY)
    assert app.run(["check", str(tmp_path / "s.yaml")]) == 1
    output = [line for line in capsys.readouterr().err.splitlines() if ": error[" in line]
    missing = [line.partition("has no note ")[2] for line in output]
    assert missing == ["'C#4'; its notes are C4 to D4", "'C#5'; its notes are C4 to D4"]
