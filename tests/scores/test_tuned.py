"""Notes of a tuning: what is heard, against closed forms, and what is refused."""

from __future__ import annotations

from contextlib import closing
from math import log2
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sessions import Stepped

from ergon import _core
from ergon.notation.tables import notes
from ergon.notation.tables import quantities as q
from ergon.notation.tables.tuning import Tuning, used
from ergon.repl.language.mapping import MapNotes
from ergon.repl.session.midi_maps import places_of_note
from ergon.scores.edits.texts import Texts
from ergon.scores.reading.digest import digest_of
from ergon.scores.reading.load import load
from ergon.scores.staging.preparing import prepare

RATE = 44100
NINETEEN = "! 19.scl\n!\n19 equal steps\n 19\n" + "".join(
    f" {1200 * step / 19:.9f}\n" for step in range(1, 20)
)
WHITE = "white\n7\n9/8\n5/4\n4/3\n3/2\n5/3\n15/8\n2/1\n"
# White keys from middle C, which has 264 Hz; black keys have no pitch.
WHITE_KEYS = "12\n0\n127\n60\n60\n264.0\n7\n" + "0 x 1 x 2 3 x 4 x 5 x 6".replace(" ", "\n")
SCALES = {"19.scl": NINETEEN, "white.scl": WHITE, "white.kbm": WHITE_KEYS}
CELLS = """ergon: 1
title: Cells
tuning: {%s}
instruments:
  cells:
    modules: {m: {CEL: {M: 1g, f: C4, t60: 200ms}}}
    notes: [%s]
    out: {SOX: m}
strikes:
%s
render: {tail: 1s}
"""


def write_scales(folder: Path) -> None:
    for name, text in SCALES.items():
        (folder / name).write_text(text, encoding="utf-8")


def score(tuning: str, words: list[str]) -> str:
    strikes = (
        f"  s{i}: {{to: [cells.{word}.m], at: {i + 1}s, impulse: 1mNs}}"
        for i, word in enumerate(words)
    )
    return CELLS % (tuning, ", ".join(words), "\n".join(strikes))


def pitches(sound: np.ndarray, count: int) -> list[float]:
    """The frequency [Hz] heard in each second but the first.

    A decaying sinusoid obeys x[n] = a x[n-1] + b x[n-2] with a = 2 r cos w and b = -r².
    """
    heights = []
    for i in range(count):
        x = sound[int((i + 1.1) * RATE) : int((i + 1.3) * RATE)]
        a, b = np.linalg.lstsq(np.stack([x[1:-1], x[:-2]], axis=1), x[2:], rcond=None)[0]
        heights.append(float(np.arccos(a / (2.0 * np.sqrt(-b)))) * RATE / (2.0 * np.pi))
    return heights


def cents(heights: list[float], expected: list[float]) -> list[float]:
    return [1200.0 * log2(a / b) for a, b in zip(heights, expected, strict=True)]


def checked(text: str, folder: Path):
    (folder / "score.yaml").write_text(text, encoding="utf-8")
    return load(folder / "score.yaml")


JUST = ["1/1", "9/8", "5/4", "4/3", "3/2", "5/3", "15/8", "2/1"]
KEYS_OF_19 = ["C4", "C#4", "G4", "A4", "B5"]
SOUNDS = [
    ("scale: 19.scl", KEYS_OF_19, [440.0 * 2 ** ((key - 69) / 19) for key in (60, 61, 67, 69, 83)]),
    (
        "scale: white.scl, keys: white.kbm",
        ["C4", "D4", "A4", "B3", "E5+14cents"],
        [264.0 * r for r in (1.0, 9 / 8, 5 / 3, 15 / 16, 2.5 * 2 ** (14 / 1200))],
    ),
    ("root: 264Hz", JUST, [264.0 * eval(word) for word in JUST]),
    ("A4: 415Hz", ["A4", "C4", "Bb3"], [415.0 * 2 ** (step / 12) for step in (0, -9, -11)]),
    (
        "edo: 31",
        ["C4", "C#4", "Db4", "E4", "7\\31"],
        [440.0 * 2 ** ((step - 23) / 31) for step in (0, 2, 3, 10, 7)],
    ),
    (
        "A4: 440Hz",
        ["A4+50cents", "C5-50cents", "550Hz", "660.5Hz", "A4+386.3cents"],
        [440 * 2 ** (1 / 24), 440 * 2 ** (5 / 24), 550.0, 660.5, 440 * 2 ** (386.3 / 1200)],
    ),
]


