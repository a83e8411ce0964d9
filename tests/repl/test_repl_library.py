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

EMPTY = "ergon: 1\nrates: {audio: 8kHz}\ntempo: [{at: 1|1, bpm: 240}]\nmix: {channels: 2}\n"
KICK = "d1 strikes kick.hammer every 1 impulse 200mNs"
OWN = """\
ergon: 1
instruments:
  plink:                                   # a small one
    modules: {m: {CEL: {M: 2g, f: 700Hz, t60: 300ms}}}
    out: {SOX: m}
  plonk:
    modules: {m: {CEL: {M: 5g, f: 200Hz, t60: 300ms}}}
    out: {SOX: m}
"""


def text(at: Stepped) -> str:
    return at.session.schedule.head.texts.text


def instruments(at: Stepped) -> set[str]:
    return {*at.session.schedule.head.piece.instruments}


def offered(at: Stepped, line: str) -> list[str]:
    return [one.text for one in at.session.complete(line, len(line))]


@pytest.fixture
def at(tmp_path: Path):
    with closing(Stepped(EMPTY, tmp_path)) as stepped:
        yield stepped


def test_use_family_is_played_by_plain_name(at: Stepped):
    assert at.ok("use skins").text == "ok 1|1 skins: timpani, tabla, tambourine, kick, snare"
    at.ok("play")
    at.run(0.5)
    assert instruments(at) == set()
    at.ok(KICK)
    at.run(2.0)
    assert instruments(at) == {"kick"}
    assert "use:\n  skins: instruments/skins.yaml\n" in text(at)
    assert "kick: {from: skins/kick}" in text(at)
    assert float(np.abs(at.sound).max()) > 0
    at.ok("save typed")
    saved = Texts.read(at.journal.with_name("typed.yaml"))
    assert {*piece_of(saved).instruments} == {"kick"}
    at.close()
    assert np.array_equal(at.again(), at.sound)
    with closing(Stepped.resumed(at.journal)) as again:
        assert text(again) == text(at)
        again.ok("back 2")
        assert "skins" not in text(again)


def test_use_family_in_one_text(at: Stepped):
    at.ok(f"use skins\n{KICK}")
    at.ok("play")
    at.run(1.5)
    assert instruments(at) == {"kick"}
    at.close()
    assert np.array_equal(at.again(), at.sound)


@pytest.mark.parametrize(
    "line",
    [
        "route kick 2 gain -6dB",
        "kick notes C2 every 1",
        "kick2 = kick transpose -3st",
        "map note C2 kick.hammer 10mNs..200mNs",
        "phrase tune 0 kick.hammer 200mNs",
        "kick2 = skins/kick\nlink kick.hammer kick2.hammer REF K=4kN/m",
    ],
)
def test_use_family_in_other_lines(at: Stepped, line: str):
    at.ok("use skins")
    reply = at.type(line)
    if line.startswith("kick notes"):  # its only fault is that the skin has no pitch of its own
        assert "kick" in reply.text
        return
    assert reply.taken, reply.text
    assert instruments(at) & {"kick", "kick2"}
    assert piece_of(at.session.schedule.head.texts)


def test_use_family_twice(at: Stepped):
    at.ok("use skins")
    before = text(at)
    reply = at.type("use skins")
    assert (reply.text, reply.try_) == (
        "skins is in use already",
        "instruments skins",
    )
    assert text(at) == before
    assert at.ok("undo").taken
    assert text(at) == EMPTY
    at.ok("redo")
    assert text(at) == before


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
    with closing(Stepped(EMPTY.replace("tempo", f"{used}tempo"), tmp_path)) as at:
        at.ok("use skins")
        assert wanted in text(at)
        at.ok(KICK)
        at.ok("save")
        assert piece_of(Texts.read(tmp_path / "score.yaml")).used[-1] == "skins"


def test_use_keeps_a_name_that_the_score_has(at: Stepped):
    at.ok("kick = skins/snare")
    reply = at.ok("use skins")
    assert "kick is not replaced, because the score has it already" in reply.text
    at.ok(KICK)
    assert "kick: {from: skins/snare}" in text(at)


def test_use_unknown_family(at: Stepped):
    reply = at.type("use skinz")
    assert not reply.taken
    assert reply.try_ == "use skins"
    assert "drums.yaml" in at.type("use qqqqq").text
    assert at.type("instruments skinz").try_ == "instruments skins"
    assert "qqqqq" in at.type("instruments qqqqq").text


