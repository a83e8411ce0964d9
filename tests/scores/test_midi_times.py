"""Tempos and meters of MIDI files, taken over by a score: instants are those of mido."""

from pathlib import Path

import midi_files
import numpy as np
import pytest

from ergon.scores.edits import times
from ergon.scores.edits.excerpt import excerpt_between
from ergon.scores.edits.texts import Texts
from ergon.scores.reading.digest import digest_of
from ergon.scores.reading.load import load
from ergon.scores.reading.piece import Piece
from ergon.scores.staging.stage import stage

CELLS = """\
ergon: 1
instruments:
  cell: {CEL: {M: 1g, f: A4, t60: 50ms}, notes: C3..C5, out: {SOX: cell}}
takes: {tune: {file: tune.mid, velocity: 1mNs}}
strikes: {melody: {play: tune, to: cell, at: 1|1}}
render: {tail: 0.1s}
"""
METERS = "meter: {from: tune.mid}\n"
BOTH = "tempo: {from: tune.mid}\n" + METERS
SEEDS = range(40)


def piece_of(folder: Path, times_text: str, text: str = CELLS) -> Piece:
    loaded = load(folder / "s.yaml", text=text + times_text)
    assert loaded.piece is not None, loaded.diagnostics
    return loaded.piece


def reports(folder: Path, times_text: str) -> list[tuple[str, int, str]]:
    loaded = load(folder / "s.yaml", text=CELLS + times_text)
    return [(d.code, d.place.line, d.message) for d in loaded.diagnostics]


def instants(piece: Piece) -> list[float]:
    """The instants of the notes [s]."""
    return sorted(piece.tempo_map.seconds(beat) for beat, *_ in piece.strikes[0].played_hits(piece))


@pytest.mark.parametrize("seed", SEEDS)
def test_instants_with_tempos_and_meters_of_file(tmp_path, seed):
    path = midi_files.random_file(tmp_path / "tune.mid", seed)
    piece = piece_of(tmp_path, BOTH)
    assert instants(piece) == pytest.approx(midi_files.instants(path), abs=1e-9)


@pytest.mark.parametrize("meter", ["4/4", "6/8", "3/2", "7/16"])
@pytest.mark.parametrize("seed", SEEDS[:8])
def test_instants_with_tempos_of_file_and_written_meter(tmp_path, seed, meter):
    path = midi_files.random_file(tmp_path / "tune.mid", seed)
    lines = f"tempo: [{{from: tune.mid}}, {{meter: {meter}}}, {{at: 3|1, meter: 5/8}}]\n"
    piece = piece_of(tmp_path, lines)
    assert instants(piece) == pytest.approx(midi_files.instants(path), abs=1e-9)


def test_meters_of_file_with_written_tempo(tmp_path):
    """Bars are those of the file; bpm counts the beats of its meters."""
    head = [midi_files.meter(0, 6, 8), midi_files.meter(1440, 2, 2), midi_files.tempo(0, 250_000)]
    midi_files.save(tmp_path / "tune.mid", head, midi_files.note(2400))
    piece = piece_of(tmp_path, "tempo: {bpm: 120}\nmeter: {from: tune.mid}\n")
    bars = [piece.tempo_map.bars.start(bar) for bar in (1, 2, 3, 4)]
    assert bars == [0.0, 6.0, 8.0, 10.0]
    assert instants(piece) == [(6.0 + 1.0) * 0.5]


def test_beats_of_file_tempo_in_each_meter(tmp_path):
    """100 quarters a minute are 200 eighths and 50 halves; a written tempo counts beats again."""
    head = [midi_files.meter(0, 6, 8), midi_files.meter(1440, 2, 2), midi_files.tempo(0, 600_000)]
    midi_files.save(tmp_path / "tune.mid", head, midi_files.note(0))
    piece = piece_of(tmp_path, "tempo: [{from: tune.mid}, {at: 3|1, bpm: 77}]\n" + METERS)
    assert [piece.tempo_map.bpm(beat) for beat in (0.0, 5.9, 6.0, 7.9, 8.0)] == pytest.approx(
        [200.0, 200.0, 50.0, 50.0, 77.0], rel=1e-15
    )


@pytest.mark.parametrize("seed", SEEDS[:10])
def test_written_tempo_ends_those_of_file(tmp_path, seed):
    """Up to the line the instants are the file's; after it the tempo is constant."""
    path = midi_files.random_file(tmp_path / "tune.mid", seed)
    lines = "tempo: [{from: tune.mid}, {at: 3|1, bpm: 90}]\nmeter: {from: tune.mid}\n"
    piece = piece_of(tmp_path, lines)
    tempo = piece.tempo_map
    border = tempo.bars.start(3)
    before = [t for t in instants(piece) if t < tempo.seconds(border) - 1e-9]
    assert before == pytest.approx(midi_files.instants(path)[: len(before)], abs=1e-9)
    for beats in (0.0, 7.0, 50.0):
        passed = tempo.seconds(border + beats) - tempo.seconds(border)
        assert passed == pytest.approx(beats * 60.0 / 90.0, abs=1e-9)


