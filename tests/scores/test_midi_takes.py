"""MIDI files as takes: their notes are strikes, or press a key; damaged files are refused."""

import contextlib
import random
from pathlib import Path

import mido
import numpy as np
import pytest

from ergon.notation.clock.meter import Bars, Meter
from ergon.scores.gesture import midi_file, midi_survey
from ergon.scores.gesture.midi_file import MidiNote, read_notes
from ergon.scores.gesture.take_file import TakeError
from ergon.scores.reading.load import Loaded, load
from ergon.scores.staging.stage import stage

CELLS = """\
ergon: 1
tempo: {at: 1|1, bpm: 240}
instruments:
  cell: {CEL: {M: 1g, f: A4, t60: 2s}, notes: C3..C5, out: {SOX: cell}}
render: {tail: 0.1s}
"""
TUNE = ((0, 48, 1, 0), (240, 52, 127, 0), (240, 55, 64, 0), (720, 49, 64, 2), (960, 50, 100, 0))


def tune(path: Path, notes=TUNE, kind: int = 1, end: int = 1920) -> Path:
    """Write notes (tick, number, velocity, channel from 0) of 480 ticks a beat."""
    file = mido.MidiFile(type=kind, ticks_per_beat=480)
    head = mido.MidiTrack([mido.MetaMessage("set_tempo", tempo=700_000)])
    track = head if kind == 0 else mido.MidiTrack()
    events = [
        *(
            (position, "note_on", number, hard, channel)
            for position, number, hard, channel in notes
        ),
        *(
            (position + 200, "note_off", number, 64, channel)
            for position, number, hard, channel in notes
        ),
    ]
    now = 0
    track.append(mido.Message("sysex", data=(1, 2, 3)))
    for position, word, number, hard, channel in sorted(events):
        track.append(
            mido.Message(word, note=number, velocity=hard, channel=channel, time=position - now)
        )
        now = position
    track.append(mido.MetaMessage("end_of_track", time=end - now))
    file.tracks += [head] if kind == 0 else [head, track]
    file.save(path)
    return path


def checked(folder: Path, text: str) -> Loaded:
    return load(folder / "s.yaml", text=CELLS + text)


def reports(folder: Path, text: str) -> list[tuple[str, int, str]]:
    return [(d.code, d.place.line, d.message) for d in checked(folder, text).diagnostics]


def sound(folder: Path, text: str) -> np.ndarray:
    loaded = checked(folder, text)
    assert loaded.piece is not None, loaded.diagnostics
    staged = stage(loaded.piece)
    out = np.zeros((staged.n_frames, staged.simulation.n_out))
    staged.simulation.process(out)
    assert np.abs(out).max() > 0
    return out


# --- what a file says ---------------------------------------------------------------------------


@pytest.mark.parametrize("kind", [0, 1])
def test_notes_of_all_channels_or_of_one(tmp_path, kind):
    path = tune(tmp_path / "tune.mid", kind=kind)
    assert read_notes(path).length == 4.0
    assert read_notes(path).notes == (
        MidiNote(0.0, 48, 1, 200 / 480),
        MidiNote(0.5, 52, 127, 200 / 480),
        MidiNote(0.5, 55, 64, 200 / 480),
        MidiNote(1.5, 49, 64, 200 / 480),
        MidiNote(2.0, 50, 100, 200 / 480),
    )
    assert [note.number for note in read_notes(path, "3").notes] == [49]
    with pytest.raises(TakeError, match=r"channel 2 has no notes; those with notes are 1, 3"):
        read_notes(path, "2")


