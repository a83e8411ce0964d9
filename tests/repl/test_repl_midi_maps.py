"""Maps of MIDI: 14 bits, the wheel, pressure, curves, gestures by notes, learning, the monitor."""

import json
from contextlib import closing

import numpy as np
import pytest
from one_bell import SCORE
from sessions import Stepped

from ergon.live.midi_messages import (
    ControlChange,
    PitchWheel,
    Pressure,
    ProgramChange,
    parse_message,
)
from ergon.live.midi_ports import ProcessPort
from tests.repl.test_repl_midi import PLAYED


@pytest.fixture
def played(tmp_path):
    with closing(Stepped(SCORE, tmp_path)) as session:
        port = ProcessPort(lambda: 0.0)
        port.listen(session.session.midi.receive)
        yield session, port


def _send(session, port, *messages):
    for message in messages:
        port.send(bytes(message))
        session.run(0.1)


def _mass(session):
    part = session.session.schedule.head.piece.instruments["bell"]
    (m,) = [module for module in part.modules if module.name == "m"]
    return m.fields["M"]


def _is_replayed(session):
    session.close()
    return np.array_equal(session.again(), session.sound)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        ([0xE3, 0, 64], PitchWheel(8192)),
        ([0xE0, 127, 127], PitchWheel(16383)),
        ([0xD5, 99], Pressure(99)),
        ([0xA0, 60, 12], Pressure(12, 60)),
        ([0xC1, 7], ProgramChange(7)),
        ([0xBF, 33, 1], ControlChange(33, 1)),
        ([0xD5, 128], None),
        ([0xD5, 1, 1], None),
        ([0xE0, 1], None),
        ([0xF1, 1], None),
        ([], None),
    ],
)
def test_parse_message_of_all_kinds(data, message):
    assert parse_message(bytes(data)) == message


@pytest.mark.parametrize(
    ("source", "messages", "share"),
    [
        ("cc 21", [[0xB0, 21, 127]], 1.0),
        ("cc 1/33", [[0xB0, 1, 64], [0xB0, 33, 1]], (64 * 128 + 1) / 16383),
        ("cc 1/33", [[0xB0, 33, 5], [0xB0, 1, 64]], 64 * 128 / 16383),  # as MIDI 1.0 has it
        ("cc 1/33", [[0xB0, 1, 127], [0xB0, 33, 127]], 1.0),
        ("bend", [[0xE0, 0, 64]], 0.5),
        ("bend", [[0xE0, 0, 0]], 0.0),
        ("bend", [[0xE0, 127, 127]], 1.0),
        ("bend", [[0xE0, 0, 96]], 0.5 + 0.5 * 4096 / 8191),
        ("pressure", [[0xD0, 127]], 1.0),
        ("pressure C4", [[0xA0, 61, 127], [0xA0, 60, 64]], 64 / 127),
    ],
)
def test_map_cc_live_equals_journal(played, source, messages, share):
    session, port = played
    session.ok("map note 60 bell.m 5mNs")
    session.ok(f"map {source} bell.m.M 1g..3g")
    session.run(0.1)
    _send(session, port, [0x90, 60, 64], [0xE0, 1, 64], [0xD0, 1], [0xB0, 1, 3], *messages)
    assert _mass(session) == pytest.approx(1e-3 + 2e-3 * share, rel=1e-5)
    assert np.abs(session.sound).max() > 1e-6
    line = session.ok("maps").lines[1]
    assert line == f"{source.replace('C4', '60')} bell.m.M 0.001kg..0.003kg"
    session.ok(f"unmap {source} now")
    session.run(0.1)
    _send(session, port, messages[-1])
    assert _is_replayed(session)
    with closing(Stepped.resumed(session.journal)) as resumed:
        assert [line for line in resumed.ok("maps").lines if "bell.m.M" in line] == []
        resumed.ok("undo")
        assert f"{line}" in resumed.ok("maps").lines


def test_map_bend_to_tempo_and_pressure_to_gain(played):
    session, port = played
    session.ok("map bend tempo 60..180")
    session.ok("map pressure gain bell -40dB..0dB")
    session.ok("map pressure C4 gain -12dB..0dB")
    session.run(0.1)
    _send(session, port, [0xE0, 0, 64], [0xD0, 0], [0xA0, 60, 127])
    head = session.session.schedule.head
    assert head.piece.tempo_map.bpm(1000.0) == pytest.approx(120.0)
    assert head.faders.gains["bell"] == pytest.approx(0.01)
    assert head.faders.master == pytest.approx(1.0)
    assert _is_replayed(session)


