"""What strikes by the clock, MIDI files and the prompt play of notes that a tuning names."""

from __future__ import annotations

import json
from contextlib import closing
from pathlib import Path

import mido
import numpy as np
import pytest
from midi_files import TICKS, note, save
from sessions import Stepped

from ergon.scores.reading.load import load

SCORE = """ergon: 1
title: Struck
tuning: {%s}
instruments:
  bars:
    modules: {m: {CEL: {M: 1g, f: C4, t60: 200ms}}}
    notes: [%s]
    play: {strike: {at: m, impulse: 1uNs..1mNs}}
    out: {SOX: m}
%s
mix: {channels: 1, route: [{from: bars, to: 1}]}
"""
NINETEEN = "nineteen\n19\n" + "".join(f"{1200 * step / 19:.9f}\n" for step in range(1, 20))


def loaded(folder: Path, tuning: str, notes: str, more: str):
    path = folder / "score.yaml"
    path.write_text(SCORE % (tuning, notes, more), encoding="utf-8")
    result = load(path)
    assert result.piece is not None, result.diagnostics
    return result.piece


def parts(piece, name: str, until: float = 4.0) -> list[str]:
    strikes = next(strikes for strikes in piece.strikes if strikes.name == name)
    hits = [(beat, number, hit) for beat, number, hit in strikes.played_hits(piece, 0.0, until)]
    return [target.part for _, _, hit in sorted(hits, key=lambda h: h[:2]) for target in hit.to]


@pytest.mark.parametrize(
    ("tuning", "expected"),
    [
        ("edo: 19", ["C#4", "Db4", "E4"]),  # a sharp is one of nineteen steps, a flat two
        ("edo: 17", ["Db4", "C#4", "E4"]),  # of seventeen a flat is the lower one
    ],
)
@pytest.mark.parametrize("do", ["arp up", "rolled 1/2", "strum 50ms"])
def test_chords_are_spread_by_the_pitches_of_the_tuning(tuning, expected, do, tmp_path):
    fields = f'rhythm: "[e4,c#4,db4]", do: {do}, to: bars, at: 0, times: 1'
    rhythm = f"strikes: {{r: {{{fields}}}}}"
    piece = loaded(tmp_path, tuning, "C4, C#4, Db4, E4", rhythm)
    assert parts(piece, "r") == [f"bars.{word}" for word in expected]


def test_chords_of_a_tuning_are_spelled_where_they_are_played(tmp_path):
    rhythm = 'strikes: {r: {rhythm: "c4.min", do: arp down, to: bars, at: 0, times: 1}}'
    piece = loaded(tmp_path, "edo: 31", "C4, D#4, Eb4, G4", rhythm)
    assert parts(piece, "r") == ["bars.G4", "bars.Eb4", "bars.C4"]


def test_same_rhythm_in_two_tunings_of_one_process(tmp_path):
    rhythm = 'strikes: {r: {rhythm: "[db4,c#4]", do: arp up, to: bars, at: 0, times: 1}}'
    nineteen = loaded(tmp_path, "edo: 19", "C#4, Db4", rhythm)
    seventeen = loaded(tmp_path, "edo: 17", "C#4, Db4", rhythm)
    assert parts(nineteen, "r") == ["bars.C#4", "bars.Db4"]
    assert parts(seventeen, "r") == ["bars.Db4", "bars.C#4"]


# Of nineteen keys to the octave; a fifth of 3/2 is no key.
MOVED = [
    ("edo: 12", "transpose 7st", "C4 G4", "bars.G4"),
    ("edo: 12", "transpose 50cents", "C4 C4+50cents", "bars.C4+50cents"),
    ("edo: 12", "transpose 50cents, transpose 50cents", "C4 C4+50cents C#4", "bars.C#4"),
    ("edo: 12", "transpose 386.3cents", "C4 C4+386.3cents", "bars.C4+386_3cents"),
    ("edo: 12", "transpose 3/2", "C4 3/2", "bars.3to2"),
    ("edo: 12", "transpose x0.5", "C4 C3", "bars.C3"),
    ("edo: 12", "transpose 100cents", "C4 C#4", "bars.C#4"),
    ("edo: 31", "transpose 1200cents", "C4 C5", "bars.C5"),
    ("scale: 19.scl", "transpose 7st", "C4 G4 C4+700cents", "bars.G4"),
    ("scale: 19.scl", "transpose 700cents", "C4 G4 C4+700cents", "bars.C4+700cents"),
    ("scale: 19.scl", "transpose 2/1", "C4 C5 G5", "bars.G5"),
    ("scale: 19.scl", "grace 1/8 7st", "C4 G4", "bars.G4"),
]


@pytest.mark.parametrize(("tuning", "do", "notes", "expected"), MOVED)
def test_rhythms_move_by_keys_cents_and_ratios(tuning, do, notes, expected, tmp_path):
    (tmp_path / "19.scl").write_text(NINETEEN, encoding="utf-8")
    fields = f'rhythm: "~ c4", do: "{do}", to: bars, at: 0, times: 1'
    piece = loaded(tmp_path, tuning, notes.replace(" ", ", "), f"strikes: {{r: {{{fields}}}}}")
    assert parts(piece, "r")[0] == expected