@pytest.mark.parametrize("seed", range(30))
def test_read_notes_equals_mido_on_random_files(tmp_path, seed):
    draw = random.Random(seed)
    notes = sorted(
        (draw.randrange(0, 5000), draw.randrange(128), draw.randrange(1, 128), draw.randrange(16))
        for _ in range(draw.randrange(1, 60))
    )
    path = tune(tmp_path / "some.mid", notes, draw.randrange(2), end=9000)
    now, theirs = 0.0, []
    is_open: dict[tuple[int, int], int] = {}  # by channel and number: which of `theirs`
    for message in mido.merge_tracks(mido.MidiFile(path).tracks):
        now += message.time
        if not message.type.startswith("note"):
            continue
        before = is_open.pop((message.channel, message.note), None)
        if before is not None:
            theirs[before][3] = (now - theirs[before][3]) / 480
        if message.type == "note_on":
            is_open[message.channel, message.note] = len(theirs)
            theirs.append([now / 480, message.note, message.velocity, now])
    assert not is_open
    assert sorted(read_notes(path).notes) == sorted(MidiNote(*note) for note in theirs)


@pytest.mark.parametrize("meter", ["4/4", "3/4", "6/8", "5/8", "2/2", "3/2"])
def test_midi_take_instants_equal_mido_in_every_meter(tmp_path, meter):
    """A quarter note of the file is one of the score, whatever note its beats are."""
    path = tune(tmp_path / "tune.mid")
    file = mido.MidiFile(path)
    now, theirs = 0.0, []
    for message in file:  # mido gives seconds, by the tempo of the file
        now += message.time
        if message.type == "note_on" and message.velocity:
            theirs.append(now)
    unit = int(meter.partition("/")[2])
    bpm = 60e6 / 700_000 * unit / 4  # the file has 0.7 s a quarter
    head = CELLS.replace("{at: 1|1, bpm: 240}", f"{{at: 1|1, bpm: {bpm!r}, meter: {meter}}}")
    text = "takes: {t: {file: tune.mid, velocity: 1mNs}}\n"
    text += "strikes: {s: {play: t, to: cell, at: 0, times: 2}}\n"
    piece = load(tmp_path / "s.yaml", text=head + text).piece
    assert piece is not None
    seconds = [piece.tempo_map.seconds(beat) for beat, *_ in piece.strikes[0].played_hits(piece)]
    length = 0.7 * 4
    expected = sorted([*theirs, *(instant + length for instant in theirs)])
    assert sorted(seconds) == pytest.approx(expected, abs=1e-9)


def test_quarters_across_a_change_of_meter():
    bars = Bars()
    bars.change(0.0, Meter(3, 4, (3,)))
    bars.change(3.0, Meter(6, 8, (6,)))
    bars.change(9.0, Meter(2, 2, (2,)))
    assert [bars.after_quarters(0.0, q) for q in (1.0, 3.0, 3.5, 6.0, 8.0)] == [1, 3, 4, 9, 10]
    assert bars.after_quarters(4.0, 2.5) == 9.0


def test_pedal_holds_notes_until_it_comes_up(tmp_path):
    track = mido.MidiTrack()
    events = [
        ("note_on", {"note": 60, "velocity": 90}, 0),
        ("control_change", {"control": 64, "value": 127}, 100),
        ("note_off", {"note": 60}, 240),
        ("note_on", {"note": 62, "velocity": 90}, 480),
        ("note_off", {"note": 62}, 500),
        ("note_on", {"note": 62, "velocity": 80}, 720),  # ends the note before
        ("control_change", {"control": 64, "value": 0}, 960),
        ("control_change", {"control": 1, "value": 127}, 970),
        ("note_off", {"note": 62}, 1200),
        ("note_on", {"note": 64, "velocity": 80}, 1210),  # nothing ends it
    ]
    now = 0
    for word, fields, position in events:
        track.append(mido.Message(word, time=position - now, **fields))
        now = position
    file = mido.MidiFile(ticks_per_beat=480)
    file.tracks.append(track)
    file.save(tmp_path / "pedal.mid")
    notes = [(n.at * 480, n.number, n.length) for n in read_notes(tmp_path / "pedal.mid").notes]
    expected = [(0, 60, 960), (480, 62, 240), (720, 62, 480), (1210, 64, None)]
    assert notes == [
        (position, n, None if held is None else held / 480) for position, n, held in expected
    ]