@pytest.mark.parametrize(("curve", "power"), [("square", 2.0), ("root", 0.5), ("even", 1.0)])
def test_map_note_with_curve(tmp_path, curve, power):
    with closing(Stepped(PLAYED, tmp_path)) as session:
        port = ProcessPort(lambda: 0.0)
        port.listen(session.session.midi.receive)
        session.ok(f"map note C4..C5 bar curve {curve}")
        session.ok(f"map note C2 drum.skin 1mNs..16mNs curve {curve}")
        session.run(0.1)
        _send(session, port, [0x90, 60, 32], [0x90, 36, 64])
        rows = [json.loads(line) for line in session.journal.read_text().splitlines()]
        by_strength, by_impulse = [row["impulse"] for row in rows if row["event"] == "strike"]
        assert by_strength == pytest.approx(1e-3 * 4 ** ((32 / 127) ** power))
        assert by_impulse == pytest.approx(1e-3 + 15e-3 * (63 / 126) ** power)
        assert _is_replayed(session)
        with closing(Stepped.resumed(session.journal)) as resumed:
            assert resumed.ok("maps").lines == session.ok("maps").lines


def test_map_note_to_gesture(played):
    session, port = played
    session.ok("map note D2 ada knock")
    session.ok("play")
    session.run(1.1)
    _send(session, port, [0x90, 38, 100])
    session.run(0.5)
    playing = session.session.schedule.running.stage.gestures
    assert [gesture.name for gesture in playing if gesture.start > 1.05][:1] == ["knock"]
    assert "ada plays knock now" in session.ok("history").lines[-1]
    assert np.abs(session.sound[-int(0.5 * session.rate) :]).max() > 1e-9
    session.ok("rename knock tap now")
    session.run(0.3)
    assert session.ok("maps").lines == ("note 38 ada tap",)
    _send(session, port, [0x90, 38, 1])
    assert "ada plays tap now" in session.ok("history").lines[-1]
    assert _is_replayed(session)


def test_learn_of_controller(played):
    session, port = played
    assert "move a controller" in session.ok("map learn bell.m.M 1g..3g").text
    _send(session, port, [0x90, 60, 100], [0xB0, 22, 127], [0xB0, 22, 0], [0xB0, 23, 127])
    assert session.session.messages() == ["cc 22 is learnt: map cc 22 bell.m.M 0.001kg..0.003kg"]
    assert session.ok("maps").lines[0] == "cc 22 bell.m.M 0.001kg..0.003kg"
    assert _mass(session) == pytest.approx(1e-3)
    session.ok("map learn gain bell -20dB..0dB")
    session.ok("map learn tempo 60..180")  # in place of the one before
    _send(session, port, [0xE0, 0, 64], [0xE0, 0, 64])
    assert session.ok("maps").lines[1] == "bend tempo 60.0..180.0"
    assert session.session.schedule.head.piece.tempo_map.bpm(1000.0) == pytest.approx(120.0)
    history = session.ok("history").lines
    assert sum("map cc 22 bell.m.M" in line for line in history) == 1
    assert _is_replayed(session)


def test_learn_of_note_on_and_off(played):
    session, port = played
    session.ok("def fill: rain strikes bell.m every 1/4 times 4 impulse 1mNs")
    session.ok("map learn note fill")
    _send(session, port, [0xB0, 22, 1], [0x90, 41, 100])
    assert session.ok("maps").lines[0] == "note 41 fill"
    session.ok("map learn note fill")
    session.ok("unmap learn")
    _send(session, port, [0x90, 42, 100])
    assert "note 42" in session.ok("maps").lines[-1]
    assert len(session.session.schedule.head.maps) == 1
    assert "nothing is to be learnt" in session.type("unmap learn").text
    assert _is_replayed(session)


def test_maps_counts_messages_without_map(played):
    session, port = played
    session.ok("map cc 21 bell.m.M 1g..3g now")
    session.run(0.1)
    messages = [[0xB0, 22, 1]] * 3 + [[0xB0, 21, 1], [0xB0, 64, 127], [0x90, 35, 1], [0x80, 35, 0]]
    _send(session, port, *messages, [0xE0, 0, 1], [0xC0, 5], [0xF8])
    line = session.ok("maps").lines[-1]
    assert line == "not mapped: cc 22 (3 times), note 35, bend, program 5"


