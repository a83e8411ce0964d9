"""Curves of the velocities of MIDI files: strengths, impulses and depths."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import mido
import numpy as np
import pytest

from ergon.scores.reading.load import Loaded, load

BAR = """\
ergon: 1
instruments:
  bar:
    CEL: {M: 1g, f: A4, t60: 2s}
    notes: C3..C5
    play: {strike: {impulse: 1mNs..16mNs}}
    out: {SOX: bar}
"""
MELODY = "strikes: {m: {play: t, to: bar, at: 1|1}}\n"


def tune(path: Path, notes: Sequence[tuple[int, int, int]]) -> None:
    """Write notes (tick, number, velocity) of 480 ticks a beat; each lasts 100."""
    events = [
        *((tick, "note_on", number, velocity) for tick, number, velocity in notes),
        *((tick + 100, "note_off", number, 0) for tick, number, _ in notes),
    ]
    track, now = mido.MidiTrack(), 0
    for tick, word, number, velocity in sorted(events):
        track.append(mido.Message(word, note=number, velocity=velocity, time=tick - now))
        now = tick
    file = mido.MidiFile(type=0, ticks_per_beat=480)
    file.tracks.append(track)
    file.save(path)


def checked(folder: Path, text: str) -> Loaded:
    return load(folder / "s.yaml", text=BAR + text)


@pytest.mark.parametrize(
    ("curve", "strength"),  # of a velocity from 0 to 1
    [
        (None, lambda x: x),
        ("even", lambda x: x),
        ("square", lambda x: x * x),
        ("root", np.sqrt),
        ("0.25@64", lambda x: 0.25),
        ("0.2@1 0.5@64 1@127",
         lambda x: np.interp(127 * x, [1, 64, 127], [0.2, 0.5, 1.0])),
        (".5@50 0@100", lambda x: np.interp(127 * x, [50, 100], [0.5, 0.0])),
    ],
)  # fmt: skip
def test_curve_of_velocities(tmp_path, curve, strength):
    hard = (1, 32, 64, 100, 127)
    tune(tmp_path / "tune.mid", [(240 * n, 60, velocity) for n, velocity in enumerate(hard)])
    written = "" if curve is None else f", curve: {curve}"
    loaded = checked(tmp_path, f"takes: {{t: {{file: tune.mid{written}}}}}\n{MELODY}")
    assert loaded.piece is not None, loaded.diagnostics
    levels = [hit.level.low for hit in loaded.piece.strikes[0].hits]
    assert levels == pytest.approx([strength(v / 127) for v in hard], abs=1e-12)


def test_curve_between_impulses_and_depths(tmp_path):
    tune(tmp_path / "tune.mid", [(0, 60, 1), (480, 60, 64), (960, 60, 127)])
    text = "takes: {t: {file: tune.mid, velocity: 1mNs..5mNs, depth: 1mm..5mm, curve: square}}\n"
    text += MELODY + "keys: {k: {M: 400g, K: 60N/m, Z: 1Ns/m}}\n"
    text += "players: {ada: {key: k}}\nparts: {ada: [{at: 1|1, play: t}]}\n"
    loaded = checked(tmp_path, text)
    assert loaded.piece is not None, loaded.diagnostics
    impulses = [hit.level.low for hit in loaded.piece.strikes[0].hits]
    assert impulses == pytest.approx([1e-3, 2e-3, 5e-3])
    depths = [point.x for point in loaded.piece.gestures["t"].points if point.x]
    assert depths == pytest.approx([1e-3, 2e-3, 5e-3])


@pytest.mark.parametrize(
    ("curve", "column", "part"),
    [
        ("sqare", 36, "neither even, square, root nor a point"),
        ("0.2@1 2@64", 42, "'2@64' is neither"),
        ("0.2@0", 36, "a velocity from 1 to 127"),
        ("0.2@64 0.5@64", 43, "is not above 64"),
        ("''", 37, "1 to 127 points"),
    ],
)
def test_velocity_curve_mistakes(tmp_path, curve, column, part):
    tune(tmp_path / "tune.mid", [(0, 60, 64)])
    (report,) = checked(tmp_path, f"takes: {{t: {{file: tune.mid, curve: {curve}}}}}\n").diagnostics
    assert part in report.message
    assert report.place.column == column


def test_curve_of_another_take_is_refused(tmp_path):
    (tmp_path / "tune.csv").write_text("t,x\n0,0\n1,1\n")
    loaded = checked(tmp_path, "takes: {t: {file: tune.csv, curve: root}}\n")
    assert [d.message for d in loaded.diagnostics if "curve" in d.message] == [
        "curve of take 't': a take that is not a MIDI or MusicXML file has no curve; remove it"
    ]