@pytest.mark.parametrize(("tuning", "words", "expected"), SOUNDS, ids=[case[0] for case in SOUNDS])
def test_session_sounds_as_closed_form_and_as_its_journal(tuning, words, expected, tmp_path):
    write_scales(tmp_path)
    with closing(Stepped(score(tuning, words), tmp_path)) as session:
        session.ok("play")
        session.run(len(words) + 1)
    sound = np.concatenate(session._sound)
    heights = pitches(sound[:, 0], len(words))
    assert np.abs(cents(heights, expected)).max() < 0.05
    for name in SCALES:  # the journal has what it needs
        (tmp_path / name).unlink()
    assert np.array_equal(session.again(), sound)


@pytest.mark.parametrize(("tuning", "words", "expected"), SOUNDS, ids=[case[0] for case in SOUNDS])
def test_render_sounds_as_closed_form(tuning, words, expected, tmp_path):
    write_scales(tmp_path)
    stage = prepare(checked(score(tuning, words), tmp_path).piece)
    plan = _core.Plan(stage.network, stage.timeline)
    simulation = _core.Simulation(stage.network, stage.timeline, plan=plan, threads=1)
    sound = np.empty((stage.n_frames, simulation.n_out))
    simulation.process(sound)
    heights = pitches(sound.sum(axis=1), len(words))
    assert np.abs(cents(heights, expected)).max() < 0.05


def test_lines_of_a_session_write_pitches(tmp_path):
    words = ["A4", "C4", "Db4", "C#4", "A4+386.3cents", "3/2", "550Hz"]
    with closing(Stepped(score("edo: 19", words), tmp_path)) as session:
        session.ok("phrase q 0 A4+386.3cents 1mNs, 1/2 550Hz 1mNs, 1 C4 1mNs to cells.m")
        session.ok("z strikes q")
        session.ok('d1 = "c4 db4 c#4 a4+386.3cents 3to2" 1mNs to cells.m')
        session.ok("set cells.C4.m.f D#4")
        session.ok("play")
        session.run(5)
        member = session.session.schedule.head.piece.instruments["cells.C4"]
    assert member.modules[0].fields["f"] == pytest.approx(440.0 * 2 ** (-10 / 19), rel=1e-12)
    assert np.array_equal(session.again(), np.concatenate(session._sound))


def test_phrases_move_by_cents(tmp_path):
    text = """ergon: 1
title: Phrases
instruments: {c: {modules: {m: {CEL: {M: 1g, f: C4, t60: 1s}}}, out: {SOX: m},
  notes: [A4, A4+50cents, E5, 3/2, 5/4]}}
phrases: {p: {to: c.m, impulse: 1mNs, entries: "0 A4\\n1 3/2\\n2 A4+50cents 1mNs"}}
strikes:
  up: {play: p, at: 0, transpose: 50cents}
  plain: {play: p, at: 9}
"""
    loaded = checked(text, tmp_path)
    messages = [d.message for d in loaded.diagnostics if d.code.startswith("E")]
    assert messages[0].startswith("strikes 'up': 'c.m' has no note")
    phrase = 'entries: "0 A4\\n1 A4 1mNs"'
    moved = checked(text.replace('entries: "0 A4\\n1 3/2\\n2 A4+50cents 1mNs"', phrase), tmp_path)
    assert [hit.to[0].part for hit in moved.piece.strikes[0].hits] == ["c.A4+50cents"] * 2
    plain = checked(text.replace("  up: {play: p, at: 0, transpose: 50cents}\n", ""), tmp_path)
    parts = [hit.to[0].part for hit in plain.piece.strikes[0].hits]
    assert parts == ["c.A4", "c.3to2", "c.A4+50cents"]


