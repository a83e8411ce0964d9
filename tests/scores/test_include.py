"""`include:` a score inside another: the same bytes as by hand, mistakes in their places."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import ergon
from ergon.scores.reading.load import load

SHARED = """\
ergon: 1
keys: {k1: {M: 400g, K: 60N/m, Z: 1.2Ns/m, travel: -15mm..15mm}}
instruments:
  bell:
    modules:
      m: {CEL: {M: 2g, f: 220Hz, t60: 0.4s}}
      b: {BUT: {between: [k1, m], K: 900N/m, Z: 0.1Ns/m, gap: 1mm}}
    out: {SOX: m}
  glass: {modules: {m: {CEL: {M: 1g, f: A4, t60: 0.3s}}}, out: {SOX: m}}
gestures: {knock: 0mm@0 smooth 6mm@1/8 smooth 0mm@1/2, lean: 0mm@0 smooth 3mm@1}
"""
VERSE = """\
ergon: 1
use: [shared.yaml]
marks: {A: 1|3}
players: {ada: {key: k1}}
phrases: {two: {length: 1, entries: [{at: 0, what: glass.m, impulse: 1mNs}]}}
strikes:
  tune: {play: two, at: 1|2, times: 2}
  rain: {to: glass.m, at: 0, for: 2, rate: 3Hz, impulse: 1uNs..4uNs}
  some: {entries: [{at: 2|1, what: glass.m, impulse: 1mNs}, {at: A+1/2, what: glass.m}]}
automation: [{at: A, set: glass.m.f, to: A4@0 smooth C5@1, until: 2|2}]
parts:
  ada:
    - {at: 0, play: knock lean, every: 1, times: 1}
    - {at: A, play: knock, until: 2|1}
"""
MAIN = """\
ergon: 1
use: [shared.yaml]
tempo: [{at: 1|1, bpm: 240}]
INCLUDE
mix: {channels: 2, route: [{from: bell, to: 1}, {from: glass, to: 2}]}
render: {tail: 100ms}
"""
BY_HAND = """\
players: {ada: {key: k1}}
phrases: {two: {length: 1, entries: [{at: 0, what: glass.m, impulse: 1mNs}]}}
strikes:
  tune: {play: two, at: 3|2, times: 2}
  rain: {to: glass.m, at: 3|1, for: 2, rate: 3Hz, impulse: 1uNs..4uNs}
  some: {entries: [{at: 4|1, what: glass.m, impulse: 1mNs}, {at: 3|3.5, what: glass.m}]}
automation: [{at: 3|3, set: glass.m.f, to: A4@0 smooth C5@1, until: 4|2}]
parts:
  ada:
    - {at: 3|1, play: knock lean, every: 1, times: 1}
    - {at: 3|3, play: knock, until: 4|1}