@pytest.mark.parametrize(
    ("tuning", "do", "notes", "expected"),
    [case for case in MOVED if case[1].count("transpose") == 1],
)
def test_phrases_move_as_rhythms_do(tuning, do, notes, expected, tmp_path):
    (tmp_path / "19.scl").write_text(NINETEEN, encoding="utf-8")
    interval = do.removeprefix("transpose ")
    more = f"""phrases: {{p: {{to: bars, entries: "0 C4 f"}}}}
strikes: {{r: {{play: p, at: 0, transpose: {interval}}}}}"""
    piece = loaded(tmp_path, tuning, notes.replace(" ", ", "), more)
    assert parts(piece, "r") == [expected]


def test_patterns_of_scales_and_pitches_become_rhythms(tmp_path):
    strikes = "strikes: {r: {notes: C4.min 3/2, to: bars, at: 0, every: 1, times: 1, do: rev}}"
    piece = loaded(tmp_path, "edo: 31", "C4, Eb4, G4, 3/2", strikes)
    assert parts(piece, "r") == ["bars.3to2", "bars.G4", "bars.Eb4", "bars.C4"]


def test_phrases_of_pitches_become_rhythms(tmp_path):
    more = r"""phrases: {p: {to: bars, entries: "0 C4 f\n1 18\\31 p\n2 3/2 p"}}
strikes: {r: {play: p, at: 0, do: legato 1/2}}"""
    piece = loaded(tmp_path, "edo: 31", "C4, 18\\31, 3/2", more)
    assert parts(piece, "r", 3.0) == ["bars.C4", "bars.18of31", "bars.3to2"]


# --- MIDI files ----------------------------------------------------------------------------------


def wheel(tick: int, value: int):
    return tick, mido.Message("pitchwheel", pitch=value)


@pytest.mark.parametrize(
    ("tuning", "notes", "transpose"),
    [
        ("edo: 31", "C4, C#4", ""),  # two of 31 steps
        ("edo: 12", "C4, D4", ""),
        ("edo: 12", "D4, E4", ", transpose: 2st"),
        ("edo: 12", "C4+50cents, D4+50cents", ", transpose: 50cents"),
        ("scale: 7.scl", "C4, D4", ""),
    ],
)
def test_wheel_glides_of_notes_played_by_keys(tuning, notes, transpose, tmp_path):
    steps = "".join(f"{1200 * step / 7:.6f}\n" for step in range(1, 8))
    (tmp_path / "7.scl").write_text(f"seven\n7\n{steps}", encoding="utf-8")
    save(
        tmp_path / "tune.mid",
        note(0, 60) + note(2 * TICKS, 62),
        [wheel(TICKS, 4096), wheel(3 * TICKS, -2048)],
    )
    more = f"""takes: {{tune: {{file: tune.mid, bend: 12st}}}}
strikes: {{line: {{play: tune, to: bars, at: 1|1{transpose}}}}}"""
    piece = loaded(tmp_path, tuning, notes, more)
    low, high = (f"bars.{word}" for word in notes.split(", "))
    cents = {
        glide.target.part: [1200.0 * np.log2(ratio) for _, ratio in glide.points]
        for glide in piece.strikes[0].glides
    }
    assert set(cents) == {low, high}
    assert cents[low] == pytest.approx([0.0, 600.0, -300.0], abs=1e-9)
    assert cents[high] == pytest.approx([600.0, -300.0], abs=1e-9)


# --- the prompt ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("hear bars e4", ["bars.E4"]),  # ten steps above C4: as a key it would be number 70
        ("hear bars 550Hz", ["bars.550Hz"]),
        ("hear bars 3/2 C4+50cents f", ["bars.3to2", "bars.C4+50cents"]),
        ("hear bars", ["bars.3to2"]),  # in the middle
    ],
)
def test_hear_strikes_pitches_and_keys_of_the_tuning(line, expected, tmp_path):
    text = SCORE % ("edo: 31", "C4, C#4, E4, 3/2, C4+50cents, 550Hz", "")
    with closing(Stepped(text, tmp_path)) as session:
        session.ok(line)
        session.run(1)
        session.ok("play")
        session.run(1)
        session.ok(line)
        session.run(1)
        rows = [json.loads(row) for row in session.journal.read_text().splitlines()]
        assert [row["part"] for row in rows if row["event"] == "strike"] == 2 * expected
        session.close()
        assert np.array_equal(session.again(), session.sound)


def test_hear_names_the_notes_of_a_tuning(tmp_path):
    text = SCORE % ("edo: 31", "C4, C#4", "")
    with closing(Stepped(text, tmp_path)) as session:
        answer = session.type("hear bars Db4")
    assert "bars has no note Db4; its notes are C4 to C#4" in str(answer)