def test_rhythms_strike_every_pitch(tmp_path):
    text = score("edo: 19", ["C4", "Db4", "C#4", "A4+386.3cents", "550Hz", "3/2"])
    rhythm = 'r: {rhythm: "c4 [db4 c#4] a4+386.3cents 550Hz 3to2", to: cells.m, at: 9}'
    text = text.replace("render", f"  {rhythm}\nrender").replace(
        "at: 9}", "at: 9, times: 1, impulse: 1mNs}"
    )
    loaded = checked(text, tmp_path)
    assert loaded.piece is not None, loaded.diagnostics
    rhythm_strikes = next(s for s in loaded.piece.strikes if s.name == "r")
    parts = [hit.to[0].part for _, _, hit in rhythm_strikes.played_hits(loaded.piece, 0.0, 20.0)]
    assert parts == [
        "cells.C4",
        "cells.Db4",
        "cells.C#4",
        "cells.A4+386_3cents",
        "cells.550Hz",
        "cells.3to2",
    ]


def test_automation_by_notes_of_the_tuning(tmp_path):
    text = score("edo: 31", ["C4"]).replace(
        "render:", "automation: [{set: cells.C4.m.f, to: D#4 Eb4 C4.min, every: 1, at: 1}]\nrender:"
    )
    (automation,) = checked(text, tmp_path).piece.automation
    steps = [31.0 * log2(amount.value / 440.0) + 23.0 for amount in automation.amounts.values()]
    assert steps == pytest.approx([7, 8, 0, 8, 18], abs=1e-9)


@given(st.integers(5, 400), st.sampled_from(["Cb4", "E4", "F#3", "Bb5", "G##2", "Abb4"]))
def test_equal_division_fifths_and_sharps(count, word):
    """Twelve fifths up and seven octaves down is a sharp and its flat apart."""
    fifth = round(count * log2(1.5))
    with used(Tuning(edo=count)):
        c4, g4, d5 = (q.frequency(name) for name in ("C4", "G4", "D5"))
        assert count * log2(g4 / c4) == pytest.approx(fifth, abs=1e-9)
        assert count * log2(d5 / c4) == pytest.approx(2 * fifth, abs=1e-9)
        step = count * log2(q.frequency(word) / c4)
        assert step == pytest.approx(round(step), abs=1e-8)
        octave = f"{word[:-1]}{int(word[-1]) + 1}"
        assert q.frequency(octave) == pytest.approx(2.0 * q.frequency(word), rel=1e-12)


@given(st.integers(0, 127))
def test_twelve_equal_steps_are_those_without_a_tuning(key):
    word = notes.name(key)
    with used(Tuning(edo=12)):
        tuned = q.frequency(word)
    assert tuned == q.frequency(word)
    assert tuned == pytest.approx(440.0 * 2.0 ** ((key - 69) / 12), rel=1e-14)


# Of the version before tunings.
DIGEST = "62a3db6feee00c8fbea3a91fdb3fe02ad3c253b2bc2647bc6b4aebc7f33252c3"


def test_digest_depends_on_frequencies_of_tuning(tmp_path):
    rhythm = (
        '  r: {rhythm: "[c4,a4]", do: arp up, to: cells.m, at: 0, times: 1, impulse: 1mNs}\nrender'
    )

    def digest(tuning: str) -> str:
        text = score(tuning, ["C4", "A4"]).replace("render", rhythm, 1)
        return digest_of(checked(text, tmp_path).piece)

    plain = digest("")
    assert plain == digest("A4: 440Hz, edo: 12") != digest("A4: 442Hz")
    text = score("", ["C4", "A4"]).replace("render", rhythm, 1).replace("tuning: {}\n", "")
    assert digest_of(checked(text, tmp_path).piece) == plain == DIGEST