# --- strikes ------------------------------------------------------------------------------------

BY_HAND = """\
strikes:
  a: {to: cell.C3, at: 1|1, impulse: 1mNs}
  b: {to: cell.E3, at: 1|1.5, impulse: 9mNs}
  c: {to: cell.G3, at: 1|1.5, impulse: 5mNs}
  d: {to: cell.D3, at: 1|3, impulse: 2.5mNs}
"""


def test_midi_take_equals_strikes_by_hand(tmp_path):
    notes = ((0, 48, 1, 0), (240, 52, 127, 0), (240, 55, 64, 0), (960, 50, 64, 1))
    tune(tmp_path / "tune.mid", notes)
    text = "takes: {t: {file: tune.mid, channel: 1, velocity: 1mNs..9mNs}}\n"
    text += "strikes: {s: {play: t, to: cell, at: 1|1},"
    text += " u: {to: cell.D3, at: 1|3, impulse: 2.5mNs}}\n"
    assert sound(tmp_path, text).tobytes() == sound(tmp_path, BY_HAND).tobytes()


def test_midi_take_transposed_stretched_and_repeated(tmp_path):
    tune(tmp_path / "tune.mid")
    text = "takes: {t: {file: tune.mid, velocity: 1mNs}}\n"
    text += "strikes: {s: {play: t, to: cell, at: 2|1, times: 2, transpose: 2st, do: stretch 2}}\n"
    piece = checked(tmp_path, text).piece
    assert piece is not None
    result = [(beat, hit.struck_text) for beat, _, hit in piece.strikes[0].played_hits(piece)]
    first = [(4.0, "D3"), (5.0, "F#3"), (5.0, "A3"), (7.0, "D#3"), (8.0, "E3")]
    assert result == [*first, *((beat + 8.0, what) for beat, what in first)]


def test_midi_take_with_impulse_of_strikes(tmp_path):
    tune(tmp_path / "tune.mid")
    text = "takes: {t: {file: tune.mid}}\n"
    text += "strikes: {s: {play: t, to: cell, at: 0, impulse: 3mNs}}\n"
    piece = checked(tmp_path, text).piece
    assert piece is not None
    assert {(hit.level.low, hit.level.high) for hit in piece.strikes[0].hits} == {(0.003, 0.003)}


# --- gestures -----------------------------------------------------------------------------------


def test_midi_take_as_gesture_on_key(tmp_path):
    tune(tmp_path / "tune.mid")
    text = (
        "takes: {t: {file: tune.mid, depth: 1mm..8mm}}\n"
        "keys: {k: {M: 400g, K: 60N/m, Z: 1.2Ns/m, travel: -9mm..9mm}}\nplayers: {p: {key: k}}\n"
        "parts: {p: [{at: 2|1, play: t, times: 2, do: [scale 0.5]}]}\n"
    )
    piece = checked(tmp_path, text).piece
    assert piece is not None
    gesture = piece.gestures["t"]
    pressed = [(p.at.beats, round(p.x, 9)) for p in gesture.points if p.x > 0]
    assert pressed == [(0.0, 0.001), (0.5, 0.008), (1.5, 0.0045), (2.0, 0.0065)]
    assert gesture.points[-1].at.beats == 4.0
    assert [*piece.starts[0]] == [4.0, 8.0]
    assert stage(piece).diagnostics == []