def test_written_meter_ends_those_of_file(tmp_path):
    head = [midi_files.meter(0, 3, 4), midi_files.meter(1440 * 4, 7, 8)]
    midi_files.save(tmp_path / "tune.mid", head, midi_files.note(0))
    lines = "tempo: [{at: 3|1, meter: 5/4}]\nmeter: {from: tune.mid}\n"
    bars = piece_of(tmp_path, lines).tempo_map.bars
    assert [str(meter) for *_, meter in bars.changes()] == ["3/4", "5/4"]
    assert bars.start(6) == 6.0 + 15.0


def test_bar_position_in_later_meter_of_file(tmp_path):
    """Beat 5 of bar 3 exists by the file's second meter, not by its first."""
    head = [midi_files.meter(0, 2, 4), midi_files.meter(1920, 5, 4)]
    midi_files.save(tmp_path / "tune.mid", head, midi_files.note(0))
    tempo = piece_of(tmp_path, "tempo: [{from: tune.mid}, {at: 3|5, bpm: 30}]\n" + METERS)
    assert tempo.tempo_map.bpm(4.0 + 3.9) == 120.0
    assert tempo.tempo_map.bpm(4.0 + 4.0) == 30.0


def test_file_without_tempo_and_meter_has_120_quarters_in_4_4(tmp_path):
    path = midi_files.save(tmp_path / "tune.mid", [], midi_files.note(960))
    piece = piece_of(tmp_path, BOTH)
    assert instants(piece) == midi_files.instants(path) == [1.0]
    assert piece.tempo_map.bar_beat(4.0) == (2, 1.0)


def test_render_with_file_tempos_equals_written_tempos(tmp_path):
    head = [midi_files.tempo(0, 500_000), midi_files.tempo(960, 375_000), midi_files.meter(0, 3, 4)]
    notes = [event for tick in (0, 480, 1200, 1500) for event in midi_files.note(tick)]
    midi_files.save(tmp_path / "tune.mid", head, notes)
    written = "tempo: [{bpm: 120, meter: 3/4}, {at: 1|3, bpm: 160}]\n"
    sounds = []
    for lines in (BOTH, written):
        staged = stage(piece_of(tmp_path, lines))
        out = np.zeros((staged.n_frames, staged.simulation.n_out))
        staged.simulation.process(out)
        sounds.append(out)
    assert np.abs(sounds[0]).max() > 0
    assert sounds[0].tobytes() == sounds[1].tobytes()


def test_content_of_file_counts_for_digest(tmp_path):
    notes = midi_files.note(960)
    digests = []
    for micros in (500_000, 500_001, 500_000):
        midi_files.save(tmp_path / "tune.mid", [midi_files.tempo(0, micros)], notes)
        digests.append(digest_of(piece_of(tmp_path, BOTH)))
    assert digests[0] == digests[2] != digests[1]


def test_files_of_times_are_inputs(tmp_path):
    midi_files.random_file(tmp_path / "tune.mid", 1)
    midi_files.random_file(tmp_path / "clock.mid", 2)
    loaded = load(tmp_path / "s.yaml", text=CELLS + "tempo: {from: clock.mid}\n")
    assert {path.name for path in loaded.inputs} == {"s.yaml", "tune.mid", "clock.mid"}


