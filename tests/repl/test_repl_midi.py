"""MIDI in a session: controllers and notes through a port inside the process."""

import json
import random
import subprocess
import threading
from contextlib import closing

import damped_bar
import numpy as np
import pytest
import soundfile
from captured import check_heard
from commands import ERGON
from one_bell import SCORE
from patience import until
from sessions import Stepped
from sweep import few

from ergon.live.midi_ports import ProcessPort
from ergon.repl.session.journal import JournalError
from tests.repl.test_repl_live import session_on


@pytest.fixture
def played(tmp_path):
    player_session = Stepped(SCORE, tmp_path)
    port = ProcessPort(lambda: 0.0)
    port.listen(player_session.session.midi.receive)
    yield player_session, port
    player_session.close()


def _events(own, name):
    rows = [json.loads(line) for line in own.journal.read_text().splitlines()]
    return [row for row in rows if row["event"] == name]


def test_mapped_note_strikes_and_renders_to_the_bit(played):
    single, port = played
    single.ok("map note C3..C5 bell.m 1mNs..20mNs")
    single.run(0.5)
    assert not single.sound.any()
    port.send(bytes([0x90, 60, 100]))
    single.run(0.3)
    port.send(bytes([0x91, 48, 1]))
    port.send(bytes([0x91, 72, 127]))
    port.send(bytes([0x91, 73, 127]))  # beyond the range
    port.send(bytes([0x80, 60, 64]))
    single.run(0.3)
    assert np.abs(single.sound).max() > 1e-6
    single.close()
    strikes = _events(single, "strike")
    assert [one["impulse"] for one in strikes] == [
        pytest.approx(1e-3 + 19e-3 * 99 / 126),
        1e-3,
        20e-3,
    ]
    assert np.array_equal(single.again(), single.sound)


PLAYED = """\
ergon: 1
rates: {audio: 8kHz}
instruments:
  bar:
    CEL: {M: 1g, f: A4, t60: 50ms}
    notes: C4..C5
    play: {strike: {impulse: 1mNs..4mNs}}
    out: {SOX: bar}
  drum:
    modules:
      skin: {CEL: {M: 5g, f: 90Hz, t60: 50ms}}
      rim: {CEL: {M: 1g, f: 900Hz, t60: 50ms}}
    play:
      strike: {at: skin, impulse: 1mNs..16mNs}
      click: {at: [rim, skin], impulse: 0.1mNs..1mNs}
    out: {SOX: [skin, rim]}
mix: {channels: 2, route: [{from: bar, to: 1}, {from: drum, to: 2}]}
"""


def test_keyboard_plays_notes_and_acts_by_strengths(tmp_path):
    with closing(Stepped(PLAYED, tmp_path)) as session:
        port = ProcessPort(lambda: 0.0)
        port.listen(session.session.midi.receive)
        session.ok("map note C4..C6 bar")
        session.ok("map note C2 drum")
        session.ok("map note D2 drum.click")
        session.run(0.3)
        for number, velocity in [(60, 127), (64, 1), (84, 64), (36, 127), (38, 127)]:
            port.send(bytes([0x90, number, velocity]))
            session.run(0.1)
        strikes = _events(session, "strike")
        assert [(e["part"], e["module"]) for e in strikes] == [
            ("bar.C4", ""),
            ("bar.E4", ""),
            ("drum", "skin"),
            ("drum", "rim"),
            ("drum", "skin"),
        ]
        expected = [4e-3, 1e-3 * 4 ** (1 / 127), 16e-3, 1e-3, 1e-3]
        assert [e["impulse"] for e in strikes] == pytest.approx(expected)
        assert "note 60..84 bar" in session.ok("maps").lines[0]
        reply = session.type("map note D2 drum.slap")
        assert not reply.taken
        assert "strike, click" in reply.text
        session.close()
        assert np.array_equal(session.again(), session.sound)
        with closing(Stepped.resumed(session.journal)) as resumed:
            assert len(resumed.session.schedule.head.maps) == 3


DAMPED = damped_bar.SCORE + "mix: {route: [{from: bar, to: 1}]}\n"


def test_keyboard_ends_notes_and_pedal_holds_them(tmp_path):
    with closing(Stepped(DAMPED, tmp_path)) as session:
        port = ProcessPort(lambda: 0.0)
        port.listen(session.session.midi.receive)
        session.ok("map note C4..C5 bar now")
        session.run(0.5)
        assert "ready: strike" in session.session.schedule.head.texts.text
        marks = []
        for data in ([0x90, 60, 100], [0x80, 60, 0], [0xB0, 64, 127], [0x90, 64, 100]):
            port.send(bytes(data))
            session.run(0.4)
            marks.append(len(session.sound))
        port.send(bytes([0x90, 64, 0]))  # the key is up, the pedal down
        session.run(0.4)
        marks.append(len(session.sound))
        port.send(bytes([0xB0, 64, 0]))
        session.run(0.4)
        marks.append(len(session.sound))
        tail = int(0.05 * session.rate)
        levels = [np.abs(session.sound[mark - tail : mark, 0]).max() for mark in marks]
        assert levels[1] < 1e-3 * levels[0]
        assert levels[4] > 0.5 * levels[3]
        assert levels[5] < 1e-3 * levels[4]
        session.close()
        assert np.array_equal(session.again(), session.sound)