"""


@pytest.fixture(autouse=True)
def _files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("shared.yaml").write_text(SHARED, encoding="utf-8")
    Path("verse.yaml").write_text(VERSE, encoding="utf-8")


def rendered(text: str) -> np.ndarray:
    Path("main.yaml").write_text(text, encoding="utf-8")
    frames = ergon.render("main.yaml").frames
    assert np.abs(frames).max() > 0
    return frames


def reports(text: str, **files: str) -> list[tuple[str, str, int]]:
    """Code, message and line of all that is wrong."""
    for name, content in files.items():
        Path(f"{name}.yaml").write_text(content, encoding="utf-8")
    loaded = load("main.yaml", text=text)
    return [(d.code, d.message, d.place.line if d.place else 0) for d in loaded.diagnostics]


def test_include_equals_score_written_by_hand():
    included = rendered(MAIN.replace("INCLUDE", "include: {file: verse.yaml, at: 3|1}"))
    assert np.array_equal(included, rendered(MAIN.replace("INCLUDE", BY_HAND)))


def test_include_with_prefix_and_transpose():
    """Without what chance draws, which is told apart by names, and pitches that are set."""
    plain = [line for line in VERSE.splitlines() if "rain" not in line and "automation" not in line]
    Path("verse.yaml").write_text("\n".join(plain), encoding="utf-8")
    line = "include: {file: verse.yaml, at: 3|1, as: v2, transpose: 7st}"
    routes = MAIN.replace("from: bell", "from: v2.bell").replace("from: glass", "from: v2.glass")
    included = rendered(routes.replace("INCLUDE", line))
    hand = [one for one in BY_HAND.splitlines() if "rain" not in one and "automation" not in one]
    Path("shared.yaml").write_text(
        SHARED.replace("  bell:\n", "  bell:\n    transpose: 7st\n").replace(
            "glass: {", "glass: {transpose: 7st, "
        ),
        encoding="utf-8",
    )
    assert np.array_equal(included, rendered(MAIN.replace("INCLUDE", "\n".join(hand))))


def test_include_twice_and_nested():
    Path("verse.yaml").write_text(
        "\n".join(line for line in VERSE.splitlines() if "rain" not in line), encoding="utf-8"
    )
    Path("song.yaml").write_text(
        "ergon: 1\ninclude: [{file: verse.yaml, at: 2|1}]\n", encoding="utf-8"
    )
    text = MAIN.replace(
        "INCLUDE",
        "include: [{file: verse.yaml, at: 3|1, as: a}, {file: song.yaml, at: 4|1, as: b}]",
    )
    text = text.replace("route: [{from: bell, to: 1}, {from: glass, to: 2}]", "route: ROUTES")
    routes = "[{from: a.glass, to: 1}, {from: b.glass, to: 2}]"
    frames = rendered(text.replace("ROUTES", routes))
    bar = int(4 * 60 / 240 * 44_100)
    first, second = frames[: -2 * bar, 0], frames[2 * bar :, 1]
    assert np.abs(first).max() > 0.01
    end = int(0.005 * 44_100)  # the file is cut, and falls there
    assert np.allclose(first[:-end], second[:-end], rtol=0, atol=1e-6)  # instants are rounded


def test_include_keeps_positions_in_seconds():
    Path("verse.yaml").write_text(
        "ergon: 1\nuse: [shared.yaml]\nstrikes: {s: {to: glass.m, at: 250ms, impulse: 1mNs}}\n",
        encoding="utf-8",
    )
    piece = load(
        "main.yaml",
        text="ergon: 1\ntempo: [{bpm: 240}]\ninclude: {file: verse.yaml, at: 2|1}\n",
    ).piece
    assert piece is not None
    assert piece.tempo_map.seconds(piece.tempo_map.resolve(piece.strikes[0].at)) == 1.25


@pytest.mark.parametrize(
    ("line", "code", "words"),
    [
        ("include: {file: nowhere.yaml}", "E107", "nowhere.yaml"),
        ("include: {file: verse.yaml, transpose: 7st}", "E103", "write `as`"),
        ("include: {file: verse.yaml, as: v, transpose: 7st}", "E304", "sets pitches, which stay"),
        ("include: [{file: verse.yaml}, {file: verse.yaml, at: 3|1}]", "E303", "give its names"),
        ("include: {file: verse.yaml, at: Q}", "E301", "no mark is called 'Q'"),
        ("include: {file: ring.yaml}", "E302", "ring.yaml uses itself"),
    ],
)
def test_include_mistakes_at_their_line(line: str, code: str, words: str):
    ring = "ergon: 1\ninclude: [{file: ring.yaml}]\n"
    errors = [one for one in reports(f"ergon: 1\n{line}\n", ring=ring) if one[0][0] == "E"]
    assert errors
    assert (errors[0][0], words in errors[0][1]) == (code, True)
    assert errors[0][2] == 2


def test_mistake_in_included_file_has_one_message():
    wrong = VERSE.replace("play: two", "play: tow")
    Path("wrong.yaml").write_text(wrong, encoding="utf-8")
    loaded = load("main.yaml", text="ergon: 1\ninclude: [{file: wrong.yaml}]\n")
    (item,) = [d for d in loaded.diagnostics if d.code[0] == "E"]
    assert item.code == "E301"
    assert item.place is not None
    assert item.place.file == "wrong.yaml"


def test_included_tempo_is_ignored_with_warning():
    slow = VERSE + "tempo: [{bpm: 30}]\n"
    codes = [one[0] for one in reports("ergon: 1\ninclude: {file: slow.yaml}\n", slow=slow)]
    assert codes.count("W330") == 1


def test_include_doubling_with_each_file_is_refused():
    files = {"f0": VERSE}
    for n in range(1, 19):
        lines = f"[{{file: f{n - 1}.yaml, as: a}}, {{file: f{n - 1}.yaml, as: b}}]"
        files[f"f{n}"] = f"ergon: 1\ninclude: {lines}\n"
    errors = reports("ergon: 1\ninclude: {file: f18.yaml}\n", **files)
    assert "E105" in [one[0] for one in errors]