# --- what is refused ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("lines", "report"),
    [
        (
            "tempo: {from: none.mid}\n",
            ("E107", 7, "from of tempo entry: there is no file none.mid"),
        ),
        ("meter: {from: none.mid}\n", ("E107", 7, "from of meter map: there is no file none.mid")),
        ("meter: {}\n", ("E103", 7, "meter map has no 'from'")),
        ("tempo: {from: ../tune.mid}\n", ("E112", 7, "from of tempo entry: ../tune.mid lies outs")),
        ("tempo: {from: s.yaml}\n", ("E310", 7, "from of tempo entry: s.yaml: it is not a MIDI")),
        (
            "tempo: [{bpm: 60}, {at: 2|1, from: tune.mid}]\n",
            ("E305", 7, "tempo: a file is named in the first line"),
        ),
        (
            "tempo: {from: tune.mid, bpm: 60}\n",
            ("E111", 7, "bpm of tempo entry: a file says the tempos from the beginning on"),
        ),
        (
            "meter: {from: odd.mid}\n",
            ("E310", 7, "from of meter map: odd.mid: its meter 1 quarter"),
        ),
        ("meter: {from: fine.mid}\n", ("E310", 7, "from of meter map: fine.mid: its meter 0 quar")),
        (
            "tempo: {from: fast.mid}\n",
            ("E310", 7, "from of tempo entry: fast.mid: its tempo 1 qua"),
        ),
        (
            "tempo: {bpm: 60 -> 90, over: 8bar}\nmeter: {from: tune.mid}\n",
            ("E305", 7, "tempo: the meter changes during this ramp, whose length is in bars"),
        ),
    ],
)
def test_tempos_of_invalid_files(tmp_path, lines, report):
    inner = tmp_path / "inner"
    inner.mkdir()
    (inner / "s.yaml").write_text(CELLS)
    head = [midi_files.meter(0, 3, 4), midi_files.meter(1440, 6, 8)]
    for folder in (tmp_path, inner):
        midi_files.save(folder / "tune.mid", head, midi_files.note(0))
    midi_files.save(inner / "odd.mid", [midi_files.meter(480, 3, 4)], midi_files.note(0))
    midi_files.save(inner / "fine.mid", [midi_files.meter(0, 3, 128)], midi_files.note(0))
    midi_files.save(inner / "fast.mid", [midi_files.tempo(480, 100)], midi_files.note(0))
    code, line, message = reports(inner, lines)[0]
    assert (code, line) == report[:2]
    assert message.startswith(report[2])


# --- edits --------------------------------------------------------------------------------------


def edited(folder: Path, lines: str, change) -> Texts:
    (folder / "s.yaml").write_text(CELLS + lines)
    texts = Texts.read(folder / "s.yaml")
    return change(texts, texts.load().piece)


def test_tempo_typed_in_piece_with_tempos_of_file(tmp_path):
    head = [midi_files.tempo(0, 400_000), midi_files.tempo(480 * 8, 300_000)]
    midi_files.save(tmp_path / "tune.mid", head, midi_files.note(0))
    texts = edited(
        tmp_path, BOTH, lambda texts, piece: times.change_tempo(texts, piece, 6.0, "120")
    )
    assert "tempo: [{from: tune.mid}, {at: 2|3, bpm: 120}]\n" in texts.text
    tempo = texts.load().piece.tempo_map
    assert [tempo.bpm(beat) for beat in (0.0, 5.9, 6.0, 9.0)] == [150.0, 150.0, 120.0, 120.0]
    texts = times.change_tempo(texts, texts.load().piece, 0.0, "60")
    assert "from: tune.mid" not in texts.text.partition("tempo:")[2].partition("meter:")[0]
    assert [texts.load().piece.tempo_map.bpm(beat) for beat in (0.0, 9.0)] == [60.0, 60.0]


def test_meter_typed_in_piece_with_meters_of_file(tmp_path):
    head = [midi_files.meter(0, 3, 4), midi_files.meter(1440 * 4, 7, 8)]
    midi_files.save(tmp_path / "tune.mid", head, midi_files.note(0))
    texts = edited(
        tmp_path, BOTH, lambda texts, piece: times.change_meter(texts, piece, 6.0, "5/4")
    )
    changes = texts.load().piece.tempo_map.bars.changes()
    assert [(beat, str(meter)) for beat, _, meter in changes] == [(0.0, "3/4"), (6.0, "5/4")]
    texts = times.change_meter(texts, texts.load().piece, 0.0, "2/2")
    assert "meter: {from" not in texts.text
    changes = texts.load().piece.tempo_map.bars.changes()
    assert [(beat, str(meter)) for beat, _, meter in changes] == [(0.0, "2/2")]


@pytest.mark.parametrize("seed", SEEDS[:10])
def test_keep_of_bars_writes_out_file_tempos(tmp_path, seed):
    """What is cut out needs no file for its tempos and meters, and has every beat where it was."""
    midi_files.random_file(tmp_path / "tune.mid", seed)
    regular = "{to: cell.C3, at: 0, every: 1/2, until: 9|1, impulse: 1mNs}"
    text = CELLS.replace("{play: tune, to: cell, at: 1|1}", regular)
    (tmp_path / "s.yaml").write_text(text + BOTH)
    texts = Texts.read(tmp_path / "s.yaml")
    before = texts.load().piece
    start, stop = (before.tempo_map.bars.start(bar) for bar in (2, 5))
    cut = excerpt_between(texts, before, "cut", start, stop)
    assert "from: tune.mid" not in cut.text
    after = cut.load().piece
    for beats in np.linspace(0.0, stop - start, 25):
        old = before.tempo_map.seconds(start + beats) - before.tempo_map.seconds(start)
        assert after.tempo_map.seconds(beats) == pytest.approx(old, abs=1e-9)
        old_bar, old_beat = before.tempo_map.bar_beat(start + beats)
        assert after.tempo_map.bar_beat(beats) == pytest.approx((old_bar - 1, old_beat), abs=1e-6)
