"""The notes of a piece, in exported MIDI and drawn."""

from __future__ import annotations

import json
from pathlib import Path
from xml.etree import ElementTree

import damped_bar
import mido
import pytest
from commands import forked

SCORE = """\
ergon: 1
title: Notes
tempo: [{at: 1|1, bpm: 90, meter: 3/4}, {at: 3|1, bpm: 60 -> 120, over: 2bar}]
instruments:
  cell:
    modules: {m: {CEL: {M: 1g, f: C4, t60: 1s}}}
    notes: C4..C5
    play: {strike: {at: m, impulse: 1mNs..100mNs}}
    out: {SOX: m}
  drum:
    modules: {a: {CEL: {M: 1g, f: 80Hz, t60: 1s}}, b: {CEL: {M: 1g, f: 130Hz, t60: 1s}}}
    play: {strike: {at: [a, b], impulse: 1mNs..100mNs}}
    out: {SOX: [a, b]}
phrases:
  call:
    to: cell
    entries: |
      0    C4     ppp
      1    E4 G4  fff
      2.5  C5     mf
strikes:
  calls: {play: call, at: 1|1, every: 3, times: 4}
  beat: {to: drum, at: 1|1, every: 3/2, times: 6, impulse: p -> f}
mix: {route: [{from: cell, to: 1}, {from: drum, to: 1}]}
render: {tail: 0.1s}
"""


@pytest.fixture
def score(tmp_path: Path) -> Path:
    path = tmp_path / "score.yaml"
    path.write_text(SCORE, encoding="utf-8")
    return path


def seconds(beat: float) -> float:
    """The instant of a beat by the closed form of docs/language.md."""
    if beat <= 6:
        return beat * 60 / 90
    from math import log

    x = min(beat, 12.0) - 6
    return 4.0 + 60 * 6 / 60 * log(1 + x * 60 / (6 * 60)) + max(0.0, beat - 12) * 0.5


def test_export_midi_with_notes(score: Path):
    out = score.parent / "daw"
    done = forked(["export", "score.yaml", "-o", "daw", "--no-stems"], score.parent)
    assert done.returncode == 0, done.stderr
    file = mido.MidiFile(out / "tempo.mid")
    assert [track.name for track in file.tracks] == ["Notes", "cell", "drum"]
    position, listened, ends = 0.0, [], 0
    for message in file:  # its times are in seconds
        position += message.time
        if message.type == "note_on" and message.velocity:
            listened.append((position, message.channel, message.note, message.velocity))
        ends += message.type == "note_off"
    expected = []
    for turn in range(4):
        for beat, key, level in ((0, 60, 1), (1, 64, 127), (1, 67, 127), (2.5, 72, 73)):
            expected.append((seconds(3 * turn + beat), 0, key, level))
    for number in range(6):
        level = round(127 * (2 + 3 * number / 5) / 7)
        expected.append((seconds(1.5 * number), 9, 36, level))
    assert ends == len(listened) == len(expected)
    for item, exact in zip(
        sorted(listened, key=by_place), sorted(expected, key=by_place), strict=True
    ):
        assert item[0] == pytest.approx(exact[0], abs=1e-3)  # a tick is 1/960 of a quarter
        assert item[1:] == exact[1:]


def by_place(note: tuple[float, int, int, int]) -> tuple[int, float, int]:
    return note[1], round(note[0], 2), note[2]


def test_plot_notes_as_svg(score: Path):
    picture = score.parent / "notes.svg"
    done = forked(["plot", "score.yaml", "notes", "--svg", "notes.svg"], score.parent)
    assert done.returncode == 0, done.stderr
    root = ElementTree.fromstring(picture.read_text(encoding="utf-8"))
    space = "{http://www.w3.org/2000/svg}"
    bars = [own for own in root.iter(f"{space}rect") if own.find(f"{space}title") is not None]
    by_name: dict[str, list[tuple[float, float]]] = {"cell": [], "drum": []}
    for rectangle in bars:
        x, y = (float(rectangle.get(name, "")) for name in ("x", "y"))
        by_name[rectangle.findtext(f"{space}title", "")].append((x, y))
    places = by_name["cell"]
    assert len(places) == 16
    # The drum has no pitch: it has a line of its own, which lies below all notes.
    assert len(by_name["drum"]) == 6
    (lane,) = {y for _, y in by_name["drum"]}
    assert lane > max(y for _, y in places)
    by_x = sorted(places)
    assert by_x[0][0] == 64.0
    # E4 and G4 together lie 4 and 7 keys above C4.
    steps = sorted(by_x[0][1] - y for x, y in places if x == by_x[1][0])
    assert steps[1] / steps[0] == pytest.approx(7 / 4, rel=0.01)
    texts = [own.text for own in root.iter(f"{space}text")]
    assert {"C4", "C5", "cell", "notes of Notes"} <= set(texts)
    assert texts.count("drum") == 2  # on its line, and among the colours


def test_plot_notes_in_terminal_and_as_json(score: Path):
    done = forked(["plot", "score.yaml", "notes", "--width", "60"], score.parent)
    assert done.returncode == 0, done.stderr
    assert "notes of Notes" in done.stdout
    assert "without a pitch: drum at 58" in done.stdout
    lines = forked(["plot", "score.yaml", "notes", "--json"], score.parent).stdout.splitlines()
    notes = [json.loads(line) for line in lines]
    assert [note["pitch"] for note in notes if note["instrument"] == "drum"] == [None] * 6
    notes = [note for note in notes if note["instrument"] == "cell"]
    assert len(notes) == 16
    assert [notes[0][name] for name in ("instrument", "member", "begin")] == [
        "cell",
        "cell.C4",
        0.0,
    ]
    assert notes[0]["pitch"] == pytest.approx(261.6256, abs=1e-3)


@pytest.mark.parametrize("command", ["check", "plan", "plot"])
def test_notes_commands_refuse_journal(tmp_path: Path, command: str):
    (tmp_path / "set.jsonl").write_text('{"v": 1, "n": 1, "event": "start"}\n', encoding="utf-8")
    done = forked([command, "set.jsonl", *(["notes"] if command == "plot" else [])], tmp_path)
    assert done.returncode != 0
    assert "set.jsonl is the journal of a session, not a score" in done.stderr
    assert "Traceback" not in done.stderr


def test_plot_notes_of_undamped_note_before_damped(tmp_path: Path):
    score = damped_bar.SCORE + (
        "tempo: {bpm: 60}\n"
        "phrases: {tap: {to: bar, entries: [{at: 0, what: C4}]}}\n"
        "strikes:\n"
        "  open: {play: tap, at: 1|1}\n"
        '  ended: {to: bar, rhythm: "~ ~ c4@2", at: 2|1, times: 1}\n'
        "mix: {route: [{from: bar, to: 1}]}\n"
    )
    (tmp_path / "score.yaml").write_text(score, encoding="utf-8")
    lines = forked(["plot", "score.yaml", "notes", "--json"], tmp_path).stdout.splitlines()
    notes = [json.loads(line) for line in lines]
    assert [(note["begin"], note["end"]) for note in notes] == [
        (0.0, 1.0),  # it rings on, drawn as a second; the damper comes down at 8 s
        (pytest.approx(6.0, abs=1e-4), pytest.approx(8.0, abs=1e-4)),
    ]