def test_note_runs_a_block_and_controller_sets_the_tempo(tmp_path):
    with closing(Stepped(PLAYED, tmp_path)) as session:
        port = ProcessPort(lambda: 0.0)
        port.listen(session.session.midi.receive)
        session.ok("def fill: d1 strikes drum every 1/4 times 4")
        session.ok("map note D2 fill")
        session.ok("map cc 1 tempo 60..187")
        session.ok("play")
        session.run(0.6)
        for _ in range(2):
            port.send(bytes([0x90, 38, 100]))
            session.run(0.4)
        versions = session.ok("history").lines
        assert sum("run fill" in line for line in versions) == 2
        assert np.abs(session.sound[:, 1]).max() > 0
        port.send(bytes([0xB0, 1, 63]))
        session.run(0.4)
        tempo = session.session.schedule.head.piece.tempo_map
        assert tempo.bpm(1000.0) == pytest.approx(123)
        session.close()
        assert np.array_equal(session.again(), session.sound)


def test_mapped_controller_moves_parameter_and_level(played):
    single, port = played
    single.ok("map cc 21 bell.m.M 1g..3g")
    single.ok("map cc 7 gain bell -40dB..0dB")
    single.ok("map note 60 bell.m 5mNs")
    single.run(0.1)
    port.send(bytes([0x90, 60, 64]))
    single.run(0.1)
    for value in range(0, 128, 9):
        port.send(bytes([0xB0, 21, value]))
        port.send(bytes([0xB0, 7, 127 - value // 2]))
        single.run(0.02)
    single.run(0.3)
    assert "0.00298425kg" in single.session.schedule.head.texts.text
    assert single.session.schedule.head.faders.gains["bell"] == pytest.approx(
        10 ** ((-40 + 40 * 64 / 127) / 20), rel=1e-5
    )
    lines = single.ok("history").lines
    assert len(lines) == 5  # a movement is one line
    single.ok("undo")
    single.run(0.1)
    assert "0.00298425kg" not in single.session.schedule.head.texts.text
    single.close()
    assert np.array_equal(single.again(), single.sound)


def test_maps_survive_undo_and_resume(played):
    single, port = played
    single.ok("map note 60..62 bell.m 1mNs..20mNs")
    single.ok("map cc 21 bell.m.K 1kN/m..9kN/m")
    assert single.ok("maps").lines == (
        "note 60..62 bell.m 0.001Ns..0.02Ns",
        "cc 21 bell.m.K 1000.0N/m..9000.0N/m",
    )
    single.run(0.1)
    single.ok("unmap note 60..62")
    single.run(0.1)
    port.send(bytes([0x90, 60, 100]))
    single.run(0.1)
    single.ok("undo")
    single.run(0.1)
    port.send(bytes([0x90, 60, 100]))
    single.run(0.2)
    single.close()
    assert len(_events(single, "strike")) == 1
    assert np.array_equal(single.again(), single.sound)
    further = Stepped.resumed(single.journal)
    further.run(0.1)
    further.session.midi.receive(bytes([0x90, 62, 1]), 0.0)
    further.run(0.2)
    further.ok("undo")  # to a version that is in the history of the journal alone
    assert further.ok("maps").lines == ("note 60..62 bell.m 0.001Ns..0.02Ns",)
    further.ok("redo")
    assert len(further.ok("maps").lines) == 2
    further.run(0.2)
    further.close()
    assert len(_events(further, "strike")) == 1
    assert np.array_equal(further.again(), further.sound)


STRING = """\
ergon: 1
keys:
  k1: {M: 400g, K: 60N/m, Z: 1.2Ns/m}
instruments:
  string: {STRING: {masses: 24, f: A2, t60: 1s, M: 4g, ends: fixed}, out: {SOX: string.3}}
  bell: {modules: {m: {CEL: {M: 2g, f: A3, t60: 0.5s}}}, out: {SOX: m}}
"""


def test_map_note_range_to_range_of_members(tmp_path):
    player_session = Stepped(STRING, tmp_path)
    player_session.ok("map note 60..64 string.4..8 1mNs")
    player_session.ok("map note 70 bell 1mNs")
    player_session.run(0.1)
    for note in (60, 63, 70):
        player_session.session.midi.receive(bytes([0x95, note, 80]), 0.0)
        player_session.run(0.05)
    player_session.close()
    struck = [
        (one["part"], one["module"], one["member"]) for one in _events(player_session, "strike")
    ]
    assert struck == [("string", "", 4), ("string", "", 7), ("bell", "m", 0)]
    assert np.array_equal(player_session.again(), player_session.sound)


@pytest.mark.parametrize(
    ("line", "why"),
    [
        ("map cc 128 bell.m.K 1kN/m..2kN/m", "128"),
        ("map cc 21 bell.m.Q 1kN/m..2kN/m", "is not a parameter"),
        ("map cc 21 bell.m.K 1kN/m..2Hz", "Hz"),
        ("map cc 21 bell.m.K 1kN/m..", "two ends"),
        ("map note H3 bell.m 1mNs", "not a note"),
        ("map note C5..C3 bell.m 1mNs", "goes down"),
        ("map note C3 bell.q 1mNs", "nothing is called 'bell.q'"),
        ("map note C3 bell.b 1mNs", "a link"),
        ("map note C3 bell.m 1N", "does not measure impulse"),
        ("map note C3 bell.m 1..2", "'1' is a strength, and here are impulses"),
        ("map note C3 bell.m 3..20", "'3' has no unit: write 3mNs or 3Ns"),
        ("map note C3 bell.m p..f", "'p' is a strength"),
        ("unmap cc 3", "nothing is mapped to cc 3"),
    ],
)
def test_map_of_impossible_target_is_refused(played, line, why):
    single, _ = played
    reply = single.type(line)
    assert not reply.taken
    assert why in reply.text


def test_mapped_value_refused_by_engine(played):
    single, port = played
    single.ok("map cc 1 bell.m.f 1Hz..40000Hz")
    single.run(0.1)
    for value in (126, 127):
        port.send(bytes([0xB0, 1, value]))
        single.run(0.1)
    messages = [one for one in single.session.messages() if one.startswith("cc 1:")]
    assert len(messages) == 1
    assert "bell" in messages[0]
    port.send(bytes([0xB0, 1, 2]))
    single.run(0.1)
    assert "630.906Hz" in single.session.schedule.head.texts.text


def test_mapped_notes_during_panic(played):
    single, port = played
    single.ok("map note 60 bell.m 1mNs")
    single.run(0.1)
    single.session.panic()
    port.send(bytes([0x90, 60, 100]))
    single.run(0.1)
    single.ok("release")
    single.run(0.1)
    port.send(bytes([0x90, 60, 100]))
    single.run(0.1)
    assert len(_events(single, "strike")) == 1


@pytest.mark.parametrize(
    "damage",
    [
        {"part": "nobody"},
        {"member": 5},
        {"member": 1e300},
        {"impulse": float("inf")},
        {"impulse": "loud"},
        {"frame": -1},
    ],
)
def test_forged_strike_in_journal_is_refused(played, damage):
    single, port = played
    single.ok("map note 60 bell.m 1mNs")
    single.run(0.1)
    port.send(bytes([0x90, 60, 100]))
    single.run(0.1)
    single.close()
    rows = [json.loads(line) for line in single.journal.read_text().splitlines()]
    for row in rows:
        if row["event"] == "strike":
            row.update(damage)
    single.journal.write_text("".join(json.dumps(row) + "\n" for row in rows))
    with pytest.raises(JournalError, match=r"session.jsonl, line \d+: "):
        single.again()


@pytest.mark.parametrize(
    "row",
    [
        [],
        ["cc"],
        ["cc", 1, "bell.m.K\npy 1", None, "N/m", 1.0, 2.0],
        ["note", 60, 59, "bell.m", 1.0, 2.0],
        ["note", 1, 2, "bell.m", 1.0, float("nan")],
        7,
    ],
)
def test_forged_maps_are_refused(played, row):
    single, _ = played
    single.run(0.1)
    single.close()
    first, *rest = single.journal.read_text().splitlines()
    fields = json.loads(first) | {"maps": [row]}
    single.journal.write_text("\n".join([json.dumps(fields), *rest]) + "\n")
    with pytest.raises(JournalError, match="'maps' has the wrong type or value"):
        single.again()


def test_live_strikes_render_to_the_bit(tmp_path):
    """Over the real engine: strikes fall between ticks, and controllers move meanwhile."""
    listened = tmp_path / "heard.wav"
    port = ProcessPort()
    with closing(session_on(tmp_path, f"clock:{listened}")) as session:
        port.listen(session.midi.receive)
        for line in (
            "play",
            "map note 48..72 bell.m 0.1mNs..2mNs now",
            "map cc 21 bell.m.K 300N/m..900N/m now",
        ):
            assert session.submit(line).taken
        engine = session.schedule.engine
        frame = session.schedule.running.start_frame + 4410
        for step in range(24):
            until(lambda after=frame: engine.frame > after, "the engine goes on")
            port.send(bytes([0x90, 48 + step, 10 + 4 * step]))
            port.send(bytes([0x90, 72 - step, 100]))
            port.send(bytes([0xB0, 21, 5 * step]))
            frame = engine.frame + 1500
        until(lambda: engine.frame > frame + 22_050, "the last rings")
        troubles = engine.status().troubles
    done = subprocess.run(
        [*ERGON, "render", "session.jsonl", "-o", "again.wav", "--bits", "float"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    rows = [json.loads(line) for line in (tmp_path / "session.jsonl").read_text().splitlines()]
    assert sum(row["event"] == "strike" for row in rows) == 48
    played, _ = soundfile.read(listened, dtype="float32", always_2d=True)
    again, _ = soundfile.read(tmp_path / "again.wav", dtype="float32", always_2d=True)
    assert check_heard(played, again, troubles).equal > 44_100


@pytest.mark.parametrize("seed", few(range(4), 1))
def test_random_sets_with_a_keyboard_render_to_the_bit(tmp_path, seed):
    """Maps, notes, controllers and lines of all kinds, in any order, and a resumed session."""
    chance = random.Random(seed)
    lines = (
        "map note 40..80 bell.m 0.1mNs..5mNs{}",
        "map note 60 bell.m -1mNs{}",
        "map cc 1 bell.m.f 200Hz..300Hz{}",
        "map cc 2 k1.M 300g..500g{}",
        "map cc 3 gain bell -30dB..0dB{}",
        "map cc 1/33 bell.m.f 200Hz..300Hz{}",
        "map bend bell.b.K 700N/m..1kN/m{}",
        "map pressure tempo 90..120{}",
        "map learn gain -12dB..0dB",
        "map note 38 ada knock{}",
        "map note 41..50 bell.m 1mNs..2mNs curve root{}",
        "hear bell.m 1mNs",
        "def fill n=2: rain strikes bell.m every 1/4 times $n impulse 1mNs",
        "fill 4{}",
        "ada plays knock every 2 sync ada",
        "unmap cc 1",
        "unmap note 60",
        "play",
        "play from 3|1",
        "stop",
        "ada plays knock every 1{}",
        "hush{}",
        "damp 1s{}",
        "tempo 90{}",
        "undo",
        "redo",
        "back 2",
        "panic",
        "release",
    )
    player_session = Stepped(SCORE, tmp_path)
    for part in range(2):
        for _ in range(40):
            match chance.randrange(5):
                case 0 | 1:
                    player_session.type(chance.choice(lines).format(chance.choice(("", " now"))))
                case 2:
                    data = chance.choice(([0xB0, chance.choice((1, 2, 3, 33))], [0xE0, 1], [0xD0]))
                    data = [*data, chance.randrange(128)]
                    player_session.session.midi.receive(bytes(data), 0.0)
                case _:
                    data = [0x90, chance.randrange(38, 82), chance.randrange(128)]
                    player_session.session.midi.receive(bytes(data), 0.0)
            player_session.run(chance.choice((0.003, 0.02, 0.3)))
        player_session.close()
        assert not [one for one in player_session.session.messages() if "rror" in one]
        assert np.array_equal(player_session.again(), player_session.sound)
        if part == 0:
            player_session = Stepped.resumed(player_session.journal)


def test_strike_in_journal_before_reply_of_line(played):
    """A kill after the answer lost it: the journal went on to a frame behind the strike."""
    single, _ = played
    single.ok("map note 60 bell.m 5mNs")
    single.run(0.1)
    single.ok("py session.midi.receive(bytes([0x90, 60, 100]), 0.0)")
    rows = [json.loads(line) for line in single.journal.read_text().splitlines()]
    assert [row["event"] for row in rows][-2:] == ["strike", "said"]
    single.run(0.1)


def test_midi_strikes_in_journal_during_long_line(tmp_path):
    """They waited for the end of the line: a kill meanwhile lost all of them, and its commits."""
    with closing(session_on(tmp_path, f"clock:{tmp_path / 'heard.wav'}")) as session:
        assert session.submit("map note 60 bell.m 5mNs now").taken
        journal = tmp_path / "session.jsonl"
        until(lambda: '"event": "commit"' in journal.read_text(), "the map")
        assert session.submit("gain bell -3dB now").taken  # under way while the next line is long
        session.gate = threading.Event()
        line = threading.Thread(target=session.submit, args=("py session.gate.wait()",))
        line.start()
        session.midi.receive(bytes([0x90, 60, 100]), 0.0)
        until(lambda: '"event": "strike"' in journal.read_text(), "the strike")
        until(lambda: journal.read_text().count('"event": "commit"') == 2, "the commit")
        session.gate.set()
        line.join()
