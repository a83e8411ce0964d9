"""`hear`: one stroke from the prompt, at once, before and while the piece plays."""

import json
import subprocess
from contextlib import closing

import damped_bar
import numpy as np
import pytest
import soundfile
from captured import check_heard
from commands import ERGON
from patience import until
from sessions import Stepped

from ergon.live.midi_ports import ProcessPort
from ergon.repl.session.journal_content import read_journal
from tests.repl.test_repl_live import session_on

SCORE = """\
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
  bell: {modules: {m: {CEL: {M: 2g, f: A3, t60: 50ms}}}, out: {SOX: m}}
mix: {channels: 2, route: [{from: bar, to: 1}, {from: drum, to: 2}, {from: bell, to: 1}]}
"""
DAMPED = damped_bar.SCORE + "mix: {route: [{from: bar, to: 1}]}\n"


@pytest.fixture
def session(tmp_path):
    with closing(Stepped(SCORE, tmp_path)) as session:
        yield session


def _strikes(session):
    rows = [json.loads(line) for line in session.journal.read_text().splitlines()]
    strikes = [row for row in rows if row["event"] == "strike"]
    return [(row["part"], row["module"], row["impulse"]) for row in strikes]


def _peak(session, seconds, channel):
    session.run(seconds)
    return np.abs(session.sound[-int(seconds * session.rate) :, channel]).max()


@pytest.mark.parametrize(
    ("line", "struck"),
    [
        ("hear drum", [("drum", "skin", 16 ** (4 / 7))]),
        ("hear drum.click fff", [("drum", "rim", 1.0), ("drum", "skin", 1.0)]),
        ("hear drum.skin 3mNs", [("drum", "skin", 3.0)]),
        ("hear bell.m 2mNs", [("bell", "m", 2.0)]),
        ("hear bar ppp", [("bar.F#4", "", 1.0)]),
        ("hear bar C4 bb4 v127", [("bar.C4", "", 4.0), ("bar.A#4", "", 4.0)]),
        ("drum mf", [("drum", "skin", 16 ** (4 / 7))]),
        ("drum.click fff", [("drum", "rim", 1.0), ("drum", "skin", 1.0)]),
        ("bell.m 2mNs", [("bell", "m", 2.0)]),
        ("bar c4", [("bar.C4", "", 4 ** (4 / 7))]),
        ("bar C4 bb4 v127", [("bar.C4", "", 4.0), ("bar.A#4", "", 4.0)]),
    ],
)
def test_hear_before_and_during_play(session, line, struck):
    expected = [(part, module, pytest.approx(1e-3 * mns)) for part, module, mns in struck]
    channel = 1 if struck[0][0] == "drum" else 0
    session.ok(line)
    assert _peak(session, 0.2, channel) > 1e-8
    assert _strikes(session) == expected
    session.ok("play")
    session.run(0.3)
    session.ok(line)
    assert _peak(session, 0.1, channel) > 1e-8  # the next bar is two seconds away
    assert _strikes(session) == [*expected, *expected]
    assert len(session.ok("history").lines) == 1
    assert session.ok("maps").lines == ()
    session.close()
    assert np.array_equal(session.again(), session.sound)


def test_stroke_line_with_other_words(session):
    for line, words in {
        "drum": "drum f for one stroke",
        "drum every 1": "write d1 strikes drum every 1",
        "bar": "or bar C4 f",
        "drum p f": "a stroke has one level",
        "drum 4": "a strength is a number from 0 to 1",
        "drum C4 f": "drum has no notes",
        "bell.m f": "the impulse is missing",
    }.items():
        reply = session.type(line)
        assert not reply.taken
        assert words in reply.text, reply.text
    assert _strikes(session) == []


