"""Instruments with a tuning of their own, beside others: what is heard, struck and refused."""

from __future__ import annotations

import json
from contextlib import closing
from math import log2
from pathlib import Path

import mido
import numpy as np
import pytest
from midi_files import TICKS, note, save
from sessions import Stepped

from ergon import _core
from ergon.scores.edits.texts import Texts
from ergon.scores.reading.load import load
from ergon.scores.staging.preparing import prepare

RATE = 44100
SCORE = """ergon: 1
title: Two tunings
%s
instruments:
  vib:
    tuning: {%s}
    modules: {m: {CEL: {M: 1g, f: C4, t60: 200ms}}}
    notes: [%s]
    play: {strike: {at: m, impulse: 1uNs..1mNs}}
    out: {SOX: m}
  bars:
    modules: {m: {CEL: {M: 1g, f: C4, t60: 200ms}}}
    notes: [C4, C#4, D#4, E4, G4]
    play: {strike: {at: m, impulse: 1uNs..1mNs}}
    out: {SOX: m}
%s
render: {tail: 1s}
"""
NINETEEN = "! 19.scl\n!\n19 equal steps\n 19\n" + "".join(
    f" {1200 * step / 19:.9f}\n" for step in range(1, 20)
)
WORDS = "C4, C#4, Db4, D#4, Eb4, E4, G4, 3/2, A4+50cents"


def score(tuning: str, more: str, *, notes: str = WORDS, head: str = "") -> str:
    return SCORE % (head, tuning, notes, more)


def checked(text: str, folder: Path):
    path = folder / "score.yaml"
    path.write_text(text, encoding="utf-8")
    return load(path)


def read(text: str, folder: Path):
    loaded = checked(text, folder)
    assert loaded.piece is not None, loaded.diagnostics
    return loaded.piece


def frequency(piece, part: str) -> float:
    return piece.instruments[part].modules[0].fields["f"]


def parts(piece, name: str) -> list[str]:
    strikes = next(strikes for strikes in piece.strikes if strikes.name == name)
    hits = [(beat, number, hit) for beat, number, hit in strikes.played_hits(piece, 0.0, 8.0)]
    return [target.part for _, _, hit in sorted(hits, key=lambda h: h[:2]) for target in hit.to]


def pitches(sound: np.ndarray, count: int) -> list[float]:
    """The frequency [Hz] of the decaying sinusoid in each second but the first: its samples obey
    x[n] = a x[n-1] + b x[n-2] with a = 2 r cos w and b = -r².
    """
    heights = []
    for i in range(count):
        x = sound[int((i + 1.1) * RATE) : int((i + 1.3) * RATE)]
        a, b = np.linalg.lstsq(np.stack([x[1:-1], x[:-2]], axis=1), x[2:], rcond=None)[0]
        heights.append(float(np.arccos(a / (2.0 * np.sqrt(-b)))) * RATE / (2.0 * np.pi))
    return heights


STRUCK = ["vib.Db4", "bars.C#4", "vib.C#4", "bars.D#4", "vib.3/2", "bars.G4", "vib.A4+50cents"]
BY_CLOSED_FORM = [
    440.0 * 2 ** (-12 / 19),  # C4 lies 14 of 19 steps below A4, and a flat second two above it
    440.0 * 2 ** (-8 / 12),
    440.0 * 2 ** (-13 / 19),
    440.0 * 2 ** (-6 / 12),
    1.5 * 440.0 * 2 ** (-14 / 19),
    440.0 * 2 ** (-2 / 12),
    440.0 * 2 ** (1 / 24),
]
TUNINGS = pytest.mark.parametrize("tuning", ["edo: 19", "edo: 19, A4: 440Hz, root: C4"])


def written_singly(words: list[str]) -> str:
    rows = (
        f"  s{i}: {{to: [{word}.m], at: {i + 1}s, impulse: 1mNs}}" for i, word in enumerate(words)
    )
    return "\n".join(["strikes:", *rows])


def off(heights: list[float], expected: list[float]) -> float:
    return max(abs(1200.0 * log2(a / b)) for a, b in zip(heights, expected, strict=True))


@TUNINGS
def test_render_of_two_tunings_against_closed_form(tuning, tmp_path):
    stage = prepare(read(score(tuning, written_singly(STRUCK)), tmp_path))
    plan = _core.Plan(stage.network, stage.timeline)
    simulation = _core.Simulation(stage.network, stage.timeline, plan=plan, threads=1)
    sound = np.empty((stage.n_frames, simulation.n_out))
    simulation.process(sound)
    assert off(pitches(sound.sum(axis=1), len(STRUCK)), BY_CLOSED_FORM) < 0.05