# --- what is refused ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "report"),
    [
        (
            "takes: {t: {file: tune.mid}}\nstrikes: {s: {play: t, to: cell, at: 0}}\n",
            (
                "E103",
                6,
                "strikes 's': how strongly? 'cell.C3' has no `play` that says what soft and "
                "hard are; write an impulse with its unit, such as impulse: 2mNs",
            ),
        ),
        (
            "takes: {t: {file: tune.mid, channel: 9, velocity: 1mNs}}\n"
            "strikes: {s: {play: t, to: cell, at: 0}}\n",
            ("E310", 6, "take 't': tune.mid: channel 9 has no notes; those with notes are 1, 3"),
        ),
        (
            "takes: {t: {file: tune.mid, channel: left, velocity: 1mNs}}\n"
            "strikes: {s: {play: t, to: cell, at: 0}}\n",
            ("E310", 6, "take 't': tune.mid: a channel of a MIDI file is a number from 1 to 16"),
        ),
        (
            "takes: {t: {file: tune.mid, rate: 3kHz, velocity: 1mNs}}\n",
            ("E111", 6, "rate of take 't': a file of notes has no rate; remove it"),
        ),
        (
            "takes: {t: {file: tune.csv, velocity: 1mNs}}\n",
            (
                "E111",
                6,
                "velocity of take 't': a take that is not a MIDI or MusicXML file has no velocity",
            ),
        ),
        (
            "takes: {t: {file: tune.mid, velocity: 1mNs}}\nkeys: {k: {M: 400g, K: 60N/m}}\n"
            "players: {p: {key: k}}\nparts: {p: [{at: 0, play: t}]}\n",
            ("E103", 6, "take 't' has no 'depth': how far notes press a key, such as 2mm..8mm"),
        ),
        (
            "takes: {t: {file: tune.mid, velocity: 1mNs}}\n"
            "strikes: {s: {play: t, to: cell, at: 0, transpose: 24st}}\n",
            ("E301", 6, "strikes 's': 'cell' has no note 'E5', to which 'E3' is moved"),
        ),
        (
            "takes: {t: {file: tone.mid, velocity: 1mNs}}\n"
            "strikes: {s: {play: t, to: cell, at: 0}}\n",
            ("E107", 6, "file of take 't': "),
        ),
    ],
)
def test_midi_take_mistakes_are_refused(tmp_path, text, report):
    tune(tmp_path / "tune.mid")
    (tmp_path / "tune.csv").write_text("t [s],x [mm]\n0,0\n1,1\n")
    code, line, message = reports(tmp_path, text)[0]
    assert (code, line) == report[:2]
    assert message.startswith(report[2])


HEAD = b"MThd\0\0\0\6\0\1\0\1\1\xe0"


def track(content: bytes) -> bytes:
    return HEAD + b"MTrk" + len(content).to_bytes(4, "big") + content


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "it is not a MIDI file: it does not begin with MThd"),
        (b"RIFF....", "it is not a MIDI file"),
        (b"MThd\0\0\0\6\0", "damaged at byte 4: the header has fewer than 6 bytes"),
        (b"MThd\0\0\0\1\0\1\0\1\1\xe0", "damaged at byte 4"),
        (b"MThd\0\0\0\6\0\2\0\1\1\xe0", "type 2 holds several pieces; save it as type 1"),
        (b"MThd\0\0\0\6\0\1\0\1\xe7\x28", "frames of film"),
        (b"MThd\0\0\0\6\0\1\0\1\0\0", "damaged at byte 12: a beat has no ticks"),
        (HEAD, "it has no notes"),
        (HEAD + b"MTr", "damaged at byte 14: a chunk ends in its name or length"),
        (HEAD + b"MTrk\xff\xff\xff\xff", "a chunk of 4,294,967,295 bytes goes beyond the end"),
        (track(b"\x00"), "damaged at byte 23: a track ends where an event is expected"),
        (track(b"\x00\x40\x40"), "damaged at byte 23: data without a status before it"),
        (track(b"\x00\x90\x40"), "damaged at byte 24: an event lacks its data"),
        (track(b"\x00\x90\x40\x90"), "an event lacks its data"),
        (track(b"\xff\xff\xff\xff\x00\x90"), "damaged at byte 22: a number has no end"),
        (track(b"\x00\xf1\x00"), "a message 0xF1, which no file has"),
        (track(b"\x00\xff\x01\x7fab"), "an event of 127 bytes goes beyond its track"),
        (track(b"\x00\xff"), "a track ends where an event is expected"),
        (track(b"\x00\x90\x40\x00"), "it has no notes"),
    ],
)
def test_damaged_midi_file_message_names_byte(tmp_path, data, message):
    path = tmp_path / "bad.mid"
    path.write_bytes(data)
    with pytest.raises(TakeError) as refused:
        read_notes(path)
    assert message in refused.value.message
    text = "takes: {t: {file: bad.mid, velocity: 1mNs}}\n"
    text += "strikes: {s: {play: t, to: cell, at: 0}}\n"
    assert [(code, line) for code, line, _ in reports(tmp_path, text)] == [("E310", 6)]