def test_hear_stroke_across_change_of_version(tmp_path):
    text = SCORE.replace("f: A4, t60: 50ms", "f: A4, t60: 1s").replace(
        "{impulse: 1mNs..4mNs}", "{impulse: 1mNs..4mNs, lasts: 40ms}"
    )
    sounds = []
    for number, edit in enumerate(("", "set drum.rim.M x1.5 now")):
        folder = tmp_path / str(number)
        folder.mkdir()
        with closing(Stepped(text, folder)) as session:
            session.ok("play")
            session.run(0.1)
            session.ok("hear bar C4 f")
            session.run(0.01)
            if edit:
                session.ok(edit)
            session.run(0.2)
            session.close()
            assert np.array_equal(session.again(), session.sound)
            sounds.append(session.sound[:, 0])
    plain, edited = sounds
    assert np.abs(plain).max() > 1e-8
    assert np.array_equal(plain, edited)


def test_hear_lifts_damper(tmp_path):
    with closing(Stepped(DAMPED, tmp_path)) as session:
        session.ok("hear bar C4 f")
        rings = _peak(session, 0.8, 0)
        assert _peak(session, 0.1, 0) > 0.3 * rings
        session.run(0.6)
        assert _peak(session, 0.1, 0) < 1e-3 * rings
        session.close()
        assert np.array_equal(session.again(), session.sound)


def test_hear_instrument_of_used_family(tmp_path):
    with closing(Stepped(SCORE.replace("8kHz", "44.1kHz"), tmp_path)) as session:
        refused = session.type("hear skins/kick")
        assert not refused.taken
        assert "type `use skins`, then `hear kick`" in refused.text
        assert "use skins" in session.type("hear kick").text
        session.ok("use skins")
        session.ok("hear skins/kick p")
        session.run(0.3)
        assert [(part, module) for part, module, _ in _strikes(session)] == [("kick", "hammer")]
        assert np.abs(session.sound).max() > 0.1
        assert session.ok("history").lines[-1].endswith("hear skins/kick p")
        assert "kick" in session.session.schedule.head.piece.instruments
        session.ok("undo")
        assert "kick" not in session.session.schedule.head.piece.instruments
        session.run(0.2)
        session.close()
        assert np.array_equal(session.again(), session.sound)


def test_hear_after_undo_and_resume(session):
    session.ok("set bell.m.M 3g")
    session.ok("hear drum")
    session.run(0.2)
    session.ok("undo")  # to a version that was before it
    session.run(0.2)
    session.ok("hear drum")
    session.ok("hear bell.m 1mNs")
    session.run(0.2)
    session.close()
    assert len(_strikes(session)) == 3
    assert np.array_equal(session.again(), session.sound)
    with closing(Stepped.resumed(session.journal)) as further:
        further.ok("hear drum f")
        further.ok("hear bar")
        further.run(0.2)
        further.close()
        assert len(_strikes(further)) == 2
        assert np.array_equal(further.again(), further.sound)


def test_hear_together_with_other_lines(tmp_path):
    with closing(Stepped(SCORE.replace("8kHz", "44.1kHz"), tmp_path)) as session:
        session.ok("play")
        session.run(0.3)
        session.ok("set bell.m.M 3g now\nhear drum\nhear bar")
        session.ok("use skins")  # on 2|1
        assert session.ok("hear kick").text.startswith("ok 2|1 kick: ")
        session.ok('d1 = "drum*4"')
        session.ok("hear drum.click")
        session.run(0.3)
        assert [part for part, *_ in _strikes(session)] == ["drum", "bar.F#4", "drum", "drum"]
        session.run(4.0)
        assert _strikes(session)[4][0] == "kick"
        session.ok("hear drum now")
        session.close()
        assert np.array_equal(session.again(), session.sound)


def test_hear_many_places_in_succession(session):
    for note in ("C4", "C#4", "D4", "D#4", "E4", "F4", "F#4", "G4", "G#4", "A4", "A#4", "B4"):
        session.ok(f"hear bar {note}")
        session.ok(f"hear bar {note} C5")
        session.run(0.0513)  # no whole number of ticks: lines and strikes have frames of their own
    assert len(_strikes(session)) == 12 * 3
    session.close()
    assert np.array_equal(session.again(), session.sound)


def test_hear_in_panic_is_refused(session):
    session.session.panic()
    assert "type `release`" in session.type("hear drum").text
    session.ok("release")
    session.ok("hear drum")
    session.run(0.1)
    assert len(_strikes(session)) == 1