def test_session_of_two_tunings_by_closed_form(tmp_path):
    with closing(Stepped(score("edo: 19", written_singly(STRUCK)), tmp_path)) as session:
        session.ok("play")
        session.run(len(STRUCK) + 1)
    assert off(pitches(session.sound.sum(axis=1), len(STRUCK)), BY_CLOSED_FORM) < 0.05
    assert np.array_equal(session.again(), session.sound)


def test_scale_of_an_instrument_is_in_the_journal(tmp_path):
    (tmp_path / "19.scl").write_text(NINETEEN, encoding="utf-8")
    text = score("scale: 19.scl", written_singly(["vib.C4", "bars.C4"]), notes="C4, A4")
    with closing(Stepped(text, tmp_path)) as session:
        session.ok("play")
        session.run(3)
    expected = [440.0 * 2 ** (-9 / 19), 440.0 * 2 ** (-9 / 12)]
    assert off(pitches(session.sound.sum(axis=1), 2), expected) < 0.05
    (tmp_path / "19.scl").unlink()
    assert np.array_equal(session.again(), session.sound)


def test_notes_of_an_instrument_beside_a_tuning_of_the_score(tmp_path):
    text = score("edo: 12", "", notes="C4, E4", head="tuning: {edo: 31}")
    piece = read(text, tmp_path)
    assert frequency(piece, "vib.E4") == pytest.approx(440.0 * 2 ** (-5 / 12), rel=1e-12)
    assert frequency(piece, "bars.E4") == pytest.approx(440.0 * 2 ** (-13 / 31), rel=1e-12)


def test_instrument_tuning_inherited_by_like(tmp_path):
    more = (
        "  twin: {like: vib, f: D#4, notes: [D#4]}\n  plain: {like: vib, tuning: {}, notes: [D#4]}"
    )
    piece = read(score("edo: 19", more), tmp_path)
    step = 440.0 * 2 ** (-10 / 19)  # D#4
    assert frequency(piece, "twin.D#4") == pytest.approx(step, rel=1e-12)
    assert frequency(piece, "plain.D#4") == pytest.approx(440.0 * 2 ** (-6 / 12), rel=1e-12)


def test_tuning_of_an_instrument_from_another_file(tmp_path):
    (tmp_path / "other.yaml").write_text(
        "instruments: {c: {tuning: {edo: 19}, notes: [C4, Db4],"
        " modules: {m: {CEL: {M: 1g, f: C4, t60: 1s}}}, out: {SOX: m}}}\n"
    )
    text = """ergon: 1
title: Used
use: other.yaml
instruments:
  brought: {from: other/c}
  rewritten: {from: other/c, notes: [Db4]}
  retuned: {from: other/c, tuning: {edo: 31}}
strikes: {s: {to: [brought.m, rewritten.m, retuned.m], at: 0, impulse: 1mNs}}
"""
    piece = read(text, tmp_path)
    expected = {
        "brought.Db4": 440.0 * 2 ** (-12 / 19),
        "rewritten.Db4": 440.0 * 2 ** (-8 / 12),
        "retuned.Db4": 440.0 * 2 ** (-20 / 31),
    }
    assert {name: frequency(piece, name) for name in expected} == pytest.approx(expected)


def test_named_value_is_in_the_tuning_of_the_score(tmp_path):
    text = score("edo: 19", "let: {low: D4}").replace("f: C4", "f: low")
    text = "\n".join(line for line in text.splitlines() if "notes" not in line)
    read(text, tmp_path)
    texts = Texts.read(tmp_path / "score.yaml")  # which remembers what it has read
    for _ in range(2):
        piece = texts.load().piece
        assert frequency(piece, "vib") == frequency(piece, "bars")
        assert frequency(piece, "bars") == pytest.approx(440.0 * 2 ** (-7 / 12), rel=1e-12)
        texts = texts.put(("title",), "Another")


def test_pitch_of_a_single_instrument(tmp_path):
    text = score("edo: 19", "").replace("f: C4", "f: D#4")
    piece = read("\n".join(x for x in text.splitlines() if "notes" not in x), tmp_path)
    assert frequency(piece, "vib") == pytest.approx(440.0 * 2 ** (-10 / 19), rel=1e-12)
    assert frequency(piece, "bars") == pytest.approx(440.0 * 2 ** (-6 / 12), rel=1e-12)