def test_use_file_of_the_score(at: Stepped):
    folder = at.journal.parent
    (folder / "kit").mkdir()
    (folder / "kit" / "mine.yaml").write_text(OWN)
    reply = at.ok("use kit/mine.yaml")
    assert reply.text.endswith("mine: plink, plonk")
    assert at.ok("instruments mine").lines == ("plink  a small one", "plonk")
    assert {"mine/plink", "mine/plonk"} <= set(offered(at, "x = mine/"))
    assert offered(at, "d1 strikes plink.") == ["plink.m"]
    at.ok("d1 strikes plink.m every 1/2 impulse 1mNs")
    at.ok("play")
    at.run(1.0)
    at.ok("save")
    assert (folder / "kit" / "mine.yaml").read_text() == OWN
    at.close()
    (folder / "kit" / "mine.yaml").unlink()  # the journal has its text
    assert np.array_equal(at.again(), at.sound)


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("use mine.yaml", "there is no file mine.yaml"),
        ("use ../mine.yaml", "lies outside the score's folder"),
        ("use 7.yaml", "'7' is not a name"),
        ("use bad.yaml", "bad.yaml:3:"),
        ("use", "missing"),
    ],
)
def test_use_file_refused(at: Stepped, line: str, said: str):
    (at.journal.parent / "bad.yaml").write_text("ergon: 1\ninstruments:\n  x: {modules: 3}\n")
    reply = at.type(line)
    assert not reply.taken
    assert said in reply.text
    assert text(at) == EMPTY


def test_use_at_a_beat_before_what_needs_it(at: Stepped):
    at.ok("play")
    at.ok("use skins at 2|1")
    at.ok(f"{KICK} at 2|2")
    at.run(3.0)
    assert instruments(at) == {"kick"}
    at.close()
    assert np.array_equal(at.again(), at.sound)


def test_reload_keeps_what_use_brought(at: Stepped):
    folder = at.journal.parent
    (folder / "mine.yaml").write_text(OWN)
    at.ok("use mine.yaml")
    at.ok("d1 strikes plink.m every 1 impulse 1mNs")
    (folder / "mine.yaml").write_text(OWN.replace("700Hz", "500Hz"))
    assert at.ok("reload").text == "ok 1|1"
    piece = at.session.schedule.head.piece
    assert piece.instruments["plink"].modules[0].fields["f"] == 500.0
    at.close()
    with closing(Stepped.resumed(at.journal)) as again:
        again.ok("reload")
        assert instruments(again) == {"plink"}
        again.ok("save")


def test_instruments_lists_routes_and_families(at: Stepped):
    first = at.ok("instruments").lines
    assert first[0] == "no instrument yet"
    assert "  skins     5 instruments" in first
    at.ok("use skins")
    at.ok(KICK)
    at.ok("route kick 2 gain -6dB")
    lines = at.ok("instruments").lines
    assert lines[0] == "kick  to 2, -6 dB"
    assert "  skins     5 instruments, in use" in lines
    about = at.ok("instruments skins").lines
    assert about[3].startswith("kick        a bass drum: a heavy beater")
    assert len(about) == 5


def test_every_instrument_that_ships_says_what_it_is():
    assert {"skins", "bells", "plates"} <= families.library().keys()
    for name, members in families.library().items():
        assert all(member.about for member in members), name


def test_gestures_and_voices_and_scenes_are_listed(tmp_path: Path):
    keys = "keys: {k1: {M: 400g, K: 60N/m, Z: 1.2Ns/m}}\nplayers: {ada: {key: k1}}\n"
    score = EMPTY.replace("mix", f"{keys}mix")
    with closing(Stepped(score, tmp_path)) as at:
        assert at.ok("gestures").lines[0].startswith("no gesture yet")
        assert at.ok("scenes").lines[0].startswith("no scene yet")
        at.ok("knock = 0@0 smooth 7@60ms smooth 0@160ms")
        at.ok("lean = 0@0 smooth 7@1 smooth 0@2")
        assert at.ok("gestures").lines == ("knock  160 ms, 3 points", "lean   2 beats, 3 points")
        at.ok("use skins")
        at.ok(KICK)
        at.ok("ada plays knock every 1")
        at.ok("play")
        at.run(3.1)
        assert at.ok("voices").lines == at.ok("show").lines
        assert "d1 (strikes): kick.hammer from 1|1" in at.ok("voices").lines
        at.ok("keep 2bar as verse")
        (tmp_path / "torn.yaml").write_text("ergon: 1\nkeys: 3\n")
        verse, torn = sorted(at.ok("scenes").lines, reverse=True)
        assert verse == "verse  2 bars"
        assert torn.startswith("torn   cannot be played: torn.yaml:")


def test_completion_of_families_and_modules(at: Stepped):
    assert {"skins", "bells"} <= set(offered(at, "use "))
    assert "score.yaml" in offered(at, "use sc")
    assert offered(at, "instruments sk") == ["skins"]
    assert "skins/" in offered(at, "kick = ")
    assert offered(at, "kick = skins/k") == ["skins/kick"]
    assert offered(at, "d1 strikes ki") == []
    at.ok("use skins")
    for line in ("d1 strikes ", "map note C2 ", "link ", "phrase tune 0 "):
        assert offered(at, f"{line}kick.") == ["kick.skin", "kick.hammer"]
    at.ok(KICK)
    assert offered(at, "d1 strikes kick.h") == ["kick.hammer"]
    assert {"kick.f", "kick.skin.", "kick.hammer."} <= set(offered(at, "set kick."))
