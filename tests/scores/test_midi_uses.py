"""What of a MIDI file is played, how long, and what is passed over and reported."""

from pathlib import Path

import midi_files
import mido
import pytest

from ergon.scores.gesture.midi_file import read_notes
from ergon.scores.reading.load import load
from ergon.scores.staging.stage import stage

CELLS = """\
ergon: 1
instruments:
  cell: {CEL: {M: 1g, f: A4, t60: 50ms}, notes: C3..C5, out: {SOX: cell}}
render: {tail: 0.1s}
"""
TAKE = "takes: {t: {file: tune.mid, velocity: 1mNs}}\n"
STRIKES = "strikes: {s: {play: t, to: cell, at: 0}}\n"
KEY = """\
keys: {k: {M: 400g, K: 60N/m, Z: 1.2Ns/m, travel: -90mm..90mm}}
players: {p: {key: k}}
"""


def reports(folder: Path, text: str, code: str) -> list[tuple[int, str]]:
    loaded = load(folder / "s.yaml", text=CELLS + text)
    assert loaded.piece is not None, loaded.diagnostics
    return [(d.place.line, d.message) for d in loaded.diagnostics if d.code == code]


def control(tick: int, number: int, value: int = 64):
    return tick, mido.Message("control_change", control=number, value=value)


def wheel(tick: int, channel: int = 0):
    return tick, mido.Message("pitchwheel", pitch=100, channel=channel)


def rich(path: Path) -> Path:
    """A file with every kind of event, notes on two channels and two tracks."""
    head = [midi_files.tempo(0, 400_000), midi_files.tempo(960, 600_000), midi_files.meter(0, 3, 4)]
    first = [*midi_files.note(0), *midi_files.note(480), *(wheel(tick) for tick in range(312))]
    first += [control(0, 64, 127), control(480, 64, 0), control(3, 1), control(4, 7), control(5, 1)]
    first += [(number, mido.Message("program_change", program=number)) for number in range(14)]
    second = [*midi_files.note(960, channel=4), (2, mido.Message("aftertouch", value=9))]
    second += [(2, mido.Message("polytouch", note=60, value=9)) for _ in range(2)]
    second += [(0, mido.Message("sysex", data=(1, 2, 3)))]
    return midi_files.save(path, head, first, second)


REST = (
    "312 pitch bends, 1 channel pressure, 2 key pressures, 14 program changes, "
    "1 system exclusive message"
)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (TAKE + STRIKES, f"2 tempos, 1 meter, {REST} and 3 controller values (1, 7)"),
        (
            TAKE.replace("velocity", "channel: 5, velocity") + STRIKES,
            f"2 notes of channel 1, 2 tempos, 1 meter, {REST} and 3 controller values (1, 7)",
        ),
        (
            TAKE + STRIKES + "tempo: {from: tune.mid}\nmeter: {from: tune.mid}\n",
            f"{REST} and 3 controller values (1, 7)",
        ),
        (
            KEY
            + TAKE.replace("velocity: 1mNs", "depth: 1mm..5mm")
            + "parts: {p: [{at: 0, play: t}]}\n",
            f"2 tempos, 1 meter, {REST} and 5 controller values (1, 7, 64)",
        ),
    ],
)
def test_passed_over_events_in_one_note(tmp_path, text, message):
    rich(tmp_path / "tune.mid")
    ((_, reported),) = reports(tmp_path, text, "N404")
    assert reported == f"tune.mid: the score does not use {message} of this file"


def test_note_on_unused_events_shared_by_takes(tmp_path):
    rich(tmp_path / "tune.mid")
    takes = "takes:\n  a: {file: tune.mid, channel: 1, velocity: 1mNs}\n"
    takes += "  b: {file: tune.mid, channel: 5, velocity: 1mNs}\n"
    strikes = "strikes: {s: {play: a, to: cell, at: 0}, u: {play: b, to: cell, at: 0}}\n"
    ((line, message),) = reports(tmp_path, takes + strikes, "N404")
    assert line == 6
    assert "notes" not in message


def test_file_of_tempos_alone_names_its_notes(tmp_path):
    midi_files.save(tmp_path / "clock.mid", [midi_files.tempo(0, 400_000)], midi_files.note(0))
    text = "tempo: {from: clock.mid}\nstrikes: {s: {to: cell.C3, at: 0, impulse: 1mNs}}\n"
    reported = reports(tmp_path, text, "N404")
    assert reported == [(5, "clock.mid: the score does not use 1 note of channel 1 of this file")]


def test_complete_use_of_file_gives_no_note(tmp_path):
    midi_files.save(tmp_path / "tune.mid", midi_files.note(0))
    assert reports(tmp_path, TAKE + STRIKES, "N404") == []


@pytest.mark.parametrize(
    ("extra", "message"),
    [
        (b"\0", "1 byte after its last track is not read"),
        (bytes(130), "130 bytes after its last track are not read"),
        (b"TAIL\0\0\0\x09abc", "11 bytes after its last track are not read"),
        (b"XFIH\0\0\0\x02ab", None),  # a whole chunk, as RP-001 allows
    ],
)
def test_bytes_after_last_track(tmp_path, extra, message):
    path = midi_files.save(tmp_path / "tune.mid", midi_files.note(0))
    notes = read_notes(path)
    path.write_bytes(path.read_bytes() + extra)
    assert read_notes(path) == notes
    expected = [] if message is None else [(5, f"tune.mid: {message}")]
    assert reports(tmp_path, TAKE + STRIKES, "W335") == expected