STRIKES = [
    ("rhythm: 'd#4 eb4', to: vib, times: 1", ["vib.D#4", "vib.Eb4"]),
    ("rhythm: 'd#4 eb4', to: bars, times: 1", ["bars.D#4"] * 2),  # in 12 steps they are one note
    ("rhythm: '[eb4,d#4]', do: arp up, to: vib, times: 1", ["vib.D#4", "vib.Eb4"]),
    ("rhythm: 'c4.min', do: arp up, to: vib, times: 1", ["vib.C4", "vib.Eb4", "vib.G4"]),
    ("rhythm: 'c4', do: transpose 3/2, to: vib, times: 1", ["vib.3to2"]),
    ("rhythm: 'vib.C#4.m:1mNs bars.C#4.m:1mNs', times: 1", ["vib.C#4", "bars.C#4"]),
    ("notes: C4.min, to: vib, every: 1, times: 1, do: rev", ["vib.G4", "vib.Eb4", "vib.C4"]),
    ("play: p, to: vib", ["vib.C4", "vib.Eb4"]),
    ("play: low, to: vib, transpose: 3/2", ["vib.3to2"]),
    ("play: low, to: vib, transpose: 694.736842cents", ["vib.G4"]),  # a fifth of eleven steps
    ("play: low, to: bars, transpose: 7st", ["bars.G4"]),
    ("play: p, to: [vib, bars]", ["vib.C4", "bars.C4", "vib.Eb4", "bars.D#4"]),
]


@pytest.mark.parametrize(("fields", "expected"), STRIKES, ids=[case[0] for case in STRIKES])
def test_strikes_name_notes_of_their_instrument(fields, expected, tmp_path):
    more = f"""phrases: {{p: {{entries: "0 C4 f\\n1 Eb4 f"}}, low: {{entries: "0 C4 f"}}}}
strikes: {{r: {{{fields}, at: 0}}}}"""
    assert parts(read(score("edo: 19", more), tmp_path), "r") == expected


def test_automation_by_notes_of_the_instrument(tmp_path):
    more = """automation:
  - {set: vib.C4.m.f, to: D#4 Eb4 C4.min, every: 1, at: 1}
  - {set: bars.C4.m.f, to: D#4 E4, every: 1, at: 1}"""
    piece = read(score("edo: 19", f"{written_singly(['vib.C4', 'bars.C4'])}\n{more}"), tmp_path)
    vib, bars = ([a.value for a in led.amounts.values()] for led in piece.automation)
    assert [19 * log2(hz / 440.0) + 14 for hz in vib] == pytest.approx([4, 5, 0, 5, 11], abs=1e-9)
    assert [12 * log2(hz / 440.0) + 9 for hz in bars] == pytest.approx([3, 4], abs=1e-9)


def test_midi_file_and_its_wheel_play_steps_of_the_instrument(tmp_path):
    wheel = mido.Message("pitchwheel", pitch=4096)
    save(tmp_path / "tune.mid", note(0, 60) + note(2 * TICKS, 61), [(TICKS, wheel)])
    more = """takes: {tune: {file: tune.mid, bend: 12st}}
strikes: {line: {play: tune, to: vib, at: 1|1}, other: {play: tune, to: bars, at: 1|1}}"""
    piece = read(score("edo: 19", more), tmp_path)
    assert parts(piece, "line") == ["vib.C4", "vib.C#4"]
    assert parts(piece, "other") == ["bars.C4", "bars.C#4"]
    assert {glide.target.part for glide in piece.strikes[0].glides} == {"vib.C4", "vib.C#4"}


# --- the prompt ----------------------------------------------------------------------------------


def test_lines_of_a_session_write_notes_of_the_instrument(tmp_path):
    with closing(Stepped(score("edo: 19", ""), tmp_path)) as session:
        session.ok('d1 = "c4 db4 c#4 3to2" 1mNs to vib')
        session.ok('d2 = "c4 eb4" 1mNs to bars')
        session.ok("phrase q 0 Db4 1mNs, 1/2 D#4 1mNs to vib")
        session.ok("z strikes q")
        session.ok("set vib.C4.m.f D#4")
        session.ok("set bars.C4.m.f D#4")
        session.ok("play")
        session.run(3)
        piece = session.session.schedule.head.piece
    assert frequency(piece, "vib.C4") == pytest.approx(440.0 * 2 ** (-10 / 19), rel=1e-12)
    assert frequency(piece, "bars.C4") == pytest.approx(440.0 * 2 ** (-6 / 12), rel=1e-12)
    assert np.abs(session.sound).max() > 0.0
    assert np.array_equal(session.again(), session.sound)


