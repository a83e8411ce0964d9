"""Phrases at the prompt: defined, played, redefined, undone, saved, kept, resumed, renamed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from edited import opened
from sessions import Stepped

SCORE = """\
ergon: 1
rates: {audio: 8kHz}
tempo: {bpm: 240}
keys: {k: {M: 400g, K: 60N/m, Z: 1.2Ns/m}}
instruments:
  harp: {CEL: {M: 5g, f: C4, t60: 100ms}, notes: C4..C5, out: {SOX: harp}}
  bell: {modules: {m: {CEL: {M: 5g, f: A3, t60: 100ms}}}, out: {SOX: m}}
gestures: {knock: 0mm@0 6mm@60ms 0mm@160ms}
players: {ada: {key: k}}
parts: {ada: []}
mix: {channels: 1, route: [{from: harp, to: 1}, {from: bell, to: 1}]}
"""
TUNE = "phrase tune 0 C4 1mNs, 1/2 E4 G4, 2.5 D4 2mNs..3mNs to harp length 4"


@pytest.fixture
def stepped_session(tmp_path: Path):
    stepped = Stepped(SCORE, tmp_path)
    stepped.ok("play")
    yield stepped
    stepped.close()


def struck(stepped_session: Stepped, since: float) -> list[float]:
    """Seconds at which something is struck, from an instant on."""
    return [
        since + onset / stepped_session.rate
        for onset in onsets(
            stepped_session.sound[int(since * stepped_session.rate) :, 0], stepped_session.rate
        )
    ]


def onsets(sound: np.ndarray, rate: float) -> list[int]:
    quiet = int(0.05 * rate)
    moved = np.flatnonzero(np.abs(sound) > 1e-9)
    result: list[int] = []
    loud = 0.0
    for n in range(0, len(sound) - quiet, 64):
        now = float(np.abs(sound[n : n + 64]).max())
        if now > 4.0 * loud + 1e-12 and (not result or n - result[-1] > quiet):
            result.append(n)
        loud = max(now, 0.9 * loud)
    return result if len(moved) else []


def test_phrase_defined_played_transformed_and_rested(stepped_session):
    stepped_session.ok(TUNE)
    piece = stepped_session.session.schedule.head.piece
    assert piece.phrases == ("tune",)
    assert (
        "entries: [{at: 0, what: C4, impulse: 1mNs}"
        in stepped_session.session.schedule.head.texts.text
    )
    stepped_session.ok("hook strikes tune every 1bar")
    stepped_session.run(4.0)
    listened = len(struck(stepped_session, 0.0))
    assert listened >= 5
    stepped_session.ok("hook strikes tune every 1bar transpose 5st do scale 0.5, from 1/2 now")
    stepped_session.run(1.0)
    (hook,) = [
        one for one in stepped_session.session.schedule.head.piece.strikes if one.name == "hook-2"
    ]
    assert {target.part for hit in hook.hits for target in hit.to} >= {"harp.A4", "harp.G4"}
    stepped_session.ok("undo")
    stepped_session.run(1.0)
    stepped_session.ok("rest hook")
    stepped_session.run(2.5)
    assert np.abs(stepped_session.sound[-int(0.5 * stepped_session.rate) :]).max() < 1e-9
    stepped_session.close()
    assert np.array_equal(stepped_session.again(), stepped_session.sound)


def test_phrase_redefined_saved_renamed_and_resumed(stepped_session):
    stepped_session.ok(TUNE)
    stepped_session.ok("hook strikes tune every 1bar\nada plays knock every 1")
    stepped_session.run(2.2)
    stepped_session.ok("phrase tune 0 C4, 1 D4, 2 E4, 3 F4 to harp length 1bar")
    assert (
        "{to: harp, length: 1bar, impulse: 1mNs, entries:"
        in stepped_session.session.schedule.head.texts.text
    )
    stepped_session.run(3.0)
    stepped_session.ok("keep 1bar as verse\nsave typed\nrename tune air")
    stepped_session.run(1.5)
    head = stepped_session.session.schedule.head
    assert head.piece.phrases == ("air",)
    assert "play: air" in head.texts.text
    _, typed = opened(str(stepped_session.journal.with_name("typed.yaml")))
    assert [len(one.hits) for one in typed.strikes] == [4]
    assert opened(str(stepped_session.journal.with_name("verse.yaml")))
    stepped_session.ok("show air")
    stepped_session.close()
    assert np.array_equal(stepped_session.again(), stepped_session.sound)
    again = Stepped.resumed(stepped_session.journal)
    assert again.session.schedule.head.piece.phrases == ("air",)
    again.ok("play")
    again.run(2.5)
    assert np.abs(again.sound).max() > 0
    again.ok("undo")
    again.run(0.5)
    again.close()
    assert np.array_equal(again.again(), again.sound)


def test_block_with_phrase(stepped_session):
    stepped_session.ok("def fill:\n  phrase two 0 C4, 1/2 D4 to harp\n  hook strikes two\nend")
    stepped_session.ok("fill every 1bar now")
    stepped_session.run(3.5)
    assert np.abs(stepped_session.sound[-int(1.2 * stepped_session.rate) :]).max() > 1e-9
    stepped_session.close()
    assert np.array_equal(stepped_session.again(), stepped_session.sound)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("phrase tune 0 C6 to harp", "has no note 'C6'"),
        ("phrase tune 0 C4", "'C4' is a note; write `to`"),
        ("phrase tune 0 bell.q", "nothing is called 'bell.q'"),
        ("phrase tune 0 C4, , 1 D4 to harp", "an entry is missing"),
        ("phrase tune C4 to harp", "C4"),
        ("phrase tune 0 to harp", "what is struck is missing"),
        ("phrase tune 0 C4 3mm to harp", "'mm'"),
        ("phrase tune 0 C4 to harq", "'harq'"),
        ("phrase knock 0 C4 to harp", "is the name of a gesture"),
        ("hook strikes tone every 1bar", "is not an instrument or a key"),
        ("hook strikes hymn every", "'every' needs a value"),
        ("hook strikes hymn transpose 3", "is not an interval"),
        ("hook strikes hymn do bend 3", "bend"),
        ("hook strikes hymn transpose 30st", "harp"),
        (
            "remove hymn",
            "cannot remove hymn, because it is used by strikes 'old'; change or remove",
        ),
    ],
)
def test_wrong_phrase_lines_change_no_version(stepped_session, line, message):
    stepped_session.ok("phrase hymn 0 C4 to harp")
    stepped_session.ok("old strikes hymn every 1bar")
    text = stepped_session.session.schedule.head.texts.text
    reply = stepped_session.type(line)
    assert not reply.taken
    assert message in reply.text
    assert stepped_session.session.schedule.head.texts.text == text


def test_completion_of_phrase_in_strikes_line(stepped_session):
    stepped_session.ok(TUNE)
    offered = [one.text for one in stepped_session.session.complete("hook strikes t", 14)]
    assert "tune" in offered