def test_monitor_prints_messages(played):
    session, port = played
    session.ok("map cc 21 bell.m.M 1g..3g now")
    _send(session, port, [0x90, 60, 1])
    assert "start ergon with --midi PORT" in session.ok("monitor on").text
    _send(
        session, port, [0x91, 60, 100], [0x81, 60, 0], [0xB9, 21, 64], [0xE0, 0, 64], [0xA0, 61, 9]
    )
    assert session.session.messages() == [
        "MIDI note 60 (C4), velocity 100, channel 2, not mapped",
        "MIDI note 60 (C4) ends, channel 2",
        "MIDI cc 21 at 64, channel 10",
        "MIDI bend at 8192, channel 1, not mapped",
        "MIDI pressure 61 at 9, channel 1, not mapped",
    ]
    session.ok("monitor off")
    _send(session, port, [0x91, 60, 100])
    assert session.session.messages() == []


def test_monitor_of_flood(played):
    session, port = played
    session.ok("monitor on")
    for _ in range(50):
        for value in range(30):
            port.send(bytes([0xB0, 22, value]))
            port.send(bytes([0x90, 60, 1 + value]))
        session.run(0.02)
    session.run(1.0)
    printed = session.session.messages()
    assert 10 <= len(printed) <= 50  # of 3,000 messages in a second
    rest = [line for line in printed if " more: " in line]
    assert sum(int(line.split()[1].replace(",", "")) for line in rest) == 3000 - len(printed) + len(
        rest
    )
    assert all("cc 22 (" in line and "note 60 (" in line for line in rest)


@pytest.mark.parametrize(
    ("line", "why"),
    [
        ("map cc 1/1 bell.m.M 1g..3g", "'1/1' names one controller twice"),
        ("map cc 1/128 bell.m.M 1g..3g", "'1/128' is not a controller"),
        ("map cc", "is missing"),
        ("map wheel bell.m.M 1g..3g", "'wheel' is not what moves"),
        ("map bend bell.m.Q 1g..3g", "'bell.m.Q' is not a parameter"),
        ("map pressure H4 gain 0dB", "is not a parameter"),
        ("map cc 7 gain -40dB..30dB", "above the highest level, 24dB"),
        ("map note D2 ada nothing", "'nothing' is not a gesture or a take"),
        ("map note D2 bell.m 1mNs curve cube", "'cube' is not a curve"),
        ("unmap bend", "nothing is mapped to bend"),
        ("monitor", "'on' is missing"),
    ],
)
def test_map_of_impossible_target_is_refused(played, line, why):
    session, _ = played
    reply = session.type(line)
    assert not reply.taken
    assert why in reply.text


@pytest.mark.parametrize(
    "row",
    [
        ["control", "cc 1\npy 1", "bell.m.K", None, "N/m", 1.0, 2.0],
        ["control", "learn", "bell.m.K", None, "N/m", 1.0, 2.0],
        ["notes", 1, 2, "bell.m", [1.0], None, "even"],
        ["notes", 1, 2, "bell.m", [1.0, float("inf")], None, "even"],
        ["notes", 1, 2, "ada", None, "knock\npanic", "even"],
        ["notes", 1, 2, "bell.m", None, None, "cube"],
        ["hear", "bell.m", 128],
        ["hear", "bell.m", "H4"],
    ],
)
def test_forged_maps_are_refused(played, row):
    session, _ = played
    session.run(0.1)
    session.close()
    first, *rest = session.journal.read_text().splitlines()
    fields = json.loads(first) | {"maps": [row]}
    session.journal.write_text("\n".join([json.dumps(fields), *rest]) + "\n")
    with pytest.raises(Exception, match="'maps' has the wrong type or value"):
        session.again()


def test_maps_of_earlier_journals_are_read(played):
    session, _ = played
    session.run(0.1)
    session.close()
    first, *rest = session.journal.read_text().splitlines()
    rows = [["cc", 21, "bell.m.K", None, "N/m", 1.0, 2.0], ["note", 60, 62, "bell.m", 1.0, 2.0]]
    fields = json.loads(first) | {"maps": [*rows, ["note", 36, 36, "drum"]]}
    session.journal.write_text("\n".join([json.dumps(fields), *rest]) + "\n")
    with closing(Stepped.resumed(session.journal)) as resumed:
        assert resumed.ok("maps").lines == (
            "cc 21 bell.m.K 1.0N/m..2.0N/m",
            "note 60..62 bell.m 1.0Ns..2.0Ns",
            "note 36 drum",
        )


def test_completion_of_map_sources(played):
    session, _ = played

    def offers(line):
        return {offer.text for offer in session.session.complete(line, len(line))}

    assert {"cc", "bend", "pressure", "learn", "note"} <= offers("map ")
    assert offers("map cc ") == {"21"}
    assert "bell." in offers("map cc 1/33 be")
    assert "bell." in offers("map bend be")
    assert {"square", "root", "even"} <= offers("map note 60 bell.m 1mNs curve ")
    assert "knock" in offers("map note 60 ada ")
