"""BANKs whose modes are lists in the score or rows of a file."""

import numpy as np
import pytest
from checked import check, check_reports

from ergon.instruments.assemble import Assembly
from ergon.scores.reading.load import load
from ergon.scores.staging.stage import stage

SCORE = "ergon: 1\ninstruments:\n  b: {modules: {m: {BANK: {M: 10g, %s}}}, out: {SOV: m.all}}\n"
LISTS = "f: [200Hz, 453Hz, A5], t60: [4s, 3s, 1s], gain: [0dB, -6dB, x0.2]"


def test_bank_modes_frequency_decay_and_gain():
    piece = check(SCORE % LISTS).piece
    assembly = Assembly()
    assembly.add_part("b", piece.instruments["b"].modules)
    listened = np.array(assembly.network.modes("b", 3))
    assert listened[:, 0] == pytest.approx([200.0, 453.0, 880.0], rel=1e-12)
    assert listened[:, 1] == pytest.approx([4.0, 3.0, 1.0], rel=1e-9)
    text = SCORE % LISTS + "strikes: {s: {to: b.m.all, at: 0s, impulse: 1mNs, lasts: 0s}}\n"
    simulation = stage(load("x.yaml", text=text).piece).simulation
    out = np.zeros((44100, 1))
    simulation.process(out)
    t = np.arange(44100) / 44100
    # An impulse p gives each member the speed gain·p/M; SOV comes 7.5 frames late.
    amplitude = []
    for f, t60 in ((200.0, 4.0), (453.0, 3.0), (880.0, 1.0)):
        turn = np.exp(-2j * np.pi * f * t) * np.hanning(44100)
        envelope = np.sum(np.hanning(44100) * 10.0 ** (-3.0 * t / t60))
        amplitude.append(2.0 * abs(np.dot(out[:, 0], turn)) / envelope)
    assert amplitude == pytest.approx([0.1, 0.1 * 10**-0.3, 0.02], rel=0.01)


def test_bank_with_single_decay_and_default_gain():
    lone = check(SCORE % "f: [200Hz, 453Hz], t60: 2s").piece.instruments["b"].modules[0].fields
    assert (lone["t60"], lone["gain"], lone["count"]) == ((2.0, 2.0), (1.0, 1.0), 2)


def test_bank_with_two_listed_frequencies_transposed():
    text = SCORE % "f: [200Hz, 453Hz], t60: [1s, 2s]" + "  h: {like: b, transpose: 12st}\n"
    high = check(text).piece.instruments["h"].modules[0].fields
    assert (high["f"], high["t60"]) == ((400.0, 906.0), (0.5, 1.0))


@pytest.fixture
def score(tmp_path):
    def loaded_bank(table: str, more: str = ""):
        (tmp_path / "bell.csv").write_bytes(table.encode())
        text = SCORE % f"modes: bell.csv{more}" + "  h: {like: b, transpose: 12st}\n"
        (tmp_path / "s.yaml").write_text(text)
        return load(tmp_path / "s.yaml")

    return loaded_bank


def test_bank_file_equals_lists(score, tmp_path):
    loaded = score("f, t60, gain\n# a bell\n200Hz, 4s, 0dB\n453, 3, -6dB\nA5,1s,x0.2\n")
    assert loaded.diagnostics == []
    lists = check(SCORE % LISTS).piece.instruments["b"].modules[0].fields
    assert loaded.piece.instruments["b"].modules[0].fields == lists
    assert loaded.piece.instruments["h"].modules[0].fields["f"] == (400.0, 906.0, 1760.0)
    assert tmp_path / "bell.csv" in loaded.inputs


def test_bank_file_bad_cells_with_line_and_column(score, tmp_path):
    loaded = score("200Hz, 4s\n2oo, 4s, 1\n300Hz, -1s\n400Hz\n")
    places = [(d.place.file, d.place.line, d.place.column) for d in loaded.diagnostics]
    name = str(tmp_path / "bell.csv")
    assert places == [(name, 2, 2), (name, 2, 10), (name, 3, 8), (name, 4, 1)]
    assert all("modes of module 'b.m'" in d.message for d in loaded.diagnostics)


@pytest.mark.parametrize(
    ("table", "code", "part"),
    [
        ("", "E106", "no modes"),
        ("f,t60\n", "E106", "no modes"),
        ("1Hz, 1s, x0\n", "E202", "gain 0"),
        ("9999999999Hz, 1s\n", "E202", "too large"),
        ("1Hz, 1s\n" * 100_001, "E105", "100,000 modes"),
        ("x" * 5000, "E106", "200Hz, 4s, -6dB"),
    ],
)
def test_bank_hostile_files_are_refused(score, table, code, part):
    reports = [(d.code, d.message) for d in score(table).diagnostics]
    assert reports[0][0] == code
    assert part in reports[0][1] or code == "E202"


def test_bank_file_outside_score_folder_is_refused(tmp_path):
    inside = tmp_path / "in"
    inside.mkdir()
    (tmp_path / "bell.csv").write_text("1Hz, 1s\n")
    (inside / "s.yaml").write_text(SCORE % "modes: ../bell.csv")
    assert [d.code for d in load(inside / "s.yaml").diagnostics] == ["E112"]
    (inside / "s.yaml").write_text(SCORE % "modes: no.csv")
    assert [d.code for d in load(inside / "s.yaml").diagnostics] == ["E107"]
    (inside / "s.yaml").write_text(SCORE % "modes: .")
    assert [d.code for d in load(inside / "s.yaml").diagnostics] == ["E107"]


@pytest.mark.parametrize(
    ("fields", "code", "part"),
    [
        ("f: [200Hz, 300Hz], t60: [1s]", "E106", "as many values, not 1"),
        ("f: [200Hz, 300Hz], t60: 1s..2s", "E106", "as a list"),
        ("f: [200Hz], t60: 1s, gain: [0dB, 0dB]", "E106", "not 2"),
        ("f: [200Hz], t60: 1s, gain: [x0]", "E202", "gain 0"),
        ("f: [200Hz], t60: 1s, count: 1", "E111", "remove it"),
        ("f: [200Hz], t60: 1s, spread: random", "E111", "remove it"),
        ("f: 200Hz, t60: [1s, 2s], count: 2", "E103", "list of frequencies"),
        ("f: [200Hz, x], t60: 1s", "E201", "x"),
        ("f: [200Hz]", "E103", "no 't60'"),
        ("modes: bell.csv, f: [200Hz]", "E111", "keep one"),
    ],
)
def test_wrong_bank_fields_report_code_and_text(fields, code, part):
    ((own, _, message),) = check_reports(SCORE % fields)
    assert (own, part in message) == (code, True), message