def test_instruments_of_other_files_keep_their_tuning(tmp_path):
    (tmp_path / "own.yaml").write_text(
        "instruments: {c: {modules: {m: {CEL: {M: 1g, f: A4, t60: 1s}}}, out: {SOX: m}}}\n"
    )
    text = """ergon: 1
title: Used
tuning: {A4: 415Hz}
use: own.yaml
instruments: {low: {from: own/c}, high: {from: own/c, f: A4}}
strikes: {s: {to: [low.m, high.m], at: 0, impulse: 1mNs}}
"""
    piece = checked(text, tmp_path).piece
    sounding = {
        name: instrument.modules[0].fields["f"] for name, instrument in piece.instruments.items()
    }
    assert sounding == {"low": 440.0, "high": 415.0}


def test_midi_notes_play_degrees(tmp_path):
    text = score("edo: 31", ["C4", "C#4", "Db4", "7\\31"]).replace(
        "out:", "play: {strike: {at: m, impulse: 1uNs..1mNs}}\n    out:"
    )
    loaded = checked(text, tmp_path)
    assert loaded.piece is not None, loaded.diagnostics
    notes_map = MapNotes(low=0, high=127, target="cells", impulse=None)
    struck = {key: places_of_note(loaded.piece, notes_map, key) for key in range(58, 70)}
    parts = {key: places[0][0][0] for key, places in struck.items() if places}
    assert parts == {60: "cells.C4", 62: "cells.C#4", 63: "cells.Db4", 67: "cells.7of31"}


def test_tuning_edited_repeatedly_in_texts(tmp_path):
    (tmp_path / "19.scl").write_text(NINETEEN, encoding="utf-8")
    text = score("scale: 19.scl", ["C4", "A4"])
    path = tmp_path / "score.yaml"
    path.write_text(text, encoding="utf-8")
    texts = Texts.read(path)
    low = [texts.load().piece.instruments["cells.C4"].modules[0].fields["f"]]
    for tuning in ("edo: 12", "A4: 415Hz", "scale: 19.scl"):
        texts = texts.put(("tuning",), f"{{{tuning}}}")
        low.append(texts.load().piece.instruments["cells.C4"].modules[0].fields["f"])
    equal = 2.0 ** (-9 / 12)
    nineteen = 440.0 * 2.0 ** (-9 / 19)
    assert low == pytest.approx([nineteen, 440.0 * equal, 415.0 * equal, nineteen], rel=1e-9)


@pytest.mark.parametrize(
    ("tuning", "code", "message"),
    [
        ("scale: none.scl", "E107", "there is no file none.scl"),
        ("scale: ../other.scl", "E112", "lies outside the score's folder"),
        ("keys: k.kbm", "E111", "write `scale` beside it"),
        ("scale: 19.scl, edo: 19", "E111", "keep `edo` or `scale`"),
        ("scale: bad.scl", "E201", "is no pitch"),
        ("scale: 19.scl, keys: bad.kbm", "E201", "the size of the map"),
        ("scale: 19.scl, keys: few.kbm", "E202", "the key 60 has no pitch"),
        ("edo: 0", "E202", "outside the range"),
        ("a4: 442Hz", "E101", "a4"),
        ("root: nothing", "E201", "neither a note such as C4 nor a frequency"),
    ],
)
def test_tuning_mistakes_are_refused(tuning, code, message, tmp_path):
    inner = tmp_path / "inner"
    inner.mkdir()
    (tmp_path / "other.scl").write_text(NINETEEN)
    (inner / "19.scl").write_text(NINETEEN)
    (inner / "bad.scl").write_text("t\n1\nquint\n")
    (inner / "bad.kbm").write_text("many\n")
    (inner / "few.kbm").write_text("0\n61\n127\n60\n69\n440.0\n0\n")
    diagnostics = checked(score(tuning, ["A4"]), inner).diagnostics
    assert any(d.code == code and message in d.message for d in diagnostics), diagnostics