def test_hear_strikes_notes_of_the_instrument(tmp_path):
    with closing(Stepped(score("edo: 19", ""), tmp_path)) as session:
        lines = ["hear vib Db4", "hear vib C#4 3/2", "hear bars Db4"]
        for line in lines:
            session.ok(line)
            session.run(1)
        session.close()
        rows = [json.loads(row) for row in session.journal.read_text().splitlines()]
        struck = [row["part"] for row in rows if row["event"] == "strike"]
        assert struck == ["vib.Db4", "vib.C#4", "vib.3to2", "bars.C#4"]
        assert np.array_equal(session.again(), session.sound)


def test_show_tuning_tells_each_instrument(tmp_path):
    with closing(Stepped(score("edo: 19", "", notes="C4, Db4"), tmp_path)) as session:
        lines = session.ok("show tuning").lines
    assert lines[0].startswith("tuning: 12 equal steps")
    assert lines[1].startswith("tuning of vib: 19 equal steps")
    assert "vib: C4 264.02 Hz, Db4 284.01 Hz" in lines[2]
    assert "C#4 277.18 Hz" in lines[3]


def test_instrument_tuning_edited_repeatedly_in_texts(tmp_path):
    (tmp_path / "19.scl").write_text(NINETEEN, encoding="utf-8")
    path = tmp_path / "score.yaml"
    path.write_text(score("scale: 19.scl", "", notes="C4, A4"), encoding="utf-8")
    texts = Texts.read(path)
    texts.load()
    low = []
    for tuning in ("edo: 12", "A4: 415Hz", "scale: 19.scl", "edo: 19"):
        texts = texts.put(("instruments", "vib", "tuning"), f"{{{tuning}}}")
        piece = texts.load().piece
        low.append(frequency(piece, "vib.C4"))
        assert frequency(piece, "bars.C4") == 440.0 * 2.0 ** (-9 / 12)
    equal = 2.0 ** (-9 / 12)
    expected = [440.0 * equal, 415.0 * equal, 440.0 * 2.0 ** (-9 / 19), 440.0 * 2.0 ** (-14 / 19)]
    assert low == pytest.approx(expected, rel=1e-9)


# --- what is refused -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("tuning", "code", "message"),
    [
        ("scale: none.scl", "E107", "there is no file none.scl"),
        ("scale: 19.scl, edo: 19", "E111", "tuning of instrument 'vib': `scale` says"),
        ("keys: k.kbm", "E111", "tuning of instrument 'vib': `keys` is the map"),
        ("edo: 0", "E202", "outside the range"),
        ("a4: 442Hz", "E101", "a4"),
    ],
)
def test_tuning_of_an_instrument_refused(tuning, code, message, tmp_path):
    (tmp_path / "19.scl").write_text(NINETEEN, encoding="utf-8")
    diagnostics = checked(score(tuning, "", notes="A4"), tmp_path).diagnostics
    wrong = [d for d in diagnostics if d.code == code and message in d.message]
    assert wrong, diagnostics
    assert wrong[0].place.line == 6  # of `tuning`


@pytest.mark.parametrize(
    "fields",
    ["rhythm: 'c4 e4', times: 1", "play: p, transpose: 7st", "play: mirrored", "play: p, do: rev"],
)
def test_notes_of_two_tunings_are_not_moved_together(fields, tmp_path):
    entries = 'entries: "0 C4 f\\n1 E4 f"'
    more = f"""phrases: {{p: {{{entries}}}, mirrored: {{{entries}, do: [mirror]}}}}
strikes: {{r: {{{fields}, to: [vib, bars], at: 0}}}}"""
    (error, *_) = [
        d for d in checked(score("edo: 19", more), tmp_path).diagnostics if d.code == "E111"
    ]
    assert "strikes 'r': 'vib' and 'bars' have different tunings" in error.message
    assert error.place.line == 17


def test_note_missing_in_instrument_tuning_is_refused(tmp_path):
    more = "strikes: {r: {entries: '1|1 Db4 f', to: vib}}"
    diagnostics = checked(score("edo: 19", more, notes="C4, C#4"), tmp_path).diagnostics
    assert any("'vib' has no note 'Db4'" in d.message for d in diagnostics), diagnostics
