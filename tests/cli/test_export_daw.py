"""A piece for a workstation: the project of REAPER, and stems with and without their rooms."""

from __future__ import annotations

import csv
import re
from pathlib import Path

import mido
import numpy as np
import pytest
import soundfile
from commands import forked

SCORE = """\
ergon: 1
title: Two "stems" and 'more'
tempo: [{at: 0, bpm: 96}, {at: 3|1, bpm: 96 -> 72, over: 2bar, meter: 6/8}]
marks: {verse: 1|1, bridge: 3|1}
instruments:
  low: {from: bell/bell, f: C4}
  high: {from: bell/bell, f: G4}
strikes:
  lows: {to: low.hammer, at: 1|1, every: 2, times: 4, impulse: 3mNs}
  highs: {to: high.hammer, at: 1|2, every: 2, times: 4, impulse: 3mNs}
mix:
  rooms: {hall: {size: 20m, t60: 1s}}
  route: [{from: low, to: 1, send: {hall: -6dB}}, {from: high, to: 2}]
rates: {audio: 16kHz}
render: {tail: 0.5s}
"""
VALUE = re.compile(r"""\s*(?:"([^"]*)"|'([^']*)'|`([^`]*)`|(\S+))""")

Block = tuple[list[str], list["list[str] | Block"]]


def parsed(text: str) -> Block:
    """The blocks of a project; a line within one is its words."""
    stack: list[Block] = [([], [])]
    for line in text.splitlines():
        if line.strip() == ">":
            stack.pop()
            continue
        if line.lstrip().startswith("|"):
            stack[-1][1].append([line.lstrip()[1:]])
            continue
        words = ["".join(match) for match in VALUE.findall(line)]
        if words[0].startswith("<"):
            block: Block = ([words[0][1:], *words[1:]], [])
            stack[-1][1].append(block)
            stack.append(block)
        else:
            stack[-1][1].append(words)
    assert len(stack) == 1, "every block ends"
    (project,) = stack[0][1]
    assert isinstance(project, tuple)
    return project


def lines(block: Block, name: str) -> list[list[str]]:
    return [line[1:] for line in block[1] if isinstance(line, list) and line[0] == name]


def blocks(block: Block, name: str) -> list[Block]:
    return [inner for inner in block[1] if isinstance(inner, tuple) and inner[0][0] == name]


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("daw")
    (folder / "s.yaml").write_text(SCORE)
    for words in (("-o", "split", "--wet"), ("-o", "joined")):
        done = forked(["export", "s.yaml", "--bits", "float", *words], folder)
        assert done.returncode == 0, done.stderr
    return folder


@pytest.fixture(scope="module")
def project(folder: Path) -> Block:
    return parsed((folder / "split" / "project.rpp").read_text())


def test_reaper_tracks_and_files_at_piece_start(folder: Path, project: Block):
    tracks = {}
    for track in blocks(project, "TRACK"):
        ((name,),) = lines(track, "NAME")
        (item,) = blocks(track, "ITEM")
        (source,) = blocks(item, "SOURCE")
        ((file,),) = lines(source, "FILE")
        ((length,),) = lines(item, "LENGTH")
        assert lines(item, "POSITION") == [["0"]]
        assert source[0] == ["SOURCE", "WAVE"]
        info = soundfile.info(folder / "split" / file)
        assert float(length) == pytest.approx(info.frames / info.samplerate, abs=1e-9)
        tracks[name] = file, lines(track, "MUTESOLO")[0][0]
    assert tracks == {
        "low-dry": ("stems/01_low-dry.wav", "0"),
        "low-wet": ("stems/02_low-wet.wav", "0"),
        "high": ("stems/03_high.wav", "0"),
        "mix": ("mix.wav", "1"),
    }


def test_reaper_tempo_envelope_equals_midi_tempo(folder: Path, project: Block):
    """Beats that pass between the points are those that mido counts; points stand at its times."""
    (envelope,) = blocks(project, "TEMPOENVEX")
    points = [(float(t), float(bpm)) for t, bpm, *_ in lines(envelope, "PT")]
    assert {shape for _, _, shape, *_ in lines(envelope, "PT")} == {"1"}
    midi = mido.MidiFile(folder / "split" / "tempo.mid")
    seconds, tick, tempo, expected = 0.0, 0, 500_000, []
    for message in midi.tracks[0]:
        seconds += mido.tick2second(message.time, midi.ticks_per_beat, tempo)
        tick += message.time
        if message.type == "set_tempo":
            tempo = message.tempo
            expected.append((tick / midi.ticks_per_beat, seconds, 60e6 / tempo))
    quarters = 0.0
    assert len(points) == len(expected) > 10
    for index, (quarter, seconds, bpm) in enumerate(expected):
        if index:
            quarters += (points[index][0] - points[index - 1][0]) * points[index - 1][1] / 60.0
        assert quarters == pytest.approx(quarter, abs=1e-4)
        assert points[index] == pytest.approx((seconds, bpm), abs=1e-5)


def test_reaper_meters_and_marks(folder: Path, project: Block):
    (envelope,) = blocks(project, "TEMPOENVEX")
    meters = [(float(t), int(more[0])) for t, _, _, *more in lines(envelope, "PT") if more]
    assert [(seconds, word & 0xFFFF, word >> 16) for seconds, word in meters] == [
        (0.0, 4, 4),
        (5.0, 6, 8),
    ]
    assert lines(project, "TEMPO") == [["96.0000000000", "4", "4"]]
    rows = list(csv.reader((folder / "split" / "marks.csv").read_text().splitlines()[2:]))
    marks = [(name, float(seconds)) for _, seconds, name, _ in lines(project, "MARKER")]
    assert marks == [(name, float(seconds)) for name, _, seconds in rows]


def test_reaper_title_with_quotes(project: Block):
    (notes,) = blocks(project, "NOTES")
    assert notes[1] == [["made by ergon"], ["""Two "stems" and 'more'"""]]


def read(path: Path) -> np.ndarray:
    return soundfile.read(path, always_2d=True)[0]


def test_dry_and_wet_stems_sum_to_stem(folder: Path):
    dry, wet = (read(folder / "split" / "stems" / f"0{i}_low-{kind}.wav") for i, kind in
                ((1, "dry"), (2, "wet")))  # fmt: skip
    joined = read(folder / "joined" / "stems" / "01_low.wav")
    assert np.abs(dry + wet - joined).max() < 1e-6 * np.abs(joined).max()
    assert np.abs(dry[:, 1]).max() == 0.0 < np.abs(wet[:, 1]).max(), "the route goes to channel 1"


def test_stems_sum_to_mix(folder: Path):
    stems = sum(read(path) for path in sorted((folder / "split" / "stems").iterdir()))
    mix = read(folder / "split" / "mix.wav")
    assert np.abs(stems - mix).max() < 1e-6 * np.abs(mix).max()


def test_export_without_stems_writes_no_project(folder: Path):
    done = forked(["export", "s.yaml", "-o", "silent", "--no-stems"], folder)
    assert done.returncode == 0, done.stderr
    assert sorted(path.name for path in (folder / "silent").iterdir()) == ["marks.csv", "tempo.mid"]


def test_wet_option_refused_without_stems(folder: Path):
    done = forked(["render", "s.yaml", "--wet"], folder)
    assert done.returncode == 2
    assert "--wet: this is about stems; add the option stems" in done.stderr