def test_running_status_over_meta_events(tmp_path):
    path = tmp_path / "run.mid"
    path.write_bytes(track(b"\x00\x90\x40\x40\x60\x41\x41\x60\x40\x00\x00\xff\x2f\x00"))
    assert [(n.number, n.velocity) for n in read_notes(path).notes] == [(64, 64), (65, 65)]
    text = b"\x00\xff\x01\x02AB"
    path.write_bytes(track(b"\x00\x90\x40\x40" + text + b"\x60\x40\x00\x00\x41\x41"))
    notes = [(n.number, n.velocity, n.length) for n in read_notes(path).notes]
    assert notes == [(64, 64, 0.2), (65, 65, None)]
    path.write_bytes(track(b"\x00\x90\x40\x40\x00\xf0\x01\xf7\x60\x41\x41"))
    assert [n.number for n in read_notes(path).notes] == [64, 65]
    path = tmp_path / "begins.mid"
    path.write_bytes(track(b"\x00\x41\x41"))
    with pytest.raises(TakeError, match="data without a status"):
        read_notes(path)


@pytest.mark.parametrize("seed", range(4))
def test_hostile_midi_bytes_are_read_or_refused(tmp_path, seed):
    """Cuts, changed bytes and noise behind a good head; 500 files of each."""
    draw = random.Random(seed)
    good = tune(tmp_path / "tune.mid").read_bytes()
    path = tmp_path / "hostile.mid"
    for number in range(500):
        data = bytearray(good)
        if number % 3 == 0:
            data = data[: draw.randrange(len(data))]
        elif number % 3 == 1:
            for _ in range(draw.randrange(1, 9)):
                data[draw.randrange(len(data))] = draw.randrange(256)
        else:
            data = bytearray(track(draw.randbytes(draw.randrange(200))))
        path.write_bytes(data)
        with contextlib.suppress(TakeError):
            held = midi_survey._survey.__wrapped__(path, ())
            assert held.length >= 0.0
            assert 0.0 <= held.seconds(held.length) < 1e12
            counts = [count for each in held.tracks for count in each.counts_by_channel.values()]
            assert all(0 <= count.low <= count.high < 128 for count in counts)
        try:
            result = midi_file._read_notes.__wrapped__(path, None, ())
        except TakeError:
            continue
        assert all(note.at >= 0.0 and 0 <= note.number < 128 for note in result.notes)
        assert all(1 <= note.velocity < 128 for note in result.notes)


def test_midi_file_size_and_note_limits(tmp_path, monkeypatch):
    path = tmp_path / "large.mid"
    path.write_bytes(track(b"\x00\x90\x40\x40" * (midi_file.MAX_BYTES // 4)))
    with pytest.raises(TakeError, match="more than 4 MB"):
        read_notes(path)
    path.write_bytes(track(b"\x00\x90\x40\x40" * (midi_file.MAX_NOTES + 1)))
    with pytest.raises(TakeError, match="more than 100,000 notes"):
        read_notes(path)


def test_midi_file_outside_folder_is_refused(tmp_path):
    tune(tmp_path / "tune.mid")
    inner = tmp_path / "inner"
    inner.mkdir()
    text = "takes: {t: {file: ../tune.mid, velocity: 1mNs}}\n"
    text += "strikes: {s: {play: t, to: cell, at: 0}}\n"
    assert reports(inner, text)[0][0] == "E112"