def test_bytes_after_end_of_track(tmp_path):
    path = midi_files.save(tmp_path / "tune.mid", midi_files.note(0))
    data = path.read_bytes()
    size = len(data) - 22
    path.write_bytes(data[:18] + (size + 3).to_bytes(4, "big") + data[22:] + b"abc")
    reported = reports(tmp_path, TAKE + STRIKES, "W335")
    assert reported == [(5, "tune.mid: 3 bytes after the end of a track are not read")]


# --- a hand -------------------------------------------------------------------------------------


def pressed(folder: Path, lines: str, play: str) -> list[float]:
    """The instants at which the key is pressed deepest [s]."""
    text = KEY + "takes: {t: {file: tune.mid, depth: 5mm}}\n" + lines + f"parts: {{p: [{play}]}}\n"
    loaded = load(folder / "s.yaml", text=CELLS + text)
    assert loaded.piece is not None, loaded.diagnostics
    staged = stage(loaded.piece)
    points = [
        (t, x)
        for gesture in staged.gestures
        for t, x in zip(gesture.instants, gesture.positions, strict=True)
    ]
    return sorted(t for t, x in points if x > 0.0)


@pytest.mark.parametrize("meter", ["4/4", "3/4", "6/8", "7/16", "3/2"])
def test_hand_plays_quarters_of_file_in_every_meter(tmp_path, meter):
    notes = [event for tick in (0, 480, 720, 1900) for event in midi_files.note(tick)]
    path = midi_files.save(tmp_path / "tune.mid", [midi_files.tempo(0, 700_000)], notes)
    bpm = 60e6 / 700_000 * int(meter.partition("/")[2]) / 4
    lines = f"tempo: {{bpm: {bpm!r}, meter: {meter}}}\n"
    theirs = midi_files.instants(path)
    assert pressed(tmp_path, lines, "{at: 1|1, play: t}") == pytest.approx(theirs, abs=1e-9)
    again = [*theirs, *(t + 1960 / 480 * 0.7 for t in theirs)]
    twice = pressed(tmp_path, lines, "{at: 1|1, play: t, times: 2}")
    assert twice == pytest.approx(again, abs=1e-9)
    slow = pressed(tmp_path, lines, "{at: 1|1, play: t, do: stretch 2}")
    assert slow == pytest.approx([2 * t for t in theirs], abs=1e-9)


@pytest.mark.parametrize("seed", range(12))
def test_hand_plays_with_tempos_and_meters_of_file(tmp_path, seed):
    path = midi_files.random_file(tmp_path / "tune.mid", seed, grid=480)
    lines = "tempo: {from: tune.mid}\nmeter: {from: tune.mid}\n"
    theirs = sorted({round(t, 9) for t in midi_files.instants(path)})
    assert pressed(tmp_path, lines, "{at: 1|1, play: t}") == pytest.approx(theirs, abs=2e-9)


# --- instruments of the library -----------------------------------------------------------------


def ends(path: Path) -> tuple[list[float], list[float]]:
    """The instants [s] at which notes begin and end, as mido plays a file of one channel: a note
    ends with its key, or where the pedal comes up.
    """
    now, is_down, down, up = 0.0, False, [], []
    open_keys, on_pedal = [], []
    for message in mido.MidiFile(path):
        now += message.time
        if message.type == "control_change" and message.control == 64:
            is_down = message.value >= 64
            up += [now] * (0 if is_down else len(on_pedal))
            on_pedal = on_pedal if is_down else []
        elif message.type == "note_on":
            down.append(now)
            open_keys.append(message.note)
        elif message.type == "note_off":
            open_keys.remove(message.note)
            if is_down:
                on_pedal.append(message.note)
            else:
                up.append(now)
    return sorted(down), sorted(up)


@pytest.mark.parametrize(("family", "name"), [("strings", "piano"), ("friction", "viol")])
def test_notes_of_library_begin_and_end_with_those_of_file(tmp_path, family, name):
    head = [midi_files.tempo(0, 400_000), midi_files.tempo(700, 730_001), midi_files.meter(0, 6, 8)]
    tones = ((0, 48, 300), (200, 50, 400), (740, 52, 111), (1111, 48, 500))
    notes = [event for tick, number, long in tones for event in midi_files.note(tick, number, long)]
    notes += [control(150, 64, 127), control(1000, 64, 0), *(wheel(tick) for tick in (5, 6, 7))]
    path = midi_files.save(tmp_path / "tune.mid", head, notes)
    text = f"ergon: 1\ninstruments: {{v: {{from: {family}/{name}, notes: C3..E3}}}}\n"
    text += "takes: {t: {file: tune.mid}}\nstrikes: {s: {play: t, to: v, at: 0}}\n"
    text += "tempo: {from: tune.mid}\nmeter: {from: tune.mid}\nrender: {tail: 0.1s}\n"
    loaded = load(tmp_path / "s.yaml", text=text)
    assert loaded.piece is not None, loaded.diagnostics
    reported = [d.message for d in loaded.diagnostics if d.code == "N404"]
    assert reported == ["tune.mid: the score does not use 3 pitch bends of this file"]
    staged = stage(loaded.piece)
    frames: dict[str, set[int]] = {"struck": set(), "lifted": set(), "let down": set()}
    for mat in range(staged.network.n_mat):
        for strike in staged.timeline.strikes_on(mat):
            is_damper = abs(abs(strike.impulse) - 0.02) < 1e-9
            kind = "struck" if not is_damper else "let down" if strike.impulse > 0.0 else "lifted"
            frames[kind].add(round(strike.at * staged.rate))
    down, up = ({round(instant * staged.rate) for instant in instants} for instants in ends(path))
    assert len(down) == 4
    if name == "piano":
        assert frames == {"struck": down, "lifted": down, "let down": up}
    else:  # the bow is drawn from the beginning of a note to its end
        assert frames == {"struck": down | up, "lifted": set(), "let down": set()}
