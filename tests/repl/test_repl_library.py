"""The library at the prompt: families that are brought in, and lists of what there is."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from edited import piece_of
from sessions import Stepped

from ergon.scores.edits.texts import Texts
from ergon.scores.reading import families

EMPTY = "ergon: 1\nrates: {audio: 32kHz}\ntempo: [{at: 1|1, bpm: 240}]\nmix: {channels: 2}\n"
KICK = "d1 strikes kick.hammer every 1 impulse 200mNs"
MINE = """\
ergon: 1
instruments:
  plink:                                   # a small one
    modules: {m: {CEL: {M: 2g, f: 700Hz, t60: 300ms}}}
    out: {SOX: m}
  plonk:
    modules: {m: {CEL: {M: 5g, f: 200Hz, t60: 300ms}}}
    out: {SOX: m}
"""


def text(session: Stepped) -> str:
    return session.session.schedule.head.texts.text


def instruments(session: Stepped) -> set[str]:
    return {*session.session.schedule.head.piece.instruments}


def suggested(session: Stepped, line: str) -> list[str]:
    return [suggestion.text for suggestion in session.session.complete(line, len(line))]


@pytest.fixture
def session(tmp_path: Path):
    with closing(Stepped(EMPTY, tmp_path)) as stepped:
        yield stepped


def test_use_family_is_played_by_plain_name(session: Stepped):
    assert (
        session.ok("use skins").text == "ok 1|1 skins: timpani, tabla, tambourine, kick, hat, snare"
    )
    session.ok("play")
    session.run(0.5)
    assert instruments(session) == set()
    session.ok(KICK)
    session.run(0.8)
    assert instruments(session) == {"kick"}
    assert "use:\n  skins: instruments/skins.yaml\n" in text(session)
    assert "kick: {from: skins/kick}" in text(session)
    assert float(np.abs(session.sound).max()) > 0
    session.ok("save typed")
    saved = Texts.read(session.journal.with_name("typed.yaml"))
    assert {*piece_of(saved).instruments} == {"kick"}
    session.close()
    assert np.array_equal(session.again(), session.sound)
    with closing(Stepped.resumed(session.journal)) as again:
        assert text(again) == text(session)
        again.ok("back 2")
        assert "skins" not in text(again)


@pytest.mark.parametrize(
    "line",
    [
        'd1 = "kick ~ snare"',
        "d1 strikes kick snare every 1",
        "link kick.hammer snare.hammer REF K=1N/m",
    ],
)
def test_route_of_all_instruments_in_line(session: Stepped, line: str):
    """All but the last were not heard."""
    session.ok("use skins")
    session.ok(line)
    routes = session.session.schedule.head.piece.routes()
    assert {route.part for route in routes} == {"kick", "snare"}


def test_use_family_in_one_text(session: Stepped):
    session.ok(f"use skins\n{KICK}")
    session.ok("play")
    session.run(0.6)
    assert instruments(session) == {"kick"}
    session.close()
    assert np.array_equal(session.again(), session.sound)


@pytest.mark.parametrize(
    "line",
    [
        "route kick 2 gain -6dB",
        "kick.hammer notes C2 every 1",
        "kick2 = kick transpose -3st",
        "map note C2 kick.hammer 10mNs..200mNs",
        "phrase tune 0 kick.hammer 200mNs",
        "kick2 = skins/kick\nlink kick.hammer kick2.hammer REF K=4kN/m",
    ],
)
def test_use_family_in_other_lines(session: Stepped, line: str):
    session.ok("use skins")
    reply = session.type(line)
    assert reply.taken, reply.text
    assert instruments(session) & {"kick", "kick2"}
    assert piece_of(session.session.schedule.head.texts)


def test_use_family_twice(session: Stepped):
    session.ok("use skins")
    before = text(session)
    reply = session.type("use skins")
    assert (reply.text, reply.try_) == (
        "skins is in use already",
        "instruments skins",
    )
    assert text(session) == before
    assert session.ok("undo").taken
    assert text(session) == EMPTY
    session.ok("redo")
    assert text(session) == before


@pytest.mark.parametrize(
    ("used", "wanted"),
    [
        ("", "use:\n  skins: instruments/skins.yaml\n"),
        (
            "use: {b: instruments/bell.yaml}\n",
            "use: {b: instruments/bell.yaml, skins: instruments/",
        ),
        ("use: instruments/bell.yaml\n", "use: [instruments/bell.yaml, {skins: instruments/"),
        ("use: [instruments/bell.yaml]\n", "use: [instruments/bell.yaml, {skins: instruments/"),
        ("use:\n  - instruments/bell.yaml\n", "  - {skins: instruments/skins.yaml}\n"),
    ],
)
def test_use_family_beside_other_files(tmp_path: Path, used: str, wanted: str):
    with closing(Stepped(EMPTY.replace("tempo", f"{used}tempo"), tmp_path)) as session:
        session.ok("use skins")
        assert wanted in text(session)
        session.ok(KICK)
        session.ok("save")
        assert piece_of(Texts.read(tmp_path / "score.yaml")).used[-1] == "skins"


def test_use_does_not_replace_existing_instrument(session: Stepped):
    session.ok("kick = skins/snare")
    reply = session.ok("use skins")
    assert "kick is not replaced, because the score has it already" in reply.text
    session.ok(KICK)
    assert "kick: {from: skins/snare}" in text(session)


def test_use_unknown_family(session: Stepped):
    reply = session.type("use skinz")
    assert not reply.taken
    assert reply.try_ == "use skins"
    assert "drums.yaml" in session.type("use qqqqq").text
    assert session.type("instruments skinz").try_ == "instruments skins"
    assert "qqqqq" in session.type("instruments qqqqq").text


def test_use_file_of_the_score(session: Stepped):
    folder = session.journal.parent
    (folder / "kit").mkdir()
    (folder / "kit" / "mine.yaml").write_text(MINE)
    reply = session.ok("use kit/mine.yaml")
    assert reply.text.endswith("mine: plink, plonk")
    assert session.ok("instruments mine").lines == ("plink  a small one", "plonk")
    assert {"mine/plink", "mine/plonk"} <= set(suggested(session, "x = mine/"))
    assert suggested(session, "d1 strikes plink.") == ["plink.m"]
    session.ok("d1 strikes plink.m every 1/2 impulse 1mNs")
    session.ok("play")
    session.run(1.0)
    session.ok("save")
    assert (folder / "kit" / "mine.yaml").read_text() == MINE
    session.close()
    (folder / "kit" / "mine.yaml").unlink()  # the journal has its text
    assert np.array_equal(session.again(), session.sound)


@pytest.mark.parametrize(
    ("line", "sentence"),
    [
        ("use mine.yaml", "there is no file mine.yaml"),
        ("use ../mine.yaml", "lies outside the score's folder"),
        ("use 7.yaml", "'7' is not a name"),
        ("use bad.yaml", "bad.yaml:3:"),
        ("use", "missing"),
    ],
)
def test_use_file_refused(session: Stepped, line: str, sentence: str):
    (session.journal.parent / "bad.yaml").write_text("ergon: 1\ninstruments:\n  x: {modules: 3}\n")
    reply = session.type(line)
    assert not reply.taken
    assert sentence in reply.text
    assert text(session) == EMPTY


def test_use_at_a_beat_before_dependent_line(session: Stepped):
    session.ok("play")
    session.ok("use skins at 2|1")
    session.ok(f"{KICK} at 2|2")
    session.run(1.6)
    assert instruments(session) == {"kick"}
    session.close()
    assert np.array_equal(session.again(), session.sound)


def test_reload_after_use_of_file(session: Stepped):
    folder = session.journal.parent
    (folder / "mine.yaml").write_text(MINE)
    session.ok("use mine.yaml")
    session.ok("d1 strikes plink.m every 1 impulse 1mNs")
    (folder / "mine.yaml").write_text(MINE.replace("700Hz", "500Hz"))
    assert session.ok("reload").text == "ok 1|1"
    piece = session.session.schedule.head.piece
    assert piece.instruments["plink"].modules[0].fields["f"] == 500.0
    session.close()
    with closing(Stepped.resumed(session.journal)) as again:
        again.ok("reload")
        assert instruments(again) == {"plink"}
        again.ok("save")


def test_instruments_lists_routes_and_families(session: Stepped):
    first = session.ok("instruments").lines
    assert first[0] == "no instrument yet"
    assert "  skins     6 instruments" in first
    session.ok("use skins")
    session.ok(KICK)
    session.ok("route kick 2 gain -6dB")
    lines = session.ok("instruments").lines
    assert lines[0] == "kick  to 2, -6 dB"
    assert "  skins     6 instruments, in use" in lines
    about = session.ok("instruments skins").lines
    assert about[3].startswith("kick        a bass drum: a heavy beater")
    assert len(about) == 6


def test_library_instruments_have_descriptions():
    assert {"skins", "bells", "plates"} <= families.library().keys()
    for name, members in families.library().items():
        assert all(member.comment for member in members), name


def test_gestures_and_voices_and_scenes_are_listed(tmp_path: Path):
    keys = "keys: {k1: {M: 400g, K: 60N/m, Z: 1.2Ns/m}}\nplayers: {ada: {key: k1}}\n"
    score = EMPTY.replace("mix", f"{keys}mix")
    with closing(Stepped(score, tmp_path)) as session:
        assert session.ok("gestures").lines[0].startswith("no gesture yet")
        assert session.ok("scenes").lines[0].startswith("no scene yet")
        session.ok("knock = 0@0 smooth 7@60ms smooth 0@160ms")
        session.ok("lean = 0@0 smooth 7@1 smooth 0@2")
        assert session.ok("gestures").lines == (
            "knock  160 ms, 3 points",
            "lean   2 beats, 3 points",
        )
        session.ok("use skins")
        session.ok(KICK)
        session.ok("ada plays knock every 1")
        session.ok("play")
        session.run(2.1)
        assert session.ok("voices").lines == session.ok("show").lines
        assert "d1 (strikes): kick.hammer from 1|1" in session.ok("voices").lines
        session.ok("keep 2bar as verse")
        (tmp_path / "torn.yaml").write_text("ergon: 1\nkeys: 3\n")
        verse, torn = sorted(session.ok("scenes").lines, reverse=True)
        assert verse == "verse  2 bars"
        assert torn.startswith("torn   cannot be played: torn.yaml:")


def test_completion_of_families_and_modules(session: Stepped):
    assert {"skins", "bells"} <= set(suggested(session, "use "))
    assert "score.yaml" in suggested(session, "use sc")
    assert suggested(session, "instruments sk") == ["skins"]
    assert "skins/" in suggested(session, "kick = ")
    assert suggested(session, "kick = skins/k") == ["skins/kick"]
    assert suggested(session, "d1 strikes ki") == []
    session.ok("use skins")
    for line in ("d1 strikes ", "map note C2 ", "link ", "phrase tune 0 "):
        offers = suggested(session, f"{line}kick.")
        assert [offer for offer in offers if offer != "kick.strike"] == [
            "kick.skin",
            "kick.hammer",
            "kick.rim",
            "kick.shell",
            "kick.lug1",
            "kick.lug2",
        ]
    assert "kick.strike" in suggested(session, "d1 strikes kick.")
    session.ok(KICK)
    assert suggested(session, "d1 strikes kick.h") == ["kick.hammer"]
    assert {"kick.f", "kick.skin.", "kick.hammer."} <= set(suggested(session, "set kick."))


def test_rhythm_words_with_levels_add_instruments(session: Stepped):
    session.ok("use skins")
    session.ok('d1 = "~ snare:mf ~ [snare:f snare:p]"')
    session.ok('d2 = "timpani:p(11,16), <tabla:v64 kick:ff>"')
    assert {"snare", "timpani", "tabla", "kick"} <= instruments(session)


def test_rename_reaches_words_with_levels(session: Stepped):
    session.ok("use skins")
    session.ok('d1 = "kick:f ~ kick snare:p"')
    session.ok("rename kick boom")
    assert "boom:f ~ boom snare:p" in text(session)
    session.ok("play")
    session.run(0.4)
    session.close()
    assert np.array_equal(session.again(), session.sound)
    assert np.abs(session.sound).max() > 0.0


def test_instrument_name_without_verb_suggests_lines(session: Stepped):
    session.ok("use skins")
    answer = session.type("kick").text
    assert """write kick = "kick*4", or kick f""" in answer
    answer = session.type("kick f at 3|1").text
    assert "one stroke acts at once: leave out 'at'" in answer
    session.ok('kick = "kick*4"')
    session.ok("hear kick f")
