"""Bad input is refused with a sentence, in bounded memory."""

import tracemalloc

import pytest

from ergon.scores.reading.load import load
from ergon.scores.reading.piece import Piece

KEY = "ergon: 1\nkeys: {k: {M: 1kg, K: 1}}\nplayers: {p: {key: k}}\ngestures: {g: 0@0 1@1}\n"


def chain(count):
    return "ergon: 1\ngestures:\n  g0: 0@0 1@1\n" + "".join(
        f"  g{i}: {{like: g{i - 1}}}\n" for i in range(1, count)
    )


def bank(count):
    body = "{BANK: {count: 2000000, M: 1g, f: 20Hz..1kHz, t60: 1s}}"
    return "ergon: 1\ninstruments:\n" + "".join(f"  b{i}: {body}\n" for i in range(count))


def rain(rate, span):
    return (
        "ergon: 1\ninstruments: {b: {BANK: {count: 1000000, M: 1g, f: 20Hz..1kHz, t60: 1s}}}\n"
        f"strikes: {{r: {{to: b.all, at: 0, {span}, {rate}, impulse: 1uNs}}}}\n"
    )


@pytest.mark.parametrize(
    ("text", "code"),
    [
        (chain(2000), "E105"),
        (bank(3), "E105"),
        (bank(1).replace("2000000", "1e11"), "E202"),
        (rain("rate: 1000Hz", "for: 1000s"), "E105"),
        (rain("every: 1ms", "for: 1000s"), "E105"),
        (rain("every: 0ms", "for: 1000s"), "E305"),
        (rain("every: 1s", "mass: 1g"), "E111"),
        (KEY + "parts: {p: [{at: 0, play: g, every: 1e-9, until: 1000}]}\n", "E305"),
        (KEY + "parts: {p: [{at: 0, play: g, times: 99999999}]}\n", "E204"),
        (KEY.replace("0@0 1@1", "0@0 " + "(" * 60 + "1@1" + ")*99" * 60), "E204"),
        (KEY.replace("0@0 1@1", "0@0 (1@1 0@2)*999999999"), "E204"),
        ("ergon: 1\nseed: 99999999999999999999999\n", "E202"),
        ("ergon: 1\nseed: " + "9" * 100_000 + "\n", "E201"),
        ("ergon: 1\nmix: {channels: 1e9}\n", "E202"),
        ("ergon: 1\nrates: {audio: 1e300}\n", "E202"),
        ("ergon: 1\nrates: {audio: .nan}\n", "E201"),
        ("ergon: 1\n" + "x" * 1_000_000 + ": 1\n", "E100"),
        ("ergon: 1\n? " + "x" * 1_000_000 + "\n: 1\n", "E101"),
        ("ergon: 1\nuse: [" + "../" * 200 + "etc/passwd]\n", "E112"),
        ('ergon: 1\nuse: ["\\0"]\n', "E201"),
        ("ergon: 1\nuse: [" + "a" * 5000 + "]\n", "E201"),
        ("ergon: 1\nuse: [" + "a" * 900 + "]\n", "E107"),
        ("ergon: 1\nuse: [.]\n", "E107"),
        ("ergon: 1\nuse: [/dev/zero]\n", "E112"),
    ],
    ids=range(24),
)
def test_hostile_scores_are_refused(text, code):
    tracemalloc.start()
    loaded = load("s.yaml", text=text)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert loaded.piece is None
    assert all(len(d.message) < 1500 for d in loaded.diagnostics)
    assert code in [d.code for d in loaded.diagnostics]
    assert peak < 50e6  # a million occurrences, the most that a piece may have, take 32 MB


def test_use_chain_of_300_files_is_refused():
    overlay = {f"f{i}.yaml": f"use: [f{i + 1}.yaml]\n" for i in range(300)}
    loaded = load("s.yaml", text="ergon: 1\nuse: [f0.yaml]\n", overlay=overlay)
    assert [d.code for d in loaded.diagnostics] == ["E105"]


def test_use_of_400_files_is_refused():
    overlay = {f"f{i}.yaml": "ergon: 1\n" for i in range(400)}
    text = f"ergon: 1\nuse: [{', '.join(overlay)}]\n"
    assert {d.code for d in load("s.yaml", text=text, overlay=overlay).diagnostics} == {"E105"}


def test_load_table_of_100000_rows():
    rows = "".join(f"    {i} {i % 7}mm\n" for i in range(100_000))
    piece = load("s.yaml", text=f"ergon: 1\ngestures:\n  t: |\n{rows}").piece
    assert isinstance(piece, Piece)
    assert len(piece.gestures["t"].points) == 100_000
    assert piece.gestures["t"].place_of(piece.gestures["t"].points[-1]).line == 100_003


def test_many_mistakes_are_counted_quickly():
    rows = "".join(f"    {i}|1 knok\n" for i in range(1, 30_001))
    loaded = load("s.yaml", text=KEY + "parts:\n  p: |\n" + rows)
    assert len(loaded.diagnostics) == 20
    assert loaded.left_out["error"] == 29_980