@pytest.mark.parametrize(
    ("line", "why"),
    [
        ("hear bar C9", "bar has no note C9; its notes are C4 to C5"),
        ("hear drum C4", "drum has no notes"),
        ("hear drum.skin C4 2mNs", "drum.skin is a module, and has no notes"),
        ("hear drum p..f", "'p..f' is a range"),
        ("hear drum f f", "one level"),
        ("hear drum.rim f", "'rim' is not a way to play drum, which are strike, click"),
        ("hear bell", "'bell' does not say how it is played; write hear bell 2mNs"),
        ("hear drum.x 2mNs", "nothing is called 'drum.x'"),
        ("hear nobody", "'nobody' is not an instrument"),
        ("hear skins/nothing", "is not an instrument of skins"),
        ("hear nowhere/kick", "'nowhere' is not a family"),
        ("hear drum f at 9|1", "leave out 'at'"),
        ("hear", "is missing"),
    ],
)
def test_hear_of_unknown_place_is_refused(session, line, why):
    reply = session.type(line)
    assert not reply.taken
    assert why in reply.text


def test_words_of_hear_are_completed(session):
    def offers(line):
        return {offer.text for offer in session.session.complete(line, len(line))}

    assert {"drum", "bar", "bell"} <= offers("hear ")
    assert {"drum.click", "drum.rim"} <= offers("hear drum.")
    assert {"mf", "fff"} <= offers("hear drum ")


def test_phrasing_live_equals_journal(tmp_path):
    """Over the real engine, where a version and a stroke are on their way at once."""
    sound_file = tmp_path / "sound_file.wav"
    port = ProcessPort()
    with closing(session_on(tmp_path, f"clock:{sound_file}")) as session:
        port.listen(session.midi.receive)
        for line in ("hear bell.m 1mNs", "play", "map bend bell.m.K 300N/m..900N/m now"):
            assert session.submit(line).taken
        engine = session.schedule.engine
        for step in range(8):
            frame = engine.frame + 3000
            assert session.submit(f"hear bell.m {1 + step}mNs").taken
            port.send(bytes([0xE0, 0, 16 * step]))
            assert session.submit(f"set bell.m.M {2 + step / 8:g}g now").taken
            until(lambda after=frame: engine.frame > after, "the engine goes on")
        journal = tmp_path / "session.jsonl"
        until(lambda: journal.read_text().count('"event": "strike"') == 9, "all are struck")
        frame = engine.frame
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
    assert sum(row["event"] == "strike" for row in rows) == 9
    played, _ = soundfile.read(sound_file, dtype="float32", always_2d=True)
    again, _ = soundfile.read(tmp_path / "again.wav", dtype="float32", always_2d=True)
    assert check_heard(played, again, troubles).equal > 22_050


def test_journal_with_numbered_hear_notes(session):
    session.ok("hear bar C4 Bb4")
    session.run(0.2)
    session.close()
    first, *rest = session.journal.read_text().splitlines()
    fields = json.loads(first) | {"maps": [["hear", "bar", 60, 70], ["hear", "bar", "3to2"]]}
    session.journal.write_text("\n".join([json.dumps(fields), *rest]) + "\n")
    assert [*read_journal(session.journal).session_start.maps] == [
        "hear bar C4 A#4",
        "hear bar 3to2",
    ]
    assert np.array_equal(session.again(), session.sound)


@pytest.mark.parametrize(
    "lines",
    [("hear kick", "play"), ("hear kick", "play", 'd1 = "kick*4"'), ("hear kick", "hear kick p")],
)
def test_hear_stroke_at_frame_of_takeover(tmp_path, lines):
    """A timeline that goes on takes over at the very frame of the stroke."""
    text = "ergon: 1\nuse: [instruments/skins.yaml]\n"
    text += "mix: {channels: 1, route: [{from: kick, to: 1}]}\n"
    with closing(Stepped(text, tmp_path)) as session:
        for line in lines:
            session.ok(line)
        session.run(0.3)
        assert np.abs(session.sound).max() > 0.01
        session.close()
        assert np.array_equal(session.again(), session.sound)
