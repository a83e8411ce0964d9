"""`ergon info` of a MIDI file, and what `check`, `plan` and `render` say of one."""

import json

import midi_files
import mido
import pytest
from commands import forked

from ergon.cli.app import run

SCORE = """\
ergon: 1
tempo: {from: tune.mid}
instruments:
  cell: {CEL: {M: 1g, f: A4, t60: 50ms}, notes: C3..C5, out: {SOX: cell}}
takes: {t: {file: tune.mid, velocity: 1mNs}}
strikes: {s: {play: t, to: cell, at: 0}, u: {play: t, to: cell, at: 9|1}}
render: {tail: 0.1s}
"""
EXTRA = bytes(3)


@pytest.fixture
def folder(tmp_path):
    head = [(0, mido.MetaMessage("track_name", name="Conductor")), midi_files.meter(0, 6, 8)]
    head += [midi_files.tempo(0, 500_000), midi_files.tempo(960, 1_000_000)]
    notes = [(0, mido.MetaMessage("track_name", name="Bells\x1b[31m"))]
    notes += [
        *midi_files.note(0, 60),
        *midi_files.note(960, 67),
        *midi_files.note(0, 50, channel=9),
    ]
    notes += [(0, mido.Message("program_change", program=7))]
    notes += [(tick, mido.Message("pitchwheel", pitch=tick)) for tick in range(12)]
    path = midi_files.save(tmp_path / "tune.mid", head, notes)
    path.write_bytes(path.read_bytes() + EXTRA)
    (tmp_path / "s.yaml").write_text(SCORE)
    return tmp_path


def test_info_of_midi_tracks_times_and_skipped_events(folder):
    done = forked(["info", "tune.mid"], folder)
    assert done.returncode == 0
    assert "\x1b" not in done.stdout
    assert done.stdout.splitlines() == [
        "tune.mid: MIDI file of format 1, 1.12 s (2.125 quarters of 480 ticks), 2 tracks",
        "  track 1 Conductor: no notes",
        "  track 2 Bells?[31m: channel 1: 2 notes, C4 to G4; channel 10: 1 note, D3",
        "  tempo: 120 bpm at 0, 60 bpm at 2 (in quarter notes)",
        "  meter: 6/8",
        "  understood: 3 notes, 12 pitch bends, 2 tempos, 1 meter",
        "  passed over: 1 program change, 3 bytes after the end of tracks",
    ]


def test_info_of_midi_as_json(folder):
    record = json.loads(forked(["info", "--json", "tune.mid"], folder).stdout)
    assert record["duration_s"] == mido.MidiFile(folder / "tune.mid").length
    assert record["tempos"] == [{"quarter": 0.0, "bpm": 120.0}, {"quarter": 2.0, "bpm": 60.0}]
    assert record["meters"] == [{"quarter": 0.0, "meter": "6/8"}]
    assert [len(track["channels"]) for track in record["tracks"]] == [0, 2]


def test_info_of_damaged_midi_file(tmp_path):
    (tmp_path / "bad.mid").write_bytes(b"MThd")
    done = forked(["info", "bad.mid"], tmp_path)
    assert done.returncode == 2
    assert "bad.mid: the file is damaged at byte 4" in done.stderr


@pytest.mark.parametrize("command", [("check",), ("plan",), ("render", "-o", "sound.wav")])
def test_commands_note_skipped_midi_events_once(folder, command):
    verb, *options = command
    done = forked([verb, "s.yaml", *options], folder)
    assert done.returncode == 0
    message = (
        "tune.mid: the score does not use 1 meter, 12 pitch bends and 1 program change of this file"
    )
    assert done.stderr.count(message) == 1
    assert done.stderr.count("[N404]") == 1
    assert done.stderr.count("tune.mid: 3 bytes after its last track are not read") == 1


def test_export_refuses_to_overwrite_tempo_file_input(folder):
    (folder / "tune.mid").rename(folder / "tempo.mid")
    (folder / "s.yaml").write_text(SCORE.replace("tune.mid", "tempo.mid"))
    before = (folder / "tempo.mid").read_bytes()
    done = forked(["export", "s.yaml", "-o", ".", "--force"], folder)
    assert done.returncode != 0
    assert (folder / "tempo.mid").read_bytes() == before


@pytest.mark.parametrize(
    ("events", "message"),
    [
        (b"\x00\xff\x51\x03\0\0\0", "passed over: tempo of 0 microseconds a quarter note"),
        (b"\x00\xff\x51\x02\x07\xa1", "passed over: tempo without its three bytes"),
        (b"\x00\xff\x58\x04\0\x02\x18\x08", "passed over: meter of 0/2^2, which no score has"),
        (b"\x00\x90\x3c\x40" * 2, "passed over: 2 × note that nothing ends"),
        (b"\x00\x90\x3c\x40\x60\x90\x3c\x00", "passed over: nothing"),
    ],
)
def test_info_of_midi_events_no_score_takes(events, message, tmp_path, capsys):
    track = events + b"\x00\xff\x2f\x00"
    head = b"MThd\0\0\0\6\0\0\0\1\0\x60"
    (tmp_path / "a.mid").write_bytes(head + b"MTrk" + len(track).to_bytes(4, "big") + track)
    assert run(["info", str(tmp_path / "a.mid")]) == 0
    assert message in capsys.readouterr().out
